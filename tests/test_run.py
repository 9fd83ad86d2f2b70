# SPDX-License-Identifier: MIT
"""Whole runs: motion, files, restart, ranks."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import pyvista as pv
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.core.parallel import on_rank_zero
from tongue_fenicsx.geometry.obstacles import Sphere
from tongue_fenicsx.geometry.tetrahedron import boundary
from tongue_fenicsx.mechanics.contact import Contact
from tongue_fenicsx.simulation.strain import hencky_von_mises, weighted_percentile
from tongue_fenicsx.testing import with_fibres

from mpi4py import MPI  # isort: skip

GGP = {"GGP": tf.Activation([(0.02, 0.0, 0.2), (0.05, 0.2, 0.2)])}
TIGHT = tf.Tolerances.of("tight", rtol=1e-10, atol=1e-13, linear=1e-8)


def simulate(
    tongue: tf.TongueMesh, folder: Path, t_end: float = 0.03, tolerances: tf.Tolerances | None = None, resume: bool = False
) -> tf.Run:
    stepping = tf.Stepping(step_max=5e-3, output_every=0.01)
    simulation = tf.Simulation(tf.Model(tongue), stepping=stepping, tolerances=tolerances)
    return simulation.run(GGP, t_end, folder, resume=resume)


@pytest.fixture(scope="module")
def run(tongue: tf.TongueMesh, workspace: Path) -> tf.Run:
    return simulate(tongue, workspace / "run")


def test_the_root_moves_forward(run: tf.Run) -> None:
    """GGP pulls the root forward, symmetrically, with little change of volume, and the energies balance."""
    assert run.probes["root"][-1, 0] < -5e-4
    for name in ("tip", "dorsum", "root"):
        assert abs(run.probes[name][:, 1]).max() < 1e-8
    s = run.summary
    assert s["volume_change_max"] < 0.02
    assert s["min_jacobian"] > 0.5
    assert s["n_rejected"] == 0
    assert s["energy_balance_error"] < 0.01
    np.testing.assert_allclose(run.probes["edge_left"], run.probes["edge_right"] * (1, -1, 1), atol=1e-8)


def test_summary_and_history(run: tf.Run) -> None:
    """The keys that other tools rely on are there and agree with the history."""
    keys = """n_nodes n_cells n_dofs ranks t_end n_steps n_rejected newton_iterations krylov_iterations wall_seconds setup_seconds
        volume_change_max min_jacobian hencky_von_mises_max peak_speed_m_s energy_balance_error probes contact_force_max_N model versions"""
    assert set(keys.split()) <= set(run.summary)
    assert run.summary["t_end"] == pytest.approx(0.03)
    assert {"law", "c10", "c20", "nu", "force_velocity", "sigma_max"} <= set(run.summary["model"])
    assert run.time[0] == 0
    assert len(run.time) == run.summary["n_steps"] + 1
    assert any(abs(run.time - 0.02) < 1e-12), "steps end on the kink of the activation"
    for name, u in run.summary["probes"].items():
        np.testing.assert_allclose(run.probes[name][-1], u)
    with h5py.File(run.folder / "history.h5", "r") as file:
        assert file["probes"].shape == (5, len(run.time), 3)
        assert {"kinetic", "elastic", "muscle_work", "dissipated"} <= set(file["energy"])
    assert np.isfinite(run.field("hencky_von_mises")).all()


def test_fields_open_as_quadratic_tetrahedra(run: tf.Run) -> None:
    """VTK reads fields.xdmf as Tetrahedron_10, with edge nodes midway and the displacement of the probes."""
    reader = pv.get_reader(run.folder / "fields.xdmf")
    assert reader.number_time_points == 4
    reader.set_active_time_point(3)
    block = reader.read()
    grid = block[0] if isinstance(block, pv.MultiBlock) else block
    assert set(grid.celltypes) == {pv.CellType.QUADRATIC_TETRA}
    assert grid.n_cells == run.summary["n_cells"]
    cells = grid.cells.reshape(-1, 11)[:, 1:]
    points = np.asarray(grid.points)
    for middle, (i, j) in enumerate([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)], start=4):
        np.testing.assert_allclose(points[cells[:, middle]], (points[cells[:, i]] + points[cells[:, j]]) / 2, atol=1e-9)
    edges = points[cells[:, 1:4]] - points[cells[:, :1]]
    assert np.linalg.det(edges).min() > 0
    at_root = np.argmin(np.linalg.norm(points - _landmark(run, "root"), axis=1))
    np.testing.assert_allclose(grid["displacement"][at_root], run.probes["root"][-1], atol=1e-7)
    assert grid.cell_data["jacobian"].min() > 0


def _landmark(run: tf.Run, name: str) -> np.ndarray:
    return np.array(json.loads((run.folder.parent / "tongue.json").read_text())["landmarks"][name])


def test_samples_and_columns(run: tf.Run) -> None:
    """In nodes a sample is their value, amid a cell what its shape functions say, of a field of cells theirs; outside is said. Columns
    are the history."""
    (nodes, cells), u = run.mesh, run.field("displacement")
    inner = np.setdiff1d(cells.ravel(), boundary(cells)[0])[::50]
    np.testing.assert_allclose(run.sample(nodes[inner]), u[inner], atol=1e-7)
    some = cells[::20]
    amid = nodes[some[:, :4]].mean(axis=1)
    shapes = np.r_[np.full(4, -1 / 8), np.full(6, 1 / 4)]  # at the barycentre
    np.testing.assert_allclose(run.sample(amid), np.einsum("s,csd->cd", shapes, u[some]), atol=1e-9)
    np.testing.assert_allclose(run.sample(amid, "jacobian"), run.field("jacobian")[::20])
    with pytest.raises(tf.InputError, match=r"sample: the point \(1000.0, 0.0, 0.0\) mm lies outside"):
        run.sample(np.array([[1.0, 0.0, 0.0]]))
    columns = run.to_dict()
    assert {len(column) for column in columns.values()} == {len(run.time)}
    np.testing.assert_array_equal(columns["root_x"], run.probes["root"][:, 0])
    assert {"time", "volume_ratio", "activation_GGP_L", "support_mandible_z", "energy_elastic"} <= columns.keys()
    assert re.fullmatch(r"Run\('.*'\): done, \d+ steps to [\d.]+ s; probes dorsum, .*", repr(run))


def test_paraview(run: tf.Run, capsys: pytest.CaptureFixture[str]) -> None:
    """Read back: the times, the tongue where it is, its fields at the nodes, and muscles with their fibres."""
    code, said = command(capsys, "paraview", run.folder)
    assert code == 0, said
    folder = run.folder.with_name(f"{run.folder.name}-paraview")
    assert (folder / "open_in_paraview.py").read_text().count("tongue.pvd") == 1
    compile((folder / "open_in_paraview.py").read_text(), "script", "exec")
    reader = pv.get_reader(folder / "tongue.pvd")
    np.testing.assert_allclose(reader.time_values, run.output_times)
    reader.set_active_time_value(run.output_times[-1])
    (grid,) = reader.read()
    u = 1e3 * run.field("displacement")
    np.testing.assert_allclose(grid.points, 1e3 * run.mesh[0] + u, atol=1e-9)
    np.testing.assert_allclose(grid["displacement"], u, atol=1e-9)
    assert {"hencky_von_mises", "jacobian", "velocity", "GGP_weight", "GGP_fibres"} <= set(grid.point_data)
    assert 0.9 < grid["GGP_weight"].max() < 1 + 1e-9
    np.testing.assert_allclose(np.linalg.norm(grid["GGP_fibres"], axis=1).max(), grid["GGP_weight"].max(), rtol=0.01)


def test_pictures(run: tf.Run) -> None:
    """Every run leaves pictures."""
    for path in run.plot():
        assert path.stat().st_size > 10_000


@pytest.mark.parallel
def test_resume_is_exact(tongue: tf.TongueMesh, scratch: Path) -> None:
    """A run stopped at 20 ms and resumed gives what the uninterrupted one gives: on one rank to the last bit, on more
    to round-off (messages arrive in any order)."""
    whole = simulate(tongue, scratch / "whole", 0.03)
    simulate(tongue, scratch / "parts", 0.02)
    parts = simulate(tongue, scratch / "parts", 0.03, resume=True)
    np.testing.assert_array_equal(parts.time, whole.time)
    round_off = 0.0 if tongue.comm.size == 1 else 1e-12
    for name, path in whole.probes.items():
        np.testing.assert_allclose(parts.probes[name], path, rtol=0, atol=round_off)
    np.testing.assert_allclose(parts.field("velocity"), whole.field("velocity"), rtol=0, atol=round_off)
    assert parts.summary["energy_balance_error"] == pytest.approx(whole.summary["energy_balance_error"])
    assert parts.output_times.tolist() == whole.output_times.tolist()


def test_resume_refuses_another_problem(tongue: tf.TongueMesh, scratch: Path) -> None:
    """A checkpoint belongs to its model."""
    simulate(tongue, scratch, 0.005)
    other = tf.Simulation(
        tf.Model(tongue, replace(tf.Tissue.calka(), density=900.0)), stepping=tf.Stepping(step_max=5e-3, output_every=0.01)
    )
    with pytest.raises(tf.InputError, match="differs in tissue"):
        other.run(GGP, 0.01, scratch, resume=True)


@pytest.mark.parallel
def test_ranks_agree(tongue: tf.TongueMesh, tongue_file: Path, scratch: Path) -> None:
    """Fixed steps and tight tolerances: the ranks together and each rank alone give the same probes to 1e-6."""
    together = simulate(tongue, scratch / "together", 0.02, TIGHT)
    alone = tf.TongueMesh.read(tongue_file, MPI.COMM_SELF)
    single = simulate(alone, scratch / f"alone{MPI.COMM_WORLD.rank}", 0.02, TIGHT)
    for name, path in single.probes.items():
        scale = abs(path).max()
        np.testing.assert_allclose(together.probes[name], path, rtol=0, atol=1e-6 * scale)
    np.testing.assert_allclose(together.field("displacement"), single.field("displacement"), atol=1e-6 * scale)
    assert together.summary["ranks"] == MPI.COMM_WORLD.size


@pytest.mark.parallel
def test_failure_is_said_and_saved(block: tf.TongueMesh, scratch: Path) -> None:
    """A load that no step survives ends in a SolveError that names place and folder; the last good state is on disk."""
    model = tf.Model(block, fixed=["left"], gravity=(0.0, 0.0, -5e5), gravity_rise=0.01)
    stepping = tf.Stepping(step_max=5e-3, step_min=2e-3, output_every=5e-3)
    simulation = tf.Simulation(model, stepping=stepping, probes={"end": (0.02, 0.005, 0.005)})
    with pytest.raises(tf.SolveError, match=r"smallest J .* in tissue that no muscle pulls at \(.*last good state is saved") as failure:
        simulation.run({}, 0.05, scratch)
    stopped = tf.Run(scratch)
    assert str(failure.value).startswith(stopped.summary["reason"])
    assert stopped.summary["status"] == "failed"
    assert stopped.summary["n_rejected"] > 0
    assert len(stopped.time) == stopped.summary["n_steps"] + 1


def test_free_fall_and_drag(block: tf.TongueMesh, scratch: Path) -> None:
    """A bar under gravity and mass damping: gravity's work goes into energy and heat to within 1 %."""
    tissue = replace(tf.Tissue.calka(), law=tf.Tissue.buchaillard().law)
    model = tf.Model(block, tissue, fixed=["left"], gravity=(0.0, 0.0, -9.81), gravity_rise=0.02)
    run = tf.Simulation(model, probes={"end": (0.02, 0.005, 0.005)}, stepping=tf.Stepping(2e-3)).run({}, 0.06, scratch)
    assert run.probes["end"][-1, 2] < -1e-4
    assert run.summary["energy_balance_error"] < 0.01
    assert run.energy["gravity_work"][-1] > 0


