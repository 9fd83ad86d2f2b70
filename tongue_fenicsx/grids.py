# SPDX-License-Identifier: MIT
"""The tongue of a run as PyVista grids, lengths in mm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pyvista as pv

if TYPE_CHECKING:
    from .run import Run


def grids(run: Run, index: int = -1) -> tuple[pv.UnstructuredGrid, pv.UnstructuredGrid]:
    """The tongue at rest and deformed at an output, with the length of ``displacement`` in mm as point data."""
    points, cells = run.mesh
    u = 1e3 * run.field("displacement", index)
    rest = pv.UnstructuredGrid({pv.CellType.QUADRATIC_TETRA: cells}, 1e3 * points)
    rest["displacement"] = np.linalg.norm(u, axis=1)
    deformed = rest.copy()
    deformed.points = rest.points + u
    return rest, deformed


def skin(grid: pv.UnstructuredGrid, subdivision: int = 1) -> pv.PolyData:
    """The surface of a grid as triangles; each side of a quadratic tetrahedron is cut into 4 to the power of `subdivision`."""
    return grid.extract_surface(algorithm="dataset_surface", nonlinear_subdivision=subdivision)
