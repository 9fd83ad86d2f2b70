# SPDX-License-Identifier: MIT
"""Tissue as one value: passive law, density, damping and the peak stresses of its muscles, and the presets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

from ..anatomy.catalogue import PEAK_STRESS
from ..core.errors import InputError
from ..core.values import Real, checked
from .hyperelasticity import Passive, Yeoh, numbers

Density = Annotated[float, Real("kg/m³", "density", low=0, above=True)]
MassDamping = Annotated[float, Real("1/s", "Rayleigh α", low=0)]
StiffnessDamping = Annotated[float, Real("s", "Rayleigh β", low=0)]
PeakStress = Annotated[float, Real("Pa", "peak stress", low=0)]


@dataclass(frozen=True)
@checked("damping")
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

    alpha: MassDamping = 0.0
    beta: StiffnessDamping = 0.0


@dataclass(frozen=True)
@checked("tissue")
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
    density: Density
    damping: Rayleigh = Rayleigh()
    peak_stress: Mapping[str, PeakStress] = field(default_factory=dict)
    source: str = field(default="", compare=False)

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


def number_of(tissue: Tissue, name: str) -> float:
    """A number of a tissue: of its law (``c10``, ``nu``), its ``density`` in kg/m³, its damping (``alpha`` in 1/s, ``beta`` in s), or the
    peak stress in Pa of a muscle.

    Raises
    ------
    InputError
        If it has no such number.
    """
    law = {**numbers(tissue.law), "nu": tissue.law.nu}
    known = {**law, "density": tissue.density, **numbers(tissue.damping), **tissue.peak_stress}
    if name not in known:
        raise InputError(f"gradient: the tissue has no number {name!r}; it has {', '.join(known)}.")
    return float(known[name])


def with_number(tissue: Tissue, name: str, value: float) -> Tissue:
    """The tissue with another value of a number of `number_of`."""
    if name == "density":
        return replace(tissue, density=value)
    if name in tissue.peak_stress:
        return replace(tissue, peak_stress={**tissue.peak_stress, name: value})
    if name in numbers(tissue.damping):
        return replace(tissue, damping=replace(tissue.damping, **{name: value}))
    return replace(tissue, law=replace(tissue.law, **{name: value}))  # type: ignore[type-var]


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
