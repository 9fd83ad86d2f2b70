# SPDX-License-Identifier: MIT
"""The assembled tangent of the equations, and the same in linear displacements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import ufl
from dolfinx import cpp, default_scalar_type, fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray

from ..core.types import Floats
from ..forms.assembly import Coefficients
from ..forms.cell_kernels import CellKernels
from ..forms.weak_form import WeakForm
from .equations import Equations
from .placement import Placement


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
            self._levels = [Level(weak.compile(weak.equations(*rates)[1]), weak.bcs)]
        else:
            blocks = not weak.suspended_nodes
            self._levels = [_KernelLevel(kernels, "tangent", weak.bcs, _Surface(equations, weak.V), "baij" if blocks else None)]
            if blocks:
                fixed = _at_vertices(weak, self.linear)
                self._levels.append(_KernelLevel(kernels, "coarse_tangent", fixed, _Surface(equations, self.linear)))
        self.matrix = self._levels[0].matrix
        self.coarse = self._levels[1].matrix if len(self._levels) > 1 else None

    def assemble(self, coarse: bool = True) -> None:
        """At the present unknowns; without the `coarse` level, if that is to stay as it was."""
        if self._inner is not None:
            self._inner.refresh()
        packed = () if self._inner is None else (self._inner.constants, self._inner.coefficients)
        for level in self._levels if coarse else self._levels[:1]:
            level.assemble(*packed)

    def destroy(self) -> None:
        """Free the matrices, on all ranks at once."""
        for level in self._levels:
            level.matrix.destroy()


class Level:
    """A matrix with what it is assembled from, a form with what is fixed and the forms of the surface beside it."""

    def __init__(self, form: fem.Form, bcs: Sequence[fem.DirichletBC], surface: Iterable[fem.Form] = (), kind: str | None = None) -> None:
        self._form, self._bcs, self._surface = form, bcs, surface
        self.matrix = fem_petsc.create_matrix(form, kind)

    def assemble(self, constants: Floats | None = None, coefficients: Coefficients | None = None) -> None:
        """With those of the form, if they are packed."""
        self.matrix.zeroEntries()
        fixed = [bc._cpp_object for bc in self._bcs]
        for form in self._surface:
            own = fem.pack_constants(form), fem.pack_coefficients(form)
            cpp.fem.petsc.assemble_matrix(self.matrix, form._cpp_object, *own, fixed)
        fem_petsc.assemble_matrix(self.matrix, self._form, self._bcs, constants=constants, coeffs=coefficients)
        self.matrix.assemble()


class _KernelLevel(Level):
    """The same of a kernel. Once the matrix has its entries, DOLFINx adds to it only where another rank has a say."""

    def __init__(
        self, kernels: CellKernels, name: str, bcs: Sequence[fem.DirichletBC], surface: Iterable[fem.Form], kind: str | None = None
    ) -> None:
        super().__init__(kernels.form(name), bcs, surface, kind)
        self._kernels, self._name = kernels, name
        self._placement: Placement | None = None

    def assemble(self, constants: Floats | None = None, coefficients: Coefficients | None = None) -> None:
        """With those of all cells."""
        if self._placement is None:
            super().assemble(constants, coefficients)
            self._place()
            return
        assert constants is not None
        assert coefficients is not None
        ((part, w),) = coefficients.items()
        border = self._placement.border
        share = w[border]
        super().assemble(constants, {part: share})
        w[border] = share  # with what the kernel left there
        with self._placement.values() as values:
            self._kernels.add(self._name, self._placement.inner, (constants, w), self._fixed, self._placement.places, values)
        self.matrix.assemble()

    def _place(self) -> None:
        """Note where the cells' entries are, and which are fixed."""
        V = self._kernels.space(self._name)
        placement = self._placement = Placement(self.matrix, V)
        self._form = self._kernels.form(self._name, placement.border)
        fixed: NDArray[np.bool_] = np.zeros((V.dofmap.index_map.size_local + V.dofmap.index_map.num_ghosts, 3), dtype=bool)
        for bc in self._bcs:
            fixed.ravel()[bc.dof_indices()[0]] = True
        unknowns = fixed[V.dofmap.list[placement.inner]].reshape(len(placement.inner), -1)
        self._fixed = (unknowns @ (1 << np.arange(unknowns.shape[1]))).astype(np.uint32)


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
