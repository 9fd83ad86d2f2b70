# SPDX-License-Identifier: MIT
"""The free parameters of the parametric tongue, as a smooth map of the space in which it is drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from .errors import InputError
from .fibres import Floats

MM = 1e-3
RANGES = {
    "length": (58.0, 84.0), "width": (40.0, 60.0), "height": (32.0, 48.0), "root": (-5.0, 8.0), "tip": (-4.0, 10.0), "scale": (0.4, 1.3),
}  # fmt: skip
"""What is accepted for each parameter of a shape."""

BASE = {"length": 70.0, "width": 50.0, "height": 39.4}
"""The tongue as drawn, in mm."""

ADULT_VOLUME = {"male": 89.9, "female": 68.9}
"""Volume of the tongue proper in cm³: means of 35 men and 35 women, 20 to 37 years (Liégeois 2010, MRI)."""

DRAWN_VOLUME = 70.3
"""The same of the tongue as drawn."""

GROWTH = ((0.0, 12.0, 18.0), (0.45, 0.9, 1.0))
"""Age in years, and length, width and thickness over those of an adult: they double between birth and adolescence and
grow on (Siebert 1985); linear in between."""


@dataclass(frozen=True)
class TongueShape:
    """A tongue of another size or form; the defaults are the tongue as drawn.

    Attributes
    ----------
    length : float
        Chord from tip to root in mm, 58 to 84.
    width : float
        Largest width of the oral part in mm, 40 to 60.
    height : float
        Height of the dorsum over the genial spine in mm, 32 to 48.
    root : float
        How much farther back the root lies, in mm, -5 to 8.
    tip : float
        How much farther the blade reaches forward, in mm, -4 to 10.
    scale : float
        Of everything, 0.4 to 1.3; `of_person` finds it from sex and age.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    length: float = BASE["length"]
    width: float = BASE["width"]
    height: float = BASE["height"]
    root: float = 0.0
    tip: float = 0.0
    scale: float = 1.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value, (low, high) = getattr(self, item.name), RANGES[item.name]
            if not low <= value <= high:  # also catches NaN
                unit = "" if item.name == "scale" else " mm"
                raise InputError(f"shape.{item.name}: {value:g}{unit} is out of range; {low:g} to {high:g}{unit} is accepted.")

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
        placed = x * self.length / BASE["length"] + self.root * _smoothstep((x - 12.0) / 30.0) - self.tip * _smoothstep((-4.0 - x) / 12.0)
        return x, placed

    def place(self, points: Floats) -> Floats:
        """Points (n, 3) of the drawing in mm as points of this tongue in m."""
        x, y, z = points.T
        placed = np.column_stack([np.interp(x, *self._along), y * self.width / BASE["width"], z * self.height / BASE["height"]])
        return np.asarray(self.scale * MM * placed)

    def drawn(self, points: Floats) -> Floats:
        """Points (n, 3) of this tongue in m as points of the drawing in mm, the inverse of `place`."""
        x, y, z = points.T / (self.scale * MM)
        return np.column_stack([np.interp(x, *self._along[::-1]), y * BASE["width"] / self.width, z * BASE["height"] / self.height])


def _smoothstep(s: Floats) -> Floats:
    t = np.clip(s, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))
