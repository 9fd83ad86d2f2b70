# SPDX-License-Identifier: MIT
"""A run at any time: between two outputs its fields change in proportion, between two steps its obstacles do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from ..core.types import Floats

if TYPE_CHECKING:
    from ..geometry.surface import Surface
    from ..runs.run import Run


def ends(run: Run) -> tuple[float, float]:
    """The times in s of the first and the last output.

    Raises
    ------
    InputError
        If the file of the fields is missing or damaged.
    """
    with run.reading("fields.h5"):
        first, last = map(float, run.output_times[[0, -1]])
    return first, last


def check_moment(run: Run, t: float, what: str) -> float:
    """A time in s at which the run has fields.

    Raises
    ------
    InputError
        If it lies before the first output or after the last; `what` is named.
    """
    first, last = ends(run)
    if not first - 1e-9 <= t <= last + 1e-9:
        raise InputError(f"{what}: {t:g} s; {run} has fields from {first:g} to {last:g} s, and a time between them is expected.")
    return float(np.clip(t, first, last))


def field_at(run: Run, name: str, t: float) -> Floats:
    """A stored field (as of `Run.field`) at a time in s."""
    times = run.output_times
    after = int(np.searchsorted(times, t))
    if after == len(times) or times[after] == t:
        return run.field(name, min(after, len(times) - 1))
    before = max(after - 1, 0)
    share = (t - times[before]) / (times[after] - times[before]) if after > before else 0.0
    return np.asarray((1 - share) * run.field(name, before) + share * run.field(name, after))


def pose_at(run: Run, obstacle: str, t: float) -> tuple[Floats, Floats]:
    """Where an obstacle is at a time in s: rotation (3, 3) and offset (3,) in m."""

    def interpolate(part: str) -> Floats:
        return np.array([np.interp(t, run.time, values) for values in run.contact[obstacle][part].T])

    return interpolate("rotation").reshape(3, 3), interpolate("offset")


def obstacles_at(run: Run, t: float) -> dict[str, Surface]:
    """The surfaces of the obstacles where they are at a time in s."""
    return {name: surface.moved(*pose_at(run, name, t)) for name, surface in run.obstacles_at_rest.items()}
