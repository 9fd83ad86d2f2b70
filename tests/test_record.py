# SPDX-License-Identifier: MIT
"""A run folder as a record: readable at every instant, owned by one process, complete, and made again from any folder."""

from __future__ import annotations

import errno
import itertools
import json
import os
import random
import re
import resource
import shutil
import signal
import tomllib
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import pyvista as pv
from filelock import FileLock
from killing import in_child, killed_at

import tongue_fenicsx as tf
from tongue_fenicsx.geometry.obstacles import Plane, Triangulated
from tongue_fenicsx.geometry.surface import read_surface
from tongue_fenicsx.mechanics.activation import FunctionOfTime
from tongue_fenicsx.mechanics.contact import Contact
from tongue_fenicsx.mechanics.control import OpenLoop
from tongue_fenicsx.runs import history as histories
from tongue_fenicsx.runs.store import Folder
from tongue_fenicsx.scenario.build import activation_of, simulation_of
from tongue_fenicsx.scenario.files import load
from tongue_fenicsx.simulation.as_scenario import as_scenario
from tongue_fenicsx.simulation.totals import Totals
from tongue_fenicsx.testing import with_fibres

pytestmark = pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
GGP = {"GGP": tf.ramp(0.01, 0.1)}
PROBE = {"end": (0.02, 0.005, 0.005)}


def bar(block: tf.TongueMesh) -> tf.Simulation:
    """A bar that contracts against a plane."""
    wall = Contact(Plane((0.0, 0.0, -1e-4), (0.0, 0.0, 1.0)))
    model = tf.Model(
        with_fibres(block),
        replace(tf.Tissue.calka(), peak_stress={"GGP": 1e3}),
        fixed=["left"],
        contacts={"floor": wall},
        gravity=(0.0, 0.0, -9.81),
        gravity_rise=0.0,
    )
    return tf.Simulation(model, PROBE, tf.Stepping(5e-3, output_every=5e-3))


@pytest.fixture(scope="module")
def simulation(block: tf.TongueMesh) -> tf.Simulation:
    return bar(block)


def datasets(folder: Path) -> dict[str, Any]:
    """All numbers of a run folder by file and path."""
    found: dict[str, Any] = {}
    for name in ("fields.h5", "history.h5", "checkpoint.h5"):
        with h5py.File(folder / name) as file:
            file.visititems(lambda path, item, name=name: found.update({f"{name}:{path}": item[()]} if hasattr(item, "shape") else {}))
    return found


def same(one: Path, other: Path) -> None:
    ours, theirs = datasets(one), datasets(other)
    assert ours.keys() == theirs.keys()
    for name, values in ours.items():
        np.testing.assert_array_equal(values, theirs[name], err_msg=name)


def check_readable(folder: Path) -> None:
    """Whatever is there can be read, and its index names only what is there."""
    for name in ("fields.h5", "history.h5", "checkpoint.h5"):
        if (folder / name).exists():
            with h5py.File(folder / name) as file:
                file.visititems(lambda path, item: item[()] if hasattr(item, "shape") else None)
    if (folder / "history.h5").exists():
        run = tf.Run(folder)
        assert np.isfinite(run.probes["end"]).all()
        assert len(run.output_times) >= 1
        assert np.isfinite(run.field("displacement")).all()
        reader = pv.get_reader(folder / "fields.xdmf")
        assert reader.number_time_points in (len(run.output_times), len(run.output_times) - 1)


