# SPDX-License-Identifier: MIT
"""What data leave open: how far from the levels of a fit others could be that the data would not tell apart."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import SolveError
from ..core.types import Floats
from ..runs.run import Run
from .fitting import Fit, Surrogate
from .goals import Track

MOVED = 0.05
"""By how much a level is moved, toward the middle of what it may be."""
BEFORE = 1 / 12
"""Variance of a level of which nothing is known but that it is from 0 to 1."""
DETERMINED, OPEN = 0.05, 0.2
"""Standard deviations of a combination of levels up to which data determine it, and from which they leave it open: before any data it
is 0.29."""
SAID = 0.35
"""Levels that are named in a combination have at least this share in it."""


@dataclass(frozen=True)
class Openness:
    """How sure the levels of a fit are.

    Attributes
    ----------
    knots : (n,) array
        Times in s of the levels, without that at rest.
    levels, deviations : dict
        Muscle to its levels (n,), and to their standard deviations given the data.
    combinations : list of (float, dict)
        Standard deviation, and muscle to shares (n,), of combinations of levels that are independent of each other, the least certain
        first; the squares of all shares add to one.
    noise : float
        Of the data in mm, of each coordinate; or what is left of it in the fit, if that is more.
    """

    knots: Floats
    levels: dict[str, Floats]
    deviations: dict[str, Floats]
    combinations: list[tuple[float, dict[str, Floats]]]
    noise: float

    def interval(self, muscle: str) -> tuple[Floats, Floats]:
        """Lowest and highest levels (n,) within two standard deviations."""
        reach = 2 * self.deviations[muscle]
        return np.clip(self.levels[muscle] - reach, 0, 1), np.clip(self.levels[muscle] + reach, 0, 1)

    @property
    def determined(self) -> int:
        """How many combinations the data determine."""
        return sum(deviation <= DETERMINED for deviation, _ in self.combinations)

    def open_ones(self) -> list[str]:
        """The combinations that the data leave open, in words."""
        words = []
        for deviation, shares in self.combinations:
            if deviation >= OPEN:
                parts = [
                    f"{'+' if share > 0 else '−'} {name} at {1e3 * t:.0f} ms"
                    for name, along in shares.items()
                    for t, share in zip(self.knots, along, strict=True)
                    if abs(share) >= SAID
                ]
                words.append(f"{' '.join(parts) or 'a mixture of many'} (± {2 * deviation:.2f})")
        return words

    def write(self, path: Path) -> None:
        """Write a line for each level, with its interval."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["muscle", "time_s", "level", "low", "high", "standard_deviation"])
            for name, levels in self.levels.items():
                for row in zip(self.knots, levels, *self.interval(name), self.deviations[name], strict=True):
                    writer.writerow([name, *(f"{value:.6g}" for value in row)])


def nearby(found: Fit) -> Iterator[tuple[str, dict[str, Floats]]]:
    """Name and levels of a fit, one of them moved; of a posture that is held, one muscle's."""
    for name, levels in found.levels.items():
        for i in [len(levels) - 1] if found.hold else range(1, len(levels)):
            moved = levels.copy()
            moved[1 if found.hold else i : i + 1] += MOVED if levels[i] <= 0.5 else -MOVED
            yield f"{name}-{i}", {**found.levels, name: moved}


def openness(found: Fit, paths: Mapping[str, Track], noise: float, slopes: Floats) -> Openness:
    """What the data say about each level: the curvature of their misfit (Gauss–Newton).

    Every coordinate of every point at every time that the tables have is taken as a measurement of its own.

    Parameters
    ----------
    found : Fit
        The levels.
    paths : mapping
        Probe to its path.
    noise : float
        Standard deviation of the data in mm; what is left in the fit is taken instead if that is more.
    slopes : (n_levels, n_measurements) array
        Derivatives in mm, from `by_runs` or `by_reduced`.
    """
    left = np.sqrt(np.mean(np.square([found.distance[name] for name in paths])) / 3)
    noise = max(noise, float(left))
    covariance = np.linalg.inv(slopes @ slopes.T / noise**2 + np.eye(len(slopes)) / BEFORE)
    variances, vectors = np.linalg.eigh(covariance)

    def by_muscle(values: Floats) -> dict[str, Floats]:
        return dict(zip(found.levels, values.reshape(len(found.levels), -1), strict=True))

    free = slice(-1 if found.hold else 1, None)
    return Openness(
        found.knots[free],
        {name: levels[free] for name, levels in found.levels.items()},
        by_muscle(np.sqrt(np.diag(covariance))),
        [(float(np.sqrt(variance)), by_muscle(vector)) for variance, vector in zip(variances[::-1], vectors.T[::-1], strict=True)],
        noise,
    )


def by_runs(found: Fit, paths: Mapping[str, Track], run: Run, moved: Mapping[str, Run | SolveError]) -> Floats:
    """Derivatives of all measurements by each level, from the `run` of a fit and those of `nearby`.

    Raises
    ------
    SolveError
        If one of them failed.
    """
    place = _measured(paths, run.time, run.probes)
    columns = []
    for name, levels in nearby(found):
        beside = moved[name]
        if isinstance(beside, SolveError):
            raise beside
        step = sum(float((levels[muscle] - found.levels[muscle])[-1 if found.hold else slice(None)].sum()) for muscle in levels)
        columns.append((_measured(paths, beside.time, beside.probes) - place) / step)
    return np.array(columns)


def by_reduced(found: Fit, paths: Mapping[str, Track], surrogate: Surrogate) -> Floats:
    """The same as a reduced tongue has them, at once; its probes are the points that have paths."""
    moved = surrogate.slopes(surrogate.search.begin(found.levels))
    return np.array([_measured(paths, surrogate.times, dict(zip(surrogate.probes, u.swapaxes(0, 1), strict=True))) for u in moved])


def _measured(paths: Mapping[str, Track], time: Floats, displacement: Mapping[str, Floats]) -> Floats:
    """Coordinates in mm of probes, which have displacements (n_t, 3) in m at times, at the times of their paths, flat."""
    parts = []
    for name, path in paths.items():
        times = path.times[(path.times > 0) & (path.times <= time[-1] + 1e-9)]
        parts += [np.interp(times, time, along) for along in displacement[name].T]
    return np.asarray(1e3 * np.concatenate(parts))
