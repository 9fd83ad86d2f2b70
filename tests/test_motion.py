# SPDX-License-Identifier: MIT
"""Bones that move, the forces that they exert, and steps by tolerance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tongue_fenicsx as tf
from tongue_fenicsx.scenario.build import simulation_of
from tongue_fenicsx.scenario.files import load
from tongue_fenicsx.testing import box, with_fibres

END = {"end": (0.02, 0.005, 0.005)}
TIGHT = tf.Tolerances.of("tight", rtol=1e-9, atol=1e-13, linear=1e-7)


def test_rotation_and_translation() -> None:
    """90° about y through a point, then 2 mm down; half of the way at half of the time, and the target holds."""
    motion = tf.RigidMotion([(0.2, 0.0, 90.0)], [(0.1, (0, 0, 0), (0, 0, 0)), (0.1, (0, 0, 0), (0, 0, -2e-3))], centre=(0.01, 0, 0))
    points = np.array([[0.02, 0.003, 0.0]])
    np.testing.assert_allclose(motion.displacement(points, 0.5), [[-0.01, 0.0, -0.012]], atol=1e-12)
    turned = motion.displacement(points, 0.1) + points - [0.01, 0.0, 0.0]
    np.testing.assert_allclose(turned, [[0.01 / np.sqrt(2), 0.003, -0.01 / np.sqrt(2)]], atol=1e-12)
    assert motion.kinks == [0.2, 0.1, 0.2]
    early = tf.RigidMotion(translation=[(1.0, (0, 0, 0), (1.0, 0, 0))]).displacement(points, 0.25)[0, 0]
    assert early == pytest.approx(10 * 0.25**3 - 15 * 0.25**4 + 6 * 0.25**5)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({}, "neither angle nor translation"),
        ({"angle": [(0.0, 0.0, 1.0)]}, "motion.angle.0.0: 0.0 s; a positive number is expected"),
        ({"angle": [(0.1, 0.0, float("nan"))]}, "motion.angle.0.2: nan; a number is expected"),
        ({"translation": [(0.1, (0, 0), (0, 0, 1))]}, "three numbers are expected"),
        ({"angle": [(0.1, 0.0, 1.0)], "axis": (0, 0, 0)}, "has no direction"),
    ],
)
def test_bad_motion(wrong: dict[str, object], message: str) -> None:
    """A motion that makes no sense is refused in a sentence."""
    with pytest.raises(tf.InputError, match=message):
        tf.RigidMotion(**wrong)  # type: ignore[arg-type]


@pytest.mark.parallel
@pytest.mark.parametrize("mixed", [False, True])
def test_a_free_block_follows_its_bone(block: tf.TongueMesh, scratch: Path, mixed: bool) -> None:
    """Turned by 40° and shifted in equilibrium, the block moves as a rigid body, without force or work."""
    motion = tf.RigidMotion([(0.1, 0.0, 40.0)], [(0.1, (0, 0, 0), (0, 1e-3, 0))])
    model = tf.Model(block, fixed=[], moving={"left": motion}, mixed=mixed)
    stepping = tf.Stepping(step_max=0.01, output_every=0.1, quasi_static=True)
    run = tf.Simulation(model, probes=END, stepping=stepping, tolerances=TIGHT).run({}, 0.1)
    np.testing.assert_allclose(run.probes["end"][-1], motion.displacement(np.array([END["end"]]), 0.1)[0], atol=1e-8)
    assert abs(run.support["left"][-1]).max() < 1e-8
    assert abs(run.energy["support_work"][-1]) < 1e-9


def test_stretched_between_bones(block: tf.TongueMesh, scratch: Path) -> None:
    """The work of the moving bone is stored or dissipated; at rest both bones pull alike, and together they carry the weight."""
    motion = tf.RigidMotion(translation=[(0.1, (0, 0, 0), (2e-3, 0, 0))])
    tissue = replace(tf.Tissue.calka(), damping=tf.Rayleigh(50.0))
    model = tf.Model(block, tissue, fixed=["left"], moving={"right": motion}, gravity=(0.0, 0.0, -9.81))
    run = tf.Simulation(model, probes=END, stepping=tf.Stepping(step_max=5e-3), tolerances=TIGHT).run({}, 0.6, scratch)
    np.testing.assert_allclose(run.probes["end"][-1], [2e-3, 0, 0], atol=1e-12)
    assert run.summary["energy_balance_error"] < 0.01
    assert run.energy["support_work"][-1] + run.energy["gravity_work"][-1] > run.energy["elastic"][-1] > 1e-5
    left, right = run.support["left"][-1], run.support["right"][-1]
    assert right[0] > 1e-3
    np.testing.assert_allclose(left + right, [0, 0, 9.81 * 1000 * 2e-6], atol=1e-6)


@pytest.mark.parallel
def test_mixed_and_moving_resume_exactly(block: tf.TongueMesh, scratch: Path) -> None:
    """Pressure, motion and steps by tolerance go on from a checkpoint, to round-off (FGMRES is not reproducible to the last bit)."""

    def simulate(folder: Path, end: float, resume: bool = False) -> tf.Run:
        motion = tf.RigidMotion([(0.06, 0.0, 20.0)])
        tissue = replace(tf.Tissue.calka(), law=tf.Yeoh(192.0, 90.0, 0.5))
        model = tf.Model(with_fibres(block), tissue, fixed=[], moving={"left": motion}, mixed=True)
        stepping = tf.Stepping(tolerance=1e-3)
        simulation = tf.Simulation(model, END, stepping)
        return simulation.run({"GGP_L": tf.ramp(0.05, 0.1, 0.5)}, end, folder, resume=resume)

    whole = simulate(scratch / "whole", 0.06)
    simulate(scratch / "parts", 0.03)
    parts = simulate(scratch / "parts", 0.06, resume=True)
    np.testing.assert_allclose(parts.probes["end"], whole.probes["end"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(parts.support["left"], whole.support["left"], rtol=0, atol=1e-9)
    assert parts.energy["support_work"][-1] == pytest.approx(whole.energy["support_work"][-1], rel=1e-9)
    assert whole.summary["volume_change_max"] < 1e-6


def test_mixed_is_accurate_when_incompressible() -> None:
    """At ν = 0.4 both forms agree; at 0.499 the displacement form is too stiff; the mixed one is within 5 % of a finer mesh at 0.5."""
    coarse, fine = (box((0.02, 0.01, 0.01), (2 * n, n, n)) for n in (2, 4))
    sag = []
    for tongue, nu, mixed in ((coarse, 0.4, False), (coarse, 0.4, True), (coarse, 0.499, False), (coarse, 0.499, True),
                              (coarse, 0.5, True), (fine, 0.5, True)):  # fmt: skip
        model = tf.Model(
            tongue, tf.Tissue(tf.Yeoh(1037.0, 486.0, nu), 1000.0, tf.Rayleigh(20.0)), fixed=["wall"], gravity=(0, 0, -9.81), mixed=mixed
        )
        stepping = tf.Stepping(step_max=0.02, output_every=0.1, quasi_static=True)
        run = tf.Simulation(model, probes=END, stepping=stepping, tolerances=tf.Tolerances.of("tight", rtol=1e-6)).run({}, 0.1)
        sag.append(-run.probes["end"][-1][2])
    assert sag[1] == pytest.approx(sag[0], rel=0.02)
    assert sag[2] < 0.95 * sag[3]
    assert sag[4] == pytest.approx(sag[3], rel=2e-3)
    assert sag[4] == pytest.approx(sag[5], rel=0.05)


def test_forms_that_do_not_fit(block: tf.TongueMesh) -> None:
    """ν = 0.5 needs the mixed form, which has no barrier; a surface either stays or moves; it must exist."""
    motion = tf.RigidMotion([(0.1, 0.0, 10.0)])
    with pytest.raises(tf.InputError, match=r"nu: 0\.5 needs the mixed form"):
        tf.Model(block, tf.Tissue(tf.Yeoh(1.0, 1.0, 0.5), 1000.0), fixed=["left"])
    with pytest.raises(tf.InputError, match="'barrier' is not known to the mixed form"):
        tf.Model(block, tf.Tissue(tf.Yeoh(1.0, 1.0, 0.49, "barrier"), 1000.0), fixed=["left"], mixed=True)
    with pytest.raises(tf.InputError, match="left is named 2 times"):
        tf.Model(block, fixed=["left"], moving={"left": motion})
    with pytest.raises(tf.InputError, match=r"boundary\.moving: the mesh has no surface 'jaw'; it has free, left, right"):
        tf.Model(block, fixed=["left"], moving={"jaw": motion})


def test_smaller_tolerance_smaller_error(block: tf.TongueMesh) -> None:
    """Steps grow and shrink with the motion, and the error follows the tolerance."""

    def simulate(tolerance: float | None, step: float) -> tf.Run:
        tissue = replace(tf.Tissue.calka(), law=tf.Tissue.buchaillard().law)
        model = tf.Model(block, tissue, fixed=["left"], gravity=(0, 0, -9.81), gravity_rise=0.02)
        stepping = tf.Stepping(step_max=step, output_every=0.3, tolerance=tolerance)
        return tf.Simulation(model, probes=END, stepping=stepping).run({}, 0.3)

    exact = simulate(None, 2e-3).probes["end"][-1]
    coarse, fine = simulate(1e-2, 0.1), simulate(1e-3, 0.1)
    errors = [np.linalg.norm(run.probes["end"][-1] - exact) / np.linalg.norm(exact) for run in (coarse, fine)]
    assert errors[1] < 0.4 * errors[0] < 0.1
    assert 1.5 * coarse.summary["n_steps"] < fine.summary["n_steps"]
    lengths = np.diff(fine.time)
    assert lengths.max() > 2 * lengths.min()
    with pytest.raises(tf.InputError, match=r"time\.tolerance: 1\.5"):
        tf.Stepping(tolerance=1.5)


SCENARIO = """
units = "mm"
[mesh]
unit = "m"
file = "block.msh"
[tissue]
formulation = "mixed"
nu = 0.5
[boundary]
fixed = []
[boundary.moving.left]
angle = [[0.02, 0, 5]]
translation = [[0.02, [0, 0, 0], [0, 0, 1]]]
centre = [-40, 0, 0]
[gravity]
posture = "supine"
[time]
end = 0.02
step = 0.01
tolerance = 0.1
"""


def test_scenario(block: tf.TongueMesh, workspace: Path) -> None:
    """The keys reach the model, lengths in m; mandible and hyoid are fixed by default unless they move."""
    path = workspace / "moving.toml"
    if block.comm.rank == 0:
        path.write_text(SCENARIO)
    block.comm.barrier()
    model = simulation_of(load(path), workspace).model
    assert model.mixed
    assert model.tissue.law.nu == 0.5
    assert model.gravity == (9.81, 0.0, 0.0)
    np.testing.assert_allclose(model.moving["left"].displacement(np.array([[-0.04, 0.0, 0.0]]), 1.0), [[0, 0, 1e-3]], atol=1e-12)
    assert load(path, ["boundary={}"]).boundary.fixed == ["mandible", "hyoid"]
    assert load(path, ["boundary={moving={mandible={angle=[[0.1, 0, 8]]}}}"]).boundary.fixed == ["hyoid"]
    with pytest.raises(tf.InputError, match="either acceleration or posture"):
        load(path, ["gravity.acceleration=[0.0, 0.0, 1.0]"])
    with pytest.raises(tf.InputError, match=r"boundary\.moving\.left: motion: neither angle nor translation"):
        load(path, ["boundary.moving.left={}"])
