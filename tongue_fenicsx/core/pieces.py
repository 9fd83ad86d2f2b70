# SPDX-License-Identifier: MIT
"""Courses in time as pieces of (duration in s, start, target); the last target holds for ever."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Any

Piece = tuple[float, Any, Any]


def follow(pieces: Sequence[Piece], t: float) -> float:
    """The value at time `t` (s), straight within each piece."""
    for duration, start, target in pieces:
        if t <= duration:
            share = max(t, 0.0) / duration
            return float((1 - share) * start + share * target)  # never beyond its ends
        t -= duration
    return float(pieces[-1][2])


def ends(pieces: Sequence[Piece]) -> list[float]:
    """Times in s at which a piece ends."""
    return list(accumulate(float(piece[0]) for piece in pieces))
