# SPDX-License-Identifier: MIT
"""The airway over the tongue: how far the roof of the mouth, the velum and the back wall are from it, along the mid-line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.types import Floats, Ints
from ..geometry.polyline import arc_length
from ..runs.run import Run
from .electropalatogram import PALATES
from .tongue_grid import cut, grids, mid_plane, outlines, section

WALLS = (*sorted(PALATES), "velum", "pharynx")
"""Obstacles that bound the airway."""
RAYS = np.radians(np.arange(200.0, -90.0, -0.5))
"""Directions in which the wall is sought, from the front over the top to the back and down, as on Maeda's (1979) polar grid."""


@dataclass(frozen=True)
class Airway:
    """Distance from wall to tongue in the mid-sagittal plane.

    Attributes
    ----------
    time : (n_t,) float array
        Of the outputs, in s.
    wall : (n, 2) float array
        Points x, z of the wall in mm, from front to back.
    part : (n,) str array
        The obstacle that each belongs to.
    along : (n,) float array
        Length of the wall up to each point in mm.
    distance : (n_t, n) float array
        To the nearest point of the tongue's mid-sagittal section in mm.
    """

    time: Floats
    wall: Floats
    part: np.ndarray
    along: Floats
    distance: Floats

    def narrowest(self, index: int = -1) -> int:
        """The point of the wall that is nearest to the tongue at an output."""
        return int(np.argmin(self.distance[index]))

    def write(self, path: Path) -> None:
        """Write a CSV table: a line for each point of the wall with its part, length and place, then the distance in mm at each output."""
        head = ["part", "along_mm", "x_mm", "z_mm", *(f"distance_mm_{1e3 * t:g}ms" for t in self.time)]
        numbers = np.column_stack([self.along, self.wall, self.distance.T])
        lines = [",".join([part, *(f"{number:.4g}" for number in row)]) for part, row in zip(self.part, numbers, strict=True)]
        path.write_text("\n".join([",".join(head), *lines]) + "\n", encoding="utf-8")


Postures = Mapping[str, Mapping[str, Run]]
"""Name and setting to the run."""
Airways = Mapping[str, Mapping[str, Airway]]
"""The same, to its airway at rest and at the end."""


def airway(run: Run, outputs: Sequence[int] | None = None) -> Airway:
    """The airway of a run.

    Parameters
    ----------
    run : Run
        With contact at walls named as in `WALLS`; they are taken where they are at rest.
    outputs : sequence of int, optional
        Which of its outputs; by default all.

    Raises
    ------
    InputError
        If there is none.
    """
    grid = grids(run, 0)[0]
    walls = {name: cut(surface, mid_plane(grid)) for name, surface in run.obstacles_at_rest.items() if name in WALLS}
    if not walls:
        raise InputError(f"{run}: has no contact with a wall of the airway; one called {', '.join(WALLS)} is expected.")
    rest = section(grid)
    wall, part = wall_of(walls, np.asarray(rest.points)[:, [0, 2]].mean(axis=0))
    along = arc_length(wall)
    outputs = range(len(run.output_times)) if outputs is None else outputs
    distance = [feet(wall, lines)[0] for lines in outlines(run, outputs)]
    return Airway(run.output_times[list(outputs)], wall, part, along, np.array(distance))


def wall_of(walls: dict[str, Floats], centre: Floats) -> tuple[Floats, np.ndarray]:
    """The points (n, 2) that rays from `centre` hit first on any of the walls, lines (n, 2, 2), and the names of the walls."""
    names = np.repeat(list(walls), [len(lines) for lines in walls.values()])
    start, end = np.moveaxis(np.concatenate(list(walls.values())) - centre, 1, 0)
    points, part = [], []
    for ray in np.column_stack([np.cos(RAYS), np.sin(RAYS)]):
        a, b = (p[:, 0] * ray[1] - p[:, 1] * ray[0] for p in (start, end))  # on which side of the ray each end lies
        crossing = np.flatnonzero(a * b < 0)
        share = a[crossing] / (a - b)[crossing]
        far = (start[crossing] + share[:, None] * (end - start)[crossing]) @ ray
        if (far > 0).any():
            first = int(np.argmin(np.where(far > 0, far, np.inf)))
            points.append(centre + far[first] * ray)
            part.append(names[crossing[first]])
    return np.array(points), np.array(part)


def feet(points: Floats, lines: Floats) -> tuple[Floats, Ints, Floats]:
    """Distances (n,) from points (n, 2) to the nearest of the lines (m, 2, 2), which of them that is, and where on it, from 0 to 1."""
    start, step = lines[:, 0], lines[:, 1] - lines[:, 0]
    from_start = points[:, None] - start
    share = np.clip((from_start * step).sum(axis=2) / np.maximum((step**2).sum(axis=1), 1e-12), 0.0, 1.0)
    distance = np.linalg.norm(from_start - share[..., None] * step, axis=2)
    rows, which = np.arange(len(points)), distance.argmin(axis=1)
    return distance[rows, which], which, share[rows, which]
