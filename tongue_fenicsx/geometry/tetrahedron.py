# SPDX-License-Identifier: MIT
"""Tetrahedra by their corners."""

from __future__ import annotations

import numpy as np

from ..core.types import Floats


def volumes(corners: Floats) -> Floats:
    """Volume of each tetrahedron, (n,), of corners (n, 4, 3): positive in the order of Gmsh and DOLFINx."""
    a, b, c, d = np.moveaxis(corners, 1, 0)
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6)
