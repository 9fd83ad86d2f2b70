# SPDX-License-Identifier: MIT
"""Linear solvers of a tangent: a ladder from multigrid down to a direct one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from petsc4py import PETSc

from ..forms.weak_form import WeakForm
from .callbacks import weakly
from .options import SolverOptions
from .rigid_bodies import RigidBodies
from .tangent import Tangent

DIRECT_COARSE_MAX = 12_000
"""Coarse unknowns up to which the coarse level is factorised; beyond it is smoothed by algebraic multigrid."""
AIM, LOOSEST = 0.5, 0.1
"""Relative residual of a linear solve over that by which Newton's method would be done, and at most."""
SMOOTHED = "0.7,7.0"
"""Eigenvalues of the tangent over its diagonal that the smoother damps; up to 7.7 it does not amplify. On tongues and blocks, at rest
and deformed, the largest is 3.3 to 4.0 at ν = 0.3 and 4.9 to 5.9 from 0.49 to 0.4999. (An estimate would depend on the run's past.)"""


class LinearSolvers:
    """The linear solvers of the tangent of a weak form, made when they are first asked for.

    Parameters
    ----------
    weak : WeakForm
        Its spaces and symmetry decide what can be used.
    tangent : Tangent
        The assembled one of all nodes.
    operator : PETSc.Mat
        The matrix to solve with: that of the tangent, or what rigid bodies make of it.
    bodies : RigidBodies or None
        Those.
    options : SolverOptions
        Of the nonlinear solver.
    rtol : float
        Relative residual of each solve.

    Attributes
    ----------
    ladder : tuple of str
        Names of the solvers, each tried where the one before fails.
    iterations : int
        Krylov iterations so far; settable.
    """

    def __init__(
        self, weak: WeakForm, tangent: Tangent, operator: PETSc.Mat, bodies: RigidBodies | None, options: SolverOptions, rtol: float
    ) -> None:
        self._weak, self._operator, self._bodies, self._options, self._rtol = weak, operator, bodies, options, rtol
        self._A, self._coarse, self._linear = tangent.matrix, tangent.coarse, tangent.linear
        self.ladder: tuple[str, ...] = ("cg+pmg", "gmres+pmg", "mumps")[0 if weak.symmetric else 1 :]
        if weak.pressure is not None:
            self.ladder = ("fgmres+schur", "mumps")
        self.iterations = 0
        self._made: dict[str, PETSc.KSP] = {}
        self._set_by_user: set[str] = set()
        self._pressure_matrix: PETSc.Mat | None = None

    def destroy(self) -> None:
        """Free the PETSc objects, on all ranks at once."""
        for item in (*self._made.values(), self._pressure_matrix):
            if item is not None:
                item.destroy()

    def update(self) -> None:
        """Follow a change of the tangent."""
        if self._coarse is not None:
            for pc in (ksp.getPC() for rung, ksp in self._made.items() if rung.endswith("pmg")):
                pc.getMGCoarseSolve().setOperators(self._coarse)  # or they would keep what they made of the last one
                pc.getMGSmoother(1).setOperators(self._A)

    def aim(self, residual: float, enough: float) -> None:
        """Solve no more accurately than it takes to shrink a residual (N) of Newton's method to what is enough; or as the user says."""
        for rung in self._made.keys() - self._set_by_user:
            self._made[rung].setTolerances(rtol=max(self._rtol, min(AIM * enough / max(residual, enough), LOOSEST)))

    def renew(self) -> None:
        """Follow a change of the tissue's numbers."""
        if self._pressure_matrix is not None:
            self._pressure_matrix.zeroEntries()
            fem_petsc.assemble_matrix(self._pressure_matrix, self._pressure_form)
            self._pressure_matrix.assemble()

    def forget(self, rung: str) -> None:
        """Make a solver anew when it is next asked for: one whose set-up failed would remember the failure."""
        self._made.pop(rung).destroy()

    def solver(self, rung: str, prepare: Callable[[], None]) -> PETSc.KSP:
        """A solver of the ladder; `prepare` assembles the tangent at the present unknowns, if the solver must see it to be made."""
        if rung not in self._made:
            ksp = PETSc.KSP().create(self._A.getComm())
            ksp.setOptionsPrefix(f"{self._options.prefix}{rung.replace('+', '_')}_")
            if rung == "mumps":
                ksp.setType("preonly")
                ksp.getPC().setType("lu")
                ksp.getPC().setFactorSolverType("mumps")
            else:
                ksp.setType(rung.split("+")[0])
                ksp.setTolerances(rtol=self._rtol, max_it=200)
                ksp.setPCSide(PETSc.PC.Side.LEFT if rung.startswith("cg") else PETSc.PC.Side.RIGHT)
                ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)  # of the forces, as Newton's method is judged
                if rung.endswith("schur"):
                    prepare()
                    self._set_schur(ksp)
                else:
                    self._set_multigrid(ksp.getPC())
            ksp.setFromOptions()
            ksp.setMonitor(weakly(self._count))
            if ksp.getTolerances()[0] != self._rtol:
                self._set_by_user.add(rung)
            self._made[rung] = ksp
        return self._made[rung]

    def _count(self, ksp: PETSc.KSP, iteration: int, norm: float) -> None:
        self.iterations += iteration > 0

    def _set_schur(self, ksp: PETSc.KSP) -> None:
        """Block triangle of displacement, by multigrid, and pressure, by its mass matrix (Elman, Silvester and Wathen 2014)."""
        pc = ksp.getPC()
        first, last = self._A.getOwnershipRange()
        n_u = 3 * self._weak.V.dofmap.index_map.size_local
        parts = [PETSc.IS().createStride(n, at, comm=ksp.getComm()) for n, at in ((n_u, first), (last - first - n_u, first + n_u))]
        self._pressure_form = self._weak.compile(self._weak.pressure_weight())
        self._pressure_matrix = fem_petsc.assemble_matrix(self._pressure_form)
        self._pressure_matrix.assemble()
        pc.setType("fieldsplit")
        pc.setFieldSplitType(PETSc.PC.CompositeType.SCHUR)
        pc.setFieldSplitIS(("u", parts[0]), ("p", parts[1]))
        pc.setFieldSplitSchurFactType(PETSc.PC.FieldSplitSchurFactType.UPPER)
        pc.setFieldSplitSchurPreType(PETSc.PC.FieldSplitSchurPreType.USER, self._pressure_matrix)
        settings = {"fieldsplit_u_ksp_type": "preonly", "fieldsplit_p_ksp_type": "preonly", "fieldsplit_p_pc_type": "sor"}
        self._options.put(ksp.getOptionsPrefix(), settings)
        ksp.setOperators(self._operator)
        ksp.setFromOptions()
        pc.setUp()
        displacement, _ = pc.getFieldSplitSchurGetSubKSP()
        self._set_multigrid(displacement.getPC())

    def _set_multigrid(self, pc: PETSc.PC) -> None:
        """Two levels: quadratic displacement, smoothed by two steps of Chebyshev and Jacobi, and linear displacement."""
        pc.setType("mg")
        pc.setMGLevels(2)
        pc.setMGInterpolation(1, constrained_interpolation(self._linear, self._weak.V, self._weak.fixed_dofs, self._bodies))
        settings: dict[str, Any] = {
            "pc_mg_galerkin": "both" if self._coarse is None else "none",
            "mg_levels_ksp_type": "chebyshev",
            "mg_levels_ksp_chebyshev_eigenvalues": SMOOTHED,
            "mg_levels_ksp_max_it": 2,
            "mg_levels_pc_type": "jacobi",  # PETSc 3.25 does not notice that diagonal blocks changed (pbjacobi, SOR in blocks)
            "mg_coarse_ksp_type": "preonly",
        }
        if self._linear.dofmap.index_map.size_global * 3 <= DIRECT_COARSE_MAX:
            solver = {"pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}  # on each rank the whole: on several, MUMPS repeats no bit
            settings |= {"mg_coarse_pc_type": "redundant"} | {f"mg_coarse_redundant_{key}": value for key, value in solver.items()}
        else:
            settings |= {"mg_coarse_pc_type": "gamg"}
        self._options.put(pc.getOptionsPrefix() or "", settings)
        pc.setFromOptions()
        if self._coarse is not None:
            pc.getMGCoarseSolve().setOperators(self._coarse)


def constrained_interpolation(
    coarse: fem.FunctionSpace, fine: fem.FunctionSpace, fixed: NDArray[np.int32], bodies: RigidBodies | None
) -> PETSc.Mat:
    """Interpolation that leaves fixed unknowns out, with a unit pair kept at each fixed vertex so that the coarse matrix is regular.

    Unknowns of rigid bodies are left out, too; what lies around them follows the six coarse unknowns of each.
    """
    P = fem_petsc.interpolation_matrix(coarse, fine)
    P.assemble()
    first, _ = P.getOwnershipRange()
    rows = (fixed if bodies is None else np.concatenate([fixed, bodies.dofs])).astype(PETSc.IntType) + first
    pairs = []
    for row in rows:
        columns, values = P.getRow(row)
        at = np.flatnonzero(values > 0.99)
        if len(at):
            pairs.append((row, columns[at[0]]))
    moving: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    if bodies is not None:
        follow, moving = bodies.coarse(P.createVecRight())
        P = P.matMult(follow)
    keep = P.createVecRight()
    keep.set(1.0)
    for _, column in pairs:
        if column not in moving:
            keep.setValue(column, 0.0)
    keep.assemble()
    P.diagonalScale(None, keep)
    P.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    P.zeroRows(rows, diag=0.0)
    for row, column in pairs:
        P.setValue(row, column, 1.0)
    P.assemble()
    return P
