# SPDX-License-Identifier: MIT
"""Active fibre stress: Blemker's force–length law, two force–velocity laws, any number of overlapping muscles."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import lazy_loader

from ..core.types import Expr
from ..core.values import Flag, OneOf, Real, checked

if TYPE_CHECKING:
    from dolfinx import mesh as dmesh

ufl = lazy_loader.load("ufl")  # a scenario is checked without it


def force_length(stretch: Expr) -> Expr:
    """Active force–length factor of the normalised fibre stretch λ̂, 1 at λ̂ = 1, 0 outside [0.4, 1.6] (Blemker 2005)."""
    x = stretch
    return ufl.conditional(
        ufl.lt(x, 0.6),
        ufl.conditional(ufl.lt(x, 0.4), 0.0, 9 * (x - 0.4) ** 2),
        ufl.conditional(ufl.lt(x, 1.4), 1 - 4 * (1 - x) ** 2, ufl.conditional(ufl.lt(x, 1.6), 9 * (x - 1.6) ** 2, 0.0)),
    )


def passive_tension(stretch: Expr) -> Expr:
    """Passive fibre tension over σ_max of the normalised stretch λ̂: 0 to λ̂ = 1, exponential to 1.4, then linear (Blemker 2005)."""
    return _toe_and_line(stretch, 6.6, 1.4) * 0.05


def tendon_tension(stretch: Expr) -> Expr:
    """Tendon tension over σ_max of the normalised stretch λ̂: 0 to λ̂ = 1, exponential to 1.03, then linear; 1 at 1.06.

    Form and exponent of Blemker 2005; her modulus is far above σ_max and would only stiffen the equations.
    """
    toe, slope = math.expm1(46.4 * 0.03), 46.4 * math.exp(46.4 * 0.03)
    return _toe_and_line(stretch, 46.4, 1.03) / (toe + slope * 0.03)


def _toe_and_line(stretch: Expr, exponent: float, end: float) -> Expr:
    """exp(exponent (λ̂ − 1)) − 1 from λ̂ = 1 to `end`, its tangent beyond, 0 below 1."""
    curve = ufl.exp(exponent * (ufl.min_value(stretch, end) - 1)) - 1
    line = exponent * math.exp(exponent * (end - 1)) * ufl.max_value(stretch - end, 0.0)
    return ufl.conditional(ufl.lt(stretch, 1.0), 0.0, curve + line)


CLIP = 0.03
"""Force–velocity factor below which it bends away from its curve, to reach 0 at −CLIP; the bend is C²."""


def _clipped(factor: Expr) -> Expr:
    """The factor where it is above `CLIP`, 0 where it is below −CLIP, and (f + w)³(3w − f)/(16 w³) between, which joins both to the
    second derivative: Newton's method cycles about a corner when fibres are let go from rest at once."""
    bounded = ufl.max_value(-CLIP, ufl.min_value(factor, CLIP))
    bend = (bounded + CLIP) ** 3 * (3 * CLIP - bounded) / (16 * CLIP**3)
    return bend + ufl.max_value(factor - CLIP, 0.0)


def _grenoble(rate: Expr) -> Expr:
    return _clipped(0.7109 + 0.712 * ufl.atan(0.43 + 0.4444 * rate) + 0.0329 * rate)


def _hill(rate: Expr) -> Expr:
    v_max, curvature, plateau = 7.5, 0.25, 1.5
    v = rate / v_max
    shortening = _clipped((1 + v) / (1 - ufl.min_value(v, 0.0) / curvature))
    k = (1 + 1 / curvature) / (plateau - 1) * ufl.max_value(v, 0.0)
    return ufl.conditional(ufl.lt(v, 0.0), shortening, (1 + plateau * k) / (1 + k))


FORCE_VELOCITY: dict[str, Callable[[Expr], Expr]] = {
    "grenoble": _grenoble,
    "hill": _hill,
    "none": lambda rate: ufl.as_ufl(1.0),
}
"""Force–velocity factor of the isochoric stretch rate (1/s) by name, 1 at rest and clipped at 0: the λ-model form of
Grenoble (constants of Perrier 2003, after Huxley 1957); Hill's hyperbola (Winters 1990; v_max 7.5 lengths/s, curvature
0.25, 1.5 in lengthening); none."""


