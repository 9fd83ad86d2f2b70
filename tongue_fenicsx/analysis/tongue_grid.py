# SPDX-License-Identifier: MIT
"""The tongue of a run as PyVista grids, lengths in mm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.types import Floats
from ..geometry.surface import Surface
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
    return _lines(skin(grid, subdivision).slice(normal="y", origin=(0.0, mid_plane(grid) + 1e-4, 0.0)))


def cut(surface: Surface, middle: float = 0.0) -> Floats:
    """Where the plane at a lateral coordinate in mm (see `mid_plane`) cuts a bone, lines (n, 2, 2) of x and z in mm."""
    return 1e3 * _lines(surface.to_pyvista().slice(normal="y", origin=(0.0, 1e-3 * middle + 1e-7, 0.0)))


def _lines(edges: pv.PolyData) -> Floats:
    ends: Floats = np.asarray(edges.points, dtype=float)[edges.lines.reshape(-1, 3)[:, 1:]]
    return ends[..., [0, 2]]
