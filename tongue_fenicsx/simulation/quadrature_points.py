# SPDX-License-Identifier: MIT
"""The quadrature points of the stress terms: values, integrals and means over cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import ufl
from dolfinx import fem

from ..core.types import Expr, Floats
from ..forms import quadrature
from ..forms.weak_form import WeakForm
from ..geometry.tetrahedron import volumes


class QuadraturePoints:
    """Quadrature points of the cells that this rank owns.

    Parameters
    ----------
    weak : WeakForm
        Its mesh and its displacement.

    Attributes
    ----------
    places : (n_cells, q, 3) float array
        In m, of the rest shape.
    weights : (n_cells, q) float array
        In m³.
    volume : float
        Of the whole tongue at rest, in m³.
    """

    def __init__(self, weak: WeakForm) -> None:
        mesh = weak.V.mesh
        self._weak, self._comm = weak, mesh.comm
        self._points, weights = quadrature.points_and_weights(weak.model.quadrature_degree)
        self._cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
        corners = mesh.geometry.x[mesh.geometry.dofmaps[0][self._cells]]
        self.weights = 6 * abs(volumes(corners))[:, None] * weights
        self.places = np.einsum("qv,cvd->cqd", np.column_stack([1 - self._points.sum(axis=1), self._points]), corners)
        self.volume = self.integrate(np.ones_like(self.weights))
        self._expressions: dict[str, fem.Expression] = {}
        F = ufl.Identity(3) + ufl.grad(weak.u)
        self._gradient = weak.expression(ufl.as_vector([F[i, j] for i in range(3) for j in range(3)]), self._points)

    def integrate(self, density: Floats) -> float:
        """Integral of a density, (n_cells, q), over the whole tongue."""
        return float(self._comm.allreduce(float((self.weights * density).sum())))

    def mean(self, values: Floats) -> Floats:
        """Mean over each cell, (n_cells, …), of values (n_cells, q, …)."""
        return np.asarray(np.einsum("cq,cq...->c...", self.weights / self.weights.sum(axis=1, keepdims=True), values))

    def deformation_gradient(self) -> Floats:
        """F at the present displacement, (n_cells, q, 3, 3)."""
        return self._evaluate(self._gradient).reshape(*self.weights.shape, 3, 3)

    def evaluate(self, name: str, build: Callable[[], Expr]) -> Floats:
        """A vector, (n_cells, q, n), whose UFL expression is built and compiled when it is first asked for by this name."""
        if name not in self._expressions:
            self._expressions[name] = self._weak.expression(build(), self._points)
        return self._evaluate(self._expressions[name]).reshape(*self.weights.shape, -1)

    def _evaluate(self, expression: fem.Expression) -> Floats:
        return np.asarray(expression.eval(self._weak.V.mesh, self._cells))
