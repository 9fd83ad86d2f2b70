# SPDX-License-Identifier: MIT
"""The acceleration with which motion begins, from the balance of forces at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from ..core.types import Floats
from ..forms.weak_form import WeakForm
from .equations import Equations
from .rigid_bodies import RigidBodies


def set_initial_acceleration(equations: Equations, least: float) -> None:
    """Give the state of the equations the acceleration that their loads cause; none where no load is larger than `least` (N)."""
    acceleration = _acceleration(equations, least)
    equations.restore(replace(equations.state, acceleration=acceleration, auxiliary=acceleration))


def _acceleration(equations: Equations, least: float) -> Floats:
    """ü in m/s² (local, flat) of the present state."""
    forces = equations.forces.unbalanced()
    if equations.weak.V.mesh.comm.allreduce(float(abs(forces).max(initial=0.0)), op=MPI.MAX) < least:
        return np.zeros_like(equations.weak.u.x.array)
    return accelerate(equations.weak, forces)


def accelerate(weak: WeakForm, forces: Floats) -> Floats:
    """The acceleration in m/s² (local, flat) that takes up forces in N, −M⁻¹ f, on owned nodes that are not held."""
    V = weak.V
    found = fem.Function(V)
    M = fem_petsc.assemble_matrix(weak.compile(weak.weighted(ufl.TrialFunction(V), ufl.TestFunction(V))), bcs=weak.bcs)
    M.assemble()
    x, b = M.createVecs()
    b.array[:] = -forces.ravel()
    surfaces = weak.suspended_nodes
    bodies = RigidBodies(V, fem.functionspace(V.mesh, ("P", 1, (3,))), surfaces, b) if surfaces else None
    operator = M
    if bodies is not None:
        bodies.begin(np.zeros((len(found.x.array) // 3, 3)), x)
        bodies.place(x, found.x.array.reshape(-1, 3))
        operator = bodies.reduce(M)
        bodies.residual(x)  # nil
        bodies.tangent(M, operator)
        bodies.residual(b)
    b.array[weak.fixed_dofs] = 0.0
    ksp = PETSc.KSP().create(V.mesh.comm)
    ksp.setOperators(operator)
    ksp.setType("cg")
    ksp.getPC().setType("jacobi")
    ksp.setTolerances(rtol=1e-12)
    ksp.solve(b, x)
    owned = x if bodies is None else bodies.nodal(x)
    found.x.array[: len(owned.array_r)] = owned.array_r
    found.x.scatter_forward()
    used = [ksp, M, x, b] if bodies is None else [ksp, M, x, b, owned, operator, bodies]
    for item in used:
        item.destroy()
    return np.array(found.x.array)
