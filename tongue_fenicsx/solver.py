# SPDX-License-Identifier: MIT
"""One nonlinear solve: PETSc SNES with a ladder of linear solvers, from multigrid down to a direct one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from . import jit
from .passive import Expr

DIRECT_COARSE_MAX = 12_000
"""Coarse unknowns up to which the coarse level is factorised; beyond it is smoothed by algebraic multigrid."""


@dataclass(frozen=True)
class Tolerances:
    """When a solve is done.

    Attributes
    ----------
    rtol : float
        Residual over the residual of the first guess.
    atol : float
        Residual in N.
    linear : float
        Relative residual of each linear solve.
    max_newton : int
        Newton iterations before the step is cut.
    """

    rtol: float = 1e-4
    atol: float = 1e-9
    linear: float = 1e-3
    max_newton: int = 15


@dataclass(frozen=True)
class Outcome:
    """What a solve did; `rung` names the linear solver that succeeded, `reason` why it stopped."""

    converged: bool
    newton: int
    krylov: int
    rung: str
    reason: str


class Newton:
    """Solve residual(u) = 0 for displacements that already satisfy the boundary values.

    Parameters
    ----------
    residual, tangent : UFL forms
        The residual and the matrix that Newton uses.
    u, frozen : fem.Function
        Unknown, and a second function that is kept equal to it (see `active.Contraction.stress`).
    bcs : list of fem.DirichletBC
        Fixed unknowns.
    tolerances : Tolerances
        When to stop.
    log : callable
        Takes a line for the log.
    """

    LADDER = ("cg+pmg", "gmres+pmg", "mumps")

    def __init__(
        self,
        residual: Expr,
        tangent: Expr,
        u: fem.Function,
        frozen: fem.Function,
        bcs: list[fem.DirichletBC],
        tolerances: Tolerances,
        log: Callable[[str], None],
    ) -> None:
        self._u, self._frozen, self._bcs, self._log = u, frozen, bcs, log
        self._tolerances = tolerances
        self._residual = fem.form(residual, jit_options=jit.options())
        self._tangent = fem.form(tangent, jit_options=jit.options())
        V = u.function_space
        comm = V.mesh.comm
        self._x = fem_petsc.create_vector(V)
        self._b = self._x.duplicate()
        self._A = fem_petsc.create_matrix(self._tangent)
        self._A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        owned = [bc.dof_indices()[0][: bc.dof_indices()[1]] for bc in bcs]
        self._fixed = np.unique(np.concatenate(owned)).astype(np.int32) if owned else np.empty(0, dtype=np.int32)
        self._ksp: dict[str, PETSc.KSP] = {}
        self._krylov = 0
        snes = PETSc.SNES().create(comm)
        snes.setOptionsPrefix("tongue_")
        snes.setFunction(self._assemble_residual, self._b)
        snes.setJacobian(self._assemble_tangent, self._A)
        snes.setType("newtonls")
        snes.getLineSearch().setType("bt")
        snes.setTolerances(rtol=tolerances.rtol, atol=tolerances.atol, stol=0.0, max_it=tolerances.max_newton)
        snes.setFromOptions()
        self._snes = snes

    def destroy(self) -> None:
        """Free the PETSc objects, on all ranks at once."""
        for item in (self._snes, *self._ksp.values(), self._A, self._b, self._x):
            item.destroy()

    @property
    def n_unknowns(self) -> int:
        """Unknowns, fixed ones included."""
        return int(self._x.getSize())

    def solve(self) -> Outcome:
        """Solve from the present `u`, which then holds the solution or, if no rung converged, the last iterate."""
        newton = self._krylov = 0
        reason = ""
        for rung in self.LADDER:
            self._snes.setKSP(self._linear_solver(rung))
            self._x.array[:] = self._u.x.array[: self._x.getLocalSize()]
            self._snes.solve(None, self._x)
            self._to_function(self._x)
            newton += self._snes.getIterationNumber()
            code = self._snes.getConvergedReason()
            reason = _reason(code)
            if code > 0:
                return Outcome(True, newton, self._krylov, rung, reason)
            if code != PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
                break
            self._log(f"  {rung} failed in the linear solve ({_reason(self._snes.getKSP().getConvergedReason(), PETSc.KSP)}); next rung")
        return Outcome(False, newton, self._krylov, rung, reason)

    # -- SNES call-backs

    def _to_function(self, x: PETSc.Vec) -> None:
        self._u.x.array[: x.getLocalSize()] = x.array_r
        self._u.x.scatter_forward()
        self._frozen.x.array[:] = self._u.x.array

    def _assemble_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        self._to_function(x)
        with b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(b, self._residual)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD_VALUES, mode=PETSc.ScatterMode.REVERSE)
        b.array[self._fixed] = 0.0

    def _assemble_tangent(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        A.zeroEntries()
        fem_petsc.assemble_matrix(A, self._tangent, bcs=self._bcs)
        A.assemble()

    # -- linear solvers

    def _linear_solver(self, rung: str) -> PETSc.KSP:
        if rung not in self._ksp:
            ksp = PETSc.KSP().create(self._snes.getComm())
            ksp.setOptionsPrefix(f"tongue_{rung.replace('+', '_')}_")
            if rung == "mumps":
                ksp.setType("preonly")
                ksp.getPC().setType("lu")
                ksp.getPC().setFactorSolverType("mumps")
            else:
                ksp.setType(rung.split("+")[0])
                ksp.setTolerances(rtol=self._tolerances.linear, max_it=200)
                self._multigrid(ksp.getPC())
            ksp.setFromOptions()
            ksp.setMonitor(self._count)
            self._ksp[rung] = ksp
        return self._ksp[rung]

    def _count(self, ksp: PETSc.KSP, iteration: int, norm: float) -> None:
        self._krylov += iteration > 0

    def _multigrid(self, pc: PETSc.PC) -> None:
        """Two levels: quadratic displacement, smoothed by one symmetric sweep, and linear displacement."""
        V = self._u.function_space
        coarse = fem.functionspace(V.mesh, ("P", 1, (3,)))
        interpolation = _constrained_interpolation(coarse, V, self._fixed)
        pc.setType("mg")
        pc.setMGLevels(2)
        pc.setMGInterpolation(1, interpolation)
        prefix = pc.getOptionsPrefix() or ""
        n_coarse = coarse.dofmap.index_map.size_global * 3
        settings = {
            "pc_mg_galerkin": "both",
            "mg_levels_ksp_type": "richardson",  # Chebyshev needs eigenvalues, estimated from random vectors: no exact restart
            "mg_levels_ksp_max_it": 1,
            "mg_levels_pc_type": "sor",
            "mg_levels_pc_sor_local_symmetric": None,
            "mg_coarse_ksp_type": "preonly",
        }
        if n_coarse <= DIRECT_COARSE_MAX:
            settings |= {"mg_coarse_pc_type": "lu", "mg_coarse_pc_factor_mat_solver_type": "mumps"}
        else:
            settings |= {"mg_coarse_pc_type": "gamg"}
        options = PETSc.Options()
        for key, value in settings.items():
            if not options.hasName(prefix + key):
                options[prefix + key] = value
        pc.setFromOptions()


def _constrained_interpolation(coarse: fem.FunctionSpace, fine: fem.FunctionSpace, fixed: np.ndarray) -> PETSc.Mat:
    """Interpolation that leaves fixed unknowns out, with a unit pair kept at each fixed vertex so that the coarse matrix is regular."""
    P = fem_petsc.interpolation_matrix(coarse, fine)
    P.assemble()
    first, _ = P.getOwnershipRange()
    rows = (fixed + first).astype(np.int32)
    pairs = []
    for row in rows:
        columns, values = P.getRow(row)
        at = np.flatnonzero(values > 0.99)
        if len(at):
            pairs.append((row, columns[at[0]]))
    keep = P.createVecRight()
    keep.set(1.0)
    for _, column in pairs:
        keep.setValue(column, 0.0)
    keep.assemble()
    P.diagonalScale(None, keep)
    P.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    P.zeroRows(rows, diag=0.0)
    for row, column in pairs:
        P.setValue(row, column, 1.0)
    P.assemble()
    return P


def _reason(code: int, kind: Any = PETSc.SNES) -> str:
    names = {value: name for name, value in vars(kind.ConvergedReason).items() if isinstance(value, int) and not name.startswith("_")}
    return str(names.get(code, code)).replace("_", " ").lower()
