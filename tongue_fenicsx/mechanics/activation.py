# SPDX-License-Identifier: MIT
"""Muscle activation over time: piecewise linear, as in the chapter's Figure 4.4, from a table, or any function of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np

from ..core.errors import InputError, reading
from ..core.number_tables import numbers_in
from ..core.pieces import ends, follow
from ..core.types import Floats
from ..core.values import Duration, Real, Share, checked

Pieces = Sequence[tuple[Duration, Share, Share]]
TimeConstant = Annotated[float, Real("s", low=1e-4, high=1)]


@runtime_checkable
class Course(Protocol):
    """A level in 0…1 over time."""

    def __call__(self, t: float, /) -> float:
        """Level at time `t` (s)."""

    @property
    def kinks(self) -> list[float]:
        """Times in s that a step must end on."""

    def description(self, t_end: float, /) -> list[Any]:
        """What makes the course until `t_end` (s), in plain numbers and names."""


@dataclass(frozen=True)
@checked("activation")
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

    pieces: Pieces

    def __post_init__(self) -> None:
        if not self.pieces:
            raise InputError("activation: no pieces; a list of [duration in s, start level, target level] is expected.")

    def __call__(self, t: float) -> float:
        """Level at time `t` (s)."""
        return follow(self.pieces, t)

    @property
    def kinks(self) -> list[float]:
        """Times in s at which a piece ends."""
        return ends(self.pieces)

    def description(self, t_end: float) -> list[Any]:
        """The pieces."""
        return [list(piece) for piece in self.pieces]

    @classmethod
    def from_table(cls, path: Path) -> Activation:
        """Straight lines between the rows of a CSV file: time in s from 0 on, level in 0…1; a first line of names is skipped.

        Columns are parted by commas, or by semicolons or tabulators, and then numbers may have a decimal comma.

        Raises
        ------
        InputError
            If the file cannot be read, times do not grow, or a level is not in 0…1.
        """
        with reading(path, "two columns, time in s and level from 0 to 1,"):
            times, levels = numbers_in(path.read_text(encoding="utf-8-sig"), 2).T
            if len(times) < 2:
                raise ValueError("it has less than two rows")
            if not (times[0] >= 0 and np.all(np.diff(times) > 0)):
                raise ValueError("the times do not grow from 0 on")
        if times[0] > 0:
            times, levels = np.r_[0.0, times], np.r_[levels[0], levels]
        try:
            return cls([(float(d), float(a), float(b)) for d, a, b in zip(np.diff(times), levels[:-1], levels[1:], strict=True)])
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


@dataclass(frozen=True)
class FunctionOfTime:
    """Activation as a Python function of time in s.

    Attributes
    ----------
    function : callable
        Returns the level.
    kinks : list of float
        Times in s that a step must end on.
    """

    function: Callable[[float], float]
    kinks: list[float] = field(default_factory=list)

    def __call__(self, t: float) -> float:
        """Level at time `t` (s).

        Raises
        ------
        InputError
            If the function returns something else than a number in 0…1.
        """
        level = float(self.function(t))
        if not 0 <= level <= 1:  # also catches NaN
            raise InputError(f"activation: the function returns {level} at t = {t:g} s; a number from 0 to 1 is expected.")
        return level

    def description(self, t_end: float) -> list[Any]:
        """Its levels every millisecond until `t_end` (s), beyond which it need not have any."""
        return [self(1e-3 * i) for i in range(int(1e3 * t_end * (1 + 1e-12)) + 1)]


@dataclass(frozen=True)
@checked("excitation")
class Excited:
    """Activation that follows an excitation with first-order dynamics, ȧ = (e − a)/τ (Zajac 1989).

    Attributes
    ----------
    excitation : Course
        e(t).
    rise, fall : float
        τ in s while e > a, and while e < a.

    Raises
    ------
    InputError
        If a time constant is not between 0.1 ms and 1 s.
    """

    excitation: Course
    rise: TimeConstant = 0.01
    fall: TimeConstant = 0.04

    _STEP = 1e-4

    def __call__(self, t: float) -> float:
        """Activation at time `t` (s), from rest at 0."""
        return float(np.interp(t, np.arange(len(self._levels)) * self._STEP, self._levels)) if t < self._end else self._beyond(t)

    @property
    def kinks(self) -> list[float]:
        """Those of the excitation."""
        return self.excitation.kinks

    def description(self, t_end: float) -> list[Any]:
        """The excitation and the time constants."""
        return ["excited", self.rise, self.fall, self.excitation.description(t_end)]

    @property
    def _end(self) -> float:
        return (len(self._levels) - 1) * self._STEP

    @cached_property
    def _levels(self) -> Floats:
        """Activation every 0.1 ms to a second after the last kink, exact for an excitation that is constant between."""
        n = math.ceil((max(self.kinks, default=0.0) + 1.0) / self._STEP)
        levels = np.zeros(n + 1)
        for i in range(n):
            levels[i + 1] = self._next(levels[i], self.excitation((i + 0.5) * self._STEP), self._STEP)
        return levels

    def _next(self, level: float, excitation: float, h: float) -> float:
        tau = self.rise if excitation > level else self.fall
        return excitation + (level - excitation) * math.exp(-h / tau)

    def _beyond(self, t: float) -> float:
        return self._next(float(self._levels[-1]), self.excitation(t), t - self._end)


def ramp(rise: float, hold: float, level: float = 1.0) -> Activation:
    """Rise from 0 to `level` in `rise` seconds and hold it for `hold` seconds."""
    return Activation([(rise, 0.0, level), (hold, level, level)])
