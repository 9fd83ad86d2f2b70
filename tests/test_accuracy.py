# SPDX-License-Identifier: MIT
"""`solver.accuracy`: one name for the step and for when a solve is done; keys that are given win."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tongue_fenicsx as tf
from tongue_fenicsx.geometry.obstacles import Plane
from tongue_fenicsx.mechanics.contact import Contact
from tongue_fenicsx.scenario.build import simulation_of
from tongue_fenicsx.scenario.schema import Scenario
from tongue_fenicsx.solvers.tolerances import ACCURACIES

BEAM = Path(__file__).parents[1] / "demos" / "cantilever.msh"


def simulation(end: float = 0.1, **tables: Any) -> tf.Simulation:
    """The demo's beam under its weight."""
    given = {"mesh": {"file": str(BEAM)}, "boundary": {"fixed": ["wall"]}, "gravity": {"acceleration": [0, 0, -9.81]}, "probes": {}}
    scenario = Scenario.model_validate(given | {"time": {"end": end}} | tables)
    return simulation_of(scenario, BEAM.parent)


@pytest.mark.parametrize("accuracy", ACCURACIES)
def test_one_name(accuracy: str) -> None:
    """The step and all tolerances follow from it, for files and Python alike."""
    made = simulation(solver={"accuracy": accuracy})
    tolerances = tf.Tolerances.of(accuracy)
    assert made.tolerances == tolerances
    assert made.stepping.step_max == tolerances.step
    assert tf.Simulation(made.model, {}, tf.Stepping(output_every=0.1), tolerances).stepping.step_max == tolerances.step


def test_default() -> None:
    """Who says nothing gets trajectories."""
    made = simulation()
    assert made.tolerances == tf.Tolerances.of("trajectory") == tf.Tolerances()
    assert made.stepping.longest == tf.Simulation(made.model, {}).stepping.longest == tf.Tolerances().step


@pytest.mark.parametrize("key", ["step", "step_max"])
def test_what_is_given_wins(key: str) -> None:
    """A step and a tolerance of one's own stay, the rest follows the accuracy."""
    made = simulation(solver={"accuracy": "preview", "rtol": 1e-7}, time={"end": 0.1, key: 2e-3})
    assert made.tolerances == tf.Tolerances.of("preview", rtol=1e-7)
    assert made.stepping.step_max == 2e-3


def test_bad_accuracy() -> None:
    """What there is, is said."""
    with pytest.raises(tf.InputError, match=r"accuracy: 'exact'; one of trajectory, tight, preview is expected\."):
        tf.Tolerances.of("exact")
    with pytest.raises(tf.InputError, match=r"solver\.linear: 2"):
        tf.Tolerances.of(linear=2)


def test_depth(block: tf.TongueMesh, scratch: Path) -> None:
    """How deep an obstacle may be penetrated follows the accuracy, unless the contact says it."""
    deepest = []
    for penetration, tolerance in ((1.0, None), (2e-6, None), (1.0, 2e-6)):
        contact = Contact(Plane((0.0, 0.0, -1e-3), (0.0, 0.0, 1.0)), stiffness=0.1, tolerance=tolerance)
        model = tf.Model(block, tf.Tissue.buchaillard(), fixed=["left"], contacts={"floor": contact}, gravity=(0.0, 0.0, -9.81))
        still = tf.Stepping(step_max=0.02, output_every=0.1, quasi_static=True)
        run = tf.Simulation(model, {}, still, tf.Tolerances.of("tight", penetration=penetration)).run({}, 0.1)
        deepest.append(run.contact["floor"]["penetration"][-1])
    assert deepest[0] > 4e-6
    assert deepest[1] == pytest.approx(deepest[2], rel=1e-6)
    assert deepest[1] < 2e-6


def test_forces_on_the_supports_count(block: tf.TongueMesh) -> None:
    """Under a load that does not change, an equilibrium needs no more iterations."""
    model = tf.Model(block, tf.Tissue.buchaillard(), fixed=["left"], gravity=(0.0, 0.0, -9.81))
    still = tf.Stepping(step_max=0.05, output_every=1.0, quasi_static=True)
    newton: list[int] = []
    tf.Simulation(model, {}, still).run({}, 0.4, report=lambda now: newton.append(now.newton))
    assert min(newton[:2]) > 0
    assert newton[-4:] == [0, 0, 0, 0]


def test_within_one_percent() -> None:
    """The beam moves as with tight tolerances at a quarter of the step."""
    quarter = {"solver": {"accuracy": "tight"}, "time": {"end": 0.15, "step": tf.Tolerances.step / 4}}
    default, fine = (simulation(0.15, probes={"end": [0.04, 0.005, 0.005]}, **tables).run({}, 0.15) for tables in ({}, quarter))
    at_the_same_times = [np.interp(default.time, fine.time, column) for column in fine.probes["end"].T]
    error = abs(default.probes["end"] - np.transpose(at_the_same_times)).max() / abs(fine.probes["end"]).max()
    assert 0 < error < 0.01
    assert default.summary["newton_iterations"] < 0.4 * fine.summary["newton_iterations"]
