# SPDX-License-Identifier: MIT
"""The command line in a process of its own: signals at any time, and terminals that break."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import write_block

from tongue_fenicsx import Run

SCENARIO = """
[mesh]
file = "bar.msh"
[boundary]
fixed = ["left"]
[gravity]
acceleration = [0.0, 0.0, -9.81]
[time]
end = 10.0
step_max = 0.001
[output]
every = 1.0
[probes]
end = [0.01, 0.005, 0.005]
"""
SHORT = ["--set", "time.end=0.002"]


@pytest.fixture
def command(tmp_path: Path) -> list[str]:
    """To run a bar for long."""
    write_block(tmp_path / "bar.msh", (0.02, 0.01, 0.01), (2, 1, 1))
    (tmp_path / "s.toml").write_text(SCENARIO)
    return [sys.executable, "-m", "tongue_fenicsx", "run", str(tmp_path / "s.toml"), "-o", str(tmp_path / "[/red]")]


def signalled(command: list[str], ready: Callable[[int], bool], *numbers: int) -> tuple[int, str, str]:
    """Send signals to a command once its process is ready for them; its exit code and what it printed."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while not ready(process.pid):
            assert process.poll() is None
            time.sleep(0.01)
        for number in numbers:
            process.send_signal(number)
            time.sleep(0.01)
        out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def catches(process: int) -> bool:
    """Whether a process has a handler for SIGTERM, by Linux."""
    caught = Path(f"/proc/{process}/status").read_text().partition("SigCgt:")[2].split()[0]
    return bool(int(caught, 16) >> (signal.SIGTERM - 1) & 1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_while_libraries_are_imported(command: list[str], number: int, delay: float) -> None:
    """Quiet, with the exit code of the signal."""

    def ready(process: int) -> bool:
        if caught := catches(process):
            time.sleep(delay)
        return caught

    code, out, err = signalled(command, ready, number)
    assert (code, out) == (128 + number, "")
    assert err in ("", "interrupted\n")


def test_while_it_runs(command: list[str], tmp_path: Path) -> None:
    """SIGTERM ends the run with a checkpoint; so does a second signal at once, with that of the last output; it goes on, also
    where nobody reads what it prints."""
    folder = tmp_path / "[/red]"

    def steps(process: int) -> bool:
        return (folder / "log.txt").is_file() and "t = 0.00" in (folder / "log.txt").read_text()

    code, _, err = signalled(command, steps, signal.SIGTERM)
    assert code == 143
    assert err.startswith("interrupted at t = ")
    assert err.endswith(f"everything so far is in {folder}, go on with --resume\n")
    (folder / "log.txt").unlink()
    code, _, err = signalled([*command, "--overwrite"], steps, signal.SIGTERM, signal.SIGINT)
    assert code in (130, 143)  # where the first had ended the run
    assert "Traceback" not in err
    on = shlex.join([*command, "--set", "time.end=0.05", "--resume"])  # farther than it can have come
    assert subprocess.run(["bash", "-c", f"set -o pipefail; {on} | head -c 1"], timeout=120).returncode == 0
    assert Run(folder).time[-1] == pytest.approx(0.05)
    assert (folder / "figures" / "midsagittal.png").is_file()


LAST = """
import os, signal, sys
from tongue_fenicsx.cli import process
process.prepare()
class Last:
    def __del__(self, kill=os.kill, me=os.getpid()):
        kill(me, {number})
last = Last()
sys.exit(5)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_while_python_ends(number: int) -> None:
    """The command is over, and keeps its exit code."""
    assert subprocess.run([sys.executable, "-c", LAST.format(number=int(number))], timeout=60).returncode == 5


def test_while_it_draws(command: list[str], tmp_path: Path) -> None:
    """The run is whole, and the pictures are not."""
    code, _, err = signalled([*command, *SHORT], lambda process: (tmp_path / "[/red]" / "summary.json").is_file(), signal.SIGINT)
    assert (code, err) == (130, "interrupted\n")
    assert Run(tmp_path / "[/red]").summary["status"] == "done"


@pytest.mark.parametrize(
    ("shell", "said"), [("{}", "/tongue_fenicsx"), ("{} | head -c 1", "w"), ("{} > /dev/full 2>&1", ""), ("{} >&- 2>&- <&-", "")]
)
def test_terminals(tmp_path: Path, shell: str, said: str) -> None:
    """A command goes on where nobody reads, the device is full, or nothing is open; what an encoding lacks is replaced."""
    text = f"set -o pipefail; {shell.format(shlex.join([sys.executable, '-m', 'tongue_fenicsx', 'cache']))}"
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "LC_ALL": "POSIX", "XDG_CACHE_HOME": str(tmp_path / "ø")}
    result = subprocess.run(["bash", "-c", text], capture_output=True, text=True, env=environment, timeout=60)
    assert (result.returncode, result.stderr) == (0, "")
    assert said in result.stdout
