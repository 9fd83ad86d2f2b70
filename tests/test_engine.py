# SPDX-License-Identifier: MIT
"""A simulation that is built once and run many times, in memory or into a folder."""

from __future__ import annotations

import gc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dolfinx import fem

import tongue_fenicsx as tf
from tongue_fenicsx.geometry.obstacles import Plane
from tongue_fenicsx.mechanics.contact import Contact
from tongue_fenicsx.simulation.engine import Engine
from tongue_fenicsx.solvers.newton import Newton, Outcome
from tongue_fenicsx.solvers.options import SolverOptions
from tongue_fenicsx.testing import with_fibres

from petsc4py import PETSc  # isort: skip

SHORT = tf.Stepping(step_max=5e-3, output_every=0.01)
LIVING = tf.Tissue.buchaillard()


def bar(block: tf.TongueMesh, **options: object) -> tf.Model:
    """The block as one muscle."""
    tissue = replace(LIVING, peak_stress={"GGP": 5e3})
    return tf.Model(with_fibres(block), **({"tissue": tissue, "fixed": ["left"]} | options))  # type: ignore[arg-type]


def test_nothing_stays_behind(block: tf.TongueMesh) -> None:
    """A simulation that is let go leaves no function space, and so no MPI communicator, of which there are two thousand."""

    def spaces() -> int:
        gc.collect()
        return sum(isinstance(item, fem.FunctionSpace) for item in gc.get_objects())

    contact = Contact(Plane((0.0, 0.0, -1e-3), (0.0, 0.0, 1.0)))
    before = spaces()
    tf.Simulation(bar(block, contacts={"floor": contact}), stepping=SHORT).run({"GGP": tf.ramp(0.01, 0.1)}, t_end=0.005)
    assert spaces() == before


@pytest.mark.parallel
def test_runs_again_as_if_for_the_first_time(block: tf.TongueMesh) -> None:
    """Twice the same run gives the same, and a run between leaves no trace."""
    course = {"GGP": tf.ramp(0.02, 0.1)}
    simulation = tf.Simulation(bar(block), probes={"end": (0.02, 0.005, 0.005)}, stepping=SHORT)
    first = simulation.run(course, t_end=0.02)
    other = simulation.run({"GGP": tf.ramp(0.01, 0.1, 0.3)}, t_end=0.02)
    again = simulation.run(course, t_end=0.02)
    assert np.array_equal(first.probes["end"], again.probes["end"])
    assert not np.allclose(first.probes["end"], other.probes["end"])
    simulation.close()


@pytest.mark.parametrize("mixed", [False, True])
def test_nothing_is_built_again(block: tf.TongueMesh, monkeypatch: pytest.MonkeyPatch, mixed: bool) -> None:
    """Other activations and other numbers use the same engine, and give what a fresh simulation gives."""
    built = []
    right = Engine.__init__

    def count(self: Engine, *arguments: object) -> None:
        built.append(self)
        right(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Engine, "__init__", count)
    simulation = tf.Simulation(bar(block, mixed=mixed), probes={"end": (0.02, 0.005, 0.005)}, stepping=SHORT)
    for level in (0.2, 0.4):
        simulation.run({"GGP": tf.ramp(0.01, 0.1, level)}, t_end=0.01)
    tissue = replace(LIVING, law=tf.Yeoh(500.0, 200.0, 0.45), density=900.0, damping=tf.Rayleigh(10.0, 0.01), peak_stress={"GGP": 3e3})
    simulation.model = replace(simulation.model, tissue=tissue)
    reused = simulation.run({"GGP": tf.ramp(0.01, 0.1)}, t_end=0.01)
    assert len(built) == 1
    fresh = tf.Simulation(bar(block, tissue=tissue, mixed=mixed), probes={"end": (0.02, 0.005, 0.005)}, stepping=SHORT)
    new = fresh.run({"GGP": tf.ramp(0.01, 0.1)}, t_end=0.01)
    assert np.allclose(new.probes["end"], reused.probes["end"], rtol=1e-12, atol=1e-15)
    assert new.summary["newton_iterations"] == reused.summary["newton_iterations"]


def test_what_does_not_fit_is_built_again(block: tf.TongueMesh) -> None:
    """A model of another structure gets another engine."""
    simulation = tf.Simulation(bar(block), probes={"end": (0.02, 0.005, 0.005)}, stepping=SHORT)
    simulation.run({}, t_end=0.005)
    engine = simulation._engine
    simulation.model = replace(simulation.model, tissue=replace(LIVING, law=tf.NeoHookean(1000.0)))
    simulation.run({}, t_end=0.005)
    assert simulation._engine is not engine


