# SPDX-License-Identifier: MIT
"""What a state is worth: Jacobian, Hencky strain, energies and their balance, from numbers at quadrature points."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from . import jit, quadrature
from .fibres import Floats
from .model import WeakForm
from .passive import Expr

ENERGIES = ("kinetic", "elastic", "muscle_work", "gravity_work", "dissipated")


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
    dissipated: float = 0.0
    start: float = field(default=0.0, repr=False)
    peak: float = field(default=0.0, repr=False)
    worst: float = field(default=0.0, repr=False)

    @property
    def error(self) -> float:
        """Largest imbalance so far over the peak muscle work (or, without muscles, over the largest energy)."""
        return self.worst / self.peak if self.peak > 0 else 0.0

    def update(self) -> None:
        """Take note of the present imbalance."""
        gap = self.muscle_work + self.gravity_work + self.start - self.kinetic - self.elastic - self.dissipated
        self.worst = max(self.worst, abs(gap))
        largest = abs(self.muscle_work) if self.muscle_work else max(self.kinetic, self.elastic, abs(self.gravity_work))
        self.peak = max(self.peak, largest)


class Measures:
    """Evaluates the densities of a `WeakForm` at the quadrature points of the cells that this rank owns.

    Parameters
    ----------
    weak : WeakForm
        The weak form, whose `u` is the state to measure.
    v : UFL expression
        Its velocity.
    """

    def __init__(self, weak: WeakForm, v: Expr) -> None:
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
        self._pull = fem.form(sum(works[1:], works[0]), jit_options=jit.options()) if works else None
        self.balance = Balance()
        self._previous: tuple[Floats, Floats, Floats] | None = None

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

    def _outside(self) -> tuple[Floats, Floats]:
        """Nodal forces in N of muscles from outside, and the displacement, of the unknowns of this rank."""
        V = self._weak.V
        owned = 3 * V.dofmap.index_map.size_local
        if self._pull is None:
            return np.zeros(0), np.zeros(0)
        force = fem.assemble_vector(self._pull)
        force.scatter_reverse(la.InsertMode.add)
        return force.array[:owned].copy(), self._weak.u.x.array[:owned].copy()

    def start(self) -> None:
        """Begin the energy balance at the present state."""
        self.evaluate()
        self._energies()
        self.balance.start = self.balance.kinetic + self.balance.elastic
        self._previous = self._now, *self._outside()

    def resume(self, balance: Balance) -> None:
        """Go on with an energy balance from a checkpoint."""
        self.evaluate()
        self.balance = balance
        self._previous = self._now, *self._outside()

    def advance(self) -> None:
        """Add the step that led to the present state to the energy balance."""
        self.evaluate()
        assert self._previous is not None
        before, force_before, u_before = self._previous
        now, (force, u) = self._now, self._outside()
        mean, change = (before + now) / 2, now - before
        dF, du = change[..., :9], change[..., 28:31]
        model = self._weak.model
        b = self.balance
        b.muscle_work -= self.sum((mean[..., 9:18] * dF).sum(axis=-1))
        b.muscle_work += self.sum(mean[..., 27] / mean[..., 34] * change[..., 34])
        b.muscle_work += float(self._comm.allreduce(float((force_before + force) @ (u - u_before)) / 2))
        drag = model.damping.alpha * model.density * (mean[..., 31:34] * du).sum(axis=-1)
        b.dissipated += self.sum((mean[..., 18:27] * dF).sum(axis=-1) + drag)
        b.gravity_work += self.sum(model.density * (du @ self._weak.gravity.value))
        self._energies()
        b.update()
        self._previous = now, force, u

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
