# SPDX-License-Identifier: MIT
"""Energies of a state, and their balance along the path."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import ufl
from dolfinx import fem

from ..core.types import Floats
from ..forms.assembly import assemble
from ..solvers.equations import Equations
from .quadrature_points import QuadraturePoints

ENERGIES = ("kinetic", "elastic", "muscle_work", "gravity_work", "load_work", "support_work", "contact_work", "dissipated")

IMBALANCE = 0.01
"""Largest imbalance over the peak work that needs no warning."""


def warn(error: float) -> list[str]:
    """What to say of an imbalance, in lines."""
    if error <= IMBALANCE:
        return []
    return [f"warning: energies are out of balance by {100 * error:.1f} %: jumps and blows are finer followed with a shorter time.step"]


@dataclass
class Balance:
    """Energies in J, the works accumulated with the trapezoidal rule along the path."""

    kinetic: float = 0.0
    elastic: float = 0.0
    muscle_work: float = 0.0
    gravity_work: float = 0.0
    load_work: float = 0.0
    support_work: float = 0.0
    contact_work: float = 0.0
    dissipated: float = 0.0
    start: float = field(default=0.0, repr=False)
    peak: float = field(default=0.0, repr=False)
    worst: float = field(default=0.0, repr=False)

    @property
    def error(self) -> float:
        """Largest imbalance so far over the peak muscle work (or, without muscles, over the largest other one)."""
        return self.worst / self.peak if self.peak > 0 else 0.0

    def update(self) -> None:
        """Take note of the present imbalance."""
        works = (self.gravity_work, self.load_work, self.support_work, self.contact_work)
        work = self.muscle_work + sum(works)
        self.worst = max(self.worst, abs(work + self.start - self.kinetic - self.elastic - self.dissipated))
        largest = abs(self.muscle_work) if self.muscle_work else max(self.kinetic, self.elastic, *map(abs, works))
        self.peak = max(self.peak, largest)


@dataclass(frozen=True)
class _Now:
    """A state as the next step needs it: displacement in m and forces in N of the owned nodes, (n, 3), and the elastic energy and the
    stiffening at the quadrature points."""

    u: Floats
    muscle: Floats
    drag: Floats
    gravity: Floats
    load: Floats
    contact: Floats
    reaction: Floats
    stiffening: Floats


class EnergyBalance:
    """Follows the energies of equations from state to state.

    Parameters
    ----------
    equations : Equations
        Their weak form and scheme.
    points : QuadraturePoints
        Of the weak form.

    Attributes
    ----------
    balance : Balance
        Up to the state that was taken in last.
    """

    def __init__(self, equations: Equations, points: QuadraturePoints) -> None:
        weak, forces = equations.weak, equations.forces
        u, v, w = weak.u, equations.scheme.v, ufl.TestFunction(weak.V)
        self._equations, self._weak, self._points, self._comm = equations, weak, points, weak.V.mesh.comm
        self._elastic = weak.compile(weak.energy_density(ufl.Identity(3) + ufl.grad(u)) * weak.dx)
        self._active = forces.pack(weak.active_work(u, v, w)) if weak.slots.directions else None
        self._damping = forces.pack(weak.damping_work(v, w)) if weak.model.tissue.damping.beta > 0 else None
        pulls, load = weak.outer_work(u, v, w), weak.load_work(u, w)
        self._pull = weak.compile(sum(pulls[1:], pulls[0])) if pulls else None
        self._load = weak.compile(load) if isinstance(load, ufl.Form) else None
        self._owned = weak.V.dofmap.index_map.size_local
        moved = [weak.supports[name] for name in (*weak.model.moving, *weak.model.suspended)]
        nodes = np.unique(np.concatenate(moved)) if moved else np.empty(0, dtype=np.int32)
        self._moved = nodes[nodes < self._owned]
        self.balance = Balance()
        self._before: _Now | None = None

    def begin(self, reaction: Floats, contact: Floats, balance: Balance | None = None) -> None:
        """Begin at the present state, or go on from there with a balance; forces of bones and obstacles (owned nodes, 3) are in N."""
        self.balance = balance or Balance()
        self._before = self._read(reaction, contact)
        if balance is None:
            self.balance.start = self.balance.kinetic + self.balance.elastic

    def advance(self, reaction: Floats, contact: Floats) -> None:
        """Add the step that led to the present state."""
        assert self._before is not None
        before, now = self._before, self._read(reaction, contact)
        path = now.u - before.u
        b = self.balance
        b.muscle_work += self._work(before.muscle + now.muscle, path)
        b.dissipated += self._work(before.drag + now.drag, path)
        b.gravity_work += self._work(before.gravity + now.gravity, path)
        b.load_work += self._work(before.load + now.load, path)
        b.contact_work += self._work(before.contact + now.contact, path)
        b.support_work += self._work((before.reaction + now.reaction)[self._moved], path[self._moved])
        if now.stiffening.ndim == 3:
            mean, change = (before.stiffening + now.stiffening) / 2, now.stiffening - before.stiffening
            b.muscle_work += self._points.integrate(mean[..., 0] / mean[..., 1] * change[..., 1])
        b.update()
        self._before = now

    def _read(self, reaction: Floats, contact: Floats) -> _Now:
        """The forces of the present state; its energies go into the balance."""
        weak, state, times_mass = self._weak, self._equations.state, self._equations.forces.times_mass
        nil = np.zeros((self._owned, 3))
        muscle = nil.copy()
        if self._active is not None:
            muscle -= self._active.assemble().reshape(-1, 3)
        if self._pull is not None:
            muscle += assemble(self._pull).reshape(-1, 3)
        momentum = times_mass(state.v)
        drag = weak.model.tissue.damping.alpha * momentum
        if self._damping is not None:
            drag += self._damping.assemble().reshape(-1, 3)
        self.balance.kinetic = self._over_nodes(momentum, state.v.reshape(-1, 3)[: self._owned]) / 2
        self.balance.elastic = float(self._comm.allreduce(fem.assemble_scalar(self._elastic)))
        stiffening = nil
        if weak.model.contraction.stiffening:
            F = ufl.Identity(3) + ufl.grad(weak.u)
            stiffening = self._points.evaluate("stiffening", lambda: ufl.as_vector([weak.energy_density(F), weak.slots.stiffness]))
        gravity = times_mass(np.tile(weak.gravity.value, len(state.u) // 3))
        load = nil if self._load is None else assemble(self._load).reshape(-1, 3)
        u = state.u.reshape(-1, 3)[: self._owned].copy()
        return _Now(u, muscle, drag, gravity, load, contact, reaction, stiffening)

    def _work(self, twice_force: Floats, path: Floats) -> float:
        """Work in J of nodal forces, (n, 3), of which the sum before and after a step is given."""
        return self._over_nodes(twice_force, path) / 2

    def _over_nodes(self, forces: Floats, path: Floats) -> float:
        return float(self._comm.allreduce(float((forces * path).sum())))
