# SPDX-License-Identifier: MIT
"""The equations of a time step: a weak form with the rates of a time scheme, at a time and with given activations."""

from __future__ import annotations

from collections.abc import Mapping

from ..forms.nodal_forces import Forces
from ..forms.weak_form import WeakForm
from .time_integration import GeneralizedAlpha, QuasiStatic, State


class Equations:
    """What a solver solves; there is no order of calls to remember.

    Parameters
    ----------
    weak : WeakForm
        The balance of forces.
    scheme : GeneralizedAlpha or QuasiStatic
        Its rates.

    Attributes
    ----------
    forces : Forces
        The nodal forces of both.
    """

    def __init__(self, weak: WeakForm, scheme: GeneralizedAlpha | QuasiStatic) -> None:
        self.weak, self.scheme = weak, scheme
        self.forces = Forces(weak, scheme)

    @property
    def state(self) -> State:
        """The last accepted state."""
        return self.scheme.state

    def at(self, t: float, levels: Mapping[str, float]) -> None:
        """The equations at time `t` (s) with muscles at `levels` (0…1): the unknowns become the first guess of the step there from the
        last state, or that state itself if it is of this time. What an earlier call or a failed solve did leaves no trace."""
        h = t - self.state.t
        self.weak.load(t, levels)
        self.weak.contacts.begin(self.state.gammas, relax=h > 0)
        if h > 0:
            self.scheme.begin(h)
            self.weak.hold()
        self._follow()

    def accept(self, t: float) -> None:
        """The unknowns solve the equations at time `t`: they become the new state."""
        self.scheme.accept(t, self.weak.contacts.gammas)
        self.restore(self.state)

    def restore(self, state: State) -> None:
        """Make a state the present one."""
        self.scheme.restore(state)
        self._follow()

    def _follow(self) -> None:
        self.weak.update()
        self.forces.repack()
