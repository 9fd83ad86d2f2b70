# SPDX-License-Identifier: MIT
"""What a run will cost, by what others did (docs/performance.md)."""

from __future__ import annotations

import math

ITERATION = 3.6e-6
"""Seconds of a Newton iteration on one core, for each unknown: 0.06 s of the coarse tongue, 0.68 s of the chapter's mesh."""
FREE, TOUCHING = 1.5, 3.0
"""Newton iterations of a step without obstacles, and with some."""
BASE, UNKNOWN = 0.25, 3e-6
"""GiB of the process, and of each unknown: 0.83 GiB with the chapter's mesh."""


def seconds(n_unknowns: int, t_end: float, every: float, longest: float, contact: bool) -> float:
    """Of a run of `t_end` (s) with an output `every` so many s, in steps of at most `longest` (s), on one core, within a factor of two."""
    n_steps = math.ceil(min(every, t_end) / longest - 1e-9) * math.ceil(t_end / min(every, t_end) - 1e-9)
    return ITERATION * n_unknowns * n_steps * (TOUCHING if contact else FREE)


def memory(n_unknowns: int) -> float:
    """GiB that it takes on one rank."""
    return BASE + UNKNOWN * n_unknowns