def test_in_memory_as_in_a_folder(block: tf.TongueMesh, tmp_path: Path) -> None:
    """The same numbers, fields and summary, without a file."""
    simulation = tf.Simulation(bar(block), probes={"end": (0.02, 0.005, 0.005)}, stepping=SHORT)
    course = {"GGP": tf.ramp(0.02, 0.1)}
    here, there = simulation.run(course, t_end=0.02), simulation.run(course, t_end=0.02, output=tmp_path / "run")
    assert np.array_equal(here.probes["end"], there.probes["end"])
    assert np.array_equal(here.field("displacement"), there.field("displacement"))
    assert here.summary["newton_iterations"] == there.summary["newton_iterations"]
    assert here.summary["status"] == "done"


def test_a_rejected_step_leaves_no_trace(block: tf.TongueMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a step that failed, contact is as stiff as if it had not been tried."""
    floor = Contact(Plane((0, 0, -1e-4), (0, 0, 1)))
    model = bar(block, gravity=(0.0, 0.0, -9.81), gravity_rise=0.0, contacts={"floor": floor})
    engines = []
    solve = Newton.solve
    fails = [False]

    def fail_once(self: Newton) -> Outcome:
        outcome = solve(self)
        return replace(outcome, converged=False) if fails and fails.pop() else outcome

    gammas: list[tuple[float, ...]] = []
    for tried in (False, True):
        simulation = tf.Simulation(model, probes={}, stepping=SHORT)
        engine = simulation._prepare([])
        engine.equations.restore(replace(engine.start({}).state, gammas=(1e-9,)))
        if tried:
            fails[:] = [True]
            monkeypatch.setattr(Newton, "solve", fail_once)
            before = engine.equations.state
            engine.solve(5e-3, {})
            engine.equations.restore(before)
        engine.equations.at(5e-3, {})
        gammas.append(engine.weak.contacts.gammas)
        engines.append(engine)
    assert gammas[0] == gammas[1]
    assert gammas[0] == pytest.approx((1.2e-9,))


def test_solvers_do_not_see_each_other(block: tf.TongueMesh) -> None:
    """Options of one solver are its own, and gone when it is."""
    SolverOptions()  # sets those that stay for all
    gc.collect()
    before = set(PETSc.Options().getAll())
    one, two = (tf.Simulation(bar(block, mixed=mixed), probes={}, stepping=SHORT) for mixed in (False, True))
    one.run({}, t_end=0.005)
    two.run({"GGP": tf.ramp(0.01, 0.1)}, t_end=0.005)
    mine = set(PETSc.Options().getAll()) - before
    two.close()
    left = set(PETSc.Options().getAll()) - before
    assert left < mine
    assert one.run({}, t_end=0.005).summary["n_steps"] == 1
    one.close()
    gc.collect()
    assert set(PETSc.Options().getAll()) == before


def test_the_user_sets_how_accurate_linear_solves_are(block: tf.TongueMesh) -> None:
    """An option for all solvers is not overruled, neither by the tolerances nor by what Newton's method needs."""
    PETSc.Options()["tongue_cg_pmg_ksp_rtol"] = "1e-9"
    try:
        simulation = tf.Simulation(bar(block), probes={}, stepping=SHORT)
        simulation.run({"GGP": tf.ramp(0.01, 0.1)}, t_end=0.005)
    finally:
        PETSc.Options().delValue("tongue_cg_pmg_ksp_rtol")
    (ksp,) = simulation._prepare(["GGP_L"])._newton._linear._made.values()
    assert ksp.getTolerances()[0] == 1e-9


@pytest.mark.parametrize(
    ("activation", "sentence"),
    [({"GGP": 1.0}, "activation.GGP: 1.0; a course"), (3, "activation: 3; a mapping"), ({"GPP": tf.ramp(0.1, 0.1)}, "did you mean GGP")],
)
def test_what_moves_muscles(block: tf.TongueMesh, activation: object, sentence: str) -> None:
    """A mistake is said at the call."""
    with pytest.raises(tf.InputError, match=sentence):
        tf.Simulation(bar(block), probes={}).run(activation, t_end=0.01)  # type: ignore[arg-type]


def test_resume_needs_a_folder(block: tf.TongueMesh) -> None:
    """There is nothing in memory to go on from."""
    with pytest.raises(tf.InputError, match="give output"):
        tf.Simulation(bar(block), probes={}).run({}, t_end=0.01, resume=True)


@pytest.mark.parametrize("pieces", [[(1.0, 1.0, 1.0)], [(1e-6, 0.0, 1.0), (1.0, 1.0, 1.0)]])
def test_activation_jumps(block: tf.TongueMesh, pieces: list[tuple[float, float, float]]) -> None:
    """From 0 to 1 at once or within a microsecond, in the softest tissue: no step is cut, and both are one jump."""
    model = bar(block, tissue=replace(tf.Tissue.calka(), peak_stress={"GGP": 5e3}))
    run = tf.Simulation(model, probes={"end": (0.02, 0.005, 0.005)}, stepping=SHORT).run({"GGP": tf.Activation(pieces)}, t_end=0.02)
    assert (run.summary["status"], run.summary["n_rejected"], run.summary["n_steps"]) == ("done", 0, 4)
    assert run.probes["end"][-1, 0] < -1e-3
