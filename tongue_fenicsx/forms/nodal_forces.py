# SPDX-License-Identifier: MIT
"""Nodal forces: what the balance leaves over, assembled without what is the same every time."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import ufl
from dolfinx import fem, la

from ..core.types import Expr, Floats
from . import jit
from .assembly import PackedForm, assemble, sum_over_ranks
from .weak_form import WeakForm


class Scheme(Protocol):
    """Velocity and acceleration at the end of a step as affine functions of the unknown displacement."""

    v: Expr
    acceleration: Expr

    @property
    def rates(self) -> tuple[tuple[float, Floats], tuple[float, Floats]]:
        """Factor and known part of velocity (m/s) and acceleration (m/s²)."""


class Mass:
    """The mass matrix of a density of one, ∫ φ_i φ_j of one component of the displacement, for all three.

    Parameters
    ----------
    V : fem.FunctionSpace
        Quadratic displacement.
    """

    def __init__(self, V: fem.FunctionSpace) -> None:
        S = fem.functionspace(V.mesh, ("P", 2))
        assert np.array_equal(S.dofmap.list, V.dofmap.list)
        form = ufl.inner(ufl.TrialFunction(S), ufl.TestFunction(S)) * ufl.dx(metadata={"quadrature_degree": 4})
        here = S.dofmap.index_map.size_local + S.dofmap.index_map.num_ghosts
        matrix = fem.assemble_matrix(jit.compile_form(form, V.mesh.comm))
        self._matrix = matrix.to_scipy(ghosted=True)[:, :here]  # of the cells of this rank
        self._product = la.vector(S.dofmap.index_map, 3)

    def times(self, values: Floats) -> Floats:
        """M times nodal vectors (local, with ghosts, flat): (owned nodes, 3)."""
        self._product.array[:] = (self._matrix @ values.reshape(-1, 3)).ravel()
        return sum_over_ranks(self._product).reshape(-1, 3)


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
    kernels : CellKernels or None
        Of the stresses, where there is no pressure.
    inner : PackedForm
        The forces of the stresses.
    """

    def __init__(self, weak: WeakForm, scheme: Scheme) -> None:
        self._weak, self._scheme = weak, scheme
        self._mass = Mass(weak.V)
        w = ufl.TestFunction(weak.V)
        self._changing = [weak.u] if weak.pressure is None else [weak.u, weak.pressure]
        self._packed: list[PackedForm] = []
        kernels = self.kernels = weak.kernels(scheme.v, scheme.acceleration)
        self.inner = (
            self.pack(weak.inner_work(weak.u, scheme.v, w)) if kernels is None else self._pack(kernels.form("forces"), kernels.spare)
        )
        surface = weak.surface_work(weak.u, scheme.v, w)
        self._surface = [weak.compile(surface)] if isinstance(surface, ufl.Form) else []
        self._contacts = weak.compile_contacts(lambda name: weak.contact_work(name, weak.u, scheme.v, w))

    def pack(self, form: ufl.Form) -> PackedForm:
        """A form over cells, assembled as these forces are."""
        return self._pack(self._weak.compile(form))

    def _pack(self, form: fem.Form, spare: int = 0) -> PackedForm:
        self._packed.append(PackedForm(form, self._changing, spare))
        return self._packed[-1]

    def repack(self) -> None:
        """Take note of other activations and of the begin of a step."""
        for form in self._packed:
            form.repack()

    def times_mass(self, values: Floats) -> Floats:
        """The mass matrix in kg times nodal vectors (local, with ghosts, flat): (owned nodes, 3)."""
        return self._weak.model.tissue.density * self._mass.times(values)

    def unbalanced(self) -> Floats:
        """What the balance leaves over, (owned nodes, 3): nil inside, at bonded nodes what the bone exerts."""
        forces = self.inner.assemble().reshape(-1, 3) + self._inertia()
        surface = [*self._surface, *self._contacts]
        return forces - assemble(*surface).reshape(-1, 3) if surface else forces

    def _inertia(self) -> Floats:
        """M (ü + α v − g)."""
        (v_factor, v_part), (a_factor, a_part) = self._scheme.rates
        alpha = self._weak.model.tissue.damping.alpha
        rate = (a_factor + alpha * v_factor) * self._weak.u.x.array + a_part + alpha * v_part
        return self.times_mass((rate.reshape(-1, 3) - self._weak.gravity.value).ravel())
