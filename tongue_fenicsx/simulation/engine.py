# SPDX-License-Identifier: MIT
"""Forms, solver and sensors of a model: made once, used by any number of runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core.types import Floats
from ..forms.weak_form import WeakForm
from ..mechanics.model import Model
from ..solvers.adjoint import Adjoint
from ..solvers.equations import Equations
from ..solvers.initial_acceleration import set_initial_acceleration
from ..solvers.newton import Newton, Outcome
from ..solvers.time_integration import GeneralizedAlpha, QuasiStatic, State
from ..solvers.tolerances import Tolerances
from .diagnosis import advise, describe_iterate
from .energy import Balance
from .probes import Probes
from .snapshot import Sensors, Snapshot
from .stepping import Stepping

AUGMENTATIONS = 5
"""How often a step is solved again where it is too deep in an obstacle."""


class Engine:
    """Solves the steps of a model with some of its muscles.

    Parameters
    ----------
    model : Model
        What is simulated.
    muscles : sequence of str
        Those that can contract, with sides.
    probes : Probes
        Points that are followed.
    stepping : Stepping
        The scheme in time.
    tolerances : Tolerances
        Accuracy of each solve.

    Attributes
    ----------
    probes : Probes
        Those.
    beginning : State, mapping
        Where the last run began, and the levels of muscles that caused its acceleration; without any, nothing depends on them.
    log : callable
        Takes a line; settable.
    """

    def __init__(self, model: Model, muscles: Sequence[str], probes: Probes, stepping: Stepping, tolerances: Tolerances) -> None:
        self.log: Callable[[str], None] = lambda line: None
        self._tolerances, self._quasi_static, self.probes = tolerances, stepping.quasi_static, probes
        self.weak = weak = WeakForm(model, muscles)
        scheme = (
            QuasiStatic(weak.u, weak.pressure)
            if stepping.quasi_static
            else GeneralizedAlpha(weak.u, stepping.spectral_radius, weak.pressure)
        )
        self.equations = Equations(weak, scheme)
        self._rest = self._first = scheme.state
        self.beginning: tuple[State, Mapping[str, float]] = scheme.state, {}
        self._newton = Newton(self.equations, tolerances, lambda line: self.log(line))
        self._sensors = Sensors(self.equations, probes)
        self._adjoint: Adjoint | None = None

    def destroy(self) -> None:
        """Free the solvers, on all ranks at once."""
        self._newton.destroy()
        if self._adjoint is not None:
            self._adjoint.destroy()

    @property
    def adjoint(self) -> Adjoint:
        """What goes back through steps; made when it is first asked for."""
        if self._adjoint is None:
            self._adjoint = Adjoint(self.equations)
        return self._adjoint

    def renew(self, model: Model, muscles: Sequence[str]) -> bool:
        """Take another model and other muscles, if only numbers change; whether that was so."""
        fits = self.weak.fits(model, muscles)
        if fits:
            self.weak.renew(model, muscles)
            self._newton.renew()
        return fits

    @property
    def n_unknowns(self) -> int:
        """Unknowns, fixed ones included."""
        return self._newton.n_unknowns

    @property
    def first_choice(self) -> str:
        """The linear solver that should serve."""
        return self._newton.ladder[0]

    def set_out(self, u: Floats | None, v: Floats | None) -> None:
        """Let the next run begin with a displacement in m and a velocity in m/s (local, flat), nil where bones hold the tongue; without
        both at rest."""
        free = np.ones(len(self._rest.u))
        free[self.weak.fixed_dofs] = 0.0
        self._first = replace(self._rest, u=self._rest.u if u is None else free * u, v=self._rest.v if v is None else free * v)

    def first(self) -> Snapshot:
        """The first state, rest as a rule, with all muscles relaxed."""
        self.equations.restore(self._first)
        return Snapshot(self._sensors, dict.fromkeys(self.weak.slots.names, 0.0))

    def start(self, levels: Mapping[str, float]) -> Snapshot:
        """Begin with the first state at t = 0 with muscles at `levels`."""
        return self._start(levels, levels)

    def start_calmly(self, levels: Mapping[str, float]) -> Snapshot:
        """Begin with the acceleration of muscles at rest, so that a jump to `levels` acts from the first step on: with the jump in it,
        soft tissue can be thrown farther in that step than any Newton iteration comes back from."""
        return self._start(levels, {})

    def _start(self, levels: Mapping[str, float], accelerating: Mapping[str, float]) -> Snapshot:
        self.equations.restore(self._first)
        self.equations.at(0.0, accelerating)
        if not self._quasi_static:
            set_initial_acceleration(self.equations, self._tolerances.atol)
        self.beginning = self.equations.state, {} if self._quasi_static else accelerating
        self.equations.at(0.0, levels)
        return self._begin(levels, None)

    def resume(self, state: State, levels: Mapping[str, float], balance: Balance) -> Snapshot:
        """Go on from a state, at which muscles are at `levels`, with its energy balance."""
        self.equations.restore(state)
        self.equations.at(state.t, levels)
        return self._begin(levels, balance)

    def _begin(self, levels: Mapping[str, float], balance: Balance | None) -> Snapshot:
        now = Snapshot(self._sensors, levels)
        self._sensors.energy.begin(now.reaction, now.contact.forces, balance)
        return now

    def solve(self, t: float, levels: Mapping[str, float]) -> Outcome:
        """Solve the step to time `t` (s): if that fails in contact, from where softer obstacles stop the tongue, and then with a greater
        parameter of Nitsche's; and again with augmented contact where it is too deep in an obstacle. The state is as before."""
        contacts = self.weak.contacts
        self.equations.at(t, levels)
        outcome = self._newton.solve()
        if not outcome.converged and contacts.touched:
            self.equations.at(t, levels)
            with contacts.soften():
                outcome = outcome.then(self._newton.solve())
            if outcome.converged:
                outcome = outcome.then(self._newton.solve())
            if not outcome.converged:
                self.equations.at(t, levels)
                if contacts.stiffen():
                    outcome = outcome.then(self._newton.solve())
        for _ in range(AUGMENTATIONS):
            if not (outcome.converged and contacts.augment(self._tolerances.penetration)):
                break
            outcome = outcome.then(self._newton.solve())
        return outcome

    def measure(self, levels: Mapping[str, float]) -> Snapshot:
        """The state that was just accepted, after a step with muscles at `levels`; its energies are in the balance."""
        now = Snapshot(self._sensors, levels)
        self._sensors.energy.advance(now.reaction, now.contact.forces)
        return now

    def describe_iterate(self) -> str:
        """What stands out in what the last solve left."""
        return describe_iterate(self._sensors)

    def advise(self, now: Snapshot, levels: Mapping[str, float]) -> str:
        """What may help where the step after the last good state `now`, with muscles at `levels`, failed."""
        return advise(self._sensors, now, levels, self._quasi_static)
