# SPDX-License-Identifier: MIT
"""A line of the verification table, and what the cases share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx import mesh as dmesh
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI

from .core.types import Expr, Floats
from .forms import jit, quadrature
from .forms.weak_form import WeakForm
from .mechanics.model import Model
from .meshing.tongue_mesh import MuscleCells, TongueMesh


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes
    ----------
    case, reference : str
        What was computed, and what it is held against.
    error : float
        Measured deviation.
    limit : float
        Largest deviation that passes.
    note : str
        Orders, or why the row was skipped.
    skipped : bool
        Whether what it needs is not installed.
    """

    case: str
    reference: str
    error: float
    limit: float
    note: str = ""
    skipped: bool = False

    @property
    def holds(self) -> bool:
        """Whether the error is within the limit (a skipped row counts as holding)."""
        return self.skipped or bool(self.error <= self.limit)


Where = Callable[[Floats], Floats]
"""Takes points (3, n) in m and says of each whether it belongs."""


def box(
    lengths: tuple[float, float, float],
    divisions: tuple[int, int, int],
    surfaces: Mapping[str, Where] | None = None,
    volumes: Mapping[str, Where] | None = None,
) -> TongueMesh:
    """A box from the origin in m, with surfaces ``wall`` (x = 0), further ones, and ``free``; volumes have the cells that lie in them."""
    mesh = dmesh.create_box(MPI.COMM_WORLD, [np.zeros(3), np.array(lengths)], divisions)
    mesh.topology.create_connectivity(2, 3)
    facets = dmesh.exterior_facet_indices(mesh.topology)
    named: dict[str, Where] = {"wall": lambda X: X[0] < 1e-9, **(surfaces or {})}
    tags = np.full(len(facets), len(named) + 1, dtype=np.int32)
    for number, where in enumerate(named.values(), start=1):
        tags[np.isin(facets, dmesh.locate_entities_boundary(mesh, 2, where))] = number
    cells = {name: np.asarray(dmesh.locate_entities(mesh, 3, where), dtype=np.int32) for name, where in (volumes or {}).items()}
    numbers = {name: number for number, name in enumerate((*named, "free"), start=1)}
    return TongueMesh(mesh, dmesh.meshtags(mesh, 2, facets, tags), numbers, volumes=cells)


def with_fibres(block: TongueMesh, direction: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> TongueMesh:
    """The same block as one muscle ``GGP_L``, all along `direction`."""
    index_map = block.mesh.topology.index_map(3)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    unit = np.array(direction) / np.linalg.norm(direction)
    muscle = MuscleCells(cells, np.ones((len(cells), 4)), np.tile(unit, (len(cells), 4, 1)))
    return TongueMesh(block.mesh, block.facet_tags, block.surfaces, {"GGP_L": muscle}, {}, "bar")


class LoadedForm(WeakForm):
    """A weak form with a dead load on a part of the boundary.

    Attributes
    ----------
    traction : dolfinx.fem.Constant
        (3,) in Pa per area at rest.
    loaded : dolfinx.ufl.Measure
        The part that bears it.
    facets, nodes : int array
        Its facets and nodes on this rank.
    """

    def __init__(self, model: Model, active: Sequence[str], where: Callable[[Floats], Floats]) -> None:
        super().__init__(model, active)
        mesh = self.V.mesh
        self.facets = dmesh.locate_entities_boundary(mesh, 2, where)
        tags = dmesh.meshtags(mesh, 2, self.facets, np.ones(len(self.facets), dtype=np.int32))
        self.traction = fem.Constant(mesh, np.zeros(3, dtype=default_scalar_type))
        self.loaded = ufl.Measure("ds", mesh, subdomain_data=tags)(1)
        self.nodes = fem.locate_dofs_topological(self.V, 2, self.facets)

    def surface_work(self, u: Expr, v: Expr, w: Expr) -> Expr:
        """With that of the load."""
        return super().surface_work(u, v, w) + ufl.inner(self.traction, w) * self.loaded


def roller(weak: WeakForm, axis: int, *places: float) -> fem.DirichletBC:
    """No displacement along `axis` on the boundary where that coordinate is one of `places` (m); by default 0."""
    V = weak.V.sub(axis)
    facets = dmesh.locate_entities_boundary(
        weak.V.mesh, 2, lambda X: np.any([abs(X[axis] - place) < 1e-9 for place in places or (0.0,)], axis=0)
    )
    return fem.dirichletbc(default_scalar_type(0), fem.locate_dofs_topological(V, 2, facets), V)


def homogeneous(weak: WeakForm, F: Floats) -> None:
    """Give the weak form the displacement (F − I) X."""
    weak.u.interpolate(lambda X: (F - np.eye(3)) @ X)
    weak.frozen.x.array[:] = weak.u.x.array


def stress_at(weak: WeakForm, P: Expr) -> Floats:
    """A homogeneous first Piola–Kirchhoff stress, (3, 3) in Pa, from one quadrature point."""
    points, _ = quadrature.points_and_weights(weak.model.quadrature_degree)
    value = jit.compile_expression(ufl.as_vector([P[i, j] for i in range(3) for j in range(3)]), points, weak.V.mesh.comm)
    values = value.eval(weak.V.mesh, np.array([0], dtype=np.int32))
    return np.asarray(values).ravel()[:9].reshape(3, 3)


def solve(weak: WeakForm, residual: Expr, bcs: list[fem.DirichletBC]) -> None:
    """Newton with a direct solver, from zero."""
    options = {
        "ksp_type": "preonly",
        "pc_type": "lu",
        "pc_factor_mat_solver_type": "mumps",
        "snes_rtol": 1e-12,
        "snes_error_if_not_converged": True,
    }
    tangent = ufl.derivative(residual, weak.u, ufl.TrialFunction(weak.V))
    forms = [jit.compile_form(form, weak.V.mesh.comm) for form in (residual, tangent)]
    problem = fem_petsc.NonlinearProblem(forms[0], weak.u, J=forms[1], bcs=bcs, petsc_options_prefix="verify_", petsc_options=options)
    problem.solve()
