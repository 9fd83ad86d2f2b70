# SPDX-License-Identifier: MIT
"""Bones that move: a rigid motion given in time, in pieces that start and stop as living jaws do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.pieces import ends
from ..core.types import Floats
from ..core.values import Direction, Duration, Number, Point, checked


@dataclass(frozen=True)
@checked("motion")
class RigidMotion:
    """Rotation about an axis that stays in place, then a translation; both from piece to piece with least jerk.

    Within a piece the share τ of its duration gives the share 10τ³ − 15τ⁴ + 6τ⁵ of the way (Flash and Hogan 1985), so that
    speed and acceleration are continuous; the last target holds for ever.

    Attributes
    ----------
    angle : sequence of (duration, start, target)
        In s and degrees, right-handed about `axis`.
    translation : sequence of (duration, start, target)
        In s and m, start and target (3,).
    centre, axis : (3,) sequence of float
        A point of the axis in m, and its direction; by default the transverse axis through the origin.

    Raises
    ------
    InputError
        If a duration is not positive, a number is not finite, the axis has no direction, or nothing moves.
    """

    angle: Sequence[tuple[Duration, Number, Number]] = ()
    translation: Sequence[tuple[Duration, Point, Point]] = ()
    centre: Point = (0.0, 0.0, 0.0)
    axis: Direction = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        if not (self.angle or self.translation):
            raise InputError("motion: neither angle nor translation is given; pieces of [duration in s, start, target] are expected.")
        if not np.any(self.axis):
            raise InputError("motion.axis: [0, 0, 0] has no direction.")

    def pose(self, t: float) -> tuple[Floats, Floats]:
        """Rotation (3, 3) and offset (3,) in m at time `t` (s): a point X of the rest shape is at R X + offset."""
        from scipy.spatial.transform import Rotation

        unit = np.asarray(self.axis, dtype=float) / np.linalg.norm(self.axis)
        turn = Rotation.from_rotvec(_follow_smoothly(self.angle, t, 0.0) * unit, degrees=True).as_matrix()
        return turn, self.centre - turn @ self.centre + _follow_smoothly(self.translation, t, np.zeros(3))

    def displacement(self, points: Floats, t: float) -> Floats:
        """Displacement in m of points (n, 3) of the rest shape at time `t` (s)."""
        turn, offset = self.pose(t)
        return np.asarray(points @ turn.T + offset - points)

    @property
    def kinks(self) -> list[float]:
        """Times in s at which a piece ends."""
        return [*ends(self.angle), *ends(self.translation)]


def _follow_smoothly(pieces: Sequence[tuple[float, Any, Any]], t: float, rest: Any) -> Any:
    """The value that pieces have reached at time `t`, `rest` without any."""
    value = rest
    for duration, start, target in pieces:
        share = min(max(t / duration, 0.0), 1.0)
        way = share**3 * (10 - 15 * share + 6 * share**2)
        value = (1 - way) * np.asarray(start) + way * np.asarray(target)
        if t <= duration:
            break
        t -= duration
    return value
