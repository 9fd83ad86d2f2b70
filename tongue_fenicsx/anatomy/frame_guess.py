# SPDX-License-Identifier: MIT
"""What the numbers of a tongue's surface mean, guessed from its size, its symmetry and its likeness to the built-in tongue."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull, cKDTree

from ..core.errors import InputError
from ..core.types import Floats
from ..core.values import UNITS
from ..geometry.registration import Similarity, lay_on, scatter
from ..geometry.surface import Surface
from .parametric.tongue import parametric_tongue

LENGTH, HULL = (0.03, 0.3), (5e-6, 400e-6)
"""Longest extent in m, and volume in m³ of the convex hull, that a tongue from a child's to a large one's may have."""
ASKEW = 0.03
"""No tongue is farther from its own mirror image, of its length; turned by 10° out of a mid-sagittal plane it is."""
UNLIKE = 0.08
"""No tongue is farther from the built-in one, of its length."""
ALIKE = 1.1
"""By this factor at least a tongue is farther from the built-in one in any other attitude: five real ones by 1.19 and more, a ball, an egg
and an ellipsoid by 1.03 at most."""
TURNED = 45.0
"""A surface that must be turned farther, in degrees, lies along other axes."""


@dataclass(frozen=True)
class Guess:
    """How a file's coordinates are meant.

    Attributes
    ----------
    unit : str or float
        Of the file: ``m``, ``cm``, ``mm``, or its length in m if it is none of them.
    axes : str
        As in `Frame`. Left and right are told by handedness alone: a tongue's shape does not say.
    mid_plane : float
        Lateral coordinate, in the file's unit, of the plane of symmetry.
    length : float
        Longest extent in m.
    turned, distance : float
        By how many degrees the built-in tongue is turned to lie on it so, and how far, in m and in the mean, it is then.
    """

    unit: str | float
    axes: str
    mid_plane: float
    length: float
    turned: float
    distance: float

    @property
    def metre(self) -> float:
        """Length of the unit in m."""
        return in_metres(self.unit)


def guess_frame(surface: Surface, source: str) -> Guess:
    """Guess it from a surface in the file's own coordinates; it may be open.

    Raises
    ------
    InputError
        If it does not resemble a tongue in any attitude.
    """
    unit = likely_unit(surface.points)
    metre = in_metres(unit)
    metres = surface.transform(lambda points: metre * points)
    length = float(np.ptp(metres.points, axis=0).max())
    if surface.n_bodies > 1:
        raise InputError(f"{source}: holds {surface.n_bodies} bodies that do not hang together; the tongue alone is expected.")
    asymmetry, lateral, middle = _symmetry(scatter(metres, 4000))
    if asymmetry > ASKEW * length:
        raise InputError(
            f"{source}: mirrored at any plane across its axes the surface is {1e3 * asymmetry:.1f} mm from itself, and at most "
            f"{1e3 * ASKEW * length:.1f} mm is accepted; a whole tongue, its mid-sagittal plane across one axis, is expected."
        )
    built_in, found = parametric_tongue().surface, []
    others = [axis for axis in range(3) if axis != lateral]
    for back, up in (others, others[::-1]):
        for signs in product((1, -1), repeat=2):
            turn = np.zeros((3, 3))
            turn[0, back], turn[2, up] = signs
            turn[1, lateral] = 1.0
            turn[1] *= np.linalg.det(turn)  # a proper rotation
            laid, distance = lay_on(built_in, metres.moved(turn, -middle * turn[:, lateral]))
            found.append((distance, _angle(laid), turn))
    upright = [entry for entry in found if entry[1] <= TURNED]
    distance, turned, turn = min(upright, key=lambda entry: entry[0], default=(np.inf, 0.0, np.eye(3)))
    other = min(entry[0] for entry in found if entry[2] is not turn)
    if distance > UNLIKE * length:
        raise InputError(
            f"{source}: the surface resembles a tongue in no attitude: the built-in one, laid on it, is {1e3 * distance:.1f} mm away, at "
            f"most {1e3 * UNLIKE * length:.1f} mm is accepted. If it is one, make the folder and its frame.toml by hand."
        )
    if other < ALIKE * distance:
        raise InputError(
            f"{source}: the surface resembles a tongue as much in one attitude ({1e3 * distance:.1f} mm away) as in another "
            f"({1e3 * other:.1f} mm), as a ball does. If it is a tongue, make the folder and its frame.toml by hand."
        )
    rows = abs(turn).argmax(axis=0)
    axes = "".join("PRS"[row] if turn[row, axis] > 0 else "ALI"[row] for axis, row in enumerate(rows))
    return Guess(unit, axes, middle / metre, length, turned, distance)


def in_metres(unit: str | float) -> float:
    """Length of a unit in m, by its name or itself."""
    return UNITS[unit] if isinstance(unit, str) else float(unit)


def likely_unit(points: Floats) -> str | float:
    """The unit in which points (n, 3) of a surface are a tongue's, or the length in m of one that makes it as large as the built-in."""
    for name, metre in UNITS.items():
        if is_tongue(points * metre):
            return name
    return float(f"{np.cbrt(hull(parametric_tongue().surface.points) / hull(points)):.2g}")


def is_tongue(points: Floats) -> bool:
    """Whether points (n, 3) in m spread and enclose as much as those of a tongue."""
    return bool(LENGTH[0] <= np.ptp(points, axis=0).max() <= LENGTH[1] and HULL[0] <= hull(points) <= HULL[1])


def hull(points: Floats) -> float:
    """Volume of the convex hull of points (n, 3), flat ones too."""
    return float(ConvexHull(points, qhull_options="QJ").volume)


def _symmetry(points: Floats) -> tuple[float, int, float]:
    """How far points (n, 3) mirrored at a plane across an axis are from themselves in the mean, the axis where that is least, and where on
    it the plane is."""
    tree, size = cKDTree(points), float(np.ptp(points, axis=0).max())

    def asymmetry(middle: float, axis: int) -> float:
        mirrored = points.copy()
        mirrored[:, axis] = 2 * middle - mirrored[:, axis]
        return float(tree.query(mirrored)[0].mean())

    best = []
    for axis in range(3):
        centre = float(points[:, axis].mean())
        near = (centre - 0.1 * size, centre + 0.1 * size)
        result = minimize_scalar(asymmetry, bounds=near, args=(axis,), method="bounded", options={"xatol": 1e-4 * size})
        best.append((float(result.fun), axis, float(result.x)))
    return min(best)


def _angle(laid: Similarity) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(laid.rotation) - 1) / 2, -1, 1))))
