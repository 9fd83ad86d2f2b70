# SPDX-License-Identifier: MIT
"""A virtual electropalatogram: which of 62 electrodes on the palate the tongue touches over time, as phoneticians record it.

The grid is like that of the Reading artificial palate (Hardcastle, Gibbon and Jones 1991): eight rows from behind the upper
incisors to the end of the hard palate, the front four half as far apart as the rear ones; six electrodes in the first row,
eight in the others, evenly spaced over the vault between the gums.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.types import Floats
from ..geometry.polyline import arc_length
from ..geometry.surface import Surface
from ..geometry.tetrahedron import outer_sides
from .tongue_grid import shell, skin

if TYPE_CHECKING:
    from ..runs.run import Run

PALATES = frozenset({"palate", "palate_hard", "hard_palate"})
"""Names of obstacles that carry electrodes."""

ALONG = np.array([0, 1, 2, 3, 5, 7, 9, 11]) / 11
"""Places of the rows from front to back, over the length of the mid-line."""

ACROSS = (np.arange(8) - 3.5) / 4
"""Places of the columns from left to right, over the half-width of the vault."""

FRONT, GUMS = 0.7, 0.78
"""The first row and the margins lie where the vault has fallen by these shares of its depth."""

WIDE = 0.6
"""The last row lies where the vault is still wider than this share of its largest width."""

ELECTRODES = [(row, column) for row in range(8) for column in range(8) if row > 0 or 0 < column < 7]
"""Row, from the front, and column, from the left, of each electrode."""

REACH = 0.5e-3
"""Distance in m at which the tongue counts as touching."""

NEAR = 6e-3
"""In m: what is farther than this from the box of the electrodes touches none."""


def electrodes(palate: Surface) -> Floats:
    """Places of the electrodes, (62, 3) in m, in the order of `ELECTRODES`.

    Parameters
    ----------
    palate : Surface
        A vault that opens downward, its front at small x, symmetric about y = 0.

    Raises
    ------
    InputError
        If the surface has no vault in the mid-sagittal plane.
    """
    (x_min, _, _), (x_max, y_max, _) = palate.points.min(axis=0), palate.points.max(axis=0)
    corners = palate.points[palate.triangles]

    def heights(x: Floats, y: Floats) -> Floats:
        """Height of the surface above (x, y) as seen from below, NaN beside it; quick for points along a line."""
        low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
        some = corners[np.all((low <= (x.max(), y.max())) & (high >= (x.min(), y.min())), axis=1)]
        a, u, v = some[:, 0], some[:, 1] - some[:, 0], some[:, 2] - some[:, 0]
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        across = np.where(abs(area) > 1e-15, area, np.inf)  # triangles that are seen from the edge hide nothing
        px, py = x[:, None] - a[:, 0], y[:, None] - a[:, 1]
        s, t = (px * v[:, 1] - py * v[:, 0]) / across, (py * u[:, 0] - px * u[:, 1]) / across
        inside = (s >= 0) & (t >= 0) & (s + t <= 1) & np.isfinite(across)
        z = np.where(inside, a[:, 2] + s * u[:, 2] + t * v[:, 2], np.inf).min(axis=1, initial=np.inf)
        return np.asarray(np.where(np.isfinite(z), z, np.nan))

    x = np.linspace(x_min, x_max, 100)[1:-1]
    middle = heights(x, np.full(len(x), 1e-5))
    x, middle = x[np.isfinite(middle)], middle[np.isfinite(middle)]
    if len(x) < 10:
        raise InputError("palate: the surface has no vault over the mid-sagittal plane; one that opens downward is expected.")
    top = middle.max()
    depth = top - middle[: np.argmax(middle) + 1].min()

    def section(at: float) -> tuple[Floats, Floats]:
        """|y| and z of the vault between the gums at an x."""
        y = np.linspace(0, y_max, 100)[:-1] + 1e-5
        z = heights(np.full(len(y), at), y)
        inside = np.cumprod(np.isfinite(z) & (z > top - GUMS * depth)).astype(bool)
        return y[inside], z[inside]

    width = np.array([section(at)[0].max(initial=0.0) for at in x])
    kept = slice(int(np.argmax(middle > top - FRONT * depth)), int(np.flatnonzero(width > WIDE * width.max())[-1]) + 1)
    rows = np.interp(ALONG, _arc(x[kept], middle[kept]), x[kept])
    places = []
    for row, at in enumerate(rows):
        y, z = section(at)
        columns = [column for r, column in ELECTRODES if r == row]
        side = np.interp(abs(ACROSS[columns]), _arc(y, z), y)
        places.append(np.column_stack([np.full(len(side), at), np.sign(ACROSS[columns]) * side, np.interp(side, y, z)]))
    return np.vstack(places)


def _arc(a: Floats, b: Floats) -> Floats:
    """Share of the length of a curve up to each of its points, (n,)."""
    length = arc_length(np.column_stack([a, b]))
    return np.asarray(length / length[-1])


@dataclass(frozen=True)
class Electropalatogram:
    """Contact of the electrodes over time.

    Attributes
    ----------
    time : (n_t,) float array
        In s.
    places : (62, 3) float array
        Of the electrodes, in m.
    on : (n_t, 62) bool array
        Whether each is touched.
    """

    time: Floats
    places: Floats
    on: NDArray[np.bool_]

    def grid(self, index: int) -> NDArray[np.bool_]:
        """The electrodes at one time as phoneticians draw them, (8, 8), front row first, left column first; no corners in front."""
        table = np.zeros((8, 8), dtype=bool)
        for (row, column), on in zip(ELECTRODES, self.on[index], strict=True):
            table[row, column] = on
        return table

    def write(self, path: Path) -> None:
        """Write a CSV table: time in s, then 1 or 0 for each electrode, ``r1c2`` to ``r8c8``."""
        names = ",".join(f"r{row + 1}c{column + 1}" for row, column in ELECTRODES)
        lines = [f"{t:.6g}," + ",".join("01"[int(on)] for on in row) for t, row in zip(self.time, self.on, strict=True)]
        path.write_text("\n".join([f"time_s,{names}", *lines]) + "\n", encoding="utf-8")


def electropalatogram(run: Run, reach: float = REACH) -> Electropalatogram:
    """The electropalatogram of a run with contact at a palate, at each output.

    Parameters
    ----------
    run : Run
        A run in which an obstacle is called as one of `PALATES`.
    reach : float
        Distance in m at which the tongue counts as touching.

    Raises
    ------
    InputError
        If the run has no such obstacle.
    """
    import pyvista as pv

    found = sorted(PALATES.intersection(run.contact))
    if not found:
        raise InputError(f"{run}: has no contact with a palate; one called {', '.join(sorted(PALATES))} is expected.")
    places = electrodes(run.obstacles(0)[found[0]])
    probe = pv.PolyData(1e3 * places)
    sides, low, high = outer_sides(run.mesh[1]), 1e3 * (places.min(axis=0) - NEAR), 1e3 * (places.max(axis=0) + NEAR)
    on = np.zeros((len(run.output_times), len(places)), dtype=bool)
    for index in range(len(on)):
        tongue = skin(shell(run, index, sides, low, high), 2).triangulate()
        if tongue.n_cells:
            on[index] = np.asarray(probe.compute_implicit_distance(tongue)["implicit_distance"]) <= 1e3 * reach
    return Electropalatogram(run.output_times, places, on)
