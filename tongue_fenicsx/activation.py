# SPDX-License-Identifier: MIT
"""Muscle activation over time: piecewise linear, as in the chapter's Figure 4.4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .errors import InputError


@dataclass(frozen=True)
class Activation:
    """Activation in 0…1 as straight pieces; the last level holds for ever.

    Attributes
    ----------
    pieces : sequence of (duration, start, target)
        Duration in s, levels without unit.

    Raises
    ------
    InputError
        If a duration is not positive or a level is not a number in 0…1.
    """

    pieces: Sequence[tuple[float, float, float]]

    def __post_init__(self) -> None:
        if not self.pieces:
            raise InputError("activation: no pieces; a list of [duration in s, start level, target level] is expected.")
        for number, piece in enumerate(self.pieces, start=1):
            if len(piece) != 3:
                raise InputError(
                    f"activation: piece {number} has {len(piece)} numbers; [duration in s, start level, target level] is expected."
                )
            duration, *levels = piece
            if not (np.isfinite(duration) and duration > 0):
                raise InputError(f"activation: the duration of piece {number} is {duration}; a positive number of seconds is expected.")
            for level in levels:
                if not 0 <= level <= 1:  # also catches NaN
                    raise InputError(f"activation: a level of piece {number} is {level}; a number from 0 to 1 is expected.")

    def __call__(self, t: float) -> float:
        """Level at time `t` (s)."""
        for duration, start, target in self.pieces:
            if t <= duration:
                return float(start + (target - start) * max(t, 0.0) / duration)
            t -= duration
        return float(self.pieces[-1][2])

    @property
    def kinks(self) -> list[float]:
        """Times in s at which a piece ends."""
        return np.cumsum([piece[0] for piece in self.pieces]).tolist()


def ramp(rise: float, hold: float, level: float = 1.0) -> Activation:
    """Rise from 0 to `level` in `rise` seconds and hold it for `hold` seconds."""
    return Activation([(rise, 0.0, level), (hold, level, level)])
