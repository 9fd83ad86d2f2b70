# SPDX-License-Identifier: MIT
"""Passive tissue: strain energies of the isochoric invariant and of the volume."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, Any, Protocol, runtime_checkable

from ..core.types import Expr
from ..core.values import OneOf, Real, checked

if TYPE_CHECKING:
    from .kinematics import Kinematics


@runtime_checkable
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


def _barrier(J: Expr) -> Expr:
    from ufl import ln

    return (J**2 - 1 - 2 * ln(J)) / 4


VOLUMETRIC: dict[str, Callable[[Expr], Expr]] = {"quadratic": lambda J: (J - 1) ** 2 / 2, "barrier": _barrier}
"""Volumetric energy over κ by name: the chapter's, and one that resists J → 0 (Simo and Taylor 1982)."""

Poisson = Annotated[float, Real("", "Poisson's ratio ν", low=-1, high=0.5, above=True)]
Volumetric = Annotated[str, OneOf(names=VOLUMETRIC)]


@dataclass(frozen=True)
@checked("tissue")
class Yeoh:
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

    c10: Annotated[float, Real("Pa", "C₁₀", low=0, above=True)]
    c20: Annotated[float, Real("Pa", "C₂₀", low=0)]
    nu: Poisson = 0.49
    volumetric: Volumetric = "quadratic"
    c30: Annotated[float, Real("Pa", "C₃₀", low=0)] = 0.0

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest, 2 C₁₀, in Pa."""
        return 2 * self.c10

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """C₁₀(Ī₁−3) + C₂₀(Ī₁−3)² + C₃₀(Ī₁−3)³."""
        x = k.I1 - 3
        return x * (parameters["c10"] + x * (parameters["c20"] + x * parameters["c30"]))


@dataclass(frozen=True)
@checked("tissue")
class NeoHookean:
    """Ψ = C₁₀(Ī₁−3) + κ U(J), κ = 2C₁₀/(1−2ν) (Treloar 1943; isochoric form).

    Attributes
    ----------
    c10 : float
        Half the shear modulus in Pa.
    nu, volumetric
        As of `Yeoh`.
    """

    c10: Annotated[float, Real("Pa", "C₁₀", low=0, above=True)]
    nu: Poisson = 0.49
    volumetric: Volumetric = "quadratic"

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest, 2 C₁₀, in Pa."""
        return 2 * self.c10

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """C₁₀(Ī₁−3)."""
        return parameters["c10"] * (k.I1 - 3)


@dataclass(frozen=True)
@checked("tissue")
class MooneyRivlin:
    """Ψ = C₁₀(Ī₁−3) + C₀₁(Ī₂−3) + κ U(J), κ = 2(C₁₀+C₀₁)/(1−2ν) (Mooney 1940, Rivlin 1948; isochoric form).

    Attributes
    ----------
    c10, c01 : float
        Stiffnesses in Pa; half the shear modulus together.
    nu, volumetric
        As of `Yeoh`.
    """

    c10: Annotated[float, Real("Pa", "C₁₀", low=0, above=True)]
    c01: Annotated[float, Real("Pa", "C₀₁", low=0)] = 0.0
    nu: Poisson = 0.49
    volumetric: Volumetric = "quadratic"

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest, 2(C₁₀ + C₀₁), in Pa."""
        return 2 * (self.c10 + self.c01)

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """C₁₀(Ī₁−3) + C₀₁(Ī₂−3)."""
        return parameters["c10"] * (k.I1 - 3) + parameters["c01"] * (k.I2 - 3)


LAWS: dict[str, Any] = {
    "yeoh": Yeoh,
    "neo_hookean": NeoHookean,
    "mooney_rivlin": MooneyRivlin,
}
"""Passive laws by the name that a scenario gives."""


def numbers(law: Any) -> dict[str, float]:
    """The numbers of a law, or of damping, but Poisson's ratio, which only the volume knows."""
    values = {item.name: getattr(law, item.name) for item in fields(law) if item.name != "nu"}
    return {name: value for name, value in values.items() if isinstance(value, int | float)}


def bulk_modulus(passive: Passive) -> float:
    """κ in Pa: the chapter's κ = 2C₁₀/(1−2ν), that is μ/(1−2ν) for any law."""
    return passive.shear_modulus / (1 - 2 * passive.nu)
