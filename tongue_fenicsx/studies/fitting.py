# SPDX-License-Identifier: MIT
"""Which activations make a movement: a bounded fit with the gradients of whole runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from ..core.errors import InputError
from ..core.types import Floats
from ..mechanics.activation import Activation, Course
from ..mechanics.control import OpenLoop
from ..reduced.tongue import ReducedTongue
from ..simulation.simulation import Simulation, resolve_sides
from .goals import Goal, Goals, Track, Within

GUESS_STEP, GUESS_ITERATIONS, NUDGE = 0.025, 60, 1e-5
"""Of a search with the reduced tongue: steps in s, iterations, and by how much a level is moved to see what that does."""
NEAR = 2e-3
"""In m: how far a probe may be from a node of the reduced tongue."""


@dataclass(frozen=True)
class Fit:
    """What a fit found.

    Attributes
    ----------
    knots : (n,) array
        Times in s between which activations are straight.
    levels : dict
        Muscle to its levels (n,) at the knots.
    distance : dict
        Goal to the root mean square over time, in mm, of how far it is missed.
    objective : float
        Mean square distance in mm² with what effort and haste cost.
    evaluations : int
        Runs with a gradient.
    reason : str
        Why the search ended.
    hold : bool
        Whether each muscle has one level, from the second knot on.
    """

    knots: Floats
    levels: dict[str, Floats]
    distance: dict[str, float]
    objective: float
    evaluations: int
    reason: str = ""
    hold: bool = False

    @property
    def activation(self) -> dict[str, Course]:
        """As `Simulation.run` takes it."""
        return courses(self.knots, self.levels)


def courses(knots: Floats, levels: Mapping[str, Floats]) -> dict[str, Course]:
    """Activations that are straight between knots."""
    return {name: Activation(list(zip(np.diff(knots), at[:-1], at[1:], strict=True))) for name, at in levels.items()}


@dataclass(frozen=True)
class Search:
    """What a fit looks for: the least of the mean square distance in mm² from goals, plus `effort` times the mean square level and `haste`
    times the mean square rate (1/s) times the square of a tenth of a second.

    Attributes
    ----------
    each : mapping
        Name to goal.
    muscles : sequence of str
        Those that may act: with sides, or both sides by their common name.
    knots : (n,) array
        Times in s, from 0 to the end, between which activations are straight; at the first all are at rest.
    hold : bool
        Each muscle has one level, from the second knot on.
    since : float
        Time in s from which on the goals count.
    most : float
        Greatest level.
    effort, haste : float
        Weights in mm².

    Raises
    ------
    InputError
        If the knots do not grow from 0 to after `since`.
    """

    each: Mapping[str, Goal]
    muscles: Sequence[str]
    knots: Floats
    hold: bool = False
    since: float = 0.0
    most: float = 1.0
    effort: float = 1e-2
    haste: float = 1e-2

    def __post_init__(self) -> None:
        knots = np.asarray(self.knots, dtype=float)
        if knots.ndim != 1 or len(knots) < 2 or knots[0] != 0 or not (np.diff(knots) > 0).all():
            raise InputError("fit: knots: times in s that grow from 0 are expected, at least two.")
        if not 0 <= self.since < knots[-1]:
            raise InputError(f"fit: since: {self.since:g} s; a time before the end, {knots[-1]:g} s, is expected.")
        object.__setattr__(self, "knots", knots)

    @property
    def end(self) -> float:
        """In s."""
        return float(self.knots[-1])

    @property
    def size(self) -> int:
        """Of how many numbers the levels are made."""
        return len(self.muscles) * (1 if self.hold else len(self.knots) - 1)

    def goals(self) -> Goals:
        """The goals, of a run that is to begin."""
        return Goals(self.each, self.since, self.end)

    def levels(self, x: Floats) -> Floats:
        """Levels (n_muscles, n_knots) from numbers."""
        free = np.repeat(x[:, None], len(self.knots) - 1, axis=1) if self.hold else x.reshape(len(self.muscles), -1)
        return np.column_stack([np.zeros(len(self.muscles)), free])

    def numbers(self, levels: Floats) -> Floats:
        """The other way round."""
        return np.asarray(levels[:, -1] if self.hold else levels[:, 1:].ravel())

    def numbers_from(self, by_levels: Floats) -> Floats:
        """Derivatives by the numbers from those by the levels."""
        return np.asarray(by_levels[:, 1:].sum(axis=1) if self.hold else by_levels[:, 1:].ravel())

    def cost(self, levels: Floats) -> tuple[float, Floats]:
        """Of effort and haste, and its derivatives by the levels."""
        rate = np.diff(levels, axis=1) / np.diff(self.knots) * 0.1
        slope = 2 * self.haste * rate / rate.size / np.diff(self.knots) * 0.1
        by = 2 * self.effort * levels / levels.size
        by[:, 1:] += slope
        by[:, :-1] -= slope
        return self.effort * float((levels**2).mean()) + self.haste * float((rate**2).mean()), by

    def least(self, function: Callable[[Floats], Any], begin: Floats, iterations: int) -> Any:
        """The search itself, with a function's value and its derivatives."""
        bounds = [(0.0, self.most)] * len(begin)
        return minimize(function, begin.clip(0, self.most), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": iterations})


def fit(
    simulation: Simulation,
    search: Search,
    *,
    given: Mapping[str, Course] | None = None,
    start: Mapping[str, Floats] | None = None,
    iterations: int = 30,
    report: Callable[[Fit], object] | None = None,
) -> Fit:
    """Activations that reach goals (L-BFGS-B: Byrd, Lu, Nocedal and Zhu 1995), with the gradients of whole runs.

    Parameters
    ----------
    simulation : Simulation
        Of steps of given length; it follows the probes of all goals (see `following`).
    search : Search
        What is sought.
    given : mapping, optional
        Activations of other muscles, which stay.
    start : mapping, optional
        Levels (n,) of muscles to begin with; without, all begin at 0.1.
    iterations : int
        At most.
    report : callable, optional
        Takes the best so far, whenever it is better.

    Raises
    ------
    InputError
        If a goal needs a probe that is not followed, or a muscle is not in the mesh.
    SolveError
        If a run fails.
    """
    given, muscles = dict(given or {}), search.muscles
    for goal in search.each.values():
        if isinstance(goal, Track | Within) and goal.probe not in simulation.probes.names:
            raise InputError(f"fit: no probe {goal.probe!r}; the simulation follows {', '.join(simulation.probes.names)}.")
    resting = courses(search.knots, {name: np.zeros(len(search.knots)) for name in muscles})
    sides = resolve_sides(OpenLoop(given | resting), simulation.model)
    best, evaluations = np.inf, 0
    found: Fit | None = None

    def evaluate(x: Floats) -> tuple[float, Floats]:
        nonlocal best, evaluations, found
        levels, of = search.levels(x), search.goals()
        named = dict(zip(muscles, levels, strict=True))
        gradient = simulation.gradient(of, given | courses(search.knots, named), search.end)
        by = np.array([sum(gradient.by_knots(side, search.knots) for side in sides[name]) for name in muscles])
        cost, by_cost = search.cost(levels)
        evaluations += 1
        if (value := gradient.value + cost) < best:
            best = value
            found = Fit(search.knots, named, of.distance, value, evaluations, hold=search.hold)
            if report is not None:
                report(found)
        return value, search.numbers_from(by + by_cost)

    begin = search.numbers(np.array([(start or {}).get(name, np.full(len(search.knots), 0.1)) for name in muscles]))
    done = search.least(evaluate, begin, iterations)
    assert found is not None
    return replace(found, evaluations=evaluations, reason=str(done.message))


def guess(tongue: ReducedTongue, search: Search, probes: Mapping[str, Floats], tries: int = 3, seed: int = 0) -> dict[str, Floats]:
    """Levels with which a reduced tongue reaches goals best, of several searches from levels at random; for a fit to begin with.

    Parameters
    ----------
    tongue : ReducedTongue
        Of the same rest shape; muscles that it does not have stay at rest.
    search : Search
        What is sought.
    probes : mapping
        Of the goals: name to point (3,) of the rest shape in m.
    tries : int
        Searches.
    seed : int
        Of the levels that they begin with.

    Raises
    ------
    InputError
        If the reduced tongue is of another shape.
    """
    apart = np.array([np.linalg.norm(tongue.points - point, axis=1) for point in probes.values()])
    if apart.min(axis=1).max() > NEAR:
        raise InputError('fit: begin: the reduced tongue has another shape than this one; "flat" is expected.')
    nodes = apart.argmin(axis=1)
    times = np.linspace(0.0, search.end, int(np.ceil(search.end / GUESS_STEP - 1e-9)) + 1)
    counts = np.flatnonzero(times > search.since)
    lasting = np.diff(times)[counts - 1]
    column = [tongue.muscles.index(name) if name in tongue.muscles else None for name in search.muscles]

    def value(x: Floats) -> tuple[float, Floats]:
        of, tried = search.goals(), [search.levels(y) for y in (x, *(x + NUDGE * np.eye(len(x))))]
        course = np.zeros((len(times), len(tried), len(tongue.muscles)))
        for run, levels in enumerate(tried):
            for at, level in zip(column, levels, strict=True):
                if at is not None:
                    course[:, run, at] = np.interp(times, search.knots, level)
        u = tongue.displacement(tongue.sequences(times, course)[counts], nodes)
        slopes = (u[:, 1:] - u[:, :1]) / NUDGE
        total, by_cost = search.cost(tried[0])
        by = search.numbers_from(by_cost)
        for t, h, at, slope in zip(times[counts], lasting, u[:, 0], slopes, strict=True):
            added, pull = of(t, h, dict(zip(probes, at, strict=True)))
            total += added
            by += sum(slope[:, i] @ pull[name] for i, name in enumerate(probes) if name in pull)
        return total, by

    random = np.random.default_rng(seed)
    n = search.size
    begins = random.uniform(0, search.most / 2, (tries, n)) * (random.random((tries, n)) < 0.5)
    results = [search.least(value, begin, GUESS_ITERATIONS) for begin in begins]
    return dict(zip(search.muscles, search.levels(min(results, key=lambda done: done.fun).x), strict=True))


def following(simulation: Simulation, goals: Mapping[str, Goal]) -> Simulation:
    """A simulation that follows the probes of goals too."""
    more = {name: point for goal in goals.values() for name, point in goal.points.items()}
    return Simulation(simulation.model, simulation.probes.rest | more, simulation.stepping, simulation.tolerances) if more else simulation
