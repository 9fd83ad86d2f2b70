# SPDX-License-Identifier: MIT
"""The shape of the built-in tongue: a smooth symmetric surface from a mid-sagittal contour and half-widths.

The numbers are millimetres in the frame of the superior genial spine (x posterior, y right, z up). The surface is the zero set of
h(x, z)² − y², where the half-width h falls to zero at the contour like a superellipse, so that edges and tip are round.
"""

from __future__ import annotations

import numpy as np
import pyvista as pv
from matplotlib.path import Path as Polygon
from scipy.interpolate import PchipInterpolator, RectBivariateSpline, splev, splprep
from scipy.special import beta

from ...core.types import Floats
from ...geometry.surface import Surface

CONTOUR = np.array([
    (-0.7, 2.3), (0.4, 8.5), (-2.0, 13.3), (-11.1, 18.0), (-17.0, 21.6), (-19.6, 26.0), (-17.4, 29.8), (-11.9, 32.4),
    (1.3, 37.0), (17.0, 39.4), (34.0, 36.2), (46.3, 25.0), (50.5, 15.1), (51.5, 5.9), (50.0, -3.0), (44.7, -9.5),
    (38.0, -14.0), (31.0, -17.0), (23.5, -17.4), (12.5, -16.5), (2.8, -15.0), (-0.6, -9.0),
])  # fmt: skip
"""Mid-sagittal contour (x, z): genial notch, blade underside, tip, dorsum, root, vallecula, hyoid, floor, symphysis."""
STATIONS = np.array([-25.0, -18, -12, -6, 0, 6, 12, 18, 24, 30, 36, 42, 48, 58])
ORAL = np.array([8.5, 10.5, 12.6, 14.4, 16.2, 18.0, 19.8, 21.2, 22.3, 23.0, 23.5, 23.8, 24.0, 24.0])
FLOOR = np.array([6.5, 6.5, 6.5, 6.6, 7.0, 9.2, 12.8, 17.0, 20.8, 24.2, 27.6, 30.4, 31.5, 31.5])
"""Half-width over x of the oral part and of the part within the jaw; they blend over a few mm around z = 15."""
ROUNDING = 11.0
"""Depth below the contour, in mm, over which the half-width grows to its full value."""


class Profile:
    """The tongue shape as functions of mid-sagittal position (mm), tabulated once on a grid of 0.5 mm."""

    def __init__(self) -> None:
        tck, _ = splprep(np.vstack([CONTOUR, CONTOUR[:1]]).T, s=6.0, per=True)
        self.contour: Floats = np.array(splev(np.linspace(0, 1, 4001)[:-1], tck)).T
        lower, upper = self.contour.min(axis=0) - 12, self.contour.max(axis=0) + 12
        x, z = (np.arange(lower[i], upper[i], 0.5) for i in (0, 1))
        depth = self._distance(np.stack(np.meshgrid(x, z, indexing="ij"), axis=2).reshape(-1, 2)).reshape(len(x), len(z))
        low = 1 / (1 + np.exp((z - 15.0) / 2.0))
        width = (1 - low) * PchipInterpolator(STATIONS, ORAL)(x)[:, None] + low * PchipInterpolator(STATIONS, FLOOR)(x)[:, None]
        s = np.clip(depth / ROUNDING, -1, 1)
        self._depth = RectBivariateSpline(x, z, depth)
        self._half_width_squared = RectBivariateSpline(x, z, width**2 * np.where(s > 0, 1 - (1 - s) ** 2.6, 2.6 * s))

    def _distance(self, xz: Floats) -> Floats:
        """Smooth signed distance to the contour, positive inside: the L³ mean over it (Belyaev, Fayolle, Pasko 2013)."""
        p = 3.0
        following = np.roll(self.contour, -1, axis=0)
        (x, z), step = (self.contour + following).T / 2, np.linalg.norm(following - self.contour, axis=1)
        total = np.concatenate([
            (step / ((chunk[:, :1] - x) ** 2 + (chunk[:, 1:] - z) ** 2) ** ((p + 1) / 2)).sum(axis=1)
            for chunk in np.array_split(xz, len(xz) // 100 + 1)
        ])  # fmt: skip
        distance = (total / beta(0.5, p / 2)) ** (-1 / p)
        return np.asarray(np.where(Polygon(self.contour).contains_points(xz), distance, -distance))

    def depth(self, xz: Floats) -> Floats:
        """Smooth distance below the contour, (n,), negative outside."""
        return np.asarray(self._depth(*np.atleast_2d(xz).T, grid=False))

    def half_width_squared(self, xz: Floats) -> Floats:
        """h² in mm², (n,), negative outside the contour."""
        return np.asarray(self._half_width_squared(*np.atleast_2d(xz).T, grid=False))

    def half_width(self, xz: Floats) -> Floats:
        """h in mm, (n,), zero outside the contour."""
        return np.sqrt(np.clip(self.half_width_squared(xz), 0, None))

    def _gradient(self, points: Floats) -> Floats:
        x, y, z = points.T
        f = self._half_width_squared
        return np.stack([f(x, z, dx=1, grid=False), -2 * y, f(x, z, dy=1, grid=False)], axis=1)

    def level(self, points: Floats) -> Floats:
        """First-order distance in mm below the surface of points (n, 3), negative outside."""
        value = self.half_width_squared(points[:, [0, 2]]) - points[:, 1] ** 2
        return np.asarray(value / np.linalg.norm(self._gradient(points), axis=1))

    def inward(self, points: Floats) -> Floats:
        """Unit normal into the tongue at points (n, 3) near its surface."""
        gradient = self._gradient(points)
        return np.asarray(gradient / np.linalg.norm(gradient, axis=1, keepdims=True))

    def surface(self, spacing: float = 1.0) -> Surface:
        """The half at y ≥ 0 of the tongue's surface, in mm, open along the mid-sagittal plane."""
        lower, upper = self.contour.min(axis=0) - 3 * spacing, self.contour.max(axis=0) + 3 * spacing
        x, z = (np.arange(lower[i], upper[i], spacing) for i in (0, 1))
        y = np.arange(0.0, FLOOR.max() + 3 * spacing, spacing)
        h2 = self.half_width_squared(np.stack(np.meshgrid(x, z, indexing="ij"), axis=2).reshape(-1, 2))
        grid = pv.ImageData(dimensions=(len(x), len(y), len(z)), spacing=(spacing,) * 3, origin=(x[0], 0.0, z[0]))
        grid["level"] = (h2.reshape(len(x), 1, len(z)) - y[None, :, None] ** 2).ravel(order="F")
        mesh = grid.contour([0.0], scalars="level").clean(tolerance=1e-3)
        return Surface.from_pyvista(mesh)
