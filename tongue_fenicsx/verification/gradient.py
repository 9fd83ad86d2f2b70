# SPDX-License-Identifier: MIT
"""Gradients of whole runs against what runs nearby give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from ..core.types import Floats
from ..geometry.obstacles import Plane
from ..mechanics.activation import Activation
from ..mechanics.contact import Contact
from ..mechanics.model import Model
from ..mechanics.tissue import Rayleigh, Tissue
from ..simulation.simulation import Simulation
from ..simulation.stepping import Stepping
from ..solvers.tolerances import Tolerances
from ..testing import Row, box, with_fibres

KNOTS = np.array([0.0, 0.02, 0.05, 0.1])
LEVELS = {"GGP_L": np.array([0.0, 0.5, 0.3, 0.5]), "VERT_L": np.array([0.0, 0.1, 0.7, 0.4])}
DIRECTION = {"GGP_L": np.array([0.0, 0.6, -0.5, 0.9]), "VERT_L": np.array([0.0, -0.7, 0.8, 0.4])}


def gradient() -> Iterator[Row]:
    """A bar with two crossing muscles that shorten and lengthen with force–velocity, free and on a floor: over 20 steps, what is left of a
    change of the objective without its gradient's part is of second order in that of the activations; also in the last of 20 equilibria."""
    cases = ("free", None), ("on a floor, Nitsche", "nitsche"), ("on a floor, penalty", "penalty")
    for name, form, static in [(*case, False) for case in cases] + [(f"{name}, equilibria", form, True) for name, form in cases[:2]]:
        bar = bar_with(form, static)
        rest, by_knot = objective_of(bar, 0.0)
        slope = sum(float(by_knot[muscle] @ direction) for muscle, direction in DIRECTION.items())
        steps = (1e-3, 1.25e-4)
        left = [abs(objective_of(bar, step)[0] - rest - step * slope) for step in steps]
        order = float(np.log(left[0] / left[1]) / np.log(steps[0] / steps[1]))
        yield Row(f"gradient of a run, {name}", "order 2", abs(order - 2), 0.05, f"order {order:.3f}")


def bar_with(form: str | None, static: bool = False) -> Simulation:
    """The bar, with a form of contact or without a floor, in motion or in equilibria."""
    block = with_fibres(box((0.02, 0.01, 0.01), (4, 2, 2)))
    block.muscles["VERT_L"] = with_fibres(block, (0.0, 1.0, 2.0)).muscles["GGP_L"]
    model = Model(
        block, replace(Tissue.calka(), damping=Rayleigh(20.0, 0.005), peak_stress={"GGP": 8e3, "VERT": 3e3}), fixed=["wall"],
        contacts={} if form is None else {"floor": Contact(Plane((0.0, 0.0, -2e-4), (0.0, 0.0, 1.0)), form)},
        gravity=(0.0, 0.0, -9.81), gravity_rise=KNOTS[1] if static else 0.0,
    )  # fmt: skip
    tolerances = Tolerances.of("tight", rtol=1e-9, linear=1e-9, penetration=1e-2)  # deep enough that no step is solved again, and stiffer
    stepping = Stepping(5e-3, output_every=KNOTS[-1], quasi_static=static)
    return Simulation(model, {"end": (0.02, 0.005, 0.005)}, stepping, tolerances)


def objective_of(bar: Simulation, step: float) -> tuple[float, Mapping[str, Floats]]:
    """How far in mm² the end is from a place, over time or in the last equilibrium, and the derivatives by the levels at the knots, at a
    step from the levels."""
    courses = {
        name: Activation(list(zip(np.diff(KNOTS), levels[:-1], levels[1:], strict=True)))
        for name, levels in ((name, levels + step * DIRECTION[name]) for name, levels in LEVELS.items())
    }

    def distance(t: float, h: float, probes: Mapping[str, Floats]) -> tuple[float, Mapping[str, Floats]]:
        away = 1e3 * (probes["end"] - np.array([-1e-3, 0.0, 5e-4]))
        share = h
        if bar.stepping.quasi_static:  # the last one, which does not depend on where steps were cut
            share = KNOTS[-1] if t > KNOTS[-1] - 1e-9 else 0.0
        return share * float(away @ away), {"end": 2e3 * share * away}

    found = bar.gradient(distance, courses, KNOTS[-1])
    return found.value, {name: found.by_knots(name, KNOTS) for name in LEVELS}
