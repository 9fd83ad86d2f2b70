# SPDX-License-Identifier: MIT
"""Passive tissue: strain energies of the isochoric invariant and of the volume."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol

import ufl

from ..core.errors import InputError
from ..core.types import Expr
from .kinematics import Kinematics


class Passive(Protocol):
    """A hyperelastic law: any dataclass with these members; its numbers become constants of the form, so changing them compiles nothing."""

    @property
    def nu(self) -> float:
        """Poisson's ratio."""

    @property
    def volumetric(self) -> str:
        """Name of the volumetric energy in `VOLUMETRIC`."""

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest in Pa."""

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """Energy density in J/m³ without that of the volume; `parameters` are the law's `numbers` as they stand in the form."""


VOLUMETRIC: dict[str, Callable[[Expr], Expr]] = {
    "quadratic": lambda J: (J - 1) ** 2 / 2,
    "barrier": lambda J: (J**2 - 1 - 2 * ufl.ln(J)) / 4,
}
"""Volumetric energy over κ by name: the chapter's, and one that resists J → 0 (Simo and Taylor 1982)."""


@dataclass(frozen=True)
class _Law:
    """What every law has: Poisson's ratio and a volumetric energy; stiffnesses are the other attributes."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "nu":
                if not -1 < value <= 0.5:
                    raise InputError(
                        f"nu: {value}; Poisson's ratio must be below 0.5 (0.49 to 0.4999 for tissue), or 0.5 in the mixed form."
                    )
            elif item.name == "volumetric":
                if value not in VOLUMETRIC:
                    raise InputError(f"volumetric: {value!r}; {' or '.join(VOLUMETRIC)} is expected.")
            elif not (0 <= value < math.inf and (value > 0 or item.name != "c10")):
                least = "a positive" if item.name == "c10" else "zero or a positive"
                raise InputError(f"{item.name}: {value} Pa; {least} stiffness in Pa is expected.")


@dataclass(frozen=True)
class Yeoh(_Law):
    """Yeoh's law of two or three terms, Ψ = C₁₀(Ī₁−3) + C₂₀(Ī₁−3)² + C₃₀(Ī₁−3)³ + κ U(J), κ = 2C₁₀/(1−2ν) (chapter, equation 4.1).

    The chapter's I₁ is read as the isochoric Ī₁ = J^(−2/3) I₁; with the plain I₁ the rest shape would carry stress.

    Attributes
    ----------
    c10, c20 : float
        Stiffnesses in Pa.
    nu : float
        Poisson's ratio, below 0.5, or 0.5 in the mixed form.
    volumetric : str
        ``"quadratic"`` U = (J−1)²/2, or ``"barrier"`` U = (J²−1−2 ln J)/4.
    c30 : float
        Third stiffness in Pa (Yeoh 1993); none of the presets uses it.

    Raises
    ------
    InputError
        If a stiffness is negative or ν is outside (−1, 0.5].
    """

    c10: float
    c20: float
    nu: float = 0.49
    volumetric: str = "quadratic"
    c30: float = 0.0

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest, 2 C₁₀, in Pa."""
        return 2 * self.c10

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """C₁₀(Ī₁−3) + C₂₀(Ī₁−3)² + C₃₀(Ī₁−3)³."""
        x = k.I1 - 3
        return x * (parameters["c10"] + x * (parameters["c20"] + x * parameters["c30"]))


@dataclass(frozen=True)
class NeoHookean(_Law):
    """Ψ = C₁₀(Ī₁−3) + κ U(J), κ = 2C₁₀/(1−2ν) (Treloar 1943; isochoric form).

    Attributes
    ----------
    c10 : float
        Half the shear modulus in Pa.
    nu, volumetric
        As of `Yeoh`.
    """

    c10: float
    nu: float = 0.49
    volumetric: str = "quadratic"

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest, 2 C₁₀, in Pa."""
        return 2 * self.c10

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """C₁₀(Ī₁−3)."""
        return parameters["c10"] * (k.I1 - 3)


@dataclass(frozen=True)
class MooneyRivlin(_Law):
    """Ψ = C₁₀(Ī₁−3) + C₀₁(Ī₂−3) + κ U(J), κ = 2(C₁₀+C₀₁)/(1−2ν) (Mooney 1940, Rivlin 1948; isochoric form).

    Attributes
    ----------
    c10, c01 : float
        Stiffnesses in Pa; half the shear modulus together.
    nu, volumetric
        As of `Yeoh`.
    """

    c10: float
    c01: float
    nu: float = 0.49
    volumetric: str = "quadratic"

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest, 2(C₁₀ + C₀₁), in Pa."""
        return 2 * (self.c10 + self.c01)

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """C₁₀(Ī₁−3) + C₀₁(Ī₂−3)."""
        return parameters["c10"] * (k.I1 - 3) + parameters["c01"] * (k.I2 - 3)


LAWS: dict[str, type[Yeoh] | type[NeoHookean] | type[MooneyRivlin]] = {
    "yeoh": Yeoh,
    "neo_hookean": NeoHookean,
    "mooney_rivlin": MooneyRivlin,
}
"""Passive laws by the name that a scenario gives."""


def numbers(law: Any) -> dict[str, float]:
    """The numbers of a law but Poisson's ratio, which only the volume knows."""
    values = {item.name: getattr(law, item.name) for item in fields(law) if item.name != "nu"}
    return {name: value for name, value in values.items() if isinstance(value, int | float)}


def bulk_modulus(passive: Passive) -> float:
    """κ in Pa: the chapter's κ = 2C₁₀/(1−2ν), that is μ/(1−2ν) for any law."""
    return passive.shear_modulus / (1 - 2 * passive.nu)
