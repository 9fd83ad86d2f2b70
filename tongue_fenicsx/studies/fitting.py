# SPDX-License-Identifier: MIT
"""Which activations make a movement: a bounded fit with the gradients of whole runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

from ..core.errors import InputError
from ..core.types import Floats
from ..mechanics.activation import Activation, Course
from ..mechanics.control import OpenLoop
from ..simulation.simulation import Simulation, resolve_sides


@dataclass(frozen=True)
class Track:
    """Where a probe should be.

    Attributes
    ----------
    times : (n,) array
        In s, growing; before and after, the first and the last displacement count.
    displacement : (n, 3) array
        In m, from rest.
    """

    times: Floats
    displacement: Floats

    def __post_init__(self) -> None:
        times, displacement = np.asarray(self.times, dtype=float), np.asarray(self.displacement, dtype=float)
        if times.ndim != 1 or displacement.shape != (len(times), 3) or not (np.diff(times) > 0).all():
            raise InputError(
                f"fit: a path of shape {displacement.shape} at {times.shape} times; growing times (n,) and (n, 3) are expected."
            )
        if not (np.isfinite(times).all() and np.isfinite(displacement).all()):
            raise InputError("fit: a path with numbers that are not finite; take them out, the path is straight between the others.")

    def at(self, t: float) -> Floats:
        """Displacement (3,) in m at a time in s."""
        return np.array([np.interp(t, self.times, along) for along in np.transpose(self.displacement)])


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
        Probe to the root mean square over time, in mm, of how far it is from its path.
    objective : float
        Mean square distance in mm² with what effort and haste cost.
    evaluations : int
        Runs with a gradient.
    reason : str
        Why the search ended.
    """

    knots: Floats
    levels: dict[str, Floats]
    distance: dict[str, float]
    objective: float
    evaluations: int
    reason: str = ""

    @property
    def activation(self) -> dict[str, Course]:
        """As `Simulation.run` takes it."""
        return courses(self.knots, self.levels)


def courses(knots: Floats, levels: Mapping[str, Floats]) -> dict[str, Course]:
    """Activations that are straight between knots."""
    return {name: Activation(list(zip(np.diff(knots), at[:-1], at[1:], strict=True))) for name, at in levels.items()}


@dataclass
class _Distance:
    """Mean square distance in mm² of probes from their paths, over time and probes; an `Objective`."""

    paths: Mapping[str, Track]
    end: float
    of: dict[str, float] = field(default_factory=dict)

    def __call__(self, t: float, h: float, probes: Mapping[str, Floats]) -> tuple[float, Mapping[str, Floats]]:
        share, added, by = h / self.end / len(self.paths), 0.0, {}
        for name, path in self.paths.items():
            away = 1e3 * (probes[name] - path.at(t))
            square = float(away @ away)
            self.of[name] = self.of.get(name, 0.0) + h / self.end * square
            added += share * square
            by[name] = 2e3 * share * away
        return added, by


def fit(
    simulation: Simulation,
    paths: Mapping[str, Track],
    muscles: Sequence[str],
    knots: Floats,
    *,
    effort: float = 1e-2,
    haste: float = 1e-2,
    given: Mapping[str, Course] | None = None,
    start: Mapping[str, Floats] | None = None,
    iterations: int = 30,
    report: Callable[[Fit], object] | None = None,
) -> Fit:
    """Activations, from 0 to 1 and at rest at the first knot, that take probes along paths (L-BFGS-B: Byrd, Lu, Nocedal and Zhu 1995).

    What is least is the mean square distance in mm² of the probes from their paths, plus `effort` times the mean square level and `haste`
    times the mean square rate (1/s) times the square of a tenth of a second.

    Parameters
    ----------
    simulation : Simulation
        Of steps of given length.
    paths : mapping
        Of probes.
    muscles : sequence of str
        Those that may act: with sides, or both sides by their common name.
    knots : (n,) array
        Times in s, from 0 to the end.
    effort, haste : float
        Weights in mm².
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
        If a path is of no probe, a muscle is not in the mesh or the knots do not grow from 0.
    SolveError
        If a run fails.
    """
    knots = np.asarray(knots, dtype=float)
    if knots.ndim != 1 or len(knots) < 2 or knots[0] != 0 or not (np.diff(knots) > 0).all():
        raise InputError("fit: knots: times in s that grow from 0 are expected, at least two.")
    for name in paths:
        if name not in simulation.probes.names:
            raise InputError(f"fit: no probe {name!r}; the simulation follows {', '.join(simulation.probes.names)}.")
    given = dict(given or {})
    resting = courses(knots, {name: np.zeros(len(knots)) for name in muscles})
    sides = resolve_sides(OpenLoop(given | resting), simulation.model)
    end, n = float(knots[-1]), len(knots) - 1
    begin = np.array([(start[name] if start and name in start else np.full(n + 1, 0.1))[1:] for name in muscles])
    best, evaluations = np.inf, 0
    found: Fit | None = None

    def evaluate(x: Floats) -> tuple[float, Floats]:
        nonlocal best, evaluations, found
        levels = np.column_stack([np.zeros(len(muscles)), x.reshape(len(muscles), n)])
        distance = _Distance(paths, end)
        gradient = simulation.gradient(distance, given | courses(knots, dict(zip(muscles, levels, strict=True))), end)
        by = np.array([sum(gradient.by_knots(side, knots) for side in sides[name]) for name in muscles])
        rate = np.diff(levels, axis=1) / np.diff(knots) * 0.1
        value = gradient.value + effort * float((levels**2).mean()) + haste * float((rate**2).mean())
        by += 2 * effort * levels / levels.size
        slope = 2 * haste * rate / rate.size / np.diff(knots) * 0.1
        by[:, 1:] += slope
        by[:, :-1] -= slope
        evaluations += 1
        if value < best:
            best = value
            away = {name: float(np.sqrt(of)) for name, of in distance.of.items()}
            found = Fit(knots, dict(zip(muscles, levels, strict=True)), away, value, evaluations)
            if report is not None:
                report(found)
        return value, by[:, 1:].ravel()

    done = minimize(evaluate, begin.ravel(), jac=True, method="L-BFGS-B", bounds=[(0, 1)] * begin.size, options={"maxiter": iterations})
    assert found is not None
    return Fit(found.knots, found.levels, found.distance, found.objective, evaluations, str(done.message))
