# SPDX-License-Identifier: MIT
"""Nodal forces: what the balance leaves over, assembled without what is the same every time."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import ufl
from dolfinx import fem, la

from ..core.types import Expr, Floats
from . import jit
from .assembly import PackedForm, assembled, summed
from .weak_form import WeakForm


class Scheme(Protocol):
    """Velocity and acceleration at the end of a step as affine functions of the unknown displacement."""

    v: Expr
    acceleration: Expr

    @property
    def rates(self) -> tuple[tuple[float, Floats], tuple[float, Floats]]:
        """Factor and known part of velocity (m/s) and acceleration (m/s²)."""


class Mass:
    """The consistent mass matrix ρ ∫ φ_i φ_j of one component of the displacement, for all three.

    Parameters
    ----------
    V : fem.FunctionSpace
        Quadratic displacement.
    density : float
        In kg/m³.
    """

    def __init__(self, V: fem.FunctionSpace, density: float) -> None:
        S = fem.functionspace(V.mesh, ("P", 2))
        assert np.array_equal(S.dofmap.list, V.dofmap.list)
        form = ufl.inner(ufl.TrialFunction(S), ufl.TestFunction(S)) * ufl.dx(metadata={"quadrature_degree": 4})
        here = S.dofmap.index_map.size_local + S.dofmap.index_map.num_ghosts
        matrix = fem.assemble_matrix(fem.form(form, jit_options=jit.options()))
        self._matrix = density * matrix.to_scipy(ghosted=True)[:, :here]  # of the cells of this rank
        self._product = la.vector(S.dofmap.index_map, 3)

    def times(self, values: Floats) -> Floats:
        """M times nodal vectors (local, with ghosts, flat): (owned nodes, 3)."""
        self._product.array[:] = (self._matrix @ values.reshape(-1, 3)).ravel()
        return summed(self._product).reshape(-1, 3)


class Forces:
    """Nodal forces of a weak form at its `u` (and `pressure`), with the velocity and acceleration of a scheme, in N.

    Parameters
    ----------
    weak : WeakForm
        The weak form.
    scheme : GeneralizedAlpha or QuasiStatic
        Its rates.

    Attributes
    ----------
    mass : Mass
        The mass matrix.
    """

    def __init__(self, weak: WeakForm, scheme: Scheme) -> None:
        self._weak, self._scheme = weak, scheme
        self.mass = Mass(weak.V, weak.model.tissue.density)
        w = ufl.TestFunction(weak.V)
        self._changing = [weak.u] if weak.pressure is None else [weak.u, weak.pressure]
        self._packed: list[PackedForm] = []
        self._inner = self.packed(weak.inner_work(weak.u, scheme.v, w))
        surface = weak.surface_work(weak.u, scheme.v, w)
        self._surface = weak.compiled(surface) if isinstance(surface, ufl.Form) else None

    def packed(self, form: ufl.Form) -> PackedForm:
        """A form over cells, assembled as these forces are."""
        self._packed.append(PackedForm(self._weak.compiled(form), self._changing))
        return self._packed[-1]

    def repack(self) -> None:
        """Take note of other activations and of the begin of a step."""
        for form in self._packed:
            form.repack()

    def unbalanced(self) -> Floats:
        """What the balance leaves over, (owned nodes, 3): nil inside, at bonded nodes what the bone exerts."""
        forces = self._inner.assemble().reshape(-1, 3) + self._inertia()
        return forces if self._surface is None else forces - assembled(self._surface).reshape(-1, 3)

    def _inertia(self) -> Floats:
        """M (ü + α v − g)."""
        (v_factor, v_part), (a_factor, a_part) = self._scheme.rates
        alpha = self._weak.model.tissue.damping.alpha
        rate = (a_factor + alpha * v_factor) * self._weak.u.x.array + a_part + alpha * v_part
        return self.mass.times((rate.reshape(-1, 3) - self._weak.gravity.value).ravel())