@dataclass(frozen=True)
@checked("muscles")
class Contraction:
    """How muscle contracts.

    Attributes
    ----------
    force_velocity : str
        ``"grenoble"``, ``"hill"`` or ``"none"``.
    optimal_stretch : float
        λ_ofl, the fibre stretch of largest active force.
    tendon_length : float
        Distance in m from a bonded area over which the active stress rises from 0 to 1; where it fades, the fibres are
        tendon and carry `tendon_tension` instead.
    deviatoric : bool
        Whether λ is the isochoric stretch, so that muscle makes no pressure; False gives the plain stretch of other codes.
    passive_fibres : bool
        Whether all muscle fibres, active or not, carry `passive_tension` (Blemker 2005).
    stiffening : bool
        Whether the tissue stiffens by 1 + 9a, a the sum of the activations there up to 1 (Buchaillard 2009).
    """

    force_velocity: Annotated[str, OneOf(names=FORCE_VELOCITY)] = "grenoble"
    optimal_stretch: Annotated[float, Real(low=0.5, high=2)] = 1.0
    tendon_length: Annotated[float, Real("m", low=0, high=0.05)] = 6e-3
    deviatoric: Flag = True
    passive_fibres: Flag = False
    stiffening: Flag = False

    def with_constants(self, mesh: dmesh.Mesh) -> Contraction:
        """The same law with its number as a constant of a form, so that another one compiles nothing."""
        from dolfinx import default_scalar_type, fem

        law = copy(self)
        object.__setattr__(law, "optimal_stretch", fem.Constant(mesh, default_scalar_type(self.optimal_stretch)))
        return law

    def stress(
        self, F: Expr, F_rate: Expr, F_frozen: Expr, direction: Expr, tension: Expr, tendon: Expr = 0.0, passive: Expr = 0.0
    ) -> Expr:
        """First Piola–Kirchhoff stress of one fibre family, (T f_L(λ̂) f_V(λ̄̇) + T_tendon f_T(λ̂) + T_passive f_P(λ̂))/λ_ofl ∂λ̄/∂F.

        Parameters
        ----------
        F, F_rate : Expr
            Deformation gradient and its rate in 1/s.
        F_frozen : Expr
            The same deformation gradient, held fixed when the stretch rate λ̄̇ = ∂λ̄/∂F : Ḟ is differentiated: what is
            left out of the tangent is its unsymmetric part, of order λ̄̇ times half the time step.
        direction : Expr
            Unit fibre direction at rest.
        tension : Expr
            Activation times peak stress in Pa.
        tendon, passive : Expr
            Peak stress in Pa where the fibres are tendon, and where they are muscle with passive tension; 0 elsewhere.
        """
        stretch, gradient = self.stretch(F, direction)
        rate = ufl.inner(self.stretch(F_frozen, direction)[1], F_rate)
        normalised = stretch / self.optimal_stretch
        total = tension * self.tension(stretch, rate) + tendon * tendon_tension(normalised)
        if self.passive_fibres:
            total += passive * passive_tension(normalised)
        return total / self.optimal_stretch * gradient

    def stretch(self, F: Expr, direction: Expr) -> tuple[Expr, Expr]:
        """Fibre stretch, λ̄ = J^(−1/3)|F a₀| or the plain |F a₀|, and its derivative by F."""
        J, fibre = ufl.det(F), F * direction
        plain = ufl.sqrt(ufl.dot(fibre, fibre))
        if not self.deviatoric:
            return plain, ufl.outer(fibre, direction) / plain
        stretch = J ** (-1 / 3) * plain
        return stretch, J ** (-2 / 3) / stretch * ufl.outer(fibre, direction) - stretch / 3 * ufl.inv(F).T

    def tension(self, stretch: Expr, rate: Expr) -> Expr:
        """Active tension over its peak, f_L f_V, at a stretch λ and a stretch rate (1/s)."""
        normalised = stretch / self.optimal_stretch
        return force_length(normalised) * FORCE_VELOCITY[self.force_velocity](rate / self.optimal_stretch)
