# SPDX-License-Identifier: MIT
"""Several ranks: whatever fails on any of them ends all, with the reason, in seconds."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

HEAD = """
import sys
import tongue_fenicsx as tf
from tongue_fenicsx.core.parallel import on_rank_zero
from mpi4py import MPI
comm = MPI.COMM_WORLD
class Odd(Exception):
    def __init__(self, a, b):
        super().__init__(f"{a} and {b}")
def fail(error):
    raise error
"""


def run_on_two(code: str, tmp_path: Path, head: str = HEAD + "...") -> subprocess.CompletedProcess[str]:
    """Run a script under mpiexec."""
    script = tmp_path / "script.py"
    script.write_text(head.replace("...", code, 1))
    mpiexec = Path(sys.executable).with_name("mpiexec")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PMI", "MPI"))}
    command = [str(mpiexec), "-n", "2", sys.executable, str(script)]
    return subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=30, env=environment)


def test_every_exception_reaches_every_rank(tmp_path: Path) -> None:
    """What `on_rank_zero` raises on rank 0 it raises on the others, too; where it cannot travel, by its words."""
    faults = {
        "tf.InputError('a: b is expected.')": "InputError a: b is expected.",
        "OSError(28, 'No space left on device')": "OSError [Errno 28] No space left on device",
        "KeyboardInterrupt()": "KeyboardInterrupt ",
        "Odd(1, 2)": "RuntimeError Odd: 1 and 2",  # cannot be pickled
    }
    code = f"""
for raised in [{", ".join(faults)}]:
    try:
        on_rank_zero(comm, lambda: fail(raised))
    except BaseException as error:
        if comm.rank == 1:
            print(type(error).__name__, error)
    assert comm.allreduce(1) == 2
"""
    result = run_on_two(code, tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines() == list(faults.values())


def test_a_value_that_cannot_travel(tmp_path: Path) -> None:
    """It is an error on all ranks."""
    result = run_on_two("on_rank_zero(comm, lambda: lambda: 0)", tmp_path)
    assert result.returncode == 1
    assert "pickle" in result.stderr


@pytest.mark.parametrize(("rank", "waiting"), [(0, "comm.barrier()"), (1, "comm.allreduce(1)"), (0, "pass"), (1, "pass")])
def test_a_script_that_fails_on_one_rank_ends(rank: int, waiting: str, tmp_path: Path) -> None:
    """The others wait in a collective call, or have come to their end."""
    result = run_on_two(f"if comm.rank == {rank}:\n    fail(ValueError('the reason'))\n{waiting}\n", tmp_path)
    assert result.returncode == 1
    assert "ValueError: the reason" in result.stderr


def test_a_script_that_fails_on_all_ranks_says_it_once(tmp_path: Path) -> None:
    """One traceback, and nothing is aborted."""
    start = time.monotonic()
    result = run_on_two("on_rank_zero(comm, lambda: fail(tf.InputError('the reason')))", tmp_path)
    assert result.returncode == 1
    assert result.stderr.count("InputError: the reason") == 1
    assert "Abort" not in result.stderr + result.stdout
    assert time.monotonic() - start < 30


@pytest.mark.parametrize(
    ("raised", "exit_code", "said"),
    [
        ("tf.InputError('the reason.')", 2, "error: the reason."),
        ("tf.SolveError('no step.')", 3, "error: no step."),
        ("ValueError('x')", 1, "x"),
    ],
)
@pytest.mark.parametrize("rank", [0, 1])
def test_a_command_that_fails_on_one_rank_ends(rank: int, raised: str, exit_code: int, said: str, tmp_path: Path) -> None:
    """Every rank leaves with the code of the fault, although one waits."""
    code = f"""
from tongue_fenicsx.cli import app
@app.app.command()
def stumble():
    if comm.rank == {rank}:
        raise {raised}
    comm.barrier()
app.main(["stumble"])
"""
    result = run_on_two(code, tmp_path)
    assert result.returncode == exit_code, result.stderr
    assert said in result.stderr


def test_a_rank_that_ends_before_mpi_begins(tmp_path: Path) -> None:
    """Input that only one rank refuses, and a signal while it imports: the other does not wait."""
    early = """
import os, sys
if os.environ["PMI_RANK"] == "1":
    ...
from mpi4py import MPI
MPI.COMM_WORLD.barrier()
MPI.COMM_WORLD.barrier()
"""
    result = run_on_two("from tongue_fenicsx.cli.app import main; main(['check', 'no.toml'])", tmp_path, early)
    assert (result.returncode, result.stderr.count("no.toml: the file does not exist")) == (2, 1), result.stderr
    result = run_on_two("from tongue_fenicsx.core.interruption import leave_at_once; leave_at_once(15, None)", tmp_path, early)
    assert result.returncode != 0
