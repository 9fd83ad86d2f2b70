# SPDX-License-Identifier: MIT
"""Muscles on a mesh: their weights and fibre directions at its vertices, and where they enter from outside.

The weight of a muscle is its region averaged over the elements around a vertex, so that the muscle's edge is smooth on
any mesh while the integral of the weight is the volume of the region.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from ..anatomy.anatomy import Anatomy, Muscle
from ..core.errors import InputError
from ..core.types import Floats, Ints
from ..geometry.fibre_direction import angle_between, common_sense
from ..geometry.surface import Surface
from .tetrahedra import Tetrahedra

SUBPOINTS = np.array([i for i in product(range(4), repeat=4) if sum(i) == 3]) / 4 + 1 / 16
"""Barycentric coordinates of 20 evenly spread points of a tetrahedron."""

FACET_SUBPOINTS = np.array([i for i in product(range(6), repeat=3) if sum(i) == 5]) / 6 + 1 / 18
"""Barycentric coordinates of 21 evenly spread points of a triangle."""


@dataclass(frozen=True)
class Entry:
    """Where the part of a muscle outside the tongue pulls at the surface.

    Attributes
    ----------
    facets : (k, 3) int array
        Boundary triangles that its fibres cross.
    share : (k, 3) float array
        Cross-section of the muscle per area of surface at their corners.
    anchor : (3,) float array
        Where it pulls to, in m.
    """

    facets: Ints
    share: Floats
    anchor: Floats


@dataclass(frozen=True)
class MuscleField:
    """One muscle on a mesh.

    Attributes
    ----------
    cells : (k,) int array
        Cells that its region touches.
    nodes : (n,) int array
        Their vertices.
    weight : (n,) float array
        Share of the region around each vertex, 0…1.
    direction : (n, 3) float array
        Unit fibre direction.
    share : (k,) float array
        Share of each cell that lies in the region.
    volume : float
        Volume of the region in m³.
    entry : Entry, optional
        Where it enters from outside.
    """

    cells: Ints
    nodes: Ints
    weight: Floats
    direction: Floats
    share: Floats
    volume: float
    entry: Entry | None = None


def project_muscles(anatomy: Anatomy, mesh: Tetrahedra) -> dict[str, MuscleField]:
    """Weights and directions of every muscle at the vertices of the cells that its region touches.

    Raises
    ------
    InputError
        If a muscle's region touches no cell.
    """
    points = np.einsum("sv,cvd->csd", SUBPOINTS, mesh.points[mesh.cells]).reshape(-1, 3)
    volumes = mesh.volumes
    fields = {}
    for name, muscle in anatomy.muscles.items():
        inside = muscle.region(points).reshape(len(mesh.cells), len(SUBPOINTS))
        cells = np.flatnonzero(inside.any(axis=1))
        if len(cells) == 0:
            raise InputError(f"{anatomy.name}: muscle {name!r} has an empty region; its fibres must run inside the tongue surface.")
        share = np.einsum("cs,sv->cv", inside[cells], SUBPOINTS) / len(SUBPOINTS) * volumes[cells, None]
        nodes, weight = lump(mesh.cells[cells], share, volumes[cells])
        fields[name] = MuscleField(
            cells,
            nodes,
            weight,
            muscle.fibres.direction(mesh.points[nodes]),
            inside[cells].mean(axis=1),
            float(share.sum()),
            _entry(muscle, anatomy.surface, mesh),
        )
    return fields


def lump(elements: Ints, share: Floats, measure: Floats) -> tuple[Ints, Floats]:
    """Vertices of some cells or facets, and weights there whose linear interpolation has a given integral.

    Parameters
    ----------
    elements : (k, n) int array
        Vertices of each simplex.
    share : (k, n) float array
        Integral over each simplex of the quantity times each linear shape function.
    measure : (k,) float array
        Volume or area of each simplex.
    """
    nodes, local = np.unique(elements, return_inverse=True)
    n = elements.shape[1]
    total = np.bincount(local.ravel(), share.ravel())
    capacity = np.bincount(local.ravel(), np.repeat(measure / n, n))
    return nodes, total / capacity


def _entry(muscle: Muscle, surface: Surface, mesh: Tetrahedra) -> Entry | None:
    """The free facets that a muscle crosses on its way from its anchor, and its cross-section per area there."""
    if muscle.anchor is None:
        return None
    track = muscle.fibres.segments[0]
    depth = -surface.signed_distance(track)
    track = track[(depth < 2e-3) & (depth > -6e-3) & (np.linalg.norm(track - muscle.anchor, axis=1) > 6e-3)]
    facets = mesh.facets[mesh.labels == "free"]
    corners = mesh.points[facets]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points = np.einsum("sv,fvd->fsd", FACET_SUBPOINTS, corners)
    flat = points.reshape(-1, 3)
    inside = np.zeros(len(flat), dtype=bool)
    near = np.isfinite(cKDTree(track).query(flat, distance_upper_bound=5e-3)[0])
    toward = ((muscle.anchor - points) * normal[:, None]).sum(axis=2).ravel() > 0
    candidates = np.flatnonzero(near & toward)
    below = flat[candidates] - 3e-4 * np.repeat(normal, len(FACET_SUBPOINTS), axis=0)[candidates]
    inside[candidates] = muscle.region(below)
    cosine = abs((muscle.fibres.direction(flat).reshape(points.shape) * normal[:, None]).sum(axis=2))
    crossed = np.where(inside.reshape(cosine.shape), cosine, 0.0)
    touched = crossed.any(axis=1)
    facets, crossed = facets[touched], crossed[touched]
    sides = corners[touched, 1:] - corners[touched, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    share = np.einsum("fs,sv->fv", crossed, FACET_SUBPOINTS) / len(FACET_SUBPOINTS) * area[:, None]
    nodes, value = lump(facets, share, area)
    return Entry(facets, value[np.searchsorted(nodes, facets)], muscle.anchor)


def direction_errors(anatomy: Anatomy, mesh: Tetrahedra, fields: Mapping[str, MuscleField]) -> dict[str, float | None]:
    """Mean angle in degrees between each muscle's fibres and its directions on the mesh along them, inside its cells, if any is."""
    import pyvista as pv  # a run has no need of it

    grid = pv.UnstructuredGrid({pv.CellType.TETRA: mesh.cells}, mesh.points)
    errors: dict[str, float | None] = {}
    for name, field in fields.items():
        points, tangents, lengths = anatomy.muscles[name].fibres.segments
        cells = np.atleast_1d(grid.find_containing_cell(points))
        inside = np.isin(cells, field.cells)
        corners = mesh.cells[cells[inside]]
        a, b, c, d = (mesh.points[corners[:, i]] for i in range(4))
        bary = np.linalg.solve(np.stack([b - a, c - a, d - a], axis=2), (points[inside] - a)[..., None])[..., 0]
        weights = np.column_stack([1 - bary.sum(axis=1), bary])
        mean = np.einsum("nv,nvd->nd", weights, common_sense(field.direction[np.searchsorted(field.nodes, corners)]))
        errors[name] = float(np.average(angle_between(mean, tangents[inside]), weights=lengths[inside])) if inside.any() else None
    return errors
