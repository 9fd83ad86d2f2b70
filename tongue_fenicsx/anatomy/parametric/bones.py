# SPDX-License-Identifier: MIT
"""The parametric bones and walls around the parametric tongue, drawn in millimetres like it (origin at the genial spine).

Sections follow subject PB of the Grenoble data (Stavness et al. 2011): palate mid-line and vault, inner and outer curves
of the mandible, hyoid body and horns, the rear pharyngeal wall. Closed bones are zero sets on a grid, cut back where the
tongue at rest comes nearer than a set clearance; palate, velum and pharynx are open, with normals toward the tongue.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pyvista as pv
from matplotlib.path import Path as Polygon
from scipy.interpolate import PchipInterpolator
from scipy.spatial import cKDTree

from ...core.types import Floats
from ...geometry.polyline import arc_length
from ...geometry.surface import Surface

if TYPE_CHECKING:
    from .profile import Profile

Field = Callable[[Floats], Floats]

ROOF = np.array([
    (-26.0, 30.4), (-22.5, 32.6), (-19.6, 34.0), (-15.5, 36.6), (-9.5, 40.6), (-3.5, 43.8), (4.5, 46.6), (12.0, 47.4), (20.5, 47.4),
    (28.5, 46.3), (33.5, 44.2), (41.5, 41.0), (46.5, 37.6), (51.5, 31.5), (54.0, 28.0),
])  # fmt: skip
"""Mid-line (x, z) of the palate from the incisors over the vault to the tip of the velum."""

VAULT = np.array(
    [
        (-26.0, 4.0),
        (-22.5, 9.0),
        (-16.0, 14.5),
        (-6.0, 19.0),
        (5.0, 20.3),
        (13.5, 21.0),
        (22.0, 22.5),
        (32.0, 24.3),
        (44.0, 22.0),
        (54.0, 9.0),
    ]
)
"""Half-width of the vault at its margin over x."""

MARGIN = np.array([(-26.0, 30.4), (22.0, 30.4), (35.0, 30.0), (54.0, 26.0)])
"""Height of the margin over x: the gums, then the sides of the velum."""

VAULT_POWER = 2.6
"""The vault falls with this power of the distance from the mid-line (0, 3, 7, 12, 16 mm at 6, 11, 14, 18, 21 mm)."""

VELUM_FROM = 22.0

WALL = np.array([(-33.0, 55.0), (-23.0, 58.0), (-13.0, 60.0), (-3.0, 60.4), (7.0, 59.8), (17.0, 58.6), (27.0, 58.6), (45.0, 58.6)])
"""Rear pharyngeal wall, x over z, in the mid-sagittal plane."""

MANDIBLE_OUTER = np.array([
    (-21.0, 0.0), (-19.5, 9.0), (-15.5, 15.5), (-10.5, 19.5), (-4.5, 23.0), (1.5, 25.6), (7.5, 28.8), (13.5, 32.8), (19.5, 37.0),
    (27.0, 41.5), (38.0, 45.0), (52.0, 47.0), (60.0, 47.5),
])  # fmt: skip
MANDIBLE_INNER = np.array(
    [(60.0, 40.0), (43.5, 33.0), (37.5, 27.8), (31.5, 22.6), (25.5, 18.6), (19.5, 15.0), (13.5, 12.2), (7.5, 8.7), (4.0, 5.0), (2.0, 0.0)]
)
"""Plan (x, |y|) of the mandible's body and ramus."""

MANDIBLE_LOW = np.array([(-21.0, -15.0), (-10.0, -18.0), (2.0, -16.5), (13.5, -12.0), (25.0, -6.0), (43.0, 0.0), (60.0, 4.0)])
MANDIBLE_HIGH = np.array([(-21.0, 16.0), (26.0, 16.0), (36.0, 40.0), (42.0, 62.0), (60.0, 62.0)])
"""Lower and upper border of the mandible, z over x."""

