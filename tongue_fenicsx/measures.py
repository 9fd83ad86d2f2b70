# SPDX-License-Identifier: MIT
"""What a state is worth: Jacobian, Hencky strain, energies and their balance, from numbers at quadrature points."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from . import jit, quadrature
from .contact import ContactMeasures
from .fibres import Floats
from .model import WeakForm

ENERGIES = ("kinetic", "elastic", "muscle_work", "gravity_work", "support_work", "contact_work", "dissipated")


def hencky_von_mises(F: Floats) -> Floats:
    """Von Mises measure √(⅔ dev h : dev h) of the Hencky strain h = ½ ln FᵀF, for F of shape (…, 3, 3)."""
    h = 0.5 * np.log(np.linalg.eigvalsh(np.swapaxes(F, -1, -2) @ F))
    deviator = h - h.mean(axis=-1, keepdims=True)
    return np.asarray(np.sqrt(2 / 3 * (deviator**2).sum(axis=-1)))


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


class Measures:
    """Evaluates the densities of a `WeakForm` at the quadrature points of the cells that this rank owns.

    Parameters
    ----------
    weak : WeakForm
        The weak form, whose `u` is the state to measure.
    v, a : fem.Function
        Its velocity and acceleration.
    """

    def __init__(self, weak: WeakForm, v: fem.Function, a: fem.Function) -> None:
        mesh = weak.V.mesh
        self._comm = mesh.comm
        points, weights = quadrature.points_and_weights(weak.model.quadrature_degree)
        self._cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
        corners = mesh.geometry.x[mesh.geometry.dofmaps[0][self._cells]]
        edges = corners[:, 1:] - corners[:, :1]
        self.weights = abs(np.linalg.det(edges))[:, None] * weights
        self.volume = self.sum(np.ones_like(self.weights))
        self._expression = fem.Expression(weak.densities(weak.u, v), points, jit_options=jit.options())
        self._weak = weak
        self._points = np.einsum("qv,cvd->cqd", np.column_stack([1 - points.sum(axis=1), points]), corners)
        works = [ufl.replace(work, {weak.frozen: weak.u}) for work in weak.outer_work(weak.u, v, ufl.TestFunction(weak.V))]
        self._pull = weak.compiled(sum(works[1:], works[0])) if works else None
        self._forces = weak.compiled(weak.balance(weak.u, v, a, ufl.TestFunction(weak.V)))
        self.contact = ContactMeasures(weak, v)
        owned = weak.V.dofmap.index_map.size_local
        self._supports = {name: nodes[nodes < owned] for name, nodes in weak.supports.items()}
        moved = [self._supports[name] for name in (*weak.model.moving, *weak.model.suspended)]
        self._moved = np.unique(np.concatenate(moved)) if moved else np.empty(0, dtype=np.int32)
        self.balance = Balance()
        self._previous: tuple[Floats, Floats, Floats, Floats, Floats] | None = None

    def sum(self, density: Floats) -> float:
        """Integral of a density, (cells, points), over the whole tongue."""
        return float(self._comm.allreduce(float((self.weights * density).sum())))

    def evaluate(self) -> None:
        """Read the present state."""
        mesh = self._weak.V.mesh
        values = self._expression.eval(mesh, self._cells)
        self._now = np.asarray(values).reshape(*self.weights.shape, 35)
        self.F = self._now[..., :9].reshape(*self.weights.shape, 3, 3)
        self.J = np.linalg.det(self.F)

    def forces(self) -> Floats:
        """Nodal forces in N that the balance leaves over, (owned nodes, 3): nil inside, at bonded nodes what the bone exerts."""
        return self._assembled(self._forces)

    def _assembled(self, form: fem.Form) -> Floats:
        vector = fem.assemble_vector(form)
        vector.scatter_reverse(la.InsertMode.add)
        return np.array(vector.array[: 3 * self._weak.V.dofmap.index_map.size_local]).reshape(-1, 3)

    def _nodal(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Of owned nodes, (n, 3): displacement, pull of muscles from outside, force of obstacles, and reactions of the bones."""
        owned = self._weak.V.dofmap.index_map.size_local
        u = self._weak.u.x.array.reshape(-1, 3)[:owned].copy()
        pull = np.zeros_like(u) if self._pull is None else self._assembled(self._pull)
        reaction = self.forces()
        self.support_forces = {
            name: np.asarray(self._comm.allreduce(reaction[nodes].sum(axis=0))) for name, nodes in self._supports.items()
        }
        self.contact.evaluate()
        return u, pull, self.contact.forces, reaction

    def _remember(self, *nodal: Floats) -> None:
        """Keep what the next step begins with."""
        u, pull, touch, reaction = nodal
        self._previous = self._now, u, pull, touch, reaction
        self._gravity = self._weak.gravity.value.copy()

    def start(self) -> None:
        """Begin the energy balance at the present state."""
        self.evaluate()
        self._energies()
        self.balance.start = self.balance.kinetic + self.balance.elastic
        self._remember(*self._nodal())

    def resume(self, balance: Balance) -> None:
        """Go on with an energy balance from a checkpoint."""
        self.evaluate()
        self.balance = balance
        self._remember(*self._nodal())

    def advance(self) -> None:
        """Add the step that led to the present state to the energy balance."""
        self.evaluate()
        assert self._previous is not None
        before, u_before, pull_before, touch_before, reaction_before = self._previous
        now, (u, pull, touch, reaction) = self._now, self._nodal()
        mean, change = (before + now) / 2, now - before
        dF, du = change[..., :9], change[..., 28:31]
        model = self._weak.model
        b = self.balance
        b.muscle_work -= self.sum((mean[..., 9:18] * dF).sum(axis=-1))
        b.muscle_work += self.sum(mean[..., 27] / mean[..., 34] * change[..., 34])
        b.muscle_work += self._work(pull_before + pull, u - u_before)
        b.contact_work += self._work(touch_before + touch, u - u_before)
        b.support_work += self._work((reaction_before + reaction)[self._moved], (u - u_before)[self._moved])
        drag = model.damping.alpha * model.density * (mean[..., 31:34] * du).sum(axis=-1)
        b.dissipated += self.sum((mean[..., 18:27] * dF).sum(axis=-1) + drag)
        b.gravity_work += self.sum(model.density * (du @ (self._gravity + self._weak.gravity.value))) / 2
        self._energies()
        b.update()
        self._remember(u, pull, touch, reaction)

    def _work(self, twice_force: Floats, path: Floats) -> float:
        """Work in J of nodal forces, (n, 3), of which the sum before and after a step is given."""
        return float(self._comm.allreduce(float((twice_force * path).sum()) / 2))

    def _energies(self) -> None:
        density = self._weak.model.density
        self.balance.kinetic = self.sum(density / 2 * (self._now[..., 31:34] ** 2).sum(axis=-1))
        self.balance.elastic = self.sum(self._now[..., 27])

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
