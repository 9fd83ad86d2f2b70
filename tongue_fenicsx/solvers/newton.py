# SPDX-License-Identifier: MIT
"""One nonlinear solve: PETSc SNES with a ladder of linear solvers, from multigrid down to a direct one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from ..core.types import Floats
from ..forms import jit
from ..forms.assembly import PackedForm, assembled
from ..forms.nodal_forces import Forces, Scheme
from ..forms.weak_form import WeakForm
from .linear import DIRECT_COARSE_MAX, SMOOTHED, _constrained_interpolation, _Galerkin
from .rigid_bodies import RigidBodies
from .tolerances import Tolerances

RESIDUAL = PETSc.Log.Event("TongueResidual")
"""In PETSc's log, the residuals with those that shortening a step takes."""
OVERSHOT = 0.1
"""Work of the residual on a Newton step, over that at its begin, beyond which the step is shortened in contact."""
GROWTH = 5.0
"""Growth of the residual that is always too much."""
TRIALS = 4
"""Residuals that shortening a step may take."""


@dataclass(frozen=True)
class Outcome:
    """What a solve did; `rung` names the linear solver that succeeded, `reason` why it stopped."""

    converged: bool
    newton: int
    krylov: int
    rung: str
    reason: str

    def then(self, after: Outcome) -> Outcome:
        """What a solve and one `after` it did together."""
        return replace(after, newton=self.newton + after.newton, krylov=self.krylov + after.krylov)


