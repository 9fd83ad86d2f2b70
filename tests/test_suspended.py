# SPDX-License-Identifier: MIT
"""A bone on springs: it stays rigid, swings with the frequency of its springs, and is driven by muscle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tongue_fenicsx as tf
from tongue_fenicsx.forms.weak_form import WeakForm
from tongue_fenicsx.mechanics.suspension import Suspension
from tongue_fenicsx.scenario.build import activation_of, simulation_of
from tongue_fenicsx.scenario.files import load
from tongue_fenicsx.solvers.equations import Equations
from tongue_fenicsx.solvers.newton import Newton
from tongue_fenicsx.solvers.time_integration import GeneralizedAlpha
from tongue_fenicsx.solvers.tolerances import Tolerances
from tongue_fenicsx.testing import with_fibres

PROBES = {f"corner_{y}{z}": (0.02, 0.01 * y, 0.01 * z) for y in (0, 1) for z in (0, 1)}


def hung(block: tf.TongueMesh, suspension: Suspension, mixed: bool = False, beta: float = 0.0) -> tf.Model:
    """The block between a fixed bone and one on springs, its fibres askew so that they also turn it."""
    muscle = with_fibres(block, (1.0, 0.3, 0.1))
    tissue = tf.Tissue(tf.Yeoh(192.0, 90.0, 0.5 if mixed else 0.49), 1000.0, tf.Rayleigh(20.0, beta), {"GGP": 3e3})
    return tf.Model(muscle, tissue, fixed=["left"], suspended={"right": suspension}, mixed=mixed)


@pytest.mark.parallel
@pytest.mark.parametrize("mixed", [False, True])
def test_rigid_and_in_equilibrium(block: tf.TongueMesh, scratch: Path, mixed: bool) -> None:
    """The bone's corners keep their distances while it moves and turns; at rest the springs bear what the tongue bears."""
    stepping = tf.Stepping(step_max=0.02, output_every=0.1, quasi_static=True)
    tight = tf.Tolerances.of("tight", rtol=1e-9, atol=1e-13, linear=1e-7, max_newton=30)
    model = hung(block, Suspension(stiffness=300.0), mixed)
    run = tf.Simulation(model, PROBES, stepping, tight).run({"GGP_L": tf.ramp(0.1, 0.1)}, 0.1, scratch)
    corners = np.array(list(PROBES.values()))
    moved = corners + np.array([run.probes[name][-1] for name in PROBES])

    def distances(points: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(points[:, None] - points, axis=2))

    np.testing.assert_allclose(distances(moved), distances(corners), rtol=0, atol=1e-12)
    mean = (moved - corners).mean(axis=0)
    assert mean[0] < -1e-4
    assert np.linalg.norm((moved - corners) - mean, axis=1).max() > 1e-4  # it turned
    np.testing.assert_allclose(run.support["right"][-1], -300.0 * mean, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(run.support["right"][-1] + run.support["left"][-1], 0, atol=1e-8)


def test_swings_with_its_springs(block: tf.TongueMesh, scratch: Path) -> None:
    """Pulled all at once by a feeble muscle in light tissue, it swings about its new rest with the period 2π √(m/k)."""
    mass, stiffness = 0.05, 100.0
    model = tf.Model(
        with_fibres(block), tf.Tissue(tf.Yeoh(5.0, 0.0), 0.1, peak_stress={"GGP": 1.0}), tf.Contraction("none", tendon_length=0.0),
        fixed=["left"], suspended={"right": Suspension(mass, stiffness)},
    )  # fmt: skip
    period = 2 * np.pi * np.sqrt(mass / stiffness)
    stepping = tf.Stepping(step_max=period / 200, output_every=1.0, spectral_radius=1.0)
    tight = tf.Tolerances.of("tight", rtol=1e-7, atol=1e-14, linear=1e-6)  # of a tenth of the first guess, which is what counts here
    run = tf.Simulation(model, PROBES, stepping, tight).run({"GGP_L": lambda t: 1.0}, period, scratch)
    x = np.mean([path[:, 0] for path in run.probes.values()], axis=0)
    np.testing.assert_allclose(x, x.min() / 2 * (1 - np.cos(2 * np.pi * run.time / period)), atol=0.01 * abs(x.min()))


@pytest.mark.parallel
@pytest.mark.parametrize("mixed", [False, True])
def test_tangent(block: tf.TongueMesh, mixed: bool) -> None:
    """The reduced tangent, with its bending part, leaves of the reduced residual's change what shrinks with the square of the step."""
    weak = WeakForm(hung(block, Suspension(), mixed, 0.01), ["GGP_L"])
    weak.load(0.0, {"GGP_L": 0.7})
    weak.frozen = weak.u  # the whole derivative
    scheme = GeneralizedAlpha(weak.u, 0.8, weak.pressure)
    scheme.begin(0.01)
    newton = Newton(Equations(weak, scheme), Tolerances.of("tight"), lambda line: None)
    assert newton._bodies is not None
    weak.u.interpolate(lambda X: 1e-3 * np.array([np.sin(100 * X[1]), np.sin(90 * X[0]), np.sin(80 * X[0])]))
    x = newton._x
    n = 3 * weak.V.dofmap.index_map.size_local
    x.array[:n] = weak.u.x.array[:n]
    newton._bodies.begin(weak.u.x.array.reshape(-1, 3), x)
    direction = x.duplicate()
    points = weak.V.tabulate_dof_coordinates()[: n // 3]
    direction.array[:n] = 1e-3 * np.sin(200 * points + 100 * points.sum(axis=1, keepdims=True)).ravel()
    direction.array[weak.fixed_dofs] = 0.0
    direction.array[newton._bodies._transformation.slaves] = 0.0
    start, here = x.copy(), x.duplicate()

    def residual(step: float) -> np.ndarray:
        start.copy(here)
        here.axpy(step, direction)
        b = x.duplicate()
        newton._form_residual(newton._snes, here, b)
        return np.array(b.array_r)

    rest = residual(0.0)
    newton._form_tangent(newton._snes, here, newton._operator, newton._operator)
    change = direction.duplicate()
    newton._operator.mult(direction, change)
    left = [block.comm.allreduce(float(((residual(h) - rest - h * change.array_r) ** 2).sum())) ** 0.5 for h in (1e-3, 5e-4)]
    assert np.log2(left[0] / left[1]) == pytest.approx(2, abs=0.1)
    newton.destroy()


@pytest.mark.parallel
def test_resume(block: tf.TongueMesh, scratch: Path) -> None:
    """A run goes on as if it had not been stopped."""

    def simulate(folder: Path, end: float, resume: bool = False) -> tf.Run:
        return tf.Simulation(hung(block, Suspension()), PROBES).run({"GGP_L": tf.ramp(0.05, 0.1)}, end, folder, resume=resume)

    whole = simulate(scratch / "whole", 0.06)
    simulate(scratch / "parts", 0.03)
    parts = simulate(scratch / "parts", 0.06, resume=True)
    for name in PROBES:
        np.testing.assert_allclose(parts.probes[name], whole.probes[name], rtol=0, atol=0.0 if block.comm.size == 1 else 1e-12)


def test_hyoid_of_a_tongue(tongue_file: Path) -> None:
    """The scenario's keys reach the model; geniohyoid pulls the hyoid forward; bad numbers and doubled names are named."""
    path = tongue_file.parent / "hyoid.toml"
    path.write_text(
        '[mesh]\nfile = "tongue.msh"\n[time]\nend = 0.05\n[boundary.suspended.hyoid]\nstiffness = 500.0\n'
        "[activation.GH]\npieces = [[0.05, 0.0, 1.0]]\n[probes]\nhyoid = [0.034, 0.0, -0.0155]\n"
    )
    simulation = simulation_of(load(path), path.parent)
    assert list(simulation.model.fixed) == ["mandible"]
    assert simulation.model.suspended == {"hyoid": Suspension(5e-3, 500.0, 0.0)}
    run = simulation.run(activation_of(load(path)), 0.05, path.parent / "hyoid")
    assert run.probes["hyoid"][-1, 0] < -1e-4
    assert run.summary["energy_balance_error"] < 0.01
    assert run.energy["support_work"][-1] < 0  # into the springs
    with pytest.raises(tf.InputError, match=r"boundary\.suspended\.hyoid\.mass: .*zero or a positive number is expected"):
        load(path, ["boundary.suspended.hyoid.mass=-1.0"])
    with pytest.raises(tf.InputError, match="hyoid is named 2 times among fixed, moving and suspended"):
        simulation_of(load(path, ['boundary.fixed=["mandible", "hyoid"]']), path.parent)
    with pytest.raises(tf.InputError, match=r"suspended\.stiffness: nan N/m"):
        Suspension(stiffness=float("nan"))
