# SPDX-License-Identifier: MIT
"""The assembled tangent of the equations, and the same in linear displacements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import cpp, default_scalar_type, fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray

from ..forms.assembly import Packed
from ..forms.weak_form import WeakForm
from .equations import Equations


class Tangent:
    """The derivative of equations by their unknowns.

    Parameters
    ----------
    equations : Equations
        Their displacement and pressure are the unknowns.

    Attributes
    ----------
    matrix : PETSc.Mat
        Of all nodes, with a unit diagonal at fixed unknowns. In blocks of three, in which it multiplies three times as fast, where there
        is neither a pressure nor a suspended bone.
    linear : fem.FunctionSpace
        Linear displacements.
    coarse : PETSc.Mat or None
        If in blocks, the tangent in linear displacements, which equals the Galerkin product.
    """

    def __init__(self, equations: Equations) -> None:
        weak, kernels = equations.weak, equations.forces.kernels
        rates = equations.scheme.v, equations.scheme.acceleration
        self._inner = None if kernels is None else equations.forces.inner
        self.linear = fem.functionspace(weak.V.mesh, ("P", 1, (3,))) if kernels is None else kernels.linear
        if kernels is None:
            self._levels = [_Level(weak.compile(weak.equations(*rates)[1]), weak.bcs)]
        else:
            blocks = not weak.suspended_nodes
            self._levels = [_Level(kernels.tangent, weak.bcs, _Surface(equations, weak.V), "baij" if blocks else None)]
            if blocks:
                fixed = _at_vertices(weak, self.linear)
                self._levels.append(_Level(kernels.coarse_tangent, fixed, _Surface(equations, self.linear)))
        self.matrix = self._levels[0].matrix
        self.coarse = self._levels[1].matrix if len(self._levels) > 1 else None

    def assemble(self) -> None:
        """At the present unknowns."""
        if self._inner is not None:
            self._inner.refresh()
        for level in self._levels:
            level.assemble(self._inner)

    def destroy(self) -> None:
        """Free the matrices, on all ranks at once."""
        for level in self._levels:
            level.matrix.destroy()


class _Level:
    """A matrix with what it is assembled from, a form with what is fixed and the forms of the surface beside it."""

    def __init__(self, form: Any, bcs: Sequence[fem.DirichletBC], surface: Iterable[fem.Form] = (), kind: str | None = None) -> None:
        self._form, self._bcs, self._surface = form, bcs, surface
        self.matrix = fem_petsc.create_matrix(form, kind)

    def assemble(self, packed: Packed | None) -> None:
        """With the packed coefficients of the form, if there are any."""
        self.matrix.zeroEntries()
        fixed = [bc._cpp_object for bc in self._bcs]
        for form in self._surface:
            own = fem.pack_constants(form), fem.pack_coefficients(form)
            cpp.fem.petsc.assemble_matrix(self.matrix, form._cpp_object, *own, fixed)
        values = {} if packed is None else {"constants": packed.constants, "coeffs": packed.coefficients}
        fem_petsc.assemble_matrix(self.matrix, self._form, self._bcs, **values)
        self.matrix.assemble()


class _Surface:
    """The forms of the surface's tangent at the present displacement, in displacements of a space."""

    def __init__(self, equations: Equations, V: fem.FunctionSpace) -> None:
        weak, scheme = equations.weak, equations.scheme
        surface = weak.surface_tangent(scheme.v, scheme.acceleration, V)
        self._forms = [weak.compile(surface)] if isinstance(surface, ufl.Form) else []
        self._contacts = weak.compile_contacts(lambda name: weak.contact_tangent(name, scheme.v, V))

    def __iter__(self) -> Iterator[fem.Form]:
        yield from self._forms
        yield from self._contacts


def _at_vertices(weak: WeakForm, linear: fem.FunctionSpace) -> list[fem.DirichletBC]:
    """The fixed unknowns among the linear displacements."""
    fixed: NDArray[np.bool_] = np.zeros(len(weak.u.x.array), dtype=bool)
    for bc in weak.bcs:
        fixed[bc.dof_indices()[0]] = True
    nodes = np.empty(linear.dofmap.index_map.size_local + linear.dofmap.index_map.num_ghosts, dtype=np.int64)
    nodes[linear.dofmap.list] = weak.V.dofmap.list[:, :4]
    at = [3 * np.flatnonzero(fixed.reshape(-1, 3)[nodes, i]) + i for i in range(3)]
    return [fem.dirichletbc(default_scalar_type(0.0), dofs.astype(np.int32), linear.sub(i)) for i, dofs in enumerate(at)]
