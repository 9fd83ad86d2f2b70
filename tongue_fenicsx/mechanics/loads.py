# SPDX-License-Identifier: MIT
"""Loads on tagged surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError


@dataclass(frozen=True)
class Pressure:
    """A pressure on a surface, which it follows as the surface moves and stretches.

    Attributes
    ----------
    pieces : sequence of (duration, start, target)
        In s and Pa, straight in time; positive pushes into the tongue, the last target holds for ever.

    Raises
    ------
    InputError
        If there are no pieces, a duration is not positive or a pressure is not finite.
    """

    pieces: Sequence[tuple[float, float, float]]

    def __post_init__(self) -> None:
        if not self.pieces:
            raise InputError("load: no pieces; a list of [duration in s, start in Pa, target in Pa] is expected.")
        for number, piece in enumerate(self.pieces, start=1):
            if len(piece) != 3 or not np.isfinite(piece).all() or piece[0] <= 0:
                raise InputError(f"load: piece {number} is {list(piece)}; [duration in s above 0, start in Pa, target in Pa] is expected.")

    def at(self, t: float) -> float:
        """Pressure in Pa at time `t` (s)."""
        for duration, start, target in self.pieces:
            if t <= duration:
                return float(start + (target - start) * max(t, 0.0) / duration)
            t -= duration
        return float(self.pieces[-1][2])

    @property
    def kinks(self) -> list[float]:
        """Times in s at which a piece ends."""
        return np.cumsum([piece[0] for piece in self.pieces]).tolist()
