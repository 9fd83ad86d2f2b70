# SPDX-License-Identifier: MIT
"""Tissue as one value: passive law, density, damping and the peak stresses of its muscles, and the presets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ..anatomy.catalogue import PEAK_STRESS
from ..core.errors import InputError
from .hyperelasticity import Passive, Yeoh


@dataclass(frozen=True)
class Rayleigh:
    """Rayleigh damping, α ρ v + β K₀ v with the stiffness K₀ of the rest state.

    Attributes
    ----------
    alpha : float
        Mass damping in 1/s.
    beta : float
        Stiffness damping in s.

    Raises
    ------
    InputError
        If a number is negative.
    """

    alpha: float = 0.0
    beta: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("alpha", self.alpha), ("beta", self.beta)):
            if not 0 <= value < math.inf:
                raise InputError(f"rayleigh_{name}: {value}; zero or a positive number is expected.")


@dataclass(frozen=True)
class Tissue:
    """What a tongue is made of.

    Attributes
    ----------
    law : Passive
        Passive law.
    density : float
        kg/m³ at rest.
    damping : Rayleigh
        Rayleigh damping.
    peak_stress : mapping
        Peak active stress in Pa by muscle (``GGP``) or muscle and side (``GGP_L``).
    source : str
        Where the numbers come from.

    Raises
    ------
    InputError
        If the density is not positive or a peak stress is negative.
    """

    law: Passive
    density: float
    damping: Rayleigh = Rayleigh()
    peak_stress: Mapping[str, float] = field(default_factory=dict)
    source: str = ""

    def __post_init__(self) -> None:
        if not 0 < self.density < math.inf:
            raise InputError(f"density: {self.density} kg/m³; a positive number is expected.")
        for name, value in self.peak_stress.items():
            if not 0 <= value < math.inf:
                raise InputError(f"peak_stress: {name} has {value} Pa; zero or a positive stress is expected.")

    @classmethod
    def calka(cls) -> Tissue:
        """Fresh cadaver tongue, as in the chapter."""
        return TISSUES["calka"]

    @classmethod
    def buchaillard(cls) -> Tissue:
        """Living tongue at rest."""
        return TISSUES["buchaillard"]

    @classmethod
    def kappert(cls) -> Tissue:
        """Living tongue, by aspiration."""
        return TISSUES["kappert"]


TISSUES: dict[str, Tissue] = {
    "calka": Tissue(
        Yeoh(c10=192.0, c20=90.0), 1000.0, Rayleigh(20.0), PEAK_STRESS["calka"],
        "fresh cadaver tongue by indentation (Gerard 2005), density and damping of the chapter",
    ),
    "buchaillard": Tissue(
        Yeoh(c10=1037.0, c20=486.0), 1040.0, Rayleigh(40.0, 0.03), PEAK_STRESS["buchaillard"],
        "living tissue: Gerard's scaled to muscle at rest (Buchaillard 2009)",
    ),
    "kappert": Tissue(
        Yeoh(c10=273.0, c20=128.0), 1040.0, Rayleigh(20.0), PEAK_STRESS["kappert"],
        "E = 1638 Pa in vivo by aspiration (Kappert 2021), C₂₀/C₁₀ as Gerard, the chapter's damping",
    ),
}  # fmt: skip
"""The presets, by the name that a scenario gives."""
