# SPDX-License-Identifier: MIT
"""Tetrahedra that fill the surface of a tongue, by Gmsh."""

from __future__ import annotations

import math
from dataclasses import dataclass

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..anatomy.anatomy import Anatomy
from ..core.errors import InputError
from ..core.types import Floats, Ints
from ..geometry import tetrahedron
from ..geometry.surface import Surface

REFINEMENT, REFINED_WITHIN = 0.7, 10e-3
"""Elements at a bonded area have this fraction of the size; it grows back to 1 over the distance in m."""

PER_RADIUS, GROWTH, CURVATURE_SCALE = 0.55, 0.3, 4e-3
"""Elements on the surface are at most this fraction of its radius of curvature, measured over the scale in m, but not
finer than at a bonded area; below the surface they grow by the second number per distance."""


@dataclass(frozen=True)
class Tetrahedra:
    """A tetrahedral mesh with labelled boundary triangles.

    Attributes
    ----------
    points : (n, 3) float array
        Vertices in m.
    cells : (m, 4) int array
        Vertex numbers, positively oriented.
    facets : (k, 3) int array
        Boundary triangles.
    labels : (k,) str array
        What each boundary triangle is bonded to, or ``free``.
    """

    points: Floats
    cells: Ints
    facets: Ints
    labels: NDArray[np.str_]

    @property
    def volumes(self) -> Floats:
        """Volume of each cell, (m,), in m³."""
        return tetrahedron.volumes(self.points[self.cells])

    @property
    def n_quadratic_nodes(self) -> int:
        """Vertices and edge midpoints."""
        edges = np.sort(self.cells[:, [0, 1, 0, 2, 0, 3, 1, 2, 1, 3, 2, 3]].reshape(-1, 2), axis=1)
        return len(self.points) + len(np.unique(edges, axis=0))


def tetrahedralise(anatomy: Anatomy, size: float) -> Tetrahedra:
    """Fill the surface with tetrahedra, finer at the bonded areas; a mirrored tongue is meshed by halves.

    Raises
    ------
    InputError
        If Gmsh cannot parametrise or fill the surface.
    """
    surface = anatomy.surface
    if anatomy.mirrored:
        right = surface.centroids[:, 1] > 0
        surface = Surface(surface.points, surface.triangles[right], surface.labels[right])
    try:
        points, cells = _gmsh_fill(surface, size)
    except Exception as error:  # the gmsh module raises plain Exception
        raise InputError(f"{anatomy.name}: Gmsh could not mesh the surface at {1e3 * size:g} mm: {error}") from error
    if anatomy.mirrored:
        points[abs(points[:, 1]) < 1e-9, 1] = 0.0
        off_plane = points[:, 1] > 0
        twin = np.arange(len(points))
        twin[off_plane] = len(points) + np.arange(off_plane.sum())
        points = np.vstack([points, points[off_plane] * (1, -1, 1)])
        cells = np.vstack([cells, twin[cells][:, [1, 0, 2, 3]]])
    faces = cells[:, [1, 2, 3, 0, 3, 2, 0, 1, 3, 0, 2, 1]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    facets = faces[first[count == 1]]
    centroids = points[facets].mean(axis=1)
    if anatomy.mirrored:
        centroids[:, 1] = abs(centroids[:, 1])  # the same label on both sides
    labels = surface.labels[surface.nearest_triangle(centroids)[0]]
    return Tetrahedra(points, cells, facets, labels)


def _gmsh_fill(surface: Surface, size: float) -> tuple[Floats, Ints]:
    """Remesh a discrete surface and fill it; a flat hole at y = 0 is closed by the mid-sagittal plane."""
    bonded = surface.triangles[surface.labels != "free"]
    near = cKDTree(1e3 * surface.points[np.unique(bonded)]) if len(bonded) else None
    h = 1e3 * size
    used, triangles = np.unique(surface.triangles, return_inverse=True)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", h)
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.3 * h)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.RandomSeed", 1)
        model = gmsh.model
        model.addDiscreteEntity(2, 1)
        model.mesh.addNodes(2, 1, np.arange(1, len(used) + 1), (1e3 * surface.points[used]).ravel())
        model.mesh.addElementsByType(1, 2, [], triangles.reshape(-1) + 1)
        model.mesh.classifySurfaces(math.pi, boundary=True, forReparametrization=True, curveAngle=math.pi)
        model.mesh.createGeometry()
        on_plane = [tag for _, tag in model.getEntities(1) if np.ptp(model.getBoundingBox(1, tag)[1::3]) < 1e-3 and _is_rim(tag)]
        if on_plane:
            loop = model.geo.addCurveLoop(on_plane, reorient=True)
            model.geo.addPlaneSurface([loop])
            model.geo.synchronize()
        model.geo.addVolume([model.geo.addSurfaceLoop([tag for _, tag in model.getEntities(2)])])
        model.geo.synchronize()

        lookup = _SizeLookup(near, surface, h)
        model.mesh.setSizeCallback(lambda dim, tag, x, y, z, lc: lookup(x, y, z))
        model.mesh.generate(3)
        model.mesh.optimize("Netgen")
        tags, coordinates, _ = model.mesh.getNodes()
        _, nodes = model.mesh.getElementsByType(4)
    finally:
        gmsh.finalize()
    points = coordinates.reshape(-1, 3)
    index = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    index[tags.astype(np.int64)] = np.arange(len(tags))
    cells = index[nodes.astype(np.int64)].reshape(-1, 4)
    kept, cells = np.unique(cells, return_inverse=True)
    return points[kept] * 1e-3, cells.reshape(-1, 4).astype(np.int64)


def _is_rim(curve: int) -> bool:
    """Whether only one surface meets at a curve."""
    return len(gmsh.model.getAdjacencies(1, curve)[0]) == 1


class _SizeLookup:
    """Element size in mm near a point, from a grid of 2 mm (Gmsh asks some hundred thousand times).

    The size falls toward bonded areas and where the surface is more curved than the elements can follow.
    """

    def __init__(self, bonded: cKDTree | None, surface: Surface, h: float) -> None:
        lower, upper = 1e3 * surface.points.min(axis=0) - 4, 1e3 * surface.points.max(axis=0) + 4
        axes = [np.arange(lower[i], upper[i] + 2, 2.0) for i in range(3)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        distance, nearest = cKDTree(1e3 * surface.centroids).query(grid)
        finest = np.clip(PER_RADIUS * 1e3 * surface.curvature_radius(CURVATURE_SCALE), REFINEMENT * h, h)
        size = np.minimum(h, finest[nearest] + GROWTH * distance)
        if bonded is not None:
            ramp = np.clip(bonded.query(grid)[0] / (1e3 * REFINED_WITHIN), 0, 1)
            size = np.minimum(size, h * (REFINEMENT + (1 - REFINEMENT) * ramp))
        self._size = size.tolist()
        self._lower = lower.tolist()
        self._last = [len(a) - 1 for a in axes]

    def __call__(self, x: float, y: float, z: float) -> float:
        i, j, k = (min(max(round((value - low) / 2), 0), last) for value, low, last in zip((x, y, z), self._lower, self._last, strict=True))
        return float(self._size[i][j][k])
