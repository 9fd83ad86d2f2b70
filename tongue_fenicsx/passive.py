# SPDX-License-Identifier: MIT
"""Passive tissue: strain energies of the isochoric invariant and of the volume."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import ufl

from .errors import InputError

Expr = Any
"""A UFL expression."""


class Passive(Protocol):
    """An isotropic hyperelastic law; its numbers become constants of the form, so changing them compiles nothing."""

    @property
    def nu(self) -> float:
        """Poisson's ratio."""

    @property
    def volumetric(self) -> str:
        """Name of the volumetric energy in `VOLUMETRIC`."""

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest in Pa."""

    @property
    def parameters(self) -> dict[str, float]:
        """The numbers of `isochoric_energy` in Pa."""

    def isochoric_energy(self, I1: Expr, parameters: Mapping[str, Expr]) -> Expr:
        """Energy density in J/m³ of the isochoric invariant Ī₁."""


VOLUMETRIC: dict[str, Callable[[Expr], Expr]] = {
    "quadratic": lambda J: (J - 1) ** 2 / 2,
    "barrier": lambda J: (J**2 - 1 - 2 * ufl.ln(J)) / 4,
}
"""Volumetric energy over κ by name: the chapter's, and one that resists J → 0 (Simo and Taylor 1982)."""


@dataclass(frozen=True)
class Yeoh:
    """Two-term Yeoh law, Ψ = C₁₀(Ī₁−3) + C₂₀(Ī₁−3)² + κ U(J), κ = 2C₁₀/(1−2ν) (chapter, equation 4.1).

    The chapter's I₁ is read as the isochoric Ī₁ = J^(−2/3) I₁; with the plain I₁ the rest shape would carry stress.

    Attributes
    ----------
    c10, c20 : float
        Stiffnesses in Pa.
    nu : float
        Poisson's ratio, below 0.5.
    volumetric : str
        ``"quadratic"`` U = (J−1)²/2, or ``"barrier"`` U = (J²−1−2 ln J)/4.

    Raises
    ------
    InputError
        If a stiffness is negative or ν is outside (−1, 0.5).
    """

    c10: float
    c20: float
    nu: float = 0.49
    volumetric: str = "quadratic"

    def __post_init__(self) -> None:
        if not self.c10 > 0:
            raise InputError(f"c10: {self.c10} Pa; a positive stiffness in Pa is expected.")
        if not self.c20 >= 0:
            raise InputError(f"c20: {self.c20} Pa; zero or a positive stiffness in Pa is expected.")
        if not -1 < self.nu < 0.5:
            raise InputError(f"nu: {self.nu}; Poisson's ratio must be below 0.5 (0.49 to 0.4999 for tissue).")
        if self.volumetric not in VOLUMETRIC:
            raise InputError(f"volumetric: {self.volumetric!r}; {' or '.join(VOLUMETRIC)} is expected.")

    @classmethod
    def calka(cls) -> Yeoh:
        """Fresh cadaver tongue by indentation (Gerard 2005), as in the chapter."""
        return cls(c10=192.0, c20=90.0)

    @classmethod
    def buchaillard(cls) -> Yeoh:
        """Living tissue: Gerard's scaled to muscle at rest (Buchaillard 2009)."""
        return cls(c10=1037.0, c20=486.0)

    @classmethod
    def kappert(cls) -> Yeoh:
        """E = 1638 Pa in vivo by aspiration (Kappert 2021), C₂₀/C₁₀ as Gerard."""
        return cls(c10=273.0, c20=128.0)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest, 2 C₁₀, in Pa."""
        return 2 * self.c10

    @property
    def parameters(self) -> dict[str, float]:
        """C₁₀ and C₂₀ in Pa."""
        return {"c10": self.c10, "c20": self.c20}

    def isochoric_energy(self, I1: Expr, parameters: Mapping[str, Expr]) -> Expr:
        """C₁₀(Ī₁−3) + C₂₀(Ī₁−3)²."""
        return parameters["c10"] * (I1 - 3) + parameters["c20"] * (I1 - 3) ** 2


def bulk_modulus(passive: Passive) -> float:
    """κ in Pa: the chapter's κ = 2C₁₀/(1−2ν), that is μ/(1−2ν) for any law."""
    return passive.shear_modulus / (1 - 2 * passive.nu)
