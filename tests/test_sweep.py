# SPDX-License-Identifier: MIT
"""Sweeps: designs as pure functions; the same table whoever does the runs and however often it is killed."""

from __future__ import annotations

import csv
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from killing import killed_at
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.core.errors import InputError
from tongue_fenicsx.forms import jit
from tongue_fenicsx.studies import cases, designs, sweep_file
from tongue_fenicsx.studies.plan import KILLED, OUTCOME, Plan
from tongue_fenicsx.studies.pool import Standing, Workers

BASE = """
[mesh]
file = "block.msh"
[time]
end = 0.02
step = 5e-3
step_min = 5e-3
[output]
every = 0.01
[boundary]
fixed = ["left"]
[gravity]
posture = "upright"
rise = 0.0
[probes]
end = [0.02, 0.005, 0.005]
"""
VARY = ["--vary", "tissue.nu=0.3,0.45", "--vary", "gravity.acceleration=[0.0, 0.0, -1.0],[0.0, 0.0, -1e6]", "--set", "gravity={rise=0.0}"]
"""Two of the four runs cannot be solved: they fall too fast."""
N_RUNS = 4


def test_factorial() -> None:
    """Every combination, the last key fastest; designs multiply; a key is varied once."""
    design = designs.factorial({"a": [1, 2], "b": ["x", "y", "z"]})
    assert len(design) == 6
    assert design[:2] == [{"a": 1, "b": "x"}, {"a": 1, "b": "y"}]
    assert designs.product(design, [{"c": 5}])[5] == {"a": 2, "b": "z", "c": 5}
    with pytest.raises(InputError, match=r"b: is varied in two ways"):
        designs.product(design, [{"b": 5}])


@pytest.mark.parametrize("method", designs.SAMPLERS)
def test_samples(method: str) -> None:
    """Each of 16 slices of each key holds one point; a seed gives the same points each time, another one others."""
    between = {"tissue.c10": (100.0, 1000.0), "tissue.nu": (0.3, 0.49)}
    design = designs.sampled(between, 16, 3, method)
    for key, (low, high) in between.items():
        share = (np.array([change[key] for change in design]) - low) / (high - low)
        assert sorted((16 * share).astype(int)) == list(range(16))
    assert designs.sampled(between, 16, 3, method) == design
    assert designs.sampled(between, 16, 4, method) != design


def test_a_longer_sobol_sequence_begins_with_the_shorter() -> None:
    """Also where the number is no power of 2."""
    assert designs.sampled({"a": (0.0, 1.0)}, 11, 0, "sobol")[:5] == designs.sampled({"a": (0.0, 1.0)}, 5, 0, "sobol")


def test_random_activations() -> None:
    """Levels, knots and rests are distributed as said; more runs or other muscles change nothing of a course; sides go apart if asked."""
    design = designs.random_activations(["GGP", "SL"], 400, 7, 0.35, level=(0.2, 0.8), spacing=(0.05, 0.15), rest=0.25)
    pieces = np.array([piece for change in design for piece in change["activation.GGP"]])
    durations, targets = pieces[:, 0], pieces[:, 2]
    assert 0.05 <= durations.min() < 0.052
    assert 0.148 < durations.max() <= 0.15
    assert np.mean(targets == 0) == pytest.approx(0.25, abs=0.04)
    assert 0.2 <= targets[targets > 0].min() < 0.21
    assert np.mean(targets[targets > 0]) == pytest.approx(0.5, abs=0.02)
    for change in design:
        course = change["activation.SL"]
        assert course[0][1] == 0
        assert all(before[2] == after[1] for before, after in pairwise(course))
        assert sum(piece[0] for piece in course[:-1]) < 0.35 <= sum(piece[0] for piece in course)
    fewer = designs.random_activations(["SL"], 3, 7, 0.35, level=(0.2, 0.8), spacing=(0.05, 0.15), rest=0.25)
    assert fewer == [{"activation.SL": change["activation.SL"]} for change in design[:3]]
    apart = designs.random_activations(["GGP", "SL", "HG_L"], 1, 7, 0.35, sides="apart")[0]
    assert list(apart) == ["activation.GGP_L", "activation.GGP_R", "activation.SL", "activation.HG_L"]
    assert apart["activation.GGP_L"] != apart["activation.GGP_R"]
    held = designs.random_activations(["GGP"], 400, 7, 0.35, rest=0.25, hold=0.4)
    pieces = np.array([piece for change in held for piece in change["activation.GGP"][1:]])
    still = pieces[:, 1] == pieces[:, 2]
    assert np.mean(still[pieces[:, 1] > 0]) == pytest.approx(0.4, abs=0.05)
    coarse = designs.random_activations(["GGP"], 50, 7, 0.35, grid=0.02)
    durations = np.array([piece[0] for change in coarse for piece in change["activation.GGP"]])
    assert set(np.round(durations / 0.02, 6)) <= {2, 3, 4, 5, 6, 7, 8}


