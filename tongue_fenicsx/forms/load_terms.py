# SPDX-License-Identifier: MIT
"""Loads on tagged surfaces in UFL."""

from __future__ import annotations

import ufl
from dolfinx import default_scalar_type, fem

from ..core.types import Expr
from ..mechanics.model import Model


class LoadTerms:
    """The loads of a model.

    Parameters
    ----------
    model : Model
        Its loads.
    measures : list of ufl.Measure
        Of their surfaces, in the same order.
    """

    def __init__(self, model: Model, measures: list[ufl.Measure]) -> None:
        mesh = model.tongue.mesh
        self._loads = [
            (load, fem.Constant(mesh, default_scalar_type(0.0)), ds) for load, ds in zip(model.loads.values(), measures, strict=True)
        ]

    def place(self, t: float) -> None:
        """Set the loads of time `t` (s)."""
        for load, value, _ in self._loads:
            value.value = load.at(t)

    def work(self, u: Expr, w: Expr) -> Expr:
        """Virtual work on `w`: a pressure p pushes with −p J F⁻ᵀN per area at rest, so it follows the surface; 0 without any load."""
        F = ufl.Identity(3) + ufl.grad(u)
        return sum(-value * ufl.dot(ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(ds.ufl_domain()), w) * ds for _, value, ds in self._loads)
