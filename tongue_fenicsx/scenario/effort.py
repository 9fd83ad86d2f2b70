# SPDX-License-Identifier: MIT
"""What a run will cost, by what others did (docs/performance.md)."""

from __future__ import annotations

import math

ITERATION = 3.6e-6
"""Seconds of a Newton iteration on one core, for each unknown: 0.06 s of the coarse tongue, 0.68 s of the chapter's mesh."""
FREE, TOUCHING = 1.5, 3.0
"""Newton iterations of a step without obstacles, and with some."""
BASE, UNKNOWN = 0.45, 2e-6
"""GiB of the process, and of each unknown: 0.83 GiB with the chapter's mesh."""


def seconds(n_unknowns: int, t_end: float, longest: float, contact: bool) -> float:
    """Of a run of `t_end` (s) in steps of `longest` (s), on one core, give or take a factor of two."""
    return ITERATION * n_unknowns * math.ceil(t_end / longest) * (TOUCHING if contact else FREE)


def memory(n_unknowns: int) -> float:
    """GiB that it takes on one rank."""
    return BASE + UNKNOWN * n_unknowns
