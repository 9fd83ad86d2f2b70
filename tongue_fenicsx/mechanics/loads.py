# SPDX-License-Identifier: MIT
"""Loads on tagged surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from ..core.errors import InputError
from ..core.pieces import ends, follow
from ..core.values import Duration, Real, checked

Pascal = Annotated[float, Real("Pa")]


@dataclass(frozen=True)
@checked("load")
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

    pieces: Sequence[tuple[Duration, Pascal, Pascal]]

    def __post_init__(self) -> None:
        if not self.pieces:
            raise InputError("load: no pieces; a list of [duration in s, start in Pa, target in Pa] is expected.")

    def at(self, t: float) -> float:
        """Pressure in Pa at time `t` (s)."""
        return follow(self.pieces, t)

    @property
    def kinks(self) -> list[float]:
        """Times in s at which a piece ends."""
        return ends(self.pieces)


LOADS: dict[str, type[Pressure]] = {"pressure": Pressure}
"""Loads by the name that a scenario gives."""