def test_probe_positions(block: tf.TongueMesh) -> None:
    """A probe outside the tongue is refused, and so is an unknown landmark."""
    with pytest.raises(tf.InputError, match=r"probes.far: the point lies 10.0 mm outside"):
        tf.Simulation(tf.Model(block, fixed=["left"]), probes={"far": (0.03, 0.005, 0.005)})
    with pytest.raises(tf.InputError, match="no landmark 'tip'"):
        tf.Simulation(tf.Model(block, fixed=["left"]), probes={"tip": "tip"})


def test_hencky_measure() -> None:
    """Uniaxial isochoric stretch λ: von Mises Hencky strain is |ln λ|; a rotation changes nothing."""
    c, s = np.cos(0.5), np.sin(0.5)
    F = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([1.5, 1.5**-0.5, 1.5**-0.5])
    assert hencky_von_mises(F[None])[0] == pytest.approx(np.log(1.5))
    assert weighted_percentile(np.array([3.0, 1.0, 2.0]), np.array([1.0, 98.0, 1.0]), 99) == 2.0


def test_folder_that_cannot_be_written(tongue: tf.TongueMesh, scratch: Path) -> None:
    """A file in the way of the run folder is said before anything is computed."""
    on_rank_zero(tongue.comm, lambda: (scratch / "file").write_text(""))
    with pytest.raises(tf.InputError, match="cannot be written"):
        simulate(tongue, scratch / "file")


