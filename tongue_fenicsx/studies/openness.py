# SPDX-License-Identifier: MIT
"""What data leave open: how far from the levels of a fit others could be that the data would not tell apart."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.types import Floats
from ..runs.run import Run
from .fitting import OPENING, Fit, Opening, Surrogate
from .goals import Track

BEFORE = 1 / 12
"""Variance of a level, or of an opening as a share of the greatest, of which nothing is known but that it is from 0 to 1."""
DETERMINED, OPEN = 0.05, 0.2
"""Standard deviations of a combination of levels up to which data determine it, and from which they leave it open: before any data it
is 0.29."""
SAID = 0.35
"""Levels that are named in a combination have at least this share in it."""


@dataclass(frozen=True)
class Openness:
    """How sure the levels of a fit are, and the opening, if one was found: its name is `OPENING`, its level a share of the greatest.

    Attributes
    ----------
    times : dict
        Muscle to the times (n,) in s of its levels, without that at rest.
    levels, deviations : dict
        Muscle to its levels (n,), and to their standard deviations given the data.
    combinations : list of (float, dict)
        Standard deviation, and muscle to shares (n,), of combinations of levels that are independent of each other, the least certain
        first; the squares of all shares add to one.
    noise : float
        Of the data in mm, of each coordinate; or what is left of it in the fit, if that is more.
    most : float
        The greatest opening in degrees.
    """

    times: dict[str, Floats]
    levels: dict[str, Floats]
    deviations: dict[str, Floats]
    combinations: list[tuple[float, dict[str, Floats]]]
    noise: float
    most: float = 0.0

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
                    for t, share in zip(self.times[name], along, strict=True)
                    if abs(share) >= SAID
                ]
                words.append(f"{' '.join(parts) or 'a mixture of many'} (± {2 * deviation:.2f})")
        return words

    def write(self, path: Path) -> None:
        """Write a line for each level with its interval, and for an opening, in degrees."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["muscle", "time_s", "level", "low", "high", "standard_deviation"])
            for name, levels in self.levels.items():
                unit = self.most if name == OPENING else 1.0
                for t, *row in zip(self.times[name], levels, *self.interval(name), self.deviations[name], strict=True):
                    writer.writerow([name, f"{t:.6g}", *(f"{unit * value:.6g}" for value in row)])


def openness(found: Fit, paths: Mapping[str, Track], noise: float, slopes: Floats, opening: Opening | None = None) -> Openness:
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
    slopes : (n_numbers, n_measurements) array
        Derivatives in mm by the numbers of the search, of `measured` or by `by_reduced`.
    opening : Opening, optional
        Whose angle was found too.
    """
    left = np.sqrt(np.mean(np.square([found.distance[name] for name in paths])) / 3)
    noise = max(noise, float(left))
    covariance = np.linalg.inv(slopes @ slopes.T / noise**2 + np.eye(len(slopes)) / BEFORE)
    variances, vectors = np.linalg.eigh(covariance)

    free = slice(-1 if found.hold else 1, None)
    levels = {name: at[free] for name, at in found.levels.items()}
    times = dict.fromkeys(levels, found.knots[free])
    if opening is not None:
        levels[OPENING], times[OPENING] = np.array([found.angle / opening.most]), np.array([opening.rise])
    ends = np.cumsum([len(at) for at in levels.values()])[:-1]

    def by_name(values: Floats) -> dict[str, Floats]:
        return dict(zip(levels, np.split(values, ends), strict=True))

    combinations = [(float(np.sqrt(variance)), by_name(along)) for variance, along in zip(variances[::-1], vectors.T[::-1], strict=True)]
    most = opening.most if opening else 0.0
    return Openness(times, levels, by_name(np.sqrt(np.diag(covariance))), combinations, noise, most)


def by_reduced(found: Fit, paths: Mapping[str, Track], surrogate: Surrogate) -> Floats:
    """Derivatives of all measurements by each number, as a reduced tongue has them, at once; its probes are the points that have paths."""
    moved = surrogate.slopes(surrogate.search.begin(found.levels, found.angle))
    return np.array([_measured(paths, surrogate.times, dict(zip(surrogate.probes, u.swapaxes(0, 1), strict=True))) for u in moved])


def measured(paths: Mapping[str, Track], run: Run) -> Floats:
    """All measurements as a run has them: coordinates in mm of the points at the times of their paths, flat."""
    return _measured(paths, run.time, run.probes)


def _measured(paths: Mapping[str, Track], time: Floats, displacement: Mapping[str, Floats]) -> Floats:
    """The same of probes that have displacements (n_t, 3) in m at times."""
    parts = []
    for name, path in paths.items():
        times = path.times[(path.times > 0) & (path.times <= time[-1] + 1e-9)]
        parts += [np.interp(times, time, along) for along in displacement[name].T]
    return np.asarray(1e3 * np.concatenate(parts))
