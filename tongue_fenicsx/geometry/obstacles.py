# SPDX-License-Identifier: MIT
"""Rigid obstacles as signed distances: gap (positive where the tongue may be), its gradient and its Hessian."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..core import cache
from ..core.errors import InputError
from ..core.types import Floats
from ..core.values import Direction, Flag, Length, Point, checked
from .surface import Surface

SPACING = 0.75e-3
LARGEST, NEAREST = 30_000_000, 2_000_000
"""Nodes of a grid of distances at most, a cube of 0.23 m, and nodes within the band of a face at most, 0.05 m². More take minutes, and a
tongue reaches no farther."""
BAND = 5e-3
TRUSTED = 0.8
"""Share of the band within which distances are used: beyond it the spline feels the end of the grid."""
GRID = "grid.npz"
EDGE = 4.0
"""Radius in grid spacings below which a convex edge is the grid's, not the surface's: the Hessian takes it for an edge of this radius,
since sharper ones outweigh all else in a soft tissue's tangent (they doubled the Newton iterations at the palate's rim and the teeth)."""
# uniform cubic B-spline: weights of four neighbours as polynomials (1, u, u², u³) of the place within the cell
B_SPLINE = np.array([(1, 4, 1, 0), (-3, 0, 3, 0), (3, -6, 3, 0), (-1, 3, -3, 1)]) / 6


@runtime_checkable
class Obstacle(Protocol):
    """What the tongue cannot enter."""

    @property
    def surface(self) -> Surface:
        """Its surface at rest, for pictures; of an endless one a part."""
        ...

    def evaluate(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Gap (n,) in m, its gradient (n, 3) and Hessian (n, 3, 3) in 1/m at points (n, 3) in m, the obstacle at rest."""
        ...


