# SPDX-License-Identifier: MIT
"""What each muscle must do alone, as statements with bounds.

After Gray's anatomy and the muscles of the Grenoble tongue moved one by one (Buchaillard, Perrier, Payan 2009; Stavness et al. 2011).
The root under GGP goes 9 ± 3 mm forward where it is stimulated. Strain and speed at full activation: the chapter has some 50 % and 10 to
20 cm/s. The height of the tip under GGP, SG and HG is left open, because sources differ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from ..analysis.movement import Movement
from .calibration import TONGUE_MUSCLES


@dataclass(frozen=True)
class Criterion:
    """A statement about the movement of one muscle: a quantity lies between two bounds.

    Attributes
    ----------
    part, says : str
        What of the tongue does what.
    quantity : str
        Of a `Movement`.
    low, high : float
        Bounds, in mm unless `unit` says otherwise.
    slight : bool
        Whether the quantity must also stay below 0.5 mm or a tenth of the muscle's largest displacement.
    full : bool
        Whether it speaks of full activation only.
    unit : str
        Of the quantity.
    open : bool
        Whether it is stated by textbooks, but met by no published fibres: neither by those here nor by the Grenoble tongue itself
        (740 hexahedra in ArtiSynth, at 0.1, 0.3 and 0.5). Such statements are counted apart.
    """

    part: str
    says: str
    quantity: str
    low: float = -inf
    high: float = inf
    slight: bool = False
    full: bool = False
    unit: str = "mm"
    open: bool = False

    def holds(self, moved: Movement) -> bool:
        """Whether a movement is as stated."""
        high = min(self.high, max(0.5, 0.1 * moved["largest"])) if self.slight else self.high
        return self.low < moved[self.quantity] < high

    @property
    def bounds(self) -> str:
        """The bounds as printed."""
        unit = f" {self.unit}".rstrip()
        if self.slight:
            return (f"{self.low:g} mm < " if self.low > -inf else "") + "… < 0.5 mm or 10 %"
        if self.low > -inf and self.high < inf:
            return f"{self.low:g} to {self.high:g}{unit}"
        return f"> {self.low:g}{unit}" if self.low > -inf else f"< {self.high:g}{unit}"


WAYS = {"forward": ("x", -inf, 0.0), "back": ("x", 0.0, inf), "down": ("z", -inf, 0.0), "up": ("z", 0.0, inf)}
"""Axis and bounds of each direction."""


def _moves(part: str, *ways: str) -> list[Criterion]:
    return [Criterion(part, way, f"{part}_{axis}", low, high) for way in ways for axis, low, high in [WAYS[way]]]


def _still(part: str, says: str = "hardly moves", open: bool = False) -> Criterion:
    return Criterion(part, says, part, slight=True, open=open)


def _groove(part: str) -> Criterion:
    return Criterion(part, "groove", f"{part}_groove", low=0.5)


WIDER = Criterion("width", "wider", "width", low=0.3)
NARROWER = Criterion("width", "narrower", "width", high=-0.3)

STATEMENTS: dict[str, list[Criterion]] = {
    "GGP": [
        *_moves("tip", "forward"),
        *_moves("dorsum", "forward"),
        Criterion("dorsum", "not lowered", "dorsum_z", low=0.0),
        *_moves("root", "forward"),
        Criterion("root", "5 to 12 mm forward", "root_x", -12.0, -5.0, full=True),
        Criterion("width", "slightly wider", "width", low=0.3, slight=True, open=True),
    ],
    "GGM": [*_moves("tip", "forward"), *_moves("dorsum", "down", "forward"), _groove("dorsum"), *_moves("root", "forward")],
    "GGA": [*_moves("tip", "down"), *_moves("front", "down"), _still("root", open=True), _groove("front")],
    "SG": [*_moves("tip", "back"), *_moves("dorsum", "back", "up"), *_moves("root", "back"), NARROWER],
    "HG": [
        *_moves("tip", "back"),
        *_moves("dorsum", "back", "down"),
        *_moves("sides", "down"),
        *_moves("root", "back", "down"),
        *(replace(criterion, open=True) for criterion in _moves("edges", "down")),
    ],
    "IL": [*_moves("tip", "down", "back"), *_moves("dorsum", "back"), _still("root", "moves slightly", open=True), WIDER],
    "SL": [*_moves("tip", "up", "back"), Criterion("front", "concave", "front_bulge", high=0.0), _still("root", open=True), WIDER],
    "VERT": [
        *_moves("tip", "forward"),
        Criterion("dorsum", "flat", "dorsum_bulge", high=0.0, open=True),
        *_moves("dorsum", "down"),
        _still("root", open=True),
        WIDER,
    ],
    "TRANS": [*_moves("tip", "forward"), *_moves("dorsum", "up"), *_moves("root", "back", "up"), NARROWER],
    "GH": [_still("tip"), _still("dorsum"), _still("root")],
    "MH": [*_moves("tip", "up"), *_moves("dorsum", "up"), *_moves("root", "up")],
}
"""By muscle; the front is the mid-line halfway from tip to dorsum, the edges are beside it, the sides beside the dorsum."""

OF_THE_TONGUE = [
    Criterion("peak strain", "of the order of 0.5", "strain", 0.3, 0.8, full=True, unit=""),
    Criterion("peak speed", "as in speech", "speed", 5.0, 30.0, full=True, unit="cm/s"),
]
"""For the muscles of the tongue itself, not GH and MH."""
OF_ALL = [
    Criterion("mid-plane", "stays", "lateral", high=0.1),
    Criterion("volume", "stays", "volume", high=2.0, unit="%"),
]


def criteria(muscle: str, level: float) -> list[Criterion]:
    """The statements about a muscle at an activation."""
    everything = STATEMENTS[muscle] + (OF_THE_TONGUE if muscle in TONGUE_MUSCLES else []) + OF_ALL
    return [criterion for criterion in everything if level == 1 or not criterion.full]
