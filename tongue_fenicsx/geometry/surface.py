# SPDX-License-Identifier: MIT
"""Closed triangulated surfaces: checks, repair, labels, nearest triangles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, quiet, reading
from ..core.types import Floats, Ints

if TYPE_CHECKING:
    import h5py
    import pyvista as pv

LABEL = "<U32"
SUFFIXES = (".stl", ".obj", ".ply", ".vtp", ".vtu")


@dataclass(frozen=True)
class Surface:
    """A triangulated surface with one label per triangle.

    Attributes
    ----------
    points : (n, 3) float array
        Vertices in m.
    triangles : (m, 3) int array
        Vertex indices, counter-clockwise seen from outside.
    labels : (m,) str array
        ``"free"`` or the bone the triangle is bonded to (``"mandible"``, ``"hyoid"``, …).
    """

    points: Floats
    triangles: Ints
    labels: NDArray[np.str_] = field(default_factory=lambda: np.empty(0, dtype=LABEL))

    def __post_init__(self) -> None:
        if len(self.labels) == 0:
            object.__setattr__(self, "labels", np.full(len(self.triangles), "free", dtype=LABEL))

    @classmethod
    def read(cls, group: h5py.Group) -> Surface:
        """The surface that `write` put into an HDF5 group.

        Raises
        ------
        ValueError
            If it is damaged.
        """
        points, triangles = group["points"][:], group["triangles"][:].astype(np.int64)
        whole = points.shape[1:] == triangles.shape[1:] == (3,) and np.isfinite(points).all()
        if not whole or not np.all((triangles >= 0) & (triangles < len(points))):
            raise ValueError(f"{group.name} is no surface")
        return cls(points, triangles)

    def write(self, group: h5py.Group) -> None:
        """Put points and triangles into an HDF5 group."""
        group.create_dataset("points", data=self.points, compression="gzip")
        group.create_dataset("triangles", data=self.triangles.astype(np.int32), compression="gzip")

    @property
    def volume(self) -> float:
        """Enclosed volume in m³ (positive when the normals point outward)."""
        a, b, c = (self.points[self.triangles[:, i]] for i in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    @property
    def centroids(self) -> Floats:
        """Triangle centroids, (m, 3), in m."""
        return self.points[self.triangles].mean(axis=1)

    def curvature_radius(self, scale: float) -> Floats:
        """Radius of curvature in m around each triangle, (m,), smoothed over `scale` (m).

        On a sphere of radius R the normals within the distance s have a mean of length 1 − s²/(4R²); this is solved for R.
        """
        from scipy.sparse import csr_array, eye_array
        from scipy.spatial import cKDTree

        a, b, c = (self.points[self.triangles[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a) / 2
        area = np.linalg.norm(normal, axis=1)
        tree = cKDTree(self.centroids)
        pairs = tree.sparse_distance_matrix(tree, scale, output_type="coo_matrix")
        near = csr_array((np.ones(pairs.nnz), (pairs.row, pairs.col)), shape=(len(area), len(area))) + eye_array(len(area))
        mean = (near @ normal) / (near @ area)[:, None]
        return np.asarray(scale / 2 / np.sqrt(np.maximum(1 - np.linalg.norm(mean, axis=1), 1e-6)))

    def edge_sharing(self) -> Ints:
        """How many triangles share each edge, (n_edges,); a closed manifold has 2 everywhere."""
        edges = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        return np.unique(edges, axis=0, return_counts=True)[1].astype(np.int64)

    def transform(self, mapping: Callable[[Floats], Floats]) -> Surface:
        """The surface with every vertex mapped."""
        return Surface(mapping(self.points), self.triangles, self.labels)

    def signed_distance(self, points: Floats) -> Floats:
        """Distance of each point, (n, 3), to the surface, (n,), positive on the side its normals point to.

        Works on open surfaces too, near their faces; distances are exact to the triangles (VTK's implicit distance).
        """
        import pyvista as pv

        probe = pv.PolyData(np.ascontiguousarray(points)).compute_implicit_distance(self.to_pyvista())
        return np.asarray(probe["implicit_distance"], dtype=float)

    def contains(self, points: Floats, tolerance: float = 0.0) -> NDArray[np.bool_]:
        """Whether each point, (n, 3), lies inside the closed surface or at most `tolerance` (m) outside."""
        near = np.all((points >= self.points.min(axis=0) - tolerance) & (points <= self.points.max(axis=0) + tolerance), axis=1)
        near[near] = self.signed_distance(points[near]) <= tolerance
        return near

    @classmethod
    def from_pyvista(cls, mesh: pv.PolyData) -> Surface:
        """The triangles of a `pyvista.PolyData`, coordinates in m."""
        return cls(np.asarray(mesh.points, dtype=float), mesh.regular_faces.astype(np.int64))

    def to_pyvista(self) -> pv.PolyData:
        """The same surface as a `pyvista.PolyData`."""
        import pyvista as pv

        return pv.PolyData.from_regular_faces(self.points, self.triangles)

    def nearest_triangle(self, points: Floats) -> tuple[Ints, Floats]:
        """Index of the nearest triangle of each point, (n,), and the nearest surface point, (n, 3)."""
        cells, nearest = self.to_pyvista().find_closest_cell(points, return_closest_point=True)
        return np.atleast_1d(cells).astype(np.int64), np.atleast_2d(nearest)


def read_surface(path: Path) -> Surface:
    """Read a triangulated surface (STL, OBJ, PLY, VTP, VTU) and merge its duplicate points.

    Raises
    ------
    InputError
        If the file is missing, unreadable or holds no triangles.
    """
    import pyvista as pv

    with reading(path, "a surface in STL, OBJ, PLY, VTP or VTU"), quiet():
        mesh = pv.read(path).extract_surface(algorithm=None).triangulate().clean()
    if not np.isfinite(mesh.points).all():
        raise InputError(f"{path}: a coordinate is not a finite number.")
    if mesh.n_cells == 0:
        raise InputError(f"{path}: holds no triangles; a surface in STL, OBJ, PLY, VTP or VTU is expected.")
    return Surface.from_pyvista(mesh)


def close_surface(surface: Surface, source: Path) -> tuple[Surface, str | None]:
    """Make a surface a closed, outward-oriented manifold, or say why it is not one.

    Edges shared by more than two triangles are repaired with pymeshfix; holes are not filled, because
    a guessed patch would be anatomy that nobody measured.

    Returns
    -------
    surface, note
        The surface and, when it was repaired, a sentence that says how.

    Raises
    ------
    InputError
        If the surface is open or the repair changes the volume by more than 1 %.
    """
    import pymeshfix

    sharing = surface.edge_sharing()
    if np.any(sharing == 1):
        raise InputError(
            f"{source}: the surface is open ({int(np.sum(sharing == 1))} edges belong to one triangle only); "
            "a closed surface is needed, so close its holes in the tool that made it."
        )
    note = None
    if np.any(sharing > 2):
        import pymeshfix

        before, n_before = abs(surface.volume), len(surface.points)
        with quiet():
            vertices, faces = pymeshfix.clean_from_arrays(surface.points, surface.triangles.astype(np.int32))
        surface = Surface(np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.int64))
        change = abs(abs(surface.volume) / before - 1)
        if np.any(surface.edge_sharing() != 2) or change > 0.01:
            raise InputError(
                f"{source}: {int(np.sum(sharing > 2))} edges are shared by more than two triangles and pymeshfix could not "
                f"repair them (volume change {100 * change:.1f} %); mend the surface in the tool that made it."
            )
        note = (
            f"{source.name}: {int(np.sum(sharing > 2))} edges shared by more than two triangles were repaired with "
            f"pymeshfix ({n_before} to {len(surface.points)} vertices, volume change {100 * change:.3f} %)."
        )
    if surface.volume < 0:
        surface = Surface(surface.points, surface.triangles[:, ::-1].copy(), surface.labels)
        note = f"{note or ''} {source.name}: the normals pointed inward and were turned.".strip()
    return surface, note
