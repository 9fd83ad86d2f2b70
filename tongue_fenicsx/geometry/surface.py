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
    def area(self) -> float:
        """In m²."""
        a, b, c = (self.points[self.triangles[:, i]] for i in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

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

    @property
    def n_bodies(self) -> int:
        """How many pieces do not hang together."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        ends = self.triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
        n = len(self.points)
        used = np.unique(self.triangles)
        labels = connected_components(coo_array((np.ones(len(ends)), ends.T), shape=(n, n)), directed=False)[1]
        return len(np.unique(labels[used]))

    def crossing(self) -> Floats:
        """Corners, (k, 3, 3), in m, of the triangles of which an edge goes through another triangle, or that an edge goes through."""
        from scipy.spatial import cKDTree

        corners = self.points[self.triangles]
        reach = 2 * np.linalg.norm(corners - self.centroids[:, None], axis=2).max()
        pairs = cKDTree(self.centroids).query_pairs(reach, output_type="ndarray")
        low, high = corners.min(axis=1), corners.max(axis=1)
        pairs = pairs[np.all((low[pairs[:, 0]] <= high[pairs[:, 1]]) & (low[pairs[:, 1]] <= high[pairs[:, 0]]), axis=1)]
        crossed = [pair[_pierces(corners, self.triangles, pair, edge)] for pair in (pairs, pairs[:, ::-1]) for edge in range(3)]
        return np.asarray(corners[np.unique(np.concatenate(crossed))])

    def transform(self, mapping: Callable[[Floats], Floats]) -> Surface:
        """The surface with every vertex mapped."""
        return Surface(mapping(self.points), self.triangles, self.labels)

    def moved(self, rotation: Floats, offset: Floats) -> Surface:
        """The surface as a rigid body that is moved: what was at X is at R X + offset, R (3, 3), offset (3,) in m."""
        return self.transform(lambda X: X @ rotation.T + offset)

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


def _pierces(corners: Floats, triangles: Ints, pairs: Ints, edge: int) -> NDArray[np.bool_]:
    """Whether, of each pair of triangles, (n, 2), an edge of the first goes through the inside of the second, of which it has no corner."""
    first, second = pairs.T
    ends = triangles[first][:, [edge, (edge + 1) % 3]]
    p, q = corners[first, edge], corners[first, (edge + 1) % 3]
    a, b, c = corners[second].swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    before, after = ((end - a) * normal for end in (p, q))
    before, after = before.sum(axis=1), after.sum(axis=1)
    apart = ~(ends[:, :, None] == triangles[second][:, None]).any(axis=(1, 2)) & (before * after < 0)
    x = p + (before / np.where(apart, before - after, 1.0))[:, None] * (q - p)
    sides = [(np.cross(end - start, x - start) * normal).sum(axis=1) for start, end in ((a, b), (b, c), (c, a))]
    return np.asarray(apart & (np.min(sides, axis=0) > 0))


def read_surface(path: Path) -> Surface:
    """Read a triangulated surface (STL, OBJ, PLY, VTP, VTU) and merge its duplicate points.

    Raises
    ------
    InputError
        If the file is missing, unreadable or holds no triangles.
    """
    import pyvista as pv

    with reading(path, "a surface in STL, OBJ, PLY, VTP or VTU"), quiet():
        mesh = pv.read(path).extract_surface(algorithm=None).triangulate()
        if not np.isfinite(mesh.points).all():
            raise InputError(f"{path}: a coordinate is not a finite number.")
        mesh = mesh.clean()
    if mesh.n_faces == 0 or mesh.area <= 1e-9 * mesh.length**2:
        raise InputError(f"{path}: holds no triangles that have an area; a surface in STL, OBJ, PLY, VTP or VTU is expected.")
    return Surface.from_pyvista(mesh)


def close_surface(surface: Surface, source: Path, within: float = 0.0, *, cap: bool = False) -> tuple[Surface, str | None]:
    """Make a surface a closed, outward-oriented manifold that does not cross itself, or say why it is not one.

    Edges shared by more than two triangles are repaired with pymeshfix, and triangles that cross each other if that is asked for; holes are
    filled only if that is asked for, because a guessed patch is anatomy that nobody measured.

    Parameters
    ----------
    surface : Surface
        As it was read.
    source : Path
        Where from.
    within : float
        How far, in m, a repair of crossing triangles may move the surface; 0 for no such repair.
    cap : bool
        Fill holes.

    Returns
    -------
    surface, note
        The surface and, when it was repaired, a sentence that says how.

    Raises
    ------
    InputError
        If the surface is open, it crosses itself farther than may be repaired, or the repair changes the volume by more than 1 %.
    """
    notes = []
    n_open = int(np.sum(surface.edge_sharing() == 1))
    if n_open and not cap:
        raise InputError(
            f"{source}: the surface is open ({n_open} edges belong to one triangle only); a closed one is needed, so close its holes in "
            "the tool that made it, or state cap = true in frame.toml."
        )
    if n_open:
        closed = _filled(surface)
        if np.any(closed.edge_sharing() == 1):
            raise InputError(f"{source}: the holes of {n_open} open edges cannot be closed; close them in the tool that made it.")
        more = 1e4 * (closed.area - surface.area)
        notes.append(f"{source.name}: what {n_open} edges left open was closed by {more:.1f} cm² that nobody measured.")
        surface = closed
    sharing = surface.edge_sharing()
    if np.any(sharing > 2):
        fault = f"{int(np.sum(sharing > 2))} edges are shared by more than two triangles"
        surface, note = _mend(surface, source, fault)
        notes.append(note)
    crossing = surface.crossing()
    if len(crossing):
        size = 1e3 * np.ptp(crossing.reshape(-1, 3), axis=0).max()
        place = ", ".join(f"{1e3 * c:.1f}" for c in crossing.mean(axis=(0, 1)))
        fault = f"{len(crossing)} triangles cross each other around ({place}) mm, over {size:.1f} mm"
        if within <= 0:
            raise InputError(
                f"{source}: {fault}; a surface that does not cross itself is expected, so mend it in the tool that made it, or state in "
                "frame.toml how far a repair may move it (repair)."
            )
        before = surface
        surface, note = _mend(surface, source, fault)
        moved = max(abs(surface.signed_distance(before.points)).max(), abs(before.signed_distance(surface.points)).max())
        if moved > within:
            raise InputError(
                f"{source}: {fault}, and the repair moves the surface by {1e3 * moved:.2f} mm; repair allows {1e3 * within:g} mm."
            )
        notes.append(f"{note} It moved by at most {1e3 * moved:.2f} mm.")
    if surface.volume < 0:
        surface = Surface(surface.points, surface.triangles[:, ::-1].copy(), surface.labels)
        notes.append(f"{source.name}: the normals pointed inward and were turned.")
    return surface, " ".join(notes) or None


def _filled(surface: Surface) -> Surface:
    """The surface with its holes filled, by triangles as large as those beside them."""
    import pymeshfix

    mesh = pymeshfix.PyTMesh()
    mesh.set_quiet(True)
    with quiet():
        mesh.load_array(surface.points, surface.triangles.astype(np.int32))
        mesh.fill_small_boundaries(0, True)
        vertices, faces = mesh.return_arrays()
    return Surface(np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.int64))


def _mend(surface: Surface, source: Path, fault: str) -> tuple[Surface, str]:
    """The surface repaired by pymeshfix, and a sentence that says so."""
    import pymeshfix

    with quiet():
        vertices, faces = pymeshfix.clean_from_arrays(surface.points, surface.triangles.astype(np.int32))
    mended = Surface(np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.int64))
    change = abs(abs(mended.volume) / abs(surface.volume) - 1) if len(mended.triangles) else 1.0
    if np.any(mended.edge_sharing() != 2) or len(mended.crossing()) or change > 0.01:
        raise InputError(
            f"{source}: {fault} and pymeshfix could not repair them (volume change {100 * change:.1f} %); "
            "mend the surface in the tool that made it."
        )
    vertices = f"{len(surface.points)} to {len(mended.points)} vertices"
    return (
        mended,
        f"{source.name}: {fault.replace(' are ', ' ')} were repaired with pymeshfix ({vertices}, volume change {100 * change:.3f} %).",
    )