UPPER_ARCH = np.array(
    [(-26.8, 0.0, 2.2), (-24.5, 9.5, 2.6), (-17.5, 17.8, 3.4), (-6.0, 22.9, 4.0), (5.0, 24.8, 4.5), (15.0, 26.2, 4.8), (22.0, 27.6, 4.8)]
)
LOWER_ARCH = np.array(
    [(-24.0, 0.0, 1.8), (-21.8, 8.0, 2.2), (-15.0, 15.8, 3.2), (-5.0, 21.0, 4.0), (5.0, 23.4, 4.5), (15.0, 25.6, 4.8), (25.0, 28.5, 4.8)]
)
"""Dental arches in plan: (x, |y|, half-thickness)."""

HYOID = np.array(
    [(37.0, 0.0, -17.5, 4.6), (38.0, 8.0, -17.0, 4.4), (42.0, 13.0, -15.5, 3.6), (50.0, 17.0, -13.0, 2.8), (62.0, 21.0, -8.5, 2.3)]
)
"""Middle (x, |y|, z) and radius of the hyoid's body and greater horn."""

CLEARANCE = 0.5
"""Between a bone and the tongue at rest."""


def parametric_bones(profile: Profile) -> dict[str, Surface]:
    """Palate, velum, pharynx, teeth, mandible and hyoid around the tongue as drawn, in mm.

    Parameters
    ----------
    profile : Profile
        The tongue, which the closed bones are cut back from.

    Returns
    -------
    dict
        ``palate``, ``velum``, ``pharynx`` (open, normals toward the tongue), ``upper_teeth``, ``lower_teeth``,
        ``mandible``, ``hyoid`` (closed, normals outward): distances are positive where the tongue is.
    """

    def apart(field: Field, rounding: float) -> Field:
        return lambda p: _least([field(p), -profile.level(p) - CLEARANCE], rounding)

    return {
        "palate": _roof(ROOF[0, 0], VELUM_FROM, 60),
        "velum": _roof(VELUM_FROM, ROOF[-1, 0], 40),
        "pharynx": _pharynx(),
        "upper_teeth": _solid(apart(_arch(UPPER_ARCH, 27.0, 34.5), 0.8), (-32, -36, 23), (30, 36, 39), 1.0),
        "lower_teeth": _solid(apart(_arch(LOWER_ARCH, 14.5, 25.5), 0.8), (-30, -37, 11), (33, 37, 29), 1.0),
        "mandible": _solid(apart(_mandible(), 2.0), (-26, -53, -24), (66, 53, 68), 1.5),
        "hyoid": _solid(apart(_hyoid, 1.0), (28, -28, -26), (68, 28, -2), 1.0),
    }


def _least(fields: list[Floats], rounding: float) -> Floats:
    """The least of several fields, with edges rounded over some `rounding` mm."""
    stacked = np.stack(fields)
    least = stacked.min(axis=0)
    return np.asarray(least - rounding * np.log(np.exp(-(stacked - least) / rounding).sum(axis=0)))


def _solid(field: Field, lower: tuple[float, ...], upper: tuple[float, ...], spacing: float) -> Surface:
    """The closed surface on which a field (mm, positive inside, the same at ±y) vanishes, from a grid that meets no flat face of it
    exactly; its left half is its right one mirrored."""
    grid = pv.ImageData(
        dimensions=[round((high - low) / spacing) + 1 for low, high in zip(lower, upper, strict=True)],
        spacing=(spacing,) * 3,
        origin=np.array(lower) + spacing * np.array([0.37, 0.0, 0.41]),
    )
    grid["field"] = -field(np.asarray(grid.points, dtype=float))
    right = (
        grid.contour([0.0], scalars="field").clean(tolerance=1e-4).smooth_taubin(n_iter=40).clip("y", origin=(0.0, 0.0, 0.0), invert=False)
    )
    both = pv.merge([right, right.reflect((0.0, 1.0, 0.0)).flip_faces()]).extract_surface(algorithm=None)
    surface = Surface.from_pyvista(both.triangulate().clean(tolerance=1e-4))
    return surface if surface.volume > 0 else Surface(surface.points, surface.triangles[:, ::-1].copy())


