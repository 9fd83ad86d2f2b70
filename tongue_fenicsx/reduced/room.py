# SPDX-License-Identifier: MIT
"""The room that walls leave: how far from them a place is, on a grid, and how a point that got into one comes out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.types import Floats, Ints
from ..geometry.obstacles import Triangulated
from ..geometry.surface import Surface

SPACING, UNIT = 1.0, 0.05
"""Of the grid, and of the distances in it, in mm."""
MARGIN = 12.0
"""In mm, by how much the grid is wider than the tongue at rest."""
STEPS = 3
"""Of Newton toward the face; the distance is nearly linear."""


@dataclass(frozen=True)
class Room:
    """Distances from walls.

    Attributes
    ----------
    origin : (3,) float array
        Of the grid, in mm.
    units : (n_x, n_y, n_z) int8 array
        At its nodes, distances in `UNIT`, positive where the tongue may be, as far as they fit; linear between them.
    """

    origin: Floats
    units: Any

    @classmethod
    def among(cls, walls: Iterable[Surface], points: Floats) -> Room:
        """The room of a tongue whose nodes are at points (n, 3) in m, among walls."""
        low, high = 1e3 * points.min(axis=0) - MARGIN, 1e3 * points.max(axis=0) + MARGIN
        shape = np.ceil((high - low) / SPACING).astype(int) + 1
        nodes = 1e-3 * (low + SPACING * np.indices(tuple(shape)).reshape(3, -1).T)
        nearest = np.full(len(nodes), np.inf)
        for wall in walls:
            nearest = np.minimum(nearest, Triangulated(wall).evaluate(nodes)[0])
        units = np.clip(np.round(1e3 * nearest / UNIT), -127, 127).astype(np.int8)
        return cls(low, units.reshape(shape))

    def clear(self, places: Floats) -> Floats:
        """Places (n, 3) in mm; those within a wall are brought to its face, along the distance's slope."""
        moved = places.copy()
        near = self._near(places)
        for _ in range(STEPS):
            distance, slope = self._distance(moved[near])
            inside = distance < 0
            near, distance, slope = near[inside], distance[inside], slope[inside]
            moved[near] -= (distance / np.maximum((slope**2).sum(axis=1), 0.25))[:, None] * slope
        return moved

    def _near(self, places: Floats) -> Ints:
        """Which of places (n, 3) may be in a wall: by the nearest node; none beyond the grid."""
        at = np.rint((places - self.origin) / SPACING).astype(int)
        known = np.flatnonzero(np.all((at >= 0) & (at < self.units.shape), axis=1))
        return np.asarray(known[UNIT * self.units[tuple(at[known].T)] < 2 * SPACING])

    def _distance(self, places: Floats) -> tuple[Floats, Floats]:
        """Distance (n,) in mm at places (n, 3), and its slope (n, 3)."""
        place = (places - self.origin) / SPACING
        cell = np.clip(np.floor(place).astype(int), 0, np.array(self.units.shape) - 2)
        (x, y, z), (i, j, k) = np.clip(place - cell, 0, 1).T, cell.T
        c = {(a, b, d): UNIT * self.units[i + a, j + b, k + d].astype(float) for a in (0, 1) for b in (0, 1) for d in (0, 1)}
        along_z = {(a, b): c[a, b, 0] + z * (c[a, b, 1] - c[a, b, 0]) for a in (0, 1) for b in (0, 1)}
        along_y = [along_z[a, 0] + y * (along_z[a, 1] - along_z[a, 0]) for a in (0, 1)]
        up = {(a, b): c[a, b, 1] - c[a, b, 0] for a in (0, 1) for b in (0, 1)}
        by_z = (1 - x) * ((1 - y) * up[0, 0] + y * up[0, 1]) + x * ((1 - y) * up[1, 0] + y * up[1, 1])
        by_y = (1 - x) * (along_z[0, 1] - along_z[0, 0]) + x * (along_z[1, 1] - along_z[1, 0])
        slope = np.column_stack([along_y[1] - along_y[0], by_y, by_z]) / SPACING
        return along_y[0] + x * (along_y[1] - along_y[0]), slope