@pytest.mark.parallel
def test_resume_knows_the_problem(block: tf.TongueMesh, scratch: Path) -> None:
    """Probes, fibres and the sphere's side are of the problem: each is named where it differs, also of a mesh that came from no file."""
    ball = Sphere((0.01, 0.005, -0.03), 0.02)
    model = tf.Model(
        with_fibres(block), replace(tf.Tissue.calka(), peak_stress={"GGP": 1e3}), fixed=["left"], contacts={"ball": Contact(ball)}
    )
    end = {"end": (0.02, 0.005, 0.005)}
    tf.Simulation(model, end).run({"GGP": tf.ramp(0.1, 0.1)}, 0.01, scratch)
    turned = replace(model, tongue=with_fibres(block, (1.0, 1.0, 0.0)))
    others = {
        "tongue": tf.Simulation(turned, end),
        "probes": tf.Simulation(model, {"end": (0.02, 0.004, 0.005)}),
        "contacts": tf.Simulation(replace(model, contacts={"ball": Contact(Sphere((0.01, 0.005, -0.03), 0.0201))}), end),
    }
    for part, simulation in others.items():
        with pytest.raises(tf.InputError, match=f"differs in {part};"):
            simulation.run({"GGP": tf.ramp(0.1, 0.1)}, 0.02, scratch, resume=True)
    with pytest.raises(tf.InputError, match="differs in activation;"):
        tf.Simulation(model, end).run({"GGP": tf.ramp(0.2, 0.1)}, 0.02, scratch, resume=True)
    run = tf.Simulation(model, end).run({"GGP": tf.ramp(0.1, 0.1)}, 0.02, scratch, resume=True)
    assert run.time[-1] == 0.02