def _plan(curve: Floats, xy: Floats) -> Floats:
    """Distance within a closed plan curve that is symmetric about y = 0, (n,), negative outside."""
    outline = np.vstack([curve, curve[::-1] * (1, -1)])
    step = np.linspace(0, 1, 20, endpoint=False)[:, None]
    dense = np.vstack([a + step * (b - a) for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True)])
    plan, above = np.unique(xy @ [1, 1j], return_inverse=True)
    xy = np.column_stack([plan.real, plan.imag])
    distance = cKDTree(dense).query(xy)[0]
    return np.asarray(np.where(Polygon(outline).contains_points(xy), distance, -distance))[above]


def _mandible() -> Field:
    plan = np.vstack([_round_off(MANDIBLE_OUTER), _round_off(MANDIBLE_INNER)])
    low, high = PchipInterpolator(*MANDIBLE_LOW.T), PchipInterpolator(*MANDIBLE_HIGH.T)

    def field(p: Floats) -> Floats:
        x = np.clip(p[:, 0], MANDIBLE_LOW[0, 0], MANDIBLE_LOW[-1, 0])
        return _least([_plan(plan, p[:, :2]), p[:, 2] - low(x), (high(x) - p[:, 2]) / 2], 2.5)

    return field


def _round_off(curve: Floats) -> Floats:
    """A smooth curve through plan points, even where it turns across the mid-line."""
    s = arc_length(curve)
    return np.asarray(PchipInterpolator(s, curve)(np.linspace(0, s[-1], 80)))


def _arch(curve: Floats, low: float, high: float) -> Field:
    dense = _round_off(curve)
    tree = cKDTree(np.vstack([dense[:, :2], dense[:, :2] * (1, -1)]))
    thickness = np.tile(dense[:, 2], 2)

    def field(p: Floats) -> Floats:
        distance, nearest = tree.query(p[:, :2])
        return _least([thickness[nearest] - distance, p[:, 2] - low, high - p[:, 2]], 0.8)

    return field


def _hyoid(p: Floats) -> Floats:
    dense = _round_off(HYOID)
    tree = cKDTree(np.vstack([dense[:, :3], dense[:, :3] * (1, -1, 1)]))
    distance, nearest = tree.query(p)
    return np.asarray(np.tile(dense[:, 3], 2)[nearest] - distance)


def _sheet(points: Floats, toward: tuple[float, float, float]) -> Surface:
    """An open surface through a grid of points (m, n, 3), its normals on the side of `toward`."""
    m, n = points.shape[:2]
    index = np.arange(m * n).reshape(m, n)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    surface = Surface(points.reshape(-1, 3), np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))
    p = surface.points[surface.triangles]
    facing = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]).sum(axis=0) @ np.asarray(toward)
    return surface if facing > 0 else Surface(surface.points, surface.triangles[:, ::-1].copy())


def _roof(start: float, stop: float, n: int) -> Surface:
    x = np.linspace(start, stop, n)[:, None]
    t = np.linspace(-1, 1, 49)[None, :]
    roof, width, margin = (PchipInterpolator(*table.T)(x) for table in (ROOF, VAULT, MARGIN))
    z = roof - (roof - margin) * abs(t) ** VAULT_POWER
    return _sheet(np.stack([np.broadcast_to(x, z.shape), width * t, z], axis=2), (0.0, 0.0, -1.0))


def _pharynx() -> Surface:
    z = np.linspace(WALL[0, 0], WALL[-1, 0], 60)[:, None]
    y = np.linspace(-24, 24, 49)[None, :]
    x = PchipInterpolator(*WALL.T)(z) - 6.0 * (y / 24) ** 2
    return _sheet(np.stack([x, np.broadcast_to(y, x.shape), np.broadcast_to(z, x.shape)], axis=2), (-1.0, 0.0, 0.0))
