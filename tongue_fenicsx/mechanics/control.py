# SPDX-License-Identifier: MIT
"""What drives the muscles: courses over time, or feedback from their lengths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from ..core.errors import InputError
from .activation import Course


class Sensed(Protocol):
    """What a control sees of the tongue: the last accepted state."""

    t: float

    def length(self, muscle: str) -> float:
        """Mean length of a muscle's fibres, 1 at rest."""

    def rate(self, muscle: str) -> float:
        """Its rate in 1/s, negative while the muscle shortens."""

    @property
    def probes(self) -> Mapping[str, Any]:
        """Displacement (3,) in m of each probe."""


@runtime_checkable
class Control(Protocol):
    """Gives the activation of muscles; the same values at the same time and state, so that a run can go on."""

    @property
    def muscles(self) -> Sequence[str]:
        """Those it may activate: with sides, or both sides by their common name."""

    def levels(self, t: float, state: Sensed) -> Mapping[str, float]:
        """Activation 0…1 of each of them at time `t` (s), the end of the step that begins at `state`."""

    @property
    def kinks(self) -> list[float]:
        """Times in s that a step must end on."""


@dataclass(frozen=True)
class OpenLoop:
    """Activations that are given as courses over time.

    Attributes
    ----------
    courses : mapping
        Muscle to its course.
    """

    courses: Mapping[str, Course] = field(default_factory=dict)

    @property
    def muscles(self) -> list[str]:
        """As of `Control`."""
        return list(self.courses)

    def levels(self, t: float, state: Sensed | None = None) -> dict[str, float]:
        """As of `Control`; the state does not matter."""
        return {name: course(t) for name, course in self.courses.items()}

    @property
    def kinks(self) -> list[float]:
        """As of `Control`."""
        return [kink for course in self.courses.values() for kink in course.kinks]


@dataclass(frozen=True)
class StretchReflex:
    """The λ model of motor control (Feldman 1986): a muscle is active by how much it is longer than a threshold that the brain sets.

    The activation is gain · (length + damping · rate − threshold), between 0 and 1.

    Attributes
    ----------
    thresholds : mapping
        Muscle, with its side, to the length at which its activity begins, 1 at rest.
    gain : float
        Activation per length beyond the threshold.
    damping : float
        What a rate of 1/s adds to the length, in s.

    Raises
    ------
    InputError
        If the gain or a threshold is not positive, or the damping negative.
    """

    thresholds: Mapping[str, float]
    gain: float = 2.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        if not (self.gain > 0 and self.damping >= 0 and all(value > 0 for value in self.thresholds.values())):
            raise InputError("control: a positive gain, positive thresholds and a damping of at least 0 s are expected.")

    @property
    def muscles(self) -> list[str]:
        """As of `Control`."""
        return list(self.thresholds)

    def levels(self, t: float, state: Sensed) -> dict[str, float]:
        """As of `Control`."""
        return {name: self._level(state.length(name) + self.damping * state.rate(name) - at) for name, at in self.thresholds.items()}

    @property
    def kinks(self) -> list[float]:
        """None."""
        return []

    def _level(self, excess: float) -> float:
        return min(max(self.gain * excess, 0.0), 1.0)
