# SPDX-License-Identifier: MIT
"""One nonlinear solve: PETSc SNES over the ladder of linear solvers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from ..forms.assembly import assemble
from .callbacks import weakly
from .equations import Equations
from .line_search import WorkLineSearch
from .linear import LinearSolvers
from .options import SolverOptions
from .rigid_bodies import RigidBodies
from .tangent import Tangent
from .time_integration import QuasiStatic
from .tolerances import Tolerances

GUESS = 0.1
"""Share of the residual of the first guess that counts as the forces on the supports do; alone, where nothing is held."""
UNSOLVED = 0.1
"""Share of what is enough that is enough of a guess in time: guesses that just do, step after step, go astray (a sagging block by 2 %)."""
EQUILIBRIUM = 0.3
"""Share of the relative tolerance that an equilibrium may take."""
STALE = 20
"""Krylov iterations after which the multigrid's coarse level follows the tangent before the next solve begins; fewer say that it serves."""
RESIDUAL = PETSc.Log.Event("TongueResidual")
"""In PETSc's log, the residuals with those that shortening a step takes."""


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
    equations : Equations
        The displacement and the pressure of their weak form are what is solved for.
    tolerances : Tolerances
        When to stop.
    log : callable
        Takes a line for the log.
    """

    def __init__(self, equations: Equations, tolerances: Tolerances, log: Callable[[str], None]) -> None:
        self._options = SolverOptions()  # before any vector
        self._equations, self._log = equations, log
        self._weak = weak = equations.weak
        if weak.pressure is not None:  # the norm of the residual hardly sees the balance of volume
            tolerances = tolerances.no_looser_than("tight")
        scheme, V = equations.scheme, weak.V
        if isinstance(scheme, QuasiStatic):
            tolerances = replace(tolerances, rtol=EQUILIBRIUM * tolerances.rtol)
        self._tangent = Tangent(equations)
        suspension = weak.suspension(weak.u, scheme.v, scheme.acceleration, ufl.TestFunction(V))
        self._suspension = weak.compile(suspension) if isinstance(suspension, ufl.Form) else None
        self._unknowns = [weak.u] if weak.pressure is None else [weak.u, weak.pressure]
        spaces = [function.function_space for function in self._unknowns]
        self._volume = None if weak.pressure is None else equations.forces.pack(weak.volume_balance(ufl.TestFunction(spaces[1])))
        self._x = fem_petsc.create_vector(spaces[0] if weak.pressure is None else spaces)
        self._b = self._x.duplicate()
        A = self._tangent.matrix
        A.setOption(PETSc.Mat.Option.SYMMETRIC, weak.symmetric)
        self._bodies = RigidBodies(V, self._tangent.linear, weak.suspended_nodes, self._x) if weak.suspended_nodes else None
        self._tangent.assemble()  # what derives from it takes over where it has entries
        self._operator = A if self._bodies is None else self._bodies.reduce(A)
        self._linear = LinearSolvers(weak, self._tangent, self._operator, self._bodies, self._options, tolerances.linear)
        snes = PETSc.SNES().create(V.mesh.comm)
        snes.setOptionsPrefix(self._options.prefix)
        snes.setFunction(weakly(self._form_residual), self._b)
        snes.setJacobian(weakly(self._form_tangent), self._operator)
        snes.setType("newtonls")
        self._search: WorkLineSearch | None = None
        if weak.contacts.terms and weak.pressure is None:  # with a pressure the work along a step has no least energy to say
            self._search = WorkLineSearch(snes, self._x, self._b, self._evaluate)
        else:
            snes.getLineSearch().setType("bt")
        self._tolerances, self._borne, self._guessed = tolerances, 0.0, True
        snes.setTolerances(rtol=GUESS * tolerances.rtol, stol=0.0, max_it=tolerances.max_newton)
        snes.setFromOptions()
        self._snes = snes

    def destroy(self) -> None:
        """Free the PETSc objects, on all ranks at once."""
        for item in (self._snes, self._linear, self._search, self._tangent, self._b, self._x):
            if item is not None:
                item.destroy()
        if self._bodies is not None:
            self._bodies.destroy()
            self._operator.destroy()
        self._options.clear()

    @property
    def ladder(self) -> tuple[str, ...]:
        """Names of the linear solvers, each tried where the one before fails."""
        return self._linear.ladder

    @property
    def n_unknowns(self) -> int:
        """Unknowns, fixed ones included."""
        return int(self._x.getSize())

    def renew(self) -> None:
        """Follow a change of the model's numbers."""
        self._linear.renew()

    def solve(self) -> Outcome:
        """Solve from the present unknowns, which then are the solution or, if no rung converged, the last iterate."""
        newton = self._linear.iterations = 0
        reason = ""
        guess = [function.x.array.copy() for function in self._unknowns]
        for rung in self.ladder:
            self._x.array[:] = np.concatenate([values[:n] for values, n in zip(guess, self._sizes, strict=True)])
            if self._bodies is not None:
                self._bodies.begin(guess[0].reshape(-1, 3), self._x)
            self._snes.setKSP(self._linear.solver(rung, self._prepare))
            if self._search is not None:
                self._search.forget()
            self._guessed = True
            self._snes.solve(None, self._x)
            self._place(self._x)
            newton += self._snes.getIterationNumber()
            code = self._snes.getConvergedReason()
            reason = _name(code)
            if code > 0:
                return Outcome(True, newton, self._linear.iterations, rung, reason)
            if code != PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
                break
            why = self._snes.getKSP().getConvergedReason()
            self._log(f"  {rung} failed in the linear solve ({_name(why, PETSc.KSP)})")
            if why == PETSc.KSP.ConvergedReason.DIVERGED_NANORINF:
                break  # an inverted element, which no solver mends
            if why == PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED:
                self._linear.forget(rung)
        return Outcome(False, newton, self._linear.iterations, rung, reason)

    @property
    def _sizes(self) -> list[int]:
        """Unknowns that this rank owns, of each kind."""
        spaces = [function.function_space.dofmap for function in self._unknowns]
        return [dofmap.index_map_bs * dofmap.index_map.size_local for dofmap in spaces]

    def _place(self, x: PETSc.Vec) -> None:
        """Make `x` the present unknowns."""
        at = 0
        for function, n in zip(self._unknowns, self._sizes, strict=True):
            function.x.array[:n] = x.array_r[at : at + n]
            function.x.scatter_forward()
            at += n
        if self._bodies is not None:
            self._bodies.place(x, self._weak.u.x.array.reshape(-1, 3))
        self._weak.update()

    def _evaluate(self, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Make `x` the present unknowns, and their residual `b`."""
        with RESIDUAL:
            self._place(x)
            residual = self._equations.forces.unbalanced().ravel()
            if self._suspension is not None:
                residual += assemble(self._suspension)
            b.array[:] = residual if self._volume is None else np.concatenate([residual, self._volume.assemble()])
            whole = b.norm()
            if self._bodies is not None:
                self._bodies.residual(b)
            b.array[self._weak.fixed_dofs] = 0.0
            rest = b.norm()
            self._borne = math.sqrt(max((whole - rest) * (whole + rest), 0.0))

    def _prepare(self) -> None:
        """Assemble what the set-up of a linear solver needs to see."""
        self._evaluate(self._x, self._b)
        self._form_tangent(self._snes, self._x, self._operator, self._operator)

    def _form_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        if self._search is None or not self._search.recall(x, b):
            self._evaluate(x, b)
        share = UNSOLVED if self._guessed and not isinstance(self._equations.scheme, QuasiStatic) else 1.0
        snes.setTolerances(atol=max(self._tolerances.atol, share * self._enough))
        self._guessed = False

    @property
    def _enough(self) -> float:
        """Residual in N at which a solve is done."""
        return max(self._tolerances.atol, self._tolerances.rtol * self._borne)

    def _form_tangent(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        static = isinstance(self._equations.scheme, QuasiStatic)
        serves = snes.getIterationNumber() > 0 and snes.getKSP().getIterationNumber() <= STALE
        self._tangent.assemble(coarse=static or not serves)  # the first guess of an equilibrium may be far from it
        if self._bodies is not None:
            self._bodies.tangent(self._tangent.matrix, self._operator)
        self._linear.update()
        if not static:  # the next guess extrapolates what is left of an equilibrium's residual
            self._linear.aim(float(snes.getFunction()[0].norm()), self._enough)


def _name(code: int, kind: Any = PETSc.SNES) -> str:
    names = {value: name for name, value in vars(kind.ConvergedReason).items() if isinstance(value, int) and not name.startswith("_")}
    return str(names.get(code, code)).replace("_", " ").lower()
