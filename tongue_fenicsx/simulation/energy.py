# SPDX-License-Identifier: MIT
"""What a state is worth: Jacobian, Hencky strain, energies and their balance, from numbers at quadrature points."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from ..core.types import Floats
from ..forms import jit, quadrature
from ..forms.assembly import assembled
from ..forms.contact_terms import ContactMeasures
from ..forms.nodal_forces import Forces, Scheme
from ..forms.weak_form import WeakForm
from ..geometry.tetrahedron import volumes

ENERGIES = ("kinetic", "elastic", "muscle_work", "gravity_work", "support_work", "contact_work", "dissipated")


def hencky_von_mises(F: Floats) -> Floats:
    """Von Mises measure √(⅔ dev h : dev h) of the Hencky strain h = ½ ln FᵀF, for F of shape (…, 3, 3)."""
    h = 0.5 * np.log(np.linalg.eigvalsh(np.swapaxes(F, -1, -2) @ F))
    deviator = h - h.mean(axis=-1, keepdims=True)
    return np.asarray(np.sqrt(2 / 3 * (deviator**2).sum(axis=-1)))


def determinant(F: Floats) -> Floats:
    """Determinants (…) of matrices (…, 3, 3), by hand, which is ten times as fast as by factors."""
    return np.asarray(np.einsum("...i,...i->...", F[..., 0, :], np.cross(F[..., 1, :], F[..., 2, :])))


def weighted_percentile(values: Floats, weights: Floats, percent: float) -> float:
    """The value below which `percent` of the total weight lies."""
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(share, percent / 100 * share[-1])])


@dataclass
class Balance:
    """Energies in J, the works accumulated with the trapezoidal rule along the path."""

    kinetic: float = 0.0
    elastic: float = 0.0
    muscle_work: float = 0.0
    gravity_work: float = 0.0
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
        work = self.muscle_work + self.gravity_work + self.support_work + self.contact_work
        self.worst = max(self.worst, abs(work + self.start - self.kinetic - self.elastic - self.dissipated))
        others = (self.kinetic, self.elastic, *map(abs, (self.gravity_work, self.support_work, self.contact_work)))
        largest = abs(self.muscle_work) if self.muscle_work else max(others)
        self.peak = max(self.peak, largest)


@dataclass(frozen=True)
class _Now:
    """A state as the next step needs it: displacement in m and forces in N of the owned nodes, (n, 3), and the elastic energy and the
    stiffness at the quadrature points."""

    u: Floats
    muscle: Floats
    drag: Floats
    gravity: Floats
    contact: Floats
    reaction: Floats
    stiffening: Floats


class Measures:
    """What the state of a weak form and a scheme is worth, at the quadrature points of the cells that this rank owns.

    Parameters
    ----------
    weak : WeakForm
        The weak form, whose `u` is the state to measure.
    scheme : GeneralizedAlpha or QuasiStatic
        Its velocity and acceleration.
    forces : Forces
        The nodal forces of both.
    """

    def __init__(self, weak: WeakForm, scheme: Scheme, forces: Forces) -> None:
        mesh, u, v = weak.V.mesh, weak.u, scheme.v
        self._comm, self._weak, self._scheme, self._forces = mesh.comm, weak, scheme, forces
        points, weights = quadrature.points_and_weights(weak.model.quadrature_degree)
        self._cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
        corners = mesh.geometry.x[mesh.geometry.dofmaps[0][self._cells]]
        self.weights = 6 * abs(volumes(corners))[:, None] * weights
        self.volume = self.sum(np.ones_like(self.weights))
        self._points = np.einsum("qv,cvd->cqd", np.column_stack([1 - points.sum(axis=1), points]), corners)
        F, w = ufl.Identity(3) + ufl.grad(u), ufl.TestFunction(weak.V)
        self._gradient = fem.Expression(ufl.as_vector([F[i, j] for i in range(3) for j in range(3)]), points, jit_options=jit.options())
        self._elastic = weak.compiled(weak.energy_density(F) * weak.dx)
        self._active = forces.packed(weak.active_work(u, v, w)) if weak.slots.directions else None
        self._damping = forces.packed(weak.damping_work(v, w)) if weak.model.damping.beta > 0 else None
        pulls = weak.outer_work(u, v, w)
        self._pull = weak.compiled(sum(pulls[1:], pulls[0])) if pulls else None
        self._stiffening = None
        if weak.model.contraction.stiffening:
            self._stiffening = fem.Expression(
                ufl.as_vector([weak.energy_density(F), weak.slots.stiffness]), points, jit_options=jit.options()
            )
        self.contact = ContactMeasures(weak, v)
        owned = weak.V.dofmap.index_map.size_local
        self._supports = {name: nodes[nodes < owned] for name, nodes in weak.supports.items()}
        moved = [self._supports[name] for name in (*weak.model.moving, *weak.model.suspended)]
        self._moved = np.unique(np.concatenate(moved)) if moved else np.empty(0, dtype=np.int32)
        self.balance = Balance()
        self._before: _Now | None = None

    def sum(self, density: Floats) -> float:
        """Integral of a density, (cells, points), over the whole tongue."""
        return float(self._comm.allreduce(float((self.weights * density).sum())))

    def evaluate(self) -> None:
        """Read the present state: `F` (cells, points, 3, 3) and its determinant `J`."""
        values = self._gradient.eval(self._weak.V.mesh, self._cells)
        self.F = np.asarray(values).reshape(*self.weights.shape, 3, 3)
        self.J = determinant(self.F)

    def _read(self) -> _Now:
        """The forces and energies of the present state."""
        state, mass = self._scheme.state, self._forces.mass
        nodes = self._weak.V.dofmap.index_map.size_local
        nil = np.zeros((nodes, 3))
        muscle = nil.copy()
        if self._active is not None:
            muscle -= self._active.assemble().reshape(-1, 3)
        if self._pull is not None:
            muscle += assembled(self._pull).reshape(-1, 3)
        momentum = mass.times(state.v)
        drag = self._weak.model.damping.alpha * momentum
        if self._damping is not None:
            drag += self._damping.assemble().reshape(-1, 3)
        reaction = self._forces.unbalanced()
        self.support_forces = {name: np.asarray(self._comm.allreduce(reaction[at].sum(axis=0))) for name, at in self._supports.items()}
        self.contact.evaluate()
        self.balance.kinetic = self._over_nodes(momentum, state.v.reshape(-1, 3)[:nodes]) / 2
        self.balance.elastic = float(self._comm.allreduce(fem.assemble_scalar(self._elastic)))
        stiffening = nil
        if self._stiffening is not None:
            stiffening = np.asarray(self._stiffening.eval(self._weak.V.mesh, self._cells)).reshape(*self.weights.shape, 2)
        gravity = mass.times(np.tile(self._weak.gravity.value, len(state.u) // 3))
        u = state.u.reshape(-1, 3)[:nodes].copy()
        return _Now(u, muscle, drag, gravity, self.contact.forces, reaction, stiffening)

    def start(self) -> None:
        """Begin the energy balance at the present state."""
        self._forces.repack()
        self.evaluate()
        self._before = self._read()
        self.balance.start = self.balance.kinetic + self.balance.elastic

    def resume(self, balance: Balance) -> None:
        """Go on with an energy balance from a checkpoint."""
        self.balance = balance
        self._forces.repack()
        self.evaluate()
        self._before = self._read()

    def advance(self) -> None:
        """Add the step that led to the present state to the energy balance."""
        self.evaluate()
        assert self._before is not None
        before, now = self._before, self._read()
        path = now.u - before.u
        b = self.balance
        b.muscle_work += self._work(before.muscle + now.muscle, path)
        b.dissipated += self._work(before.drag + now.drag, path)
        b.gravity_work += self._work(before.gravity + now.gravity, path)
        b.contact_work += self._work(before.contact + now.contact, path)
        b.support_work += self._work((before.reaction + now.reaction)[self._moved], path[self._moved])
        if self._stiffening is not None:
            mean, change = (before.stiffening + now.stiffening) / 2, now.stiffening - before.stiffening
            b.muscle_work += self.sum(mean[..., 0] / mean[..., 1] * change[..., 1])
        b.update()
        self._before = now

    def _work(self, twice_force: Floats, path: Floats) -> float:
        """Work in J of nodal forces, (n, 3), of which the sum before and after a step is given."""
        return self._over_nodes(twice_force, path) / 2

    def _over_nodes(self, forces: Floats, path: Floats) -> float:
        return float(self._comm.allreduce(float((forces * path).sum())))

    @property
    def volume_ratio(self) -> float:
        """Present volume over rest volume."""
        return self.sum(self.J) / self.volume

    @property
    def min_jacobian(self) -> float:
        """Smallest J at a quadrature point of any rank."""
        return float(self._comm.allreduce(float(self.J.min(initial=np.inf)), op=MPI.MIN))

    def hencky(self) -> tuple[Floats, float, float]:
        """Hencky von Mises strain per owned cell, its 99th percentile by volume and its maximum over all ranks."""
        values = hencky_von_mises(self.F)
        per_cell = (values * self.weights).sum(axis=1) / self.weights.sum(axis=1)
        gathered = self._comm.gather((values.ravel(), self.weights.ravel()))
        figures = None
        if gathered is not None:
            everything, weights = (np.concatenate(part) for part in zip(*gathered, strict=True))
            figures = weighted_percentile(everything, weights, 99), float(everything.max())
        percentile, largest = self._comm.bcast(figures)
        return per_cell, percentile, largest

    def jacobian_per_cell(self) -> Floats:
        """Mean J of each owned cell."""
        return np.asarray((self.J * self.weights).sum(axis=1) / self.weights.sum(axis=1))

    def extremes(self) -> str:
        """Where J is smallest and the stretch largest, for the message of a solve that gave up."""
        stretch = np.sqrt(np.linalg.eigvalsh(np.swapaxes(self.F, -1, -2) @ self.F)[..., -1])
        found = []
        for values, pick, name in ((self.J, np.argmin, "J"), (stretch, np.argmax, "stretch")):
            at = np.unravel_index(pick(values), values.shape) if values.size else None
            found.append((float(values[at]), self._points[at].tolist(), name) if at else None)
        everything = self._comm.allgather(found)
        low = min((row[0] for row in everything if row[0]), key=lambda item: item[0])
        high = max((row[1] for row in everything if row[1]), key=lambda item: item[0])

        def place(point: list[float]) -> str:
            return "(" + ", ".join(f"{1e3 * c:.1f}" for c in point) + ") mm"

        return f"smallest J {low[0]:.3g} at {place(low[1])}, largest stretch {high[0]:.3g} at {place(high[1])} of the rest shape"
