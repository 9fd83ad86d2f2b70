# SPDX-License-Identifier: MIT
"""The discrete adjoint of both schemes in time: what the end of a step owes to its begin and to the muscles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from ..core.errors import InputError, SolveError
from ..core.types import Expr, Floats
from ..forms.assembly import assemble
from ..forms.fibre_slots import FibreSlots
from ..mechanics.tissue import number_of, with_number
from .equations import Equations
from .initial_acceleration import accelerate
from .linear import LinearSolvers
from .options import SolverOptions
from .tangent import Level, Tangent
from .time_integration import GeneralizedAlpha, State

RTOL = 1e-7
"""Relative residual of each linear solve."""
STEP = 1e-4
"""Share of a number of the tissue on both sides of which the balance is compared."""


@dataclass(frozen=True)
class Costate:
    """Derivatives of an objective by the displacement, velocity, acceleration and auxiliary acceleration of a state, at the nodes that this
    rank owns, flat."""

    u: Floats
    v: Floats
    acceleration: Floats
    auxiliary: Floats


class Adjoint:
    """Goes through the steps of a run backwards; derivatives are of the whole balance, also of what the solver's tangent leaves out.

    Parameters
    ----------
    equations : Equations
        Of the run.

    Raises
    ------
    InputError
        For the mixed form and suspended bones.
    """

    def __init__(self, equations: Equations) -> None:
        self._equations = equations
        self._weak = weak = equations.weak
        scheme = equations.scheme
        if weak.pressure is not None or weak.suspended_nodes:
            raise InputError("gradient: the displacement form, without suspended bones, is expected.")
        self._scheme = scheme
        V, u = weak.V, weak.u
        test, trial = ufl.TestFunction(V), ufl.TrialFunction(V)
        self._multiplier = lam = fem.Function(V)
        touching = weak.contacts.derivatives()

        def free(w: Expr) -> Expr:
            return ufl.replace(weak.free_balance(u, scheme.v, scheme.acceleration, w), {weak.frozen: u})

        def contact(name: str, w: Expr) -> Expr:
            return ufl.replace(-weak.contact_work(name, u, scheme.v, w), {weak.frozen: u})

        def by(function: fem.Function, direction: Expr) -> Any:
            return weak.compile(ufl.derivative(free(lam), function, direction))

        self._transposed = Level(
            weak.compile(ufl.derivative(free(trial), u, test)),
            weak.bcs,
            weak.compile_contacts(lambda name: ufl.derivative(contact(name, trial), u, test, touching)),
            "baij",
        )
        if isinstance(scheme, GeneralizedAlpha):
            self._by_v, self._by_a = by(scheme.v_part, test), by(scheme.a_part, test)
        self._slots = [(weak.slots, self._by_slots(weak.slots, lambda f, w: [by(f, w)]))]
        self._contact_by_v: Any = ()
        if (on_surface := weak.surface_slots) is not None:

            def by_contact(function: fem.Function, direction: Expr) -> Any:
                return weak.compile_contacts(lambda name: ufl.derivative(contact(name, lam), function, direction))

            if isinstance(scheme, GeneralizedAlpha):
                self._contact_by_v = by_contact(scheme.v_part, test)
            self._slots.append((on_surface, self._by_slots(on_surface, by_contact)))
        rates = weak.u, scheme.v, weak.u, lam
        self._pulls = [(pull, weak.compile(pull.work_of_one(weak.law, *rates))) for pull in weak.pulls]
        self._options = SolverOptions()
        self._tangent = Tangent(equations)  # near enough to its transpose for a preconditioner
        self._options.put(self._options.prefix + "gmres_pmg_", {"ksp_gmres_restart": 60})
        self._linear = LinearSolvers(weak, self._tangent, self._tangent.matrix, None, self._options, RTOL)

    def _by_slots(self, slots: FibreSlots, by: Callable[[fem.Function, Expr], Iterable[fem.Form]]) -> tuple[list[Any], Any]:
        """Forms of the derivatives by the slots' tensions, and by their stiffness where that follows the activation."""
        stiffening = self._weak.model.contraction.stiffening
        fields = [*slots.tensions, *([slots.stiffness] if stiffening else [])]
        forms = [by(field, ufl.TestFunction(field.function_space)) for field in fields]
        return (forms[:-1], forms[-1]) if stiffening else (forms, None)

    def destroy(self) -> None:
        """Free the PETSc objects, on all ranks at once."""
        self._linear.destroy()
        self._transposed.matrix.destroy()
        self._tangent.destroy()
        self._options.clear()

    def back(self, end: Costate, before: State, after: State, levels: Mapping[str, float]) -> tuple[Costate, Floats]:
        """From the end of a step to its begin.

        Parameters
        ----------
        end : Costate
            Of the state `after` the step.
        before, after : State
            Of the run.
        levels : mapping
            Of the muscles in the step.

        Returns
        -------
        Costate
            Of the state before.
        (n_muscles,) array
            Derivative by the level of each muscle of the weak form's slots.
        """
        scheme = self._scheme
        h = after.t - before.t
        self._stand(before, after, levels)
        if not isinstance(scheme, GeneralizedAlpha):  # an equilibrium owes nothing to the one before: implicit functions
            self._solve(-end.u)
            nil = np.zeros_like(end.u)
            return Costate(nil, nil, nil, nil), self._by_level()
        m, f, g, b = scheme.alpha_m, scheme.alpha_f, scheme.gamma, scheme.beta
        (v_factor, _), (a_factor, _) = scheme.rates
        a = end.acceleration + (1 - f) / (1 - m) * end.auxiliary
        self._solve(-(end.u + v_factor * end.v + a_factor * a))
        v = end.v + assemble(self._by_v, *self._contact_by_v)
        a = a + assemble(self._by_a)
        known = v_factor * v + a_factor * a
        auxiliary = h * (1 - g) * v + m / (1 - f) * a - h**2 * (0.5 - b) * known - m / (1 - m) * end.auxiliary
        share = 1.0 if before.h in (0.0, h) else h / before.h
        acceleration = f / (1 - m) * end.auxiliary - f / (1 - f) * a + (1 - share) * auxiliary
        return Costate(-known, v - h * known, acceleration, share * auxiliary), self._by_level()

    def _stand(self, before: State, after: State, levels: Mapping[str, float], softest: tuple[float, ...] = ()) -> None:
        """The equations at the end of a step that has been solved; where the tissue has other numbers since, `softest` says how soft
        obstacles were by themselves before."""
        self._equations.restore(before)
        self._equations.at(after.t, levels)
        contacts = self._weak.contacts
        ratios = [now / then for now, then in zip(contacts.softest, softest or contacts.softest, strict=True)]
        contacts.begin(tuple(gamma * ratio for gamma, ratio in zip(after.gammas, ratios, strict=True)), relax=False)
        self._weak.u.x.array[:] = after.u
        self._weak.update()

    def by_numbers(self, names: Sequence[str], before: State, after: State, levels: Mapping[str, float]) -> Floats:
        """After `back` of the same step: what it adds to the derivatives (n,) by numbers of the tissue.

        The balance is linear in most of them, so the difference of the balance on both sides of a number is its derivative.
        """
        weak, forces = self._weak, self._equations.forces
        model, active = weak.model, list(weak.slots.names)
        multiplier, found, softest = self._multiplier.x.array.copy(), np.zeros(len(names)), weak.contacts.softest
        for i, name in enumerate(names):
            value = number_of(model.tissue, name)
            step = STEP * (abs(value) or 1.0)
            for sign in (1.0, -1.0):
                weak.renew(replace(model, tissue=with_number(model.tissue, name, value + sign * step)), active)
                self._stand(before, after, levels, softest)
                left = forces.unbalanced().ravel()
                found[i] += sign * float(multiplier[: len(left)] @ left) / (2 * step)
        weak.renew(model, active)
        self._stand(before, after, levels)
        return np.asarray(weak.V.mesh.comm.allreduce(found))

    def begin(self, end: Costate, start: State, levels: Mapping[str, float]) -> tuple[Costate, Floats]:
        """From the first state to what a run begins with, its displacement and velocity, from which and from muscles at `levels` the
        acceleration followed; and the derivative (n_muscles,) by these, if there are any."""
        nil = np.zeros_like(end.u)
        if not isinstance(self._scheme, GeneralizedAlpha):
            return Costate(nil, nil, nil, nil), np.zeros(len(self._weak.slots.names))
        self._equations.restore(start)
        self._equations.at(start.t, levels)
        self._multiplier.x.array[:] = accelerate(self._weak, (end.acceleration + end.auxiliary).reshape(-1, 3))
        self._transposed.assemble()
        A = self._transposed.matrix
        x, b = A.createVecs()
        x.array[:] = self._multiplier.x.array[: len(nil)]
        A.mult(x, b)
        u, v = end.u + b.array_r, end.v + assemble(self._by_v, *self._contact_by_v)
        x.destroy()
        b.destroy()
        u[self._weak.fixed_dofs] = v[self._weak.fixed_dofs] = 0.0
        by_level = self._by_level()
        return Costate(u, v, nil, nil), by_level if levels else np.zeros_like(by_level)

    def _solve(self, right: Floats) -> None:
        """The multiplier λ, for which the transposed tangent times it is the `right` side."""
        right[self._weak.fixed_dofs] = 0.0
        if not self._weak.V.mesh.comm.allreduce(bool(right.any()), op=MPI.LOR):  # an equilibrium that does not count
            self._multiplier.x.array[:] = 0.0
            return
        self._transposed.assemble()
        self._tangent.assemble()
        self._linear.update()
        A = self._transposed.matrix
        x, b = A.createVecs()
        b.array[:] = right
        x.array[:] = self._multiplier.x.array[: len(right)]  # of the step after, which is near
        for rung, near in (("gmres+pmg", self._tangent.matrix), ("mumps", A)):
            ksp = self._linear.solver(rung, lambda: None)
            ksp.setOperators(A, near)
            ksp.setInitialGuessNonzero(rung != "mumps")
            ksp.solve(b, x)
            if ksp.getConvergedReason() > 0:
                break
        else:
            raise SolveError(f"gradient: the linear solve of the adjoint failed ({ksp.getConvergedReason()}).")
        self._multiplier.x.array[: len(right)] = x.array_r
        self._multiplier.x.scatter_forward()
        x.destroy()
        b.destroy()

    def _by_level(self) -> Floats:
        """λ times the derivative of the balance by the level of each muscle."""
        found = np.zeros(len(self._weak.slots.names))
        for slots, (tensions, stiffness) in self._slots:
            by_tension = [_spread(slots.tensions[0], forms) for forms in tensions]
            found += slots.levels_from(by_tension, None if stiffness is None else _spread(slots.stiffness, stiffness))
        for pull, form in self._pulls:
            found[self._weak.slots.names.index(pull.name)] -= pull.peak_stress * fem.assemble_scalar(form)
        return np.asarray(self._weak.V.mesh.comm.allreduce(found))


def _spread(field: fem.Function, forms: Iterable[fem.Form]) -> Floats:
    """Vector forms of the cells of this rank, at all nodes of their elements."""
    total: Floats = np.zeros_like(field.x.array)
    for form in forms:
        fem.assemble_vector(total, form)
    return total
