# SPDX-License-Identifier: MIT
"""Gradients of a whole run: how an objective would change with the activations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..core.types import Floats
from ..solvers.adjoint import Adjoint, Costate
from ..solvers.time_integration import State
from .engine import Engine
from .initial import Initial
from .snapshot import Snapshot

Objective = Callable[[float, float, Mapping[str, Floats]], tuple[float, Mapping[str, Floats]]]
"""Of a step: takes its end and its length in s and the displacement (3,) in m of each probe; returns what the step adds to the objective,
and the derivative (3,) of that by the displacement of each probe that matters."""


@dataclass(frozen=True)
class Gradient:
    """An objective of a run and its derivatives.

    Attributes
    ----------
    value : float
        The objective.
    times : (n + 1,) array
        0 and the end of each step, in s.
    levels : dict
        Muscle, with its side, to the derivatives (n + 1,) by its activation at these times.
    tissue : dict
        Number of the tissue to the derivative by it, of those that were asked for.
    initial : Initial
        The derivatives (n, 3) by the displacement and by the velocity of each node with which the run began, on all ranks; nil where bones
        hold the tongue, and in equilibria.
    """

    value: float
    times: Floats
    levels: dict[str, Floats]
    tissue: dict[str, float] = field(default_factory=dict)
    initial: Initial = field(default_factory=Initial)

    def by_knots(self, muscle: str, knots: Floats) -> Floats:
        """Derivatives (n,) by the levels at knots (n,) in s between which the activation of a muscle (with its side) is straight."""
        hats = np.array([np.interp(self.times, knots, hat) for hat in np.eye(len(knots))])
        return np.asarray(hats @ self.levels[muscle])


class Recorder:
    """Keeps what going back through a run needs; its `step` is to be called after each."""

    def __init__(self, objective: Objective) -> None:
        self._objective = objective
        self.states: list[State] = []
        self.levels: list[Mapping[str, float]] = []
        self.by_probe: list[Mapping[str, Floats]] = []
        self.value = 0.0

    def step(self, now: Snapshot) -> None:
        """Note an accepted state."""
        added, by_probe = self._objective(now.t, now.h, now.probes)
        self.value += added
        self.states.append(now.state)
        self.levels.append(now.levels)
        self.by_probe.append(by_probe)


def go_back(engine: Engine, adjoint: Adjoint, recorded: Recorder, numbers: Sequence[str] = ()) -> Gradient:
    """The gradient of the last run of an engine, which was recorded, also by numbers of the tissue."""
    by_tissue = np.zeros(len(numbers))
    probes, V = engine.probes, engine.weak.V
    start, levels = engine.beginning
    states = [start, *recorded.states]
    nil = np.zeros(3 * V.dofmap.index_map.size_local)
    costate, found = Costate(nil, nil, nil, nil), []
    for before, after, at, by_probe in reversed(list(zip(states, states[1:], recorded.levels, recorded.by_probe, strict=False))):
        rows = np.array([by_probe.get(name, np.zeros(3)) for name in probes.names])
        end = Costate(costate.u + probes.transposed(V, rows), costate.v, costate.acceleration, costate.auxiliary)
        costate, by_level = adjoint.back(end, before, after, at)
        found.append(by_level)
        if numbers:
            by_tissue += adjoint.by_numbers(numbers, before, after, at)
    costate, by_level = adjoint.begin(costate, start, levels)
    found.append(by_level)
    by_level = np.array(found[::-1])
    by_muscle = dict(zip(engine.weak.slots.names, by_level.T, strict=True))
    by_number = dict(zip(numbers, map(float, by_tissue), strict=True))
    initial = Initial.gathered(V, costate.u, costate.v)
    return Gradient(recorded.value, np.array([state.t for state in states]), by_muscle, by_number, initial)