class Newton:
    """Solve the equations of a time step for unknowns that already satisfy the boundary values.

    Parameters
    ----------
    weak : WeakForm
        The equations; its `u` and `pressure` are what is solved for.
    scheme : GeneralizedAlpha or QuasiStatic
        Velocity and acceleration as functions of the displacement.
    tolerances : Tolerances
        When to stop.
    log : callable
        Takes a line for the log.

    Attributes
    ----------
    ladder : tuple of str
        Linear solvers, each tried where the one before fails.
    forces : Forces
        Of the weak form, with the rates of the scheme.
    """

    def __init__(self, weak: WeakForm, scheme: Scheme, tolerances: Tolerances, log: Callable[[str], None]) -> None:
        self._u, self._bcs, self._log = weak.u, weak.bcs, log
        self._weak, self._tolerances = weak, tolerances
        V = weak.V
        self._tangent = weak.compiled(weak.equations(scheme.v, scheme.acceleration)[1])
        self.forces = Forces(weak, scheme)
        suspension = weak.suspension(weak.u, scheme.v, scheme.acceleration, ufl.TestFunction(V))
        self._suspension = weak.compiled(suspension) if isinstance(suspension, ufl.Form) else None
        self._volume: PackedForm | None = None
        if weak.pressure is not None:
            self._volume = self.forces.packed(weak.volume_balance(ufl.TestFunction(weak.pressure.function_space)))
        comm = V.mesh.comm
        if weak.pressure is None:
            self._unknowns = [weak.u]
            self.ladder: tuple[str, ...] = ("cg+pmg", "gmres+pmg", "mumps")[0 if weak.symmetric else 1 :]
            self._x = fem_petsc.create_vector(V)
        else:
            self._unknowns = [weak.u, weak.pressure]
            self.ladder = ("fgmres+schur", "mumps")
            self._x = fem_petsc.create_vector([V, weak.pressure.function_space])
        self._b = self._x.duplicate()
        blocks = weak.pressure is None and not weak.model.suspended  # in blocks a matrix multiplies three times as fast
        self._A = fem_petsc.create_matrix(self._tangent, kind="baij" if blocks else None)
        self._A.setOption(PETSc.Mat.Option.SYMMETRIC, weak.symmetric)
        owned = [bc.dof_indices()[0][: bc.dof_indices()[1]] for bc in weak.bcs]
        self._fixed = np.unique(np.concatenate(owned)).astype(np.int32) if owned else np.empty(0, dtype=np.int32)
        self._coarse = fem.functionspace(V.mesh, ("P", 1, (3,)))
        self._suspended = [weak.supports[name] for name in weak.model.suspended]
        self._bodies = RigidBodies(V, self._coarse, self._suspended, self._x) if self._suspended else None
        self.assemble()  # what derives from it takes over where it has entries
        self._operator = self._A if self._bodies is None else self._bodies.reduced(self._A)
        self._galerkin = _Galerkin(self._A, _constrained_interpolation(self._coarse, V, self._fixed, None)) if blocks else None
        self._ksp: dict[str, PETSc.KSP] = {}
        self._options: list[str] = []
        self._krylov = 0
        snes = PETSc.SNES().create(comm)
        snes.setOptionsPrefix("tongue_")
        snes.setFunction(self._assemble_residual, self._b)
        snes.setJacobian(self._assemble_tangent, self._operator)
        snes.setType("newtonls")
        # where points begin to touch, residuals grow before they shrink; with a pressure the work along a step has no least energy to say
        searched = bool(weak.contacts.terms) and weak.pressure is None
        self._trial, self._trial_residual, self._tried = self._x.duplicate(), self._b.duplicate(), False
        snes.getLineSearch().setType("basic" if searched else "bt")
        if searched:
            snes.setLineSearchPreCheck(self._shorten)
        snes.setTolerances(rtol=tolerances.rtol, atol=tolerances.atol, stol=0.0, max_it=tolerances.max_newton)
        snes.setFromOptions()
        self._snes = snes

    def destroy(self) -> None:
        """Free the PETSc objects, on all ranks at once."""
        for item in (self._snes, *self._ksp.values(), self._A, self._b, self._x, self._trial, self._trial_residual):
            item.destroy()
        if self._bodies is not None:
            self._bodies.destroy()
            self._operator.destroy()
        if self._galerkin is not None:
            self._galerkin.destroy()
        for name in self._options:
            PETSc.Options().delValue(name)

    @property
    def n_unknowns(self) -> int:
        """Unknowns, fixed ones included."""
        return int(self._x.getSize())

    def solve(self) -> Outcome:
        """Solve from the present `u`, which then holds the solution or, if no rung converged, the last iterate."""
        newton = self._krylov = 0
        reason = ""
        guess = [function.x.array.copy() for function in self._unknowns]
        self.forces.repack()
        for rung in self.ladder:
            self._x.array[:] = np.concatenate([values[:n] for values, n in zip(guess, self._sizes, strict=True)])
            if self._bodies is not None:
                self._bodies.begin(guess[0].reshape(-1, 3), self._x)
            self._snes.setKSP(self._linear_solver(rung))
            self._tried = False  # loads and time have changed
            self._snes.solve(None, self._x)
            self._to_function(self._x)
            newton += self._snes.getIterationNumber()
            code = self._snes.getConvergedReason()
            reason = _reason(code)
            if code > 0:
                return Outcome(True, newton, self._krylov, rung, reason)
            if code != PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
                break
            why = self._snes.getKSP().getConvergedReason()
            self._log(f"  {rung} failed in the linear solve ({_reason(why, PETSc.KSP)})")
            if why == PETSc.KSP.ConvergedReason.DIVERGED_NANORINF:
                break  # an inverted element, which no solver mends
            if why == PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED:
                self._ksp.pop(rung).destroy()  # it would remember the failure
        return Outcome(False, newton, self._krylov, rung, reason)

    def acceleration(self, forces: Floats) -> Floats:
        """ü in m/s² (local, flat) at rest, from nodal forces (owned nodes, 3) in N that the balance without inertia leaves over."""
        weak, V = self._weak, self._u.function_space
        found = fem.Function(V)
        if V.mesh.comm.allreduce(float(abs(forces).max(initial=0.0)), op=MPI.MAX) < self._tolerances.atol:
            return np.array(found.x.array)
        M = fem_petsc.assemble_matrix(weak.compiled(weak.weighted(ufl.TrialFunction(V), ufl.TestFunction(V))), bcs=self._bcs)
        M.assemble()
        x, b = M.createVecs()
        b.array[:] = -forces.ravel()
        bodies = RigidBodies(V, self._coarse, self._suspended, b) if self._suspended else None
        operator = M
        if bodies is not None:
            bodies.begin(np.zeros((len(found.x.array) // 3, 3)), x)
            bodies.place(x, found.x.array.reshape(-1, 3))
            operator = bodies.reduced(M)
            bodies.residual(x)  # nil
            bodies.tangent(M, operator)
            bodies.residual(b)
        b.array[self._fixed] = 0.0
        ksp = PETSc.KSP().create(V.mesh.comm)
        ksp.setOperators(operator)
        ksp.setType("cg")
        ksp.getPC().setType("jacobi")
        ksp.setTolerances(rtol=1e-12)
        ksp.solve(b, x)
        if bodies is not None:
            x = bodies.nodal(x)
            bodies.destroy()
        found.x.array[: len(x.array_r)] = x.array_r
        found.x.scatter_forward()
        for item in (ksp, M, x, b):
            item.destroy()
        return np.array(found.x.array)

    # -- SNES call-backs

    @property
    def _sizes(self) -> list[int]:
        """Unknowns that this rank owns, of each kind."""
        spaces = [function.function_space.dofmap for function in self._unknowns]
        return [dofmap.index_map_bs * dofmap.index_map.size_local for dofmap in spaces]

    def _to_function(self, x: PETSc.Vec) -> None:
        at = 0
        for function, n in zip(self._unknowns, self._sizes, strict=True):
            function.x.array[:n] = x.array_r[at : at + n]
            function.x.scatter_forward()
            at += n
        if self._bodies is not None:
            self._bodies.place(x, self._u.x.array.reshape(-1, 3))
        self._weak.refresh()

    def _assemble_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        if self._tried and x.equal(self._trial):
            self._trial_residual.copy(b)
        else:
            self._evaluate(x, b)

    def _evaluate(self, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Make `x` the present unknowns, and their residual `b`."""
        with RESIDUAL:
            self._to_function(x)
            residual = self.forces.unbalanced().ravel()
            if self._suspension is not None:
                residual += assembled(self._suspension)
            b.array[:] = residual if self._volume is None else np.concatenate([residual, self._volume.assemble()])
            if self._bodies is not None:
                self._bodies.residual(b)
            b.array[self._fixed] = 0.0

    def _shorten(self, x: PETSc.Vec, step: PETSc.Vec) -> None:
        """Shorten a Newton step (of which x − step is next) to where the work of the residual along it is nil, if that comes first."""
        residual = self._snes.getFunction()[0]
        first, norm = float(residual.dot(step)), float(residual.norm())
        at, b, self._tried = self._trial, self._trial_residual, True
        low, high, share = (0.0, 1.0), (1.0, -np.inf), 1.0
        for _ in range(TRIALS if first else 0):
            at.waxpy(-1.0, step, x)
            self._evaluate(at, b)
            work = float(b.dot(step)) / (share * first) if float(b.norm()) < GROWTH * norm else -np.inf
            if work >= -OVERSHOT and (work <= OVERSHOT or share == 1.0):
                return
            if work > 0:
                low = share, work
            else:
                high = share, work
            next_share = low[0] + (high[0] - low[0]) * (low[1] / (low[1] - high[1]) if np.isfinite(high[1]) else 0.5)
            step.scale(next_share / share)
            share = next_share

    def _assemble_tangent(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        self.assemble()
        if self._bodies is not None:
            self._bodies.tangent(self._A, self._operator)
        if self._galerkin is not None:
            self._galerkin.update(self._A)
            for pc in (ksp.getPC() for rung, ksp in self._ksp.items() if rung.endswith("pmg")):
                pc.getMGCoarseSolve().setOperators(self._galerkin.coarse)  # or they would keep what they made of the last one
                pc.getMGSmoother(1).setOperators(self._A)

    def assemble(self) -> None:
        """The tangent at the present unknowns, without what multigrid and rigid bodies make of it."""
        self._A.zeroEntries()
        fem_petsc.assemble_matrix(self._A, self._tangent, bcs=self._bcs)
        self._A.assemble()

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
                ksp.setPCSide(PETSc.PC.Side.LEFT if rung.startswith("cg") else PETSc.PC.Side.RIGHT)
                ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)  # of the forces, as Newton's method is judged
                if rung.endswith("schur"):
                    self._schur(ksp)
                else:
                    self._multigrid(ksp.getPC())
            ksp.setFromOptions()
            ksp.setMonitor(self._count)
            self._ksp[rung] = ksp
        return self._ksp[rung]

    def _count(self, ksp: PETSc.KSP, iteration: int, norm: float) -> None:
        self._krylov += iteration > 0

    def _schur(self, ksp: PETSc.KSP) -> None:
        """Block triangle of displacement, by multigrid, and pressure, by its mass matrix (Elman, Silvester and Wathen 2014)."""
        pc = ksp.getPC()
        prefix = ksp.getOptionsPrefix()
        first, _ = self._A.getOwnershipRange()
        n_u, n_p = self._sizes
        parts = [PETSc.IS().createStride(n, at, comm=ksp.getComm()) for n, at in ((n_u, first), (n_p, first + n_u))]
        self._pressure_matrix = fem_petsc.assemble_matrix(fem.form(self._weak.pressure_weight(), jit_options=jit.options()))
        self._pressure_matrix.assemble()
        pc.setType("fieldsplit")
        pc.setFieldSplitType(PETSc.PC.CompositeType.SCHUR)
        pc.setFieldSplitIS(("u", parts[0]), ("p", parts[1]))
        pc.setFieldSplitSchurFactType(PETSc.PC.FieldSplitSchurFactType.UPPER)
        pc.setFieldSplitSchurPreType(PETSc.PC.FieldSplitSchurPreType.USER, self._pressure_matrix)
        self._set_options(prefix, {"fieldsplit_u_ksp_type": "preonly", "fieldsplit_p_ksp_type": "preonly", "fieldsplit_p_pc_type": "sor"})
        self._assemble_residual(self._snes, self._x, self._b)
        self._assemble_tangent(self._snes, self._x, self._operator, self._operator)
        ksp.setOperators(self._operator)
        ksp.setFromOptions()
        pc.setUp()
        displacement, _ = pc.getFieldSplitSchurGetSubKSP()
        self._multigrid(displacement.getPC())

    def _multigrid(self, pc: PETSc.PC) -> None:
        """Two levels: quadratic displacement, smoothed by two steps of Chebyshev and Jacobi, and linear displacement."""
        pc.setType("mg")
        pc.setMGLevels(2)
        if self._galerkin is not None:
            pc.setMGInterpolation(1, self._galerkin.interpolation)
        else:
            pc.setMGInterpolation(1, _constrained_interpolation(self._coarse, self._u.function_space, self._fixed, self._bodies))
        prefix = pc.getOptionsPrefix() or ""
        n_coarse = self._coarse.dofmap.index_map.size_global * 3
        settings = {
            "pc_mg_galerkin": "both" if self._galerkin is None else "none",
            "mg_levels_ksp_type": "chebyshev",
            "mg_levels_ksp_chebyshev_eigenvalues": SMOOTHED,
            "mg_levels_ksp_max_it": 2,
            "mg_levels_pc_type": "jacobi",  # PETSc 3.25 does not notice that diagonal blocks changed (pbjacobi, SOR in blocks)
            "mg_coarse_ksp_type": "preonly",
        }
        if n_coarse <= DIRECT_COARSE_MAX:
            settings |= {"mg_coarse_pc_type": "lu", "mg_coarse_pc_factor_mat_solver_type": "mumps"}
        else:
            settings |= {"mg_coarse_pc_type": "gamg"}
        self._set_options(prefix, settings)
        pc.setFromOptions()
        if self._galerkin is not None:
            pc.getMGCoarseSolve().setOperators(self._galerkin.coarse)

    def _set_options(self, prefix: str, settings: dict[str, str | int]) -> None:
        """Put what the user has not set into PETSc's options, until this solver is destroyed (parts of it read them late)."""
        options = PETSc.Options()
        for key, value in settings.items():
            if not options.hasName(prefix + key):
                options[prefix + key] = value
                self._options.append(prefix + key)


def _reason(code: int, kind: Any = PETSc.SNES) -> str:
    names = {value: name for name, value in vars(kind.ConvergedReason).items() if isinstance(value, int) and not name.startswith("_")}
    return str(names.get(code, code)).replace("_", " ").lower()
