# SPDX-License-Identifier: MIT
"""Tetrahedra by their corners."""

from __future__ import annotations

import numpy as np

from ..core.types import Floats, Ints

SIDES = np.array([[0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [2, 0, 3, 6, 7, 9], [0, 2, 1, 6, 5, 4]])
"""The sides of a quadratic tetrahedron in VTK order: three corners, counter-clockwise from outside, and the nodes between them."""

QUARTERS = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
"""A side cut into four."""

PLANE = 1e-6
"""In m: points so near y = 0 are on the mid-plane, where a mirrored tongue has sides."""


def volumes(corners: Floats) -> Floats:
    """Volume of each tetrahedron, (n,), of corners (n, 4, 3): positive in the order of Gmsh and DOLFINx."""
    a, b, c, d = np.moveaxis(corners, 1, 0)
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6)


def outer_sides(cells: Ints) -> Ints:
    """The sides (n, 6) of quadratic tetrahedra (n_cells, 10) that belong to one only: corners and nodes between them as in `SIDES`."""
    sides = cells[:, SIDES].reshape(-1, 6)
    _, first, count = np.unique(np.sort(sides[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(sides[first[count == 1]])


def boundary(cells: Ints, most: int | None = None) -> tuple[Ints, Ints]:
    """The surface of quadratic tetrahedra (n_cells, 10): its nodes, (n,), and triangles, (m, 3), counter-clockwise from outside.

    Triangles count within the nodes. Each side of a tetrahedron is four triangles, or one where there would be more than `most` nodes.
    """
    sides = outer_sides(cells)
    triangles = sides[:, :3] if most is not None and len(np.unique(sides)) > most else sides[:, QUARTERS].reshape(-1, 3)
    nodes, places = np.unique(triangles, return_inverse=True)
    return nodes, places.reshape(-1, 3)


def mid_sides(points: Floats, cells: Ints) -> Ints:
    """The sides (n, 6) of quadratic tetrahedra (n_cells, 10) of a mirrored tongue that lie in the mid-plane y = 0, each once."""
    sides = cells[:, SIDES].reshape(-1, 6)
    sides = sides[(abs(points[:, 1]) < PLANE)[sides].all(axis=1)]
    return np.asarray(sides[np.unique(np.sort(sides[:, :3], axis=1), axis=0, return_index=True)[1]])


def mid_edges(points: Floats, triangles: Ints) -> Ints:
    """The edges (n, 2) of a mirrored surface's triangles that lie in the mid-plane y = 0: its mid-sagittal outline."""
    edges = np.vstack([triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    on = (abs(points[:, 1]) < PLANE)[edges].all(axis=1)
    return np.asarray(np.unique(np.sort(edges[on], axis=1), axis=0))