def test_table(tmp_path: Path) -> None:
    """A line is a run; cells are values of TOML or words; an empty one leaves the key alone."""
    path = tmp_path / "runs.csv"
    path.write_text('tissue.preset,tissue.c10,gravity.acceleration\nkappert,192,"[0, 0, -1.0]"\n,400,\n')
    assert designs.from_table(path) == [
        {"tissue.preset": "kappert", "tissue.c10": 192, "gravity.acceleration": [0, 0, -1.0]},
        {"tissue.c10": 400},
    ]
    path.write_text("a,b\n1\n")
    with pytest.raises(InputError, match=r"line 2 has 1 cells, the first one 2"):
        designs.from_table(path)


def test_a_number_for_a_muscle(tmp_path: Path) -> None:
    """It is the highest level of the base's course, from pieces or a table; without one, 100 ms of rise and hold. What only other runs move
    is at rest."""
    (tmp_path / "sl.csv").write_text("0,0\n0.1,0.4\n0.2,0.2\n")
    base = {
        "mesh": {"file": "tongue.msh"},
        "time": {"end": 0.2},
        "activation": {"GGP": {"pieces": [[0.1, 0.0, 0.5], [0.1, 0.5, 0.25]]}, "SL": {"table": "sl.csv"}},
    }
    design: list[designs.Change] = [
        {"activation.GGP": 1.0, "activation.SL": 0.8},
        {"activation.HG": 0.3},
        {"activation.MH_L": [[0.1, 0.0, 0.1]]},
    ]
    first, second, third = (
        {name: list(section.course().pieces) for name, section in case.activation.items()}
        for case, _ in cases.scenarios(base, tmp_path, design)
    )
    assert list(first) == list(second) == list(third) == ["GGP", "HG", "MH_L", "SL"]
    assert first["GGP"] == [(0.1, 0.0, 1.0), (0.1, 1.0, 0.5)]
    assert np.allclose(first["SL"], [(0.1, 0.0, 0.8), (0.1, 0.8, 0.4)])
    assert second["HG"] == [(0.1, 0.0, 0.3)]
    assert second["GGP"] == [(0.1, 0.0, 0.5), (0.1, 0.5, 0.25)]
    assert first["MH_L"] == second["MH_L"] == [(1.0, 0.0, 0.0)]
    assert base["activation"]["GGP"]["pieces"][0][2] == 0.5  # type: ignore[index]
    both: list[designs.Change] = [{"activation.HG": 0.3}, {"activation.HG_L": 0.3}, {}]
    assert [sorted(case.activation) for case, _ in cases.scenarios(base, tmp_path, both)] == [
        ["GGP", "HG", "SL"],
        ["GGP", "HG_L", "HG_R", "SL"],
        ["GGP", "HG_L", "HG_R", "SL"],
    ]


