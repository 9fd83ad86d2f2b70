# SPDX-License-Identifier: MIT
"""The tongue of a run as PyVista grids, lengths in mm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..core.types import Floats, Ints
from ..geometry.surface import Surface
from ..geometry.tetrahedron import outer_sides
from .moments import field_at

if TYPE_CHECKING:
    import pyvista as pv

    from ..runs.run import Run


def grids(run: Run, index: int = -1) -> tuple[pv.UnstructuredGrid, pv.UnstructuredGrid]:
    """The tongue at rest and deformed at an output, with the length of ``displacement`` in mm as point data."""
    return grids_at(run, float(run.output_times[index]))


def grids_at(run: Run, t: float) -> tuple[pv.UnstructuredGrid, pv.UnstructuredGrid]:
    """The same at a time in s."""
    import pyvista as pv

    points, cells = run.mesh
    u = 1e3 * field_at(run, "displacement", t)
    rest = pv.UnstructuredGrid({pv.CellType.QUADRATIC_TETRA: cells}, 1e3 * points)
    rest["displacement"] = np.linalg.norm(u, axis=1)
    rest.field_data["mid_plane"] = [_middle(rest.points[:, 1])]
    deformed = rest.copy()
    deformed.points = rest.points + u
    return rest, deformed


def shell(run: Run, index: int, sides: Ints, low: Floats, high: Floats) -> pv.UnstructuredGrid:
    """The sides (n, 6) of `outer_sides` that reach into a box of mm, as quadratic triangles, where they are at an output."""
    import pyvista as pv

    points = 1e3 * (run.mesh[0] + run.field("displacement", index))
    ends = points[sides]
    least, most = ends.min(axis=1), ends.max(axis=1)
    margin = (most - least) / 4  # a curved side goes beyond its nodes
    near = np.all((least - margin <= high) & (most + margin >= low), axis=1)
    return pv.UnstructuredGrid({pv.CellType.QUADRATIC_TRIANGLE: sides[near]}, points)


def _middle(y: Floats) -> float:
    """Where to cut a tongue whose nodes have these lateral coordinates (n,): at 0, or in the middle of one that lies to a side of it."""
    low, high = float(y.min()), float(y.max())
    middle = (low + high) / 2
    return middle if abs(middle) > (high - low) / 4 else 0.0


def mid_plane(grid: pv.UnstructuredGrid) -> float:
    """The lateral coordinate in mm of the plane that cuts a grid of `grids_at` in the middle."""
    return float(grid.field_data["mid_plane"][0])


def skin(grid: pv.UnstructuredGrid, subdivision: int = 1) -> pv.PolyData:
    """The surface of a grid as triangles; each side of a quadratic tetrahedron is cut into 4 to the power of `subdivision`."""
    return grid.extract_surface(algorithm="dataset_surface", nonlinear_subdivision=subdivision)


def section(grid: pv.UnstructuredGrid) -> pv.PolyData:
    """Where the mid-sagittal plane cuts a grid, as triangles."""
    import pyvista as pv

    plane = mid_plane(grid) + 1e-4
    y = np.asarray(grid.points)[grid.cells_dict[pv.CellType.QUADRATIC_TETRA], 1]
    low, high = y.min(axis=1), y.max(axis=1)
    margin = (high - low) / 2  # a curved side goes beyond its nodes
    beside = grid.extract_cells((low - margin <= plane) & (plane <= high + margin))
    return beside.tessellate(max_n_subdivide=1).slice(normal="y", origin=(0.0, plane, 0.0)).triangulate()


def outline(grid: pv.UnstructuredGrid, subdivision: int = 2) -> Floats:
    """Where the mid-sagittal plane cuts the `skin` of a grid, lines (n, 2, 2) of x and z in mm."""
    return _outline(grid, mid_plane(grid), subdivision)


def outlines(run: Run, outputs: Sequence[int]) -> Iterator[Floats]:
    """The outlines of a run at outputs, of a coarser skin; quick for many."""
    points, cells = run.mesh
    plane, sides = _middle(1e3 * points[:, 1]), outer_sides(cells)
    low, high = np.array([[-np.inf, plane, -np.inf], [np.inf, plane, np.inf]])
    for index in outputs:
        yield _outline(shell(run, index, sides, low, high), plane, 1)


def _outline(grid: pv.UnstructuredGrid, plane: float, subdivision: int) -> Floats:
    return _lines(skin(grid, subdivision).slice(normal="y", origin=(0.0, plane + 1e-4, 0.0)))


def cut(surface: Surface, middle: float = 0.0) -> Floats:
    """Where the plane at a lateral coordinate in mm (see `mid_plane`) cuts a bone, lines (n, 2, 2) of x and z in mm."""
    return 1e3 * _lines(surface.to_pyvista().slice(normal="y", origin=(0.0, 1e-3 * middle + 1e-7, 0.0)))


def _lines(edges: pv.PolyData) -> Floats:
    ends: Floats = np.asarray(edges.points, dtype=float)[edges.lines.reshape(-1, 3)[:, 1:]]
    return ends[..., [0, 2]]
