# SPDX-License-Identifier: MIT
"""What a passive law is given of the deformation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import ufl

from ..core.types import Expr


@dataclass(frozen=True)
class Kinematics:
    """Deformation at a point.

    Attributes
    ----------
    F : Expr
        Deformation gradient.
    fibre : Expr, optional
        Unit fibre direction at rest; None where there is none.
    """

    F: Expr
    fibre: Expr | None = None

    @cached_property
    def J(self) -> Expr:
        """Volume over rest volume, det F."""
        return ufl.det(self.F)

    @cached_property
    def C(self) -> Expr:
        """Right Cauchy–Green tensor FᵀF."""
        return self.F.T * self.F

    @cached_property
    def I1(self) -> Expr:
        """Isochoric invariant Ī₁ = J^(−2/3) tr C."""
        return self.J ** (-2 / 3) * ufl.tr(self.C)

    @cached_property
    def I2(self) -> Expr:
        """Isochoric invariant Ī₂ = (Ī₁² − J^(−4/3) C : C)/2."""
        return (self.I1**2 - self.J ** (-4 / 3) * ufl.inner(self.C, self.C)) / 2