def test_resume_on_another_number_of_ranks(tongue_file: Path, tmp_path: Path) -> None:
    """A run of one rank goes on on two, to what one rank alone gives."""
    scenario = tmp_path / "run.toml"
    scenario.write_text(
        f'[mesh]\nfile = "{tongue_file}"\n[time]\nend = 0.02\n[solver]\nrtol = 1e-9\nlinear = 1e-8\n'
        "[activation.GGP]\npieces = [[0.02, 0.0, 0.5]]\n"
    )
    tongue = [sys.executable, "-m", "tongue_fenicsx", "run", str(scenario), "--no-figures", "-o"]
    mpiexec = [str(Path(sys.executable).with_name("mpiexec")), "-n", "2"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PMI", "MPI", "HYDRA"))}

    def call(*command: str) -> None:
        done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=300, env=environment)
        assert done.returncode == 0, done.stderr

    call(*tongue, str(tmp_path / "whole"))
    call(*tongue, str(tmp_path / "parts"), "--set", "time.end=0.01")
    call(*mpiexec, *tongue, str(tmp_path / "parts"), "--resume")
    whole, parts = (tf.Run(tmp_path / name).probes["root"] for name in ("whole", "parts"))
    assert abs(parts - whole).max() < 1e-10 * abs(whole).max()