@dataclass(frozen=True)
@checked("plane")
class Plane:
    """The half-space behind a plane.

    Attributes
    ----------
    point : (3,) sequence of float
        On the plane, in m.
    normal : (3,) sequence of float
        To the free side, of any length.

    Raises
    ------
    InputError
        If a number is not finite or the normal has no direction.
    """

    point: Point
    normal: Direction

    def __post_init__(self) -> None:
        if not np.any(self.normal):
            raise InputError("plane: the normal [0, 0, 0] has no direction.")

    @property
    def surface(self) -> Surface:
        """A square of 10 cm about the point."""
        import pyvista as pv

        return Surface.from_pyvista(pv.Plane(center=self.point, direction=self.normal, i_size=0.1, j_size=0.1).triangulate())

    def evaluate(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """See `Obstacle.evaluate`."""
        n = np.asarray(self.normal, dtype=float) / np.linalg.norm(self.normal)
        return (points - self.point) @ n, np.tile(n, (len(points), 1)), np.zeros((len(points), 3, 3))


@dataclass(frozen=True)
@checked("sphere")
class Sphere:
    """A ball, or all that is around a hollow sphere.

    Attributes
    ----------
    centre : (3,) sequence of float
        In m.
    radius : float
        In m.
    inside : bool
        Whether the tongue is inside; the gap is then radius − distance from the centre, which is not smooth at the centre.

    Raises
    ------
    InputError
        If a number is not finite or the radius is not positive.
    """

    centre: Point
    radius: Length
    inside: Flag = False

    @property
    def surface(self) -> Surface:
        """The sphere as triangles."""
        import pyvista as pv

        return Surface.from_pyvista(pv.Sphere(radius=self.radius, center=self.centre, theta_resolution=60, phi_resolution=60))

    def evaluate(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """See `Obstacle.evaluate`."""
        away = points - self.centre
        d = np.maximum(np.linalg.norm(away, axis=1), 1e-6 * self.radius)
        n = away / d[:, None]
        H = (np.eye(3) - n[:, :, None] * n[:, None, :]) / d[:, None, None]
        return (self.radius - d, -n, -H) if self.inside else (d - self.radius, n, H)


OBSTACLES: dict[str, Any] = {"plane": Plane, "sphere": Sphere}
"""Obstacles that are made of a few numbers, by the name that a scenario gives."""


@dataclass(frozen=True)
class Moved:
    """An obstacle carried by a rigid motion: what was at X is at R X + offset.

    Attributes
    ----------
    obstacle : Obstacle
        At rest.
    rotation : (3, 3) float array
        R.
    offset : (3,) float array
        In m.
    """

    obstacle: Obstacle
    rotation: Floats
    offset: Floats

    @property
    def surface(self) -> Surface:
        """Where its surface is now."""
        return self.obstacle.surface.moved(self.rotation, self.offset)

    def evaluate(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """See `Obstacle.evaluate`, at points in space."""
        R = self.rotation
        gap, n, H = self.obstacle.evaluate((points - self.offset) @ R)
        HR = (H.reshape(-1, 3) @ R.T).reshape(H.shape)  # in two large products: one for each point takes ten times as long
        return gap, n @ R.T, (HR.swapaxes(1, 2).reshape(-1, 3) @ R.T).reshape(H.shape)


class Triangulated:
    """The signed distance of a triangulated surface, a tricubic B-spline through its values on a grid.

    The gap is twice continuously differentiable, and gradient and Hessian are its own derivatives, but for the curvature of edges
    sharper than `EDGE` spacings. It is trusted within 0.8
    bands of the faces. Beyond, where the grid ends or the gap exceeds 0.8 bands, the gap is one band, the gradient any unit
    vector and the Hessian zero. More than a band inside a closed surface the gap is minus one band. An open surface repels from
    its front only near its faces: a point behind it whose nearest point is on the rim, beside the faces, has a positive gap,
    and so has a point more than a band behind it.

    Parameters
    ----------
    surface : Surface
        Closed or open, normals to the free side, triangles that share vertices.
    spacing : float
        Of the grid in m; edges are rounded and details lost below it.
    band : float
        Distance in m up to which the gap is known.

    Raises
    ------
    InputError
        If there are no triangles, a length is not positive, the band is thinner than four spacings or the surface is too large.
    """

    def __init__(self, surface: Surface, spacing: float = SPACING, band: float = BAND) -> None:
        if len(surface.triangles) == 0:
            raise InputError("obstacle: the surface has no triangles.")
        if not (0 < 4 * spacing <= band < np.inf):
            raise InputError(f"obstacle: spacing {spacing} m and band {band} m; a positive spacing and at least 4 of it are expected.")
        self.surface, self.spacing, self.band = surface, spacing, band
        sides, thickness = np.ptp(surface.points, axis=0), 2 * (band + 2 * spacing)
        if np.prod((sides + thickness) / spacing) > LARGEST or surface.area * thickness / spacing**3 > NEAREST:
            raise InputError(
                f"obstacle: the surface is {' × '.join(f'{side:.3g}' for side in sides)} m large, too much for distances on a grid of "
                f"{1e3 * spacing:g} mm; the part that the tongue can reach is expected, in m."
            )
        points, triangles = surface.points.astype(float), surface.triangles.astype(np.int64)
        self._origin, self._values, self._coefficients = _sample(points.tobytes(), triangles.tobytes(), spacing, band)

    @property
    def fingerprint(self) -> list[Any]:
        """What makes the distance: the faces and the grid."""
        return [self.surface.points, self.surface.triangles, self.spacing, self.band]

    def evaluate(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """See `Obstacle.evaluate`."""
        gap = np.full(len(points), self.band)
        gradient = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        hessian = np.zeros((len(points), 3, 3))
        place = (points - self._origin) / self.spacing
        within = np.flatnonzero(np.all((place >= 1) & (place < np.array(self._coefficients.shape) - 2), axis=1))
        at_node = self._values[tuple(np.rint(place[within]).astype(np.int64).T)]
        within = within[at_node <= TRUSTED * self.band + self.spacing]  # the others are farther
        D = self._derivatives(place[within])
        near = D[:, 0, 0, 0] <= TRUSTED * self.band
        within, D = within[near], D[near]
        first = np.eye(3, dtype=np.int64)
        second = first[:, None] + first
        gap[within] = D[:, 0, 0, 0]
        gradient[within] = D[:, first[..., 0], first[..., 1], first[..., 2]]
        hessian[within] = _blunt(D[:, second[..., 0], second[..., 1], second[..., 2]], 1 / (EDGE * self.spacing))
        return gap, gradient, hessian

    def _derivatives(self, place: Floats) -> Floats:
        """Value and derivatives (n, i, j, k) at places (n, 3) in cells; i, j, k = 0 to 2 are the orders along the axes."""
        cell = place.astype(np.int64)
        u = place - cell
        one, zero = np.ones_like(u), np.zeros_like(u)
        powers = np.array([[one, u, u**2, u**3], [zero, one, 2 * u, 3 * u**2], [zero, zero, 2 * one, 6 * u]])
        weights = np.moveaxis(powers, (2, 3), (0, 1)) @ B_SPLINE / self.spacing ** np.arange(3)[:, None]
        steps = np.array(self._coefficients.strides) // self._coefficients.itemsize
        stencil = (np.indices((4, 4, 4)).reshape(3, -1).T - 1) @ steps
        D = self._coefficients.ravel()[(cell @ steps)[:, None] + stencil].reshape(-1, 4, 4, 4)
        D = D @ weights[:, None, 2].swapaxes(2, 3)
        D = weights[:, None, 1] @ D
        return np.asarray(weights[:, 0] @ D.reshape(-1, 4, 9)).reshape(-1, 3, 3, 3)


@lru_cache(maxsize=16)
def _sample(points: bytes, triangles: bytes, spacing: float, band: float) -> tuple[Floats, Floats, Floats]:
    """Origin (3,) of the grid, signed distance at its nodes, clamped to ± one band, and the spline's coefficients, of double points and
    long triangles; kept in memory and on disk, as it takes seconds for a bone and all runs meet the same bones."""
    from scipy import ndimage

    code = (Path(__file__).with_name(name).read_bytes() for name in ("obstacles.py", "surface.py"))
    made_of = b"".join([points, triangles, repr((spacing, band, version("vtk"))).encode(), *code])
    entry = cache.open_cache(cache.DISTANCES) / hashlib.sha256(made_of).hexdigest()
    surface = Surface(np.frombuffer(points).reshape(-1, 3), np.frombuffer(triangles, dtype=np.int64).reshape(-1, 3))
    cache.provide(entry, lambda folder: _compute(surface, spacing, band, folder / GRID))
    with np.load(entry / GRID) as grid:
        return grid["origin"], grid["values"], np.asarray(ndimage.spline_filter(grid["values"], order=3))


def _compute(surface: Surface, spacing: float, band: float, file: Path) -> None:
    """Write the origin and the values of `_sample` to a file."""
    from scipy import ndimage

    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    shape = np.ceil((high - low + 2 * (band + 2 * spacing)) / spacing).astype(np.int64) + 1
    origin = (low + high - spacing * (shape - 1)) / 2  # a symmetric surface has a symmetric grid
    surface = _simplify(surface, spacing)
    dense = surface.to_pyvista().subdivide_adaptive(max_edge_len=spacing, max_n_passes=20).points
    away = np.ones(shape, dtype=bool)
    away[tuple(np.rint((dense - origin) / spacing).astype(np.int64).T)] = False
    near = np.flatnonzero(ndimage.distance_transform_edt(away) * spacing < band + 2 * spacing)
    values = np.full(away.size, np.inf)
    values[near] = _beside_rim(surface, origin + spacing * np.column_stack(np.unravel_index(near, shape)))
    values = values.reshape(shape)
    far = ~(abs(values) < band)
    parts, n_parts = ndimage.label(far)
    around = ndimage.maximum_filter(np.where(far, -np.inf, values), size=3)
    free = np.asarray(ndimage.maximum(around, parts, np.arange(n_parts + 1))) >= 0
    values = np.where(far, np.where(free[parts], band, -band), values)
    np.savez_compressed(file, origin=origin, values=values)


def _blunt(hessian: Floats, limit: float) -> Floats:
    """Hessians (n, 3, 3) in 1/m, convex by at most `limit`."""
    sharp = np.linalg.norm(hessian, axis=(1, 2)) > limit
    values, vectors = np.linalg.eigh(hessian[sharp])
    hessian[sharp] = (vectors * np.minimum(values, limit)[:, None]) @ vectors.swapaxes(1, 2)
    return hessian


def _simplify(surface: Surface, spacing: float) -> Surface:
    """The surface with fewer triangles, where they are much finer than the grid (quadric decimation, Garland and Heckbert 1997)."""
    mesh = surface.to_pyvista()
    wanted = 4 * mesh.area / spacing**2
    return surface if mesh.n_cells <= 2 * wanted else Surface.from_pyvista(mesh.decimate(1 - wanted / mesh.n_cells).clean())


def _beside_rim(surface: Surface, points: Floats) -> Floats:
    """Signed distance (n,) in m of points (n, 3), which is positive beside the rim of an open surface, not behind it."""
    distance = surface.signed_distance(points)
    rim = surface.to_pyvista().extract_feature_edges(
        boundary_edges=True, feature_edges=False, manifold_edges=False, non_manifold_edges=False
    )
    behind = np.flatnonzero(distance < 0)
    if rim.n_cells == 0 or len(behind) == 0:
        return distance
    triangles, nearest = surface.nearest_triangle(points[behind])
    _, on_rim = rim.find_closest_cell(nearest, return_closest_point=True)
    a, b, c = (surface.points[surface.triangles[triangles, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    height = abs(np.einsum("ni,ni->n", points[behind] - nearest, normal)) / np.linalg.norm(normal, axis=1)
    beside = (np.linalg.norm(nearest - on_rim, axis=1) < 1e-7) & (height < 0.999 * abs(distance[behind]))
    distance[behind[beside]] *= -1
    return distance


def check_orientation(obstacle: Triangulated, name: str, free_points: Floats) -> None:
    """Make sure that the normals of an obstacle point to the free side; of one that is far away, by the free points nearest to it.

    Parameters
    ----------
    obstacle : Triangulated
        Points within its band count, if there are any.
    name : str
        Of the obstacle, for the message.
    free_points : (n, 3) or (3,) float array
        Points in m on the free side, such as those of the tongue at rest.

    Raises
    ------
    InputError
        If more than half of the points that count are behind the surface.
    """
    points, band = np.atleast_2d(free_points), TRUSTED * obstacle.band
    gap = obstacle.evaluate(points)[0]
    gap = gap[abs(gap) < band]
    if len(gap) == 0 and len(points):
        gap = _beside_rim(obstacle.surface, points)
        band = 1.2 * float(abs(gap).min())
        gap = gap[abs(gap) < band]
    behind = int(np.sum(gap < 0))
    if 2 * behind > len(gap):
        raise InputError(
            f"{name}: {behind} of the {len(gap)} free points within {1e3 * band:.3g} mm are behind the surface; "
            "its normals must point to the free side, so turn its triangles."
        )
