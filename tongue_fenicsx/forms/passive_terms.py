# SPDX-License-Identifier: MIT
"""The passive tissue in UFL: one law everywhere, or others in regions of the mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem

from ..core.types import Expr
from ..mechanics.hyperelasticity import VOLUMETRIC, Passive, bulk_modulus, numbers
from ..mechanics.kinematics import Kinematics
from ..mechanics.model import Model


@dataclass(frozen=True)
class _Part:
    """A law with its numbers as constants of a form: shear modulus in Pa, compressibility (1 − 2ν)/μ in 1/Pa, bulk modulus in Pa."""

    law: Passive
    parameters: dict[str, fem.Constant]
    shear: fem.Constant
    compressibility: fem.Constant
    bulk: fem.Constant


class PassiveTerms:
    """Elastic energy and stress of a model's passive laws.

    Parameters
    ----------
    model : Model
        Its tissue and the laws of its regions.

    Attributes
    ----------
    stress_scale : fem.Constant
        What turns the pressure of the mixed form, in m, into Pa.
    """

    def __init__(self, model: Model) -> None:
        mesh = model.tongue.mesh
        self._mixed = model.mixed

        def constant() -> fem.Constant:
            return fem.Constant(mesh, default_scalar_type(0.0))

        self._parts = [
            _Part(law, {name: constant() for name in numbers(law)}, constant(), constant(), constant())
            for law in (model.tissue.law, *model.regions.values())
        ]
        self.stress_scale = constant()
        self._region: fem.Function | None = None
        if model.regions:
            self._region = fem.Function(fem.functionspace(mesh, ("DG", 0)), name="region")
            for number, name in enumerate(model.regions, start=1):
                self._region.x.array[self._region.function_space.dofmap.list[model.tongue.region(name)].ravel()] = number

    def renew(self, model: Model, edge: float) -> None:
        """Take the numbers of a model with laws of the same kinds; `edge` (m) is typical of its mesh."""
        for part, law in zip(self._parts, (model.tissue.law, *model.regions.values()), strict=True):
            for name, value in numbers(law).items():
                part.parameters[name].value = value
            part.shear.value = law.shear_modulus
            part.compressibility.value = (1 - 2 * law.nu) / law.shear_modulus
            part.bulk.value = np.inf if law.nu == 0.5 else bulk_modulus(law)
        self.stress_scale.value = model.tissue.law.shear_modulus / edge

    def energy_density(self, k: Kinematics, stiffening: Expr, pressure: Expr | None) -> Expr:
        """Elastic energy density Ψ in J/m³, `stiffening` times that of the laws; with a pressure (in m) Ψ_iso + p (J − 1) − p²/(2κ),
        stationary in p."""
        isochoric = stiffening * self._select(lambda part: part.law.isochoric_energy(k, part.parameters))
        if pressure is None:
            return isochoric + stiffening * self._select(lambda part: part.bulk * VOLUMETRIC[part.law.volumetric](k.J))
        p = self.stress_scale * pressure
        return isochoric + p * (k.J - 1) - self.compressibility / stiffening * p**2 / 2

    def rest_stress(self, w: Expr) -> Expr:
        """Stress in Pa of a small displacement from rest; its deviatoric part alone in the mixed form."""
        strain = ufl.sym(ufl.grad(w))
        isotropic = ufl.tr(strain) * ufl.Identity(3)
        deviatoric = 2 * self.shear_modulus * (strain - isotropic / 3)
        return deviatoric if self._mixed else deviatoric + self._select(lambda part: part.bulk) * isotropic

    @property
    def shear_modulus(self) -> Expr:
        """At rest, in Pa."""
        return self._select(lambda part: part.shear)

    @property
    def compressibility(self) -> Expr:
        """(1 − 2ν)/μ in 1/Pa."""
        return self._select(lambda part: part.compressibility)

    def _select(self, value: Callable[[_Part], Expr]) -> Expr:
        """The value of the law that holds in each cell."""
        chosen, *others = (value(part) for part in self._parts)
        region: Expr = self._region
        for number, other in enumerate(others, start=1):
            chosen = ufl.conditional(ufl.lt(abs(region - number), 0.5), other, chosen)
        return chosen