SWEEP = """
[base]
mesh = { file = "block.msh" }
time = { end = 0.02 }
boundary = { fixed = ["left"] }
"""
BAD: list[tuple[str, list[str], str]] = [
    ("base = 3\n[vary]\ntissue.nu = [0.3]", [], "base: 3; the file of a scenario, or its tables, are expected"),
    (SWEEP, [], "nothing is varied; one or more of vary, table"),
    (SWEEP + "[vry]\ntissue.nu = [0.3]", [], "unknown key 'vry'; did you mean 'vary'?"),
    (SWEEP + "[vary]\ntissue.nu = 0.3", [], "vary.tissue.nu: 0.3; a list of values, or first:last:number"),
    (SWEEP + "[vary]\ntissue.nu = '0.3:0.4:1'", [], "'0.3:0.4:1'; a list of values, or first:last:number"),
    (SWEEP + "[vary]\ntissue.nu = [0.3, 0.6]", [], "run 1 (tissue.nu = 0.6): tissue.nu: 0.6; a number above -1 and up to 0.5"),
    (SWEEP + "[vary]\ntisue.nu = [0.3]", [], "run 0 (tisue.nu = 0.3): unknown key 'tisue'; did you mean 'tissue'?"),
    (SWEEP + "[vary]\nactivation.GGP = [0.3, 1.5]", [], "activation.GGP.pieces.0.2: 1.5; a number from 0 to 1"),
    (SWEEP + "[vary]\nactivation.GGP = [0.3]", [], "runs/00000 (activation.GGP = 0.3): activation.GGP: no muscle 'GGP' in the mesh"),
    (
        SWEEP + "[vary]\nboundary.fixed = [['left'], ['lft']]",
        [],
        "runs/00001 (boundary.fixed = ['lft']): boundary.fixed: the mesh has no surface 'lft'",
    ),
    (SWEEP + "[sample]\nn = 4\nbetween = { tissue.nu = [0.4, 0.3] }", [], "sample: tissue.nu: [0.4, 0.3]; the smaller bound comes first"),
    (SWEEP + "[sample]\nn = 0\nbetween = { tissue.nu = [0.3, 0.4] }", [], "sample.n: 0; a whole number from 1"),
    (SWEEP + "[random_activations]\nn = 2\nmuscles = ['GGP']\nsides = 'both'", [], "sides: 'both'; one of together, apart is expected"),
    (SWEEP + "[vary]\ntissue.nu = [0.3]\n[sample]\nn = 2\nbetween = { tissue.nu = [0.3, 0.4] }", [], "tissue.nu: is varied in two ways"),
    (SWEEP + "[vary]\ntissue.nu = [0.3]", ["--shard", "3/2"], "--shard 3/2: one of the shares 1/2 to 2/2 is expected"),
    (SWEEP + "[vary]\ntissue.nu = [0.3]", ["--shard", "x"], "--shard x: the number of a share and how many"),
    (SWEEP + "[vary]\ntissue.nu = [0.3]", ["--jobs", "0"], "--jobs 0: a positive number is expected"),
    (SWEEP + "[vary]\ntissue.nu = [0.3]", ["--ranks-per-run", "2"], "--ranks-per-run 2: a divisor of the number of ranks, 1, is expected"),
    (BASE, ["--vary", "tissue.nu"], "--vary tissue.nu: key=value,value,… or key=first:last:number is expected"),
]


@pytest.mark.parametrize(("text", "options", "message"), BAD)
@pytest.mark.usefixtures("block")
def test_bad_input(
    workspace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, options: list[str], message: str
) -> None:
    """Exit code 2 and one sentence, before any run."""
    path = workspace / "bad_sweep.toml"
    path.write_text(text)
    code, said = command(capsys, "sweep", path, "-o", tmp_path / "out", *options)
    assert (code, message in said) == (2, True), said
    assert not list(tmp_path.glob("out/runs"))


