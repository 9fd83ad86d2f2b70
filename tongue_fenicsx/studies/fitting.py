# SPDX-License-Identifier: MIT
"""Which activations make a movement: a bounded fit with the gradients of whole runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import minimize

from ..core.errors import InputError, SolveError
from ..core.types import Floats
from ..geometry.rigid_motion import RigidMotion
from ..mechanics.activation import Activation, Course
from ..mechanics.control import OpenLoop
from ..reduced.tongue import ReducedTongue
from ..runs.run import Run
from ..simulation.simulation import Simulation, resolve_sides
from .goals import Goal, Goals, Track, Within

GUESS_STEP, NUDGE = 0.025, 1e-5
"""Of a search with the reduced tongue: steps in s, and by how much a level is moved to see what that does."""
GUESSES, INNER, SHARES, ENOUGH, LEAST = 20, 200, (1.0, 0.5, 0.25, 0.1), 1e-3, 0.03
"""Of Gauss–Newton: iterations at most, those of the problem that is linear in displacements, shares of a step that are tried with the
reduced tongue, the share of the value below which less is no gain, and the least share of a step that is tried with the full one."""
OPENED, OPENING = 0.05, "opening"
"""The share of the greatest angle by which an opening is moved to see what that does, and the name of that number."""
NEAR = 2e-3
"""In m: how far a probe may be from a node of the reduced tongue."""


@dataclass(frozen=True)
class Opening:
    """A bone that is opened by an angle which is found with the levels: reached in `rise` seconds, then held.

    Attributes
    ----------
    bone : str
        That moves in the model, and with it the obstacles that move as it does.
    motion : RigidMotion
        About the axis of this one, by other angles.
    rise : float
        In s.
    most : float
        Greatest angle in degrees; the least is 0.
    """

    bone: str
    motion: RigidMotion
    rise: float
    most: float

    def motion_by(self, angle: float) -> RigidMotion:
        """Of an angle in degrees."""
        return replace(self.motion, angle=[(self.rise, 0.0, float(angle))])

    def move(self, simulation: Simulation, angle: float) -> None:
        """Let a simulation open by an angle in degrees."""
        model, motion = simulation.model, self.motion_by(angle)
        before = model.moving[self.bone]
        contacts = {
            name: replace(contact, motion=motion) if contact.motion == before else contact for name, contact in model.contacts.items()
        }
        simulation.model = replace(model, moving={**model.moving, self.bone: motion}, contacts=contacts)


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
    angle : float
        In degrees, of an `Opening`.
    """

    knots: Floats
    levels: dict[str, Floats]
    distance: dict[str, float]
    objective: float
    evaluations: int
    reason: str = ""
    hold: bool = False
    angle: float = 0.0

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
    bounds : mapping
        Muscle to its least and greatest level, where they are not 0 and `most`: with a least one, antagonists pull together.
    effort, haste : float
        Weights in mm².
    opening : Opening, optional
        Its angle, as a share of the greatest, is the last of the numbers.
    weights : mapping
        Name to how much a goal counts in the mean, 1 without.

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
    opening: Opening | None = None
    weights: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)

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
        """How many numbers are sought: of the levels, and of an opening."""
        return len(self.muscles) * (1 if self.hold else len(self.knots) - 1) + (self.opening is not None)

    @property
    def names(self) -> list[str]:
        """Of the numbers: muscle and knot, and `OPENING`."""
        knots = [len(self.knots) - 1] if self.hold else range(1, len(self.knots))
        return [f"{name}-{k}" for name in self.muscles for k in knots] + [OPENING] * (self.opening is not None)

    @property
    def limits(self) -> tuple[Floats, Floats]:
        """The least and greatest numbers."""
        each = [self.bounds.get(name, (0.0, self.most)) for name in self.muscles]
        low, high = np.repeat(each, 1 if self.hold else len(self.knots) - 1, axis=0).T
        return (low, high) if self.opening is None else (np.append(low, 0.0), np.append(high, 1.0))

    def moved(self, found: Fit, x: Floats) -> Fit:
        """A fit with other numbers."""
        return replace(found, levels=dict(zip(self.muscles, self.levels(x), strict=True)), angle=self.angle(x))

    def goals(self) -> Goals:
        """The goals, of a run that is to begin."""
        return Goals(self.each, self.since, self.end, self.weights)

    def levels(self, x: Floats) -> Floats:
        """Levels (n_muscles, n_knots) from numbers."""
        x = x if self.opening is None else x[:-1]
        free = np.repeat(x[:, None], len(self.knots) - 1, axis=1) if self.hold else x.reshape(len(self.muscles), -1)
        return np.column_stack([np.zeros(len(self.muscles)), free])

    def angle(self, x: Floats) -> float:
        """The opening in degrees from numbers."""
        return 0.0 if self.opening is None else float(self.opening.most * x[-1])

    def begin(self, start: Mapping[str, Floats], angle: float = 0.0) -> Floats:
        """Numbers within the limits of levels (n_knots,) of muscles and an angle in degrees to begin with; other muscles begin at 0.1."""
        levels = np.array([start.get(name, np.full(len(self.knots), 0.1)) for name in self.muscles])
        x = levels[:, -1] if self.hold else levels[:, 1:].ravel()
        return np.asarray(np.clip(x if self.opening is None else np.append(x, angle / self.opening.most), *self.limits))

    def check(self, probes: Mapping[str, Floats]) -> None:
        """Refuse probes without one of the goals', with an `InputError`."""
        for goal in self.each.values():
            if isinstance(goal, Track | Within) and goal.probe not in probes:
                raise InputError(f"fit: no probe {goal.probe!r}; the simulation follows {', '.join(probes)}.")

    def numbers_from(self, by_levels: Floats) -> Floats:
        """Derivatives by the numbers from those by the levels."""
        by = by_levels[:, 1:].sum(axis=1) if self.hold else by_levels[:, 1:].ravel()
        return np.asarray(by if self.opening is None else np.append(by, 0.0))

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
        low, high = self.limits
        bounds = list(zip(low, high, strict=True))
        return minimize(function, begin, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": iterations})


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
        If a goal needs a probe that is not followed, a muscle is not in the mesh, or an opening is sought, which has no gradient.
    SolveError
        If a run fails.
    """
    if search.opening is not None:
        raise InputError('fit: an opening is found with begin = "live" and iterations = 0 only.')
    given, muscles = dict(given or {}), search.muscles
    search.check(simulation.probes.rest)
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

    done = search.least(evaluate, search.begin(start or {}), iterations)
    assert found is not None
    return replace(found, evaluations=evaluations, reason=str(done.message))


@dataclass(frozen=True)
class Surrogate:
    """A reduced tongue in place of the simulation, for a search that takes seconds.

    Attributes
    ----------
    tongue : ReducedTongue
        Of the same rest shape; muscles that it does not have stay at rest.
    search : Search
        What is sought.
    probes : mapping
        Of the goals: name to point (3,) of the rest shape in m.

    Raises
    ------
    InputError
        If the reduced tongue is of another shape, or a goal needs a probe that is not among these.
    """

    tongue: ReducedTongue
    search: Search
    probes: Mapping[str, Floats]

    def __post_init__(self) -> None:
        self.search.check(self.probes)
        if self._apart.min(axis=1).max() > NEAR:
            raise InputError('fit: begin: the reduced tongue has another shape than this one; "flat" is expected.')

    @cached_property
    def _apart(self) -> Floats:
        return np.array([np.linalg.norm(self.tongue.points - point, axis=1) for point in self.probes.values()])

    @cached_property
    def times(self) -> Floats:
        """Times (n,) in s of its steps, from 0 on."""
        return np.linspace(0.0, self.search.end, int(np.ceil(self.search.end / GUESS_STEP - 1e-9)) + 1)

    def displacement(self, tried: Sequence[Floats]) -> Floats:
        """Displacement (n_tried, n_times, n_probes, 3) in m with several levels (n_muscles, n_knots)."""
        tongue, search = self.tongue, self.search
        courses: dict[str, Floats] = dict.fromkeys(tongue.muscles, np.zeros((len(self.times), len(tried))))
        for name, levels in zip(search.muscles, np.swapaxes(tried, 0, 1), strict=True):
            courses[name] = np.transpose([np.interp(self.times, search.knots, level) for level in levels])
        return tongue.displacement(tongue.sequences(self.times, tongue.inputs(courses)), self._apart.argmin(axis=1)).swapaxes(0, 1)

    def slopes(self, x: Floats) -> Floats:
        """Derivatives (n, n_times, n_probes, 3) of the displacement by the numbers (n,)."""
        here, *beside = self.displacement([self.search.levels(y) for y in (x, *(x + NUDGE * np.eye(len(x))))])
        return np.asarray((np.array(beside) - here) / NUDGE)

    def value(self, x: Floats, u: Floats) -> tuple[float, Floats, Floats]:
        """What is sought the least of, with displacements (n_times, n_probes, 3), and its derivatives by the numbers (n,) of the levels and
        by these."""
        of, by_u = self.search.goals(), np.zeros_like(u)
        total, by_levels = self.search.cost(self.search.levels(x))
        for i, h in enumerate(np.diff(self.times), 1):
            added, pull = of(self.times[i], h, dict(zip(self.probes, u[i], strict=True)))
            total += added
            for p, name in enumerate(self.probes):
                by_u[i, p] = pull.get(name, 0.0)
        return total, self.search.numbers_from(by_levels), by_u

    def along(self, run: Run) -> Floats:
        """Displacement (n_times, n_probes, 3) in m of the probes in a run."""
        return np.stack([np.column_stack([np.interp(self.times, run.time, u) for u in run.probes[name].T]) for name in self.probes], axis=1)

    def step(self, x: Floats, u: Floats, slopes: Floats) -> Floats:
        """Numbers that would be best if displacements went on from `u` at `x` with `slopes` (n, n_times, n_probes, 3) by each
        (Gauss–Newton)."""

        def value(y: Floats) -> tuple[float, Floats]:
            total, by, by_u = self.value(y, u + np.tensordot(y - x, slopes, axes=1))
            return total, by + np.tensordot(slopes, by_u, axes=3)

        return np.asarray(self.search.least(value, x, INNER).x)


def guess(surrogate: Surrogate, tries: int = 3, seed: int = 0) -> dict[str, Floats]:
    """Levels with which a reduced tongue reaches goals best, of `tries` searches from levels at random; for a fit to begin with."""
    search, random = surrogate.search, np.random.default_rng(seed)

    def at(x: Floats) -> tuple[float, Floats]:
        (u,) = surrogate.displacement([search.levels(x)])
        return surrogate.value(x, u)[0], u

    found = []
    for _ in range(tries):
        low, high = search.limits
        x = low + random.uniform(0, (high - low) / 2) * (random.random(search.size) < 0.5)
        if search.opening is not None:
            x[-1] = 0.0  # of which the reduced tongue does not know
        value, u = at(x)
        for _ in range(GUESSES):
            way = surrogate.step(x, u, surrogate.slopes(x)) - x
            better = ((x + share * way, *at(x + share * way)) for share in SHARES)
            y, lower, moved = next((tried for tried in better if tried[1] < value), (x, value, u))
            if value - lower < ENOUGH * value:
                break
            x, value, u = y, lower, moved
        found.append((value, x))
    return dict(zip(search.muscles, search.levels(min(found, key=lambda one: one[0])[1]), strict=True))


def correct(
    simulation: Simulation,
    surrogate: Surrogate,
    start: Mapping[str, Floats],
    *,
    given: Mapping[str, Course] | None = None,
    angle: float = 0.0,
    rounds: int = 6,
    slopes: Floats | None = None,
    report: Callable[[Fit], object] | None = None,
) -> Fit:
    """Gauss–Newton with what the full tongue does and how the reduced one says that it would change: a run a round, without a gradient.
    Where that is worse, or fails, a third of the step is tried. What an opening would change a second run says.

    Parameters
    ----------
    simulation : Simulation
        As of `fit`.
    surrogate : Surrogate
        Of its probes.
    start : mapping
        As of `fit`.
    given : mapping, optional
        Activations of other muscles, which stay.
    angle : float
        In degrees, of an opening to begin with.
    rounds : int
        At most.
    slopes : (n, n_times, n_probes, 3) array, optional
        How it would change, from runs of the full tongue, for all rounds.
    report : callable, optional
        Takes the best so far, whenever it is better.

    Raises
    ------
    InputError
        If a muscle is not in the mesh.
    SolveError
        If the first run fails.
    """
    search, opening = surrogate.search, surrogate.search.opening

    def follow(x: Floats) -> Run:
        if opening is not None:
            opening.move(simulation, search.angle(x))
        named = dict(zip(search.muscles, search.levels(x), strict=True))
        return simulation.run(dict(given or {}) | courses(search.knots, named), search.end)

    best: Fit | None = None
    x = tried = search.begin(start, angle)
    way, share = np.zeros(search.size), 1.0
    for evaluations in range(1, rounds + 1):
        levels, of = search.levels(tried), search.goals()
        value = search.cost(levels)[0]
        try:
            run = follow(tried)
            for i, h in enumerate(np.diff(run.time), 1):
                value += of(run.time[i], h, {name: u[i] for name, u in run.probes.items()})[0]
        except SolveError:
            if best is None:
                raise
            value = np.inf
        if best is None or value < best.objective:
            share = 1.0 if best is None else min(2 * share, 1.0)
            named = dict(zip(search.muscles, levels, strict=True))
            best = Fit(search.knots, named, of.distance, value, evaluations, hold=search.hold, angle=search.angle(tried))
            if report is not None:
                report(best)
            x, u = tried, surrogate.along(run)
            by = surrogate.slopes(x) if slopes is None else slopes
            if opening is not None and slopes is None:
                nudge = OPENED if x[-1] < 0.5 else -OPENED
                by[-1] = (surrogate.along(follow(np.append(x[:-1], x[-1] + nudge))) - u) / nudge
            way = surrogate.step(x, u, by) - x
        elif (share := share / 3) < LEAST:
            break
        tried = x + share * way
    assert best is not None
    reason = "the rounds are over" if share >= LEAST else "no step that these derivatives know is better"
    return replace(best, evaluations=evaluations, reason=reason)


def following(simulation: Simulation, goals: Mapping[str, Goal]) -> Simulation:
    """A simulation that follows the probes of goals too."""
    more = {name: point for goal in goals.values() for name, point in goal.points.items()}
    return Simulation(simulation.model, simulation.probes.rest | more, simulation.stepping, simulation.tolerances) if more else simulation
