# SPDX-License-Identifier: MIT
"""The free parameters of the parametric tongue, as a smooth map of the space in which it is drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from ...core.errors import InputError
from ...core.types import Floats
from ...core.values import Real, checked

MM = 1e-3
BASE = {"length": 0.070, "width": 0.050, "height": 0.0394}
"""The tongue as drawn, in m."""

ADULT_VOLUME = {"male": 89.9, "female": 68.9}
"""Volume of the tongue proper in cm³: means of 35 men and 35 women, 20 to 37 years (Liégeois 2010, MRI)."""

DRAWN_VOLUME = 70.3
"""The same of the tongue as drawn."""

PRESETS = {"coarse": 6.4e-3, "medium": 4.2e-3, "reference": 2.32e-3}
"""Element sizes in m of the meshes of the parametric tongue that have a name."""

SPLITTABLE = ("GGP", "SL")
"""Muscles of it that may be split (see `parametric_tongue`)."""

GROWTH = ((0.0, 12.0, 18.0), (0.45, 0.9, 1.0))
"""Age in years, and length, width and thickness over those of an adult: they double between birth and adolescence and
grow on (Siebert 1985); linear in between."""


@dataclass(frozen=True)
@checked("shape")
class TongueShape:
    """A tongue of another size or form; the defaults are the tongue as drawn.

    Attributes
    ----------
    length : float
        Chord from tip to root in m, 0.058 to 0.084.
    width : float
        Largest width of the oral part in m, 0.040 to 0.060.
    height : float
        Height of the dorsum over the genial spine in m, 0.032 to 0.048.
    root : float
        How much farther back the root lies, in m, -0.005 to 0.008.
    tip : float
        How much farther the blade reaches forward, in m, -0.004 to 0.010.
    scale : float
        Of everything, 0.4 to 1.3; `of_person` finds it from sex and age.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    length: Annotated[float, Real("m", low=0.058, high=0.084)] = BASE["length"]
    width: Annotated[float, Real("m", low=0.040, high=0.060)] = BASE["width"]
    height: Annotated[float, Real("m", low=0.032, high=0.048)] = BASE["height"]
    root: Annotated[float, Real("m", low=-0.005, high=0.008)] = 0.0
    tip: Annotated[float, Real("m", low=-0.004, high=0.010)] = 0.0
    scale: Annotated[float, Real(low=0.4, high=1.3)] = 1.0

    @classmethod
    def of_person(cls, sex: str = "male", age: float = 30.0) -> TongueShape:
        """The mean tongue of a person: volume by sex (Liégeois 2010), growth by age (Siebert 1985).

        Parameters
        ----------
        sex : str
            ``"male"`` or ``"female"``.
        age : float
            In years, 0 to 100; from 18 on the tongue is an adult's.
        """
        if sex not in ADULT_VOLUME:
            raise InputError(f"sex: {sex!r} is not one of {', '.join(ADULT_VOLUME)}.")
        if not 0 <= age <= 100:
            raise InputError(f"age: {age:g} years is out of range; 0 to 100 is accepted.")
        adult = math.cbrt(ADULT_VOLUME[sex] / DRAWN_VOLUME)
        return cls(scale=round(adult * float(np.interp(age, *GROWTH)), 4))

    @cached_property
    def _along(self) -> tuple[Floats, Floats]:
        """x as drawn and x placed, before scaling, in mm; increasing."""
        x = np.linspace(-150.0, 200.0, 7001)
        root, tip = self.root / MM, self.tip / MM
        placed = x * self.length / BASE["length"] + root * _smoothstep((x - 12.0) / 30.0) - tip * _smoothstep((-4.0 - x) / 12.0)
        return x, placed

    def place(self, points: Floats) -> Floats:
        """Points (n, 3) of the drawing in mm as points of this tongue in m."""
        x, y, z = points.T
        placed = np.column_stack([np.interp(x, *self._along), y * self.width / BASE["width"], z * self.height / BASE["height"]])
        return np.asarray(self.scale * MM * placed)

    def to_drawing(self, points: Floats) -> Floats:
        """Points (n, 3) of this tongue in m as points of the drawing in mm, the inverse of `place`."""
        x, y, z = points.T / (self.scale * MM)
        return np.column_stack([np.interp(x, *self._along[::-1]), y * BASE["width"] / self.width, z * BASE["height"] / self.height])


def _smoothstep(s: Floats) -> Floats:
    t = np.clip(s, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))