def test_dry_run(workspace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The design as a table, and nothing else."""
    path = workspace / "dry.toml"
    path.write_text(SWEEP + "[vary]\ntissue.nu = '0.3:0.45:4'")
    assert command(capsys, "sweep", path, "--dry-run") == (0, "run,tissue.nu\n0,0.3\n1,0.35\n2,0.4\n3,0.45\n")


@pytest.fixture(scope="module", autouse=True)
def _as_other_processes() -> Iterator[None]:
    """Forms are compiled as in the processes that runs are compared with."""
    here = jit.FLAGS[0]
    jit.FLAGS[0] = "-O3"
    yield
    jit.FLAGS[0] = here


@pytest.fixture(scope="module")
def base(workspace: Path, block: tf.TongueMesh) -> Path:
    path = workspace / "falling.toml"
    path.write_text(BASE)
    return path


@pytest.fixture(scope="module")
def whole(base: Path, workspace: Path) -> Path:
    """The folder of the sweep, done in this process."""
    folder = workspace / "whole"
    tables, where, design = sweep_file.from_options(base, VARY[1:4:2], VARY[5:])
    tf.sweep(tables | {"mesh": {"file": str(where / "block.msh")}}, design, folder)
    return folder


def rows(folder: Path) -> list[dict[str, str]]:
    """The table of a sweep."""
    with open(folder / "table.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_and_the_fields(whole: Path) -> None:
    """A line for each run, also for those that failed, with the reason; run folders are whole; fields are those of the runs."""
    table = rows(whole)
    assert [row["index"] for row in table] == [str(i) for i in range(N_RUNS)]
    assert [row["status"] for row in table] == ["done", "failed", "done", "failed"]
    assert "the solve failed at t = 0.000000 s even with the smallest step" in table[1]["reason"]
    assert [row["tissue.nu"] for row in table] == ["0.3", "0.3", "0.45", "0.45"]
    run = tf.Run(whole / table[2]["folder"])
    assert float(table[2]["end_z_m"]) == run.probes["end"][-1, 2] < -1e-5
    assert int(table[2]["n_steps"]) == 4
    with h5py.File(whole / "fields.h5") as file:
        displacement = file["displacement"]
        assert displacement.shape == (N_RUNS, 3, len(run.mesh[0]), 3)
        assert displacement.chunks == (1, *displacement.shape[1:])
        assert np.array_equal(displacement[2, -1], run.field("displacement").astype(np.float32))
        assert np.isnan(displacement[1]).all()
        assert np.array_equal(file["time"][2], run.output_times)
        assert np.array_equal(file["mesh/points"], run.mesh[0])
        assert file["activation"].shape == (N_RUNS, 3, 0)
        assert np.array_equal(file["parameters/tissue.nu"], [0.3, 0.3, 0.45, 0.45])
    assert "runs/00001 failed" in (whole / "logs" / "worker-0.log").read_text()


def test_a_run_is_the_same_alone(whole: Path, workspace: Path) -> None:
    """What a run shares with those before it leaves no trace in it: its saved scenario gives the same bits."""
    from tongue_fenicsx.scenario.build import activation_of, simulation_of
    from tongue_fenicsx.scenario.files import load

    folder = whole / "runs" / "00002"
    scenario = load(folder / "scenario.toml")
    alone = simulation_of(scenario, workspace).run(activation_of(scenario), scenario.time.end)
    run = tf.Run(folder)
    assert np.array_equal(alone.probes["end"], run.probes["end"])
    assert np.array_equal(alone.field("displacement"), run.field("displacement"))


def test_again(whole: Path, base: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same call does nothing again; what is missing is done, and table and fields are as before; another sweep is refused."""
    table, fields = (whole / "table.csv").read_bytes(), (whole / "fields.h5").read_bytes()
    stamp = (whole / "runs" / "00000" / "history.h5").stat().st_mtime_ns
    (whole / "runs" / "00002" / OUTCOME).unlink()
    (whole / "table.csv").write_text("cut")
    code, said = command(capsys, "sweep", base, "-o", whole, *VARY)
    assert (code, "3 of 4 runs are already there" in said) == (0, True), said
    assert "4 runs: 2 done, 2 failed" in said
    assert (whole / "table.csv").read_bytes() == table
    assert (whole / "fields.h5").read_bytes() == fields
    assert (whole / "runs" / "00000" / "history.h5").stat().st_mtime_ns == stamp
    code, said = command(capsys, "sweep", base, "-o", whole, "--vary", "tissue.nu=0.31,0.45", *VARY[2:])
    assert (code, "runs/00000: holds the run of another scenario; give another folder, or --overwrite" in said) == (2, True), said
    assert (whole / "table.csv").read_bytes() == table


def test_shards(base: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each does its share; when the last has, table and fields are those of one process."""
    for share, status in (("2/2", [("1", "failed"), ("3", "failed")]), ("1/2", None)):
        code, said = command(capsys, "sweep", base, "-o", tmp_path, "--shard", share, *VARY)
        assert code == 0, said
        if status is not None:
            assert [(row["index"], row["status"]) for row in rows(tmp_path)] == status
            assert not (tmp_path / "fields.h5").exists()
    assert (tmp_path / "table.csv").read_bytes() == (whole / "table.csv").read_bytes()
    assert (tmp_path / "fields.h5").is_file()


def once_at_work(deal: Callable[[], object]) -> Callable[[Standing], None]:
    """Do something as soon as a run has begun."""
    done: list[bool] = []

    def report(now: Standing) -> None:
        if now.shares and not done:
            done.append(True)
            deal()

    return report


def workers_of(base: Path, output: Path, **options: Any) -> list[dict[str, str]]:
    """The sweep with these workers."""
    tables, where, design = sweep_file.from_options(base, VARY[1:4:2], VARY[5:])
    tf.sweep(tables | {"mesh": {"file": str(where / "block.msh")}}, design, output, **options)
    return rows(output)


def test_workers_are_killed(base: Path, whole: Path, tmp_path: Path) -> None:
    """Their runs are lines that say so, other workers do the rest; at the next start they are done, and the table is as if nothing had
    happened."""

    def kill() -> None:
        for child in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
            os.kill(int(child), signal.SIGKILL)

    table = workers_of(base, tmp_path, jobs=2, report=once_at_work(kill))
    assert len(table) == N_RUNS
    killed = [row["reason"] for row in table if row["status"] == KILLED]
    assert 1 <= len(killed) <= 2
    assert set(killed) == {"killed by signal 9"}
    workers_of(base, tmp_path)
    assert (tmp_path / "table.csv").read_bytes() == (whole / "table.csv").read_bytes()


def test_interrupted(base: Path, tmp_path: Path) -> None:
    """Ctrl-C ends the workers; nothing is marked that could not go on."""
    with pytest.raises(KeyboardInterrupt):
        workers_of(base, tmp_path, jobs=2, report=once_at_work(lambda: os.kill(os.getpid(), signal.SIGINT)))
    plan = Plan.read(tmp_path)
    assert all(outcome.status != KILLED for _, outcome in plan.over())
    assert len(rows(tmp_path)) == len(list(plan.over()))


def under_mpiexec(base: Path, output: Path, *options: str) -> list[dict[str, str]]:
    """The sweep on two ranks."""
    mpiexec = Path(sys.executable).with_name("mpiexec")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PMI", "MPI"))}
    tongue = [sys.executable, "-m", "tongue_fenicsx", "sweep", str(base), "-o", str(output), *VARY, *options]
    done = subprocess.run(
        [str(mpiexec), "-n", "2", *tongue], capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return rows(output)


def test_under_mpiexec(base: Path, whole: Path, tmp_path: Path) -> None:
    """Two ranks, one run each at a time: the same table."""
    under_mpiexec(base, tmp_path)
    assert (tmp_path / "table.csv").read_bytes() == (whole / "table.csv").read_bytes()
    logs = [(tmp_path / "logs" / f"worker-{rank}.log").read_text() for rank in (0, 1)]
    assert all("begins" in log for log in logs)


def test_ranks_that_share_a_run(base: Path, whole: Path, tmp_path: Path) -> None:
    """Two ranks for each run: the same but for the last digits, from one worker."""
    for ours, theirs in zip(under_mpiexec(base, tmp_path, "--ranks-per-run", "2"), rows(whole), strict=True):
        assert ours["status"] == theirs["status"]
        if ours["status"] == "done":
            assert float(ours["end_z_m"]) == pytest.approx(float(theirs["end_z_m"]), rel=1e-6)
    assert tf.Run(tmp_path / "runs" / "00000").summary["ranks"] == 2
    assert [path.name for path in (tmp_path / "logs").glob("*.log")] == ["worker-0.log"]


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_killed_at_any_write(base: Path, whole: Path, tmp_path: Path) -> None:
    """A sweep killed at twelve of its touches of files, spread over it: the same call ends with the same table and the same fields."""
    total = next(n for n in count(50, 50) if not killed_at(tmp_path / "counted", n, partial(workers_of, base, tmp_path / "counted")))
    struck = 0
    for n in range(0, total, total // 12):
        folder = tmp_path / f"killed-{n}"
        struck += killed_at(folder, n, partial(workers_of, base, folder))
        workers_of(base, folder)
        for name in ("table.csv", "fields.h5"):
            assert (folder / name).read_bytes() == (whole / name).read_bytes(), n
        shutil.rmtree(folder)
    assert struck > 9


def test_workers_that_cannot_be() -> None:
    """Processes and shares are two ways to the same end."""
    with pytest.raises(InputError, match=r"--jobs 2: not with mpiexec or --shard"):
        Workers(jobs=2, shard=(1, 2))


def test_the_seed_goes_with_each_run(tmp_path: Path) -> None:
    """The seed of a design stands in the scenario of each of its runs, whose record has it."""
    (tmp_path / "sweep.toml").write_text('[base.time]\nend = 0.1\n[random_activations]\nn = 2\nseed = 7\nmuscles = ["GGP"]\n')
    assert sweep_file.load(tmp_path / "sweep.toml")[0]["seed"] == 7