def test_killed_at_any_write(simulation: tf.Simulation, tmp_path: Path) -> None:
    """Killed at 36 of its touches of files, spread over the run and drawn at random: what is there can be read, and the run that goes on or
    begins anew leaves what the whole one leaves, to the last bit of every dataset."""
    whole = simulation.run(GGP, 0.02, tmp_path / "whole")
    folder = tmp_path / "counted"
    total = next(
        n for n in itertools.count(100, 100) if not killed_at(folder, n, lambda: simulation.run(GGP, 0.02, folder, overwrite=True))
    )
    draw = random.Random(1)
    tried = sorted({*range(0, total, total // 24), *(draw.randrange(total) for _ in range(12))})
    struck = 0
    for n in tried:
        folder = tmp_path / f"killed-{n}"
        if killed_at(folder, n, partial(simulation.run, GGP, 0.02, folder)):
            struck += 1
            check_readable(folder)
        resume = (folder / "checkpoint.h5").exists()
        simulation.run(GGP, 0.02, folder, resume=resume, overwrite=not resume)
        same(folder, whole.folder)
        shutil.rmtree(folder)
    assert struck > 18


def test_killed_while_going_on(simulation: tf.Simulation, tmp_path: Path) -> None:
    """A run that goes on to a later end may be killed as well."""
    whole = simulation.run(GGP, 0.03, tmp_path / "whole")
    simulation.run(GGP, 0.015, tmp_path / "begun")
    for n in range(0, 90, 15):
        folder = tmp_path / f"killed-{n}"
        shutil.copytree(tmp_path / "begun", folder)
        assert killed_at(folder, n, partial(simulation.run, GGP, 0.03, folder, resume=True))
        check_readable(folder)
        simulation.run(GGP, 0.03, folder, resume=True)
        same(folder, whole.folder)


def test_a_run_repeats_to_the_last_bit(block: tf.TongueMesh, tmp_path: Path) -> None:
    """Also with GMRES, and wherever vectors lie in memory."""
    first = bar(block).run(GGP, 0.015, tmp_path / "first")
    kept = [np.zeros(n) for n in (13, 1001, 7777)]
    again = bar(block).run(GGP, 0.015, tmp_path / "again")
    assert kept
    same(first.folder, again.folder)


def test_a_finished_run_stays(simulation: tf.Simulation, tmp_path: Path) -> None:
    """It is replaced only when asked; what the new run does not write does not stay; a run that is refused changes nothing."""
    simulation.run(GGP, 0.01, tmp_path)
    (tmp_path / "airway.csv").write_text("of an earlier scenario")
    before = datasets(tmp_path), (tmp_path / "summary.json").read_bytes()
    with pytest.raises(tf.InputError, match=r"holds a run already, done at t = 0.01 s; overwrite \(--overwrite\)"):
        simulation.run(GGP, 0.005, tmp_path)
    with pytest.raises(tf.InputError, match="no muscle 'XX'"):
        simulation.run({"XX": tf.ramp(0.1, 0.1)}, 0.005, tmp_path, overwrite=True)
    np.testing.assert_equal((datasets(tmp_path), (tmp_path / "summary.json").read_bytes()), before)
    reader = h5py.File(tmp_path / "fields.h5")  # as a viewer holds it
    short = simulation.run(GGP, 0.005, tmp_path, overwrite=True)
    assert len(reader["displacement"]) == 3
    reader.close()
    assert short.output_times.tolist() == [0.0, 0.005]
    assert not (tmp_path / "airway.csv").exists()


def test_one_process_at_a_time(simulation: tf.Simulation, tmp_path: Path) -> None:
    with FileLock(tmp_path / ".lock"), pytest.raises(tf.InputError, match="another process writes a run there"):
        simulation.run(GGP, 0.005, tmp_path)


@pytest.mark.parametrize("name", ["scenario.toml", "mesh.msh"])
def test_a_user_s_own_files_stay(simulation: tf.Simulation, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(tf.InputError, match=f"{name}: was not left by a run"):
        simulation.run(GGP, 0.005, tmp_path, overwrite=True)
    assert (tmp_path / name).read_text() == "mine"


def test_disk_full(simulation: tf.Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the start: nothing is lost and the room that is missing is said. Later: what is stored stays and the run can go on."""
    whole = simulation.run(GGP, 0.02, tmp_path / "whole")
    simulation.run(GGP, 0.01, tmp_path / "full")
    before = datasets(tmp_path / "full")

    def limited() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
        with pytest.raises(tf.InputError, match=r"fields.h5: 5 outputs of .* MB cannot be written .*; give a folder with more room"):
            simulation.run(GGP, 0.02, tmp_path / "full", overwrite=True)

    assert in_child(limited) == 0
    np.testing.assert_equal(datasets(tmp_path / "full"), before)
    plain, calls = Folder.write_at, itertools.count()

    def write_at(self: Folder, name: str, at: int, data: bytes) -> None:
        if next(calls) > 100:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path / name))
        plain(self, name, at, data)

    with monkeypatch.context() as patch:
        patch.setattr(Folder, "write_at", write_at)
        with pytest.raises(tf.SolveError, match=r"\.h5: cannot be written \(No space left on device\); what was stored before can be read"):
            simulation.run(GGP, 0.02, tmp_path / "full", overwrite=True)
    check_readable(tmp_path / "full")
    simulation.run(GGP, 0.02, tmp_path / "full", resume=True)
    same(tmp_path / "full", whole.folder)


def test_folder_that_goes_away(simulation: tf.Simulation, tmp_path: Path) -> None:
    with pytest.raises(tf.SolveError, match=r"cannot be written \(No such file or directory\)"):
        simulation.run(GGP, 0.02, tmp_path / "run", after_step=lambda now: shutil.rmtree(tmp_path / "run", ignore_errors=True))


def test_long_histories(simulation: tf.Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A history grows beyond its first room, in a folder and in memory alike, and is made anew only where it doubles."""
    monkeypatch.setattr(histories, "ROOM", 8)
    sizes: set[int] = set()
    fine = tf.Simulation(simulation.model, PROBE, tf.Stepping(5e-4, output_every=1e-3))
    t_end = 5e-4 * 40
    run = fine.run({}, t_end, tmp_path / "run", after_step=lambda now: sizes.add((tmp_path / "run" / "history.h5").stat().st_size))
    memory = fine.run({}, t_end)
    assert len(run.time) == len(memory.time) == 41
    for name, energy in memory.energy.items():
        np.testing.assert_array_equal(run.energy[name], energy)
    np.testing.assert_array_equal(run.field("velocity"), memory.field("velocity"))
    assert len(sizes) == 4, "room for 8, 16, 32 and 64 times"


@dataclass(frozen=True)
class Feedback:
    """A control that no scenario can say."""

    muscles: tuple[str, ...] = ("GGP",)

    @property
    def kinks(self) -> list[float]:
        return []

    def levels(self, t: float, state: object) -> dict[str, float]:
        return {"GGP": 0.1}


def test_a_run_from_python_is_told_as_a_scenario(tongue: tf.TongueMesh, tmp_path: Path) -> None:
    """From another folder it makes the same bits; a function of time is sampled and said, and so is what cannot be told."""
    pv.Sphere(radius=0.02, center=(0.03, 0.0, 0.06)).save(tmp_path / "ball.stl")
    ball = read_surface(tmp_path / "ball.stl")
    model = tf.Model(
        tongue,
        replace(tf.Tissue.buchaillard(), density=1010.0),
        contraction=tf.Contraction(stiffening=True),
        contacts={"ball": Contact(Triangulated(ball), tolerance=1e-4)},
        moving={"mandible": tf.RigidMotion(angle=[(0.01, 0.0, -1.0)])},
        fixed=["hyoid"],
    )
    simulation = tf.Simulation(model, {"tip": "tip", "here": tongue.landmarks["root"]}, tf.Stepping(5e-3, output_every=5e-3))
    made = simulation.run({"GGP": tf.ramp(0.01, 0.02), "SL": tf.ramp(0.01, 0.02, 0.2)}, 0.01, tmp_path / "made")
    shutil.move(made.folder, tmp_path / "moved")
    scenario = load(tmp_path / "moved" / "scenario.toml")
    simulation_of(scenario, tmp_path).run(activation_of(scenario), scenario.time.end, tmp_path / "again")
    same(tmp_path / "moved", tmp_path / "again")
    sampled = OpenLoop({"SL": FunctionOfTime(lambda t: 10 * t)})
    told = as_scenario(model, simulation.stepping, simulation.tolerances, {}, sampled, 0.003)
    assert "# activation.SL: a function of time, sampled every 1 ms." in told.scenario
    np.testing.assert_allclose(
        tomllib.loads(told.scenario)["activation"]["SL"]["pieces"], [[1e-3, 0, 0.01], [1e-3, 0.01, 0.02], [1e-3, 0.02, 0.03]], atol=1e-12
    )
    run = simulation.run(Feedback(), 0.005, tmp_path / "fed")
    assert "# Not told: the control Feedback" in (run.folder / "scenario.toml").read_text()
    record = run.summary["record"]
    assert {"command", "date", "host", "cpu", "python", "mpi", "seed"} <= set(record)
    assert run.summary["cpu_seconds"] > 0


def test_a_scenario_is_kept_whole(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Mesh, surfaces and tables go with it: moved away from what it was made of, it gives the same bits."""
    source = tmp_path / "source"
    source.mkdir()
    for suffix in (".msh", ".h5", ".json"):
        shutil.copy(tongue_file.with_suffix(suffix), source)
    pv.Sphere(radius=0.02, center=(0.03, 0.0, 0.06)).save(source / "ball.stl")
    (source / "rise.csv").write_text("time,level\n0,0\n0.01,0.3\n")
    (source / "run.toml").write_text(
        '[mesh]\nfile = "tongue.msh"\n[time]\nend = 0.01\n[output]\nevery = 0.005\n'
        '[activation.GGP]\ntable = "rise.csv"\n[contact.ball]\nsurface = "ball.stl"\n'
    )
    from tongue_fenicsx.cli.app import main

    def call(*arguments: str) -> int:
        with pytest.raises(SystemExit) as ended:
            main(["run", "--no-figures", *arguments])
        return int(ended.value.code or 0)

    assert call(str(source / "run.toml"), "-o", str(tmp_path / "run")) == 0
    shutil.rmtree(source)
    shutil.move(tmp_path / "run", tmp_path / "moved")
    assert call(str(tmp_path / "moved" / "scenario.toml"), "-o", str(tmp_path / "again")) == 0
    same(tmp_path / "moved", tmp_path / "again")
    assert json.loads((tmp_path / "again" / "summary.json").read_text())["status"] == "done"
    capsys.readouterr()
    assert call(str(tmp_path / "moved" / "scenario.toml"), "-o", str(tmp_path / "again")) == 2
    assert "holds a run already" in capsys.readouterr().err


def test_the_page_names_everything(simulation: tf.Simulation, tmp_path: Path) -> None:
    """docs/output.md names every file, group and key that a run leaves."""
    page = (Path(__file__).parents[1] / "docs" / "output.md").read_text(encoding="utf-8")
    run = simulation.run(GGP, 0.005, tmp_path)
    named = {part.split("/")[0].split(",")[0] for part in re.findall(r"`([^`\n]+)`", page)}
    assert {path.name for path in tmp_path.iterdir()} - {"figures", ".lock"} <= named
    assert {path.split(":")[1].split("/")[0] for path in datasets(tmp_path) if not path.startswith("checkpoint")} <= named
    assert run.summary.keys() - Totals().__dict__.keys() <= named
