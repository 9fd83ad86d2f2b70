# SPDX-License-Identifier: MIT
"""Fibres of overlapping muscles on a mesh: a few slots per cell, and pulls from outside the tongue."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import entities_to_geometry
from mpi4py import MPI
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.types import Expr, Floats
from ..geometry.fibre_direction import common_sense
from ..mechanics.contraction import Contraction
from ..mechanics.model import Model
from ..meshing.tongue_mesh import MuscleCells, TongueMesh
from . import quadrature
from .cell_kernels import Term


@dataclass(frozen=True)
class Places:
    """Where in each cell fibres are given: reference points (q, 3) and the element, of a value shape, that has them as nodes."""

    points: Floats
    element: Callable[[tuple[int, ...]], Any]
    interpolates: bool = False

    @classmethod
    def inside(cls, degree: int) -> Places:
        """The quadrature points of the stress terms."""

        def element(shape: tuple[int, ...]) -> Any:
            return basix.ufl.quadrature_element("tetrahedron", value_shape=shape, scheme=quadrature.RULE, degree=degree)

        return cls(quadrature.points_and_weights(degree)[0], element)

    @classmethod
    def corners(cls) -> Places:
        """The vertices, linear between them: for stresses on the surface."""
        return cls(np.vstack([np.zeros(3), np.eye(3)]), lambda shape: basix.ufl.element("DG", "tetrahedron", 1, shape=shape), True)


class FibreSlots:
    """Overlapping muscles as a few slots per cell, so that one kernel serves any number of them.

    Each cell keeps the direction and the weight of its first, second, … muscle in slot 1, 2, …; a slot that a cell does
    not need carries no tension.

    Attributes
    ----------
    names : list of str
        The muscles.
    owners : (n_slots, n_cells) int array
        Which of them is in each slot of each local cell, -1 for none.

    Parameters
    ----------
    tongue : TongueMesh
        The mesh.
    n_slots : int
        How many (see `count_slots`).
    places : Places
        Where in each cell fibres are given.
    """

    def __init__(self, tongue: TongueMesh, n_slots: int, places: Places) -> None:
        self._tongue, self.places = tongue, places
        mesh = tongue.mesh
        vectors, scalars = (fem.functionspace(mesh, places.element(shape)) for shape in ((3,), ()))
        self.directions = [fem.Function(vectors, name=f"direction_{i}") for i in range(n_slots)]
        self.tensions = [fem.Function(scalars, name=f"tension_{i}") for i in range(n_slots)]
        self.tendons = [fem.Function(scalars, name=f"tendon_{i}") for i in range(n_slots)]
        self.passives = [fem.Function(scalars, name=f"passive_{i}") for i in range(n_slots)]
        self.stiffness = fem.Function(scalars, name="stiffness")
        self._dofs = scalars.dofmap.list
        self.names: list[str] = []
        self.owners = np.full((n_slots, len(self._dofs)), -1, dtype=np.int64)

    def carry(self, muscles: Mapping[str, MuscleCells], peak_stress: Mapping[str, float], fade: Callable[[Floats], Floats]) -> None:
        """Carry these muscles, at rest, and no others.

        Parameters
        ----------
        muscles : mapping
            Not more in any cell than there are slots.
        peak_stress : mapping
            Of each, in Pa.
        fade : callable
            Takes points (n, 3) in m, returns the tendon factor 0…1.
        """
        mesh, points = self._tongue.mesh, self.places.points
        vertex = np.column_stack([1 - points.sum(axis=1), points])  # P1 shape functions, (q, 4)
        used = np.zeros(len(self._dofs), dtype=np.int64)
        self.names = list(muscles)
        self.owners[:] = -1
        self._peak = np.zeros((*self.owners.shape, len(points)))
        self._share = np.zeros_like(self._peak)
        for function in self.directions:
            function.x.array[:] = np.tile([1.0, 0.0, 0.0], len(function.x.array) // 3)
        for function in (*self.tendons, *self.passives):
            function.x.array[:] = 0.0
        for index, (name, muscle) in enumerate(muscles.items()):
            direction = np.einsum("qv,cvd->cqd", vertex, common_sense(muscle.direction))
            direction /= np.linalg.norm(direction, axis=2, keepdims=True)
            at = np.einsum("qv,cvd->cqd", vertex, mesh.geometry.x[mesh.geometry.dofmaps[0][muscle.cells]])
            share = muscle.weight @ vertex.T
            peak = peak_stress[name] * share
            muscular = fade(at.reshape(-1, 3)).reshape(at.shape[:2])
            slot = used[muscle.cells]
            used[muscle.cells] += 1
            self.owners[slot, muscle.cells] = index
            self._peak[slot, muscle.cells] = peak * muscular
            self._share[slot, muscle.cells] = share
            for i in range(len(self.owners)):
                mine = slot == i
                self.directions[i].x.array.reshape(-1, 3)[self._dofs[muscle.cells[mine]]] = direction[mine]
                self.tendons[i].x.array[self._dofs[muscle.cells[mine]]] = (peak * (1 - muscular))[mine]
                self.passives[i].x.array[self._dofs[muscle.cells[mine]]] = (peak * muscular)[mine]
        self.activate({})

    def activate(self, levels: Mapping[str, float]) -> None:
        """Set the activation of each muscle, 0…1; those that are not named rest."""
        level = np.array([*(levels.get(name, 0.0) for name in self.names), 0.0])  # the last serves empty slots
        self._total = total = np.zeros(self._dofs.shape)
        for i, tension in enumerate(self.tensions):
            in_slot = level[self.owners[i]][:, None]
            tension.x.array[self._dofs] = in_slot * self._peak[i]
            total += in_slot * self._share[i]
        self.stiffness.x.array[self._dofs] = 1 + 9 * np.minimum(total, 1.0)

    def levels_from(self, tensions: Sequence[Floats], stiffness: Floats | None) -> Floats:
        """What a function of the slots' tensions (and stiffness) owes to the level of each muscle, from its derivatives by their values."""
        found = np.zeros(len(self.names) + 1)  # the last of empty slots
        stiffens = np.zeros_like(self._share[0]) if stiffness is None else np.where(self._total < 1, 9 * stiffness[self._dofs], 0.0)
        for owner, peak, share, values in zip(self.owners, self._peak, self._share, tensions, strict=True):
            np.add.at(found, owner, (values[self._dofs] * peak + stiffens * share).sum(axis=1))
        return found[:-1]

    def share(self, slot: int) -> Floats:
        """The share of the muscle in a slot at each place, (n_cells, q), 0…1."""
        return np.asarray(self._share[slot])

    def stress(self, law: Contraction, F: Expr, F_rate: Expr, F_frozen: Expr) -> Expr:
        """Sum of the first Piola–Kirchhoff stresses of all slots."""
        zero = 0.0 * F
        return sum((self._stress_of(slot, law, F, F_rate, F_frozen) for slot in self._slots), zero)

    def term(self, law: Contraction, F: Expr, F_rate: Expr, F_frozen: Expr) -> Term:
        """The same as one function of the coefficients of each slot."""
        first = self._slots[0]
        same = [dict(zip(first, slot, strict=True)) for slot in self._slots]
        return Term(self._stress_of(first, law, F, F_rate, F_frozen), same, switches=first[1:])

    @property
    def _slots(self) -> list[tuple[fem.Function, ...]]:
        return list(zip(self.directions, self.tensions, self.tendons, self.passives, strict=True))

    def _stress_of(self, slot: tuple[fem.Function, ...], law: Contraction, F: Expr, F_rate: Expr, F_frozen: Expr) -> Expr:
        direction, *tensions = slot
        return law.stress(F, F_rate, F_frozen, direction / _norm(direction) if self.places.interpolates else direction, *tensions)

    def state(self, law: Contraction, F: Expr, F_rate: Expr) -> list[Expr]:
        """Stretch, rate in 1/s, and active Cauchy stress along the fibre in Pa, of each slot in turn."""
        values = []
        for direction, tension in zip(self.directions, self.tensions, strict=True):
            stretch, gradient = law.stretch(F, direction)
            rate = ufl.inner(gradient, F_rate)
            stress = tension * law.tension(stretch, rate) * stretch / (law.optimal_stretch * ufl.det(F))
            values += [stretch, rate, stress]
        return values


class OuterPull:
    """The pull of a muscle's part outside the tongue on the surface that it crosses, such as styloglossus.

    It follows the line to its anchor. Its tension is that of the fibres inside, peak stress times activation, with
    the length and the rate of the part outside in the force–length and force–velocity factors: so it comes from a
    potential and a damper, and the tangent stays symmetric.

    Parameters
    ----------
    tongue : TongueMesh
        The mesh.
    name : str
        A muscle with an `MuscleCells.entry`.
    ds : ufl.Measure
        The surface that it crosses.

    Attributes
    ----------
    peak_stress : float
        In Pa; settable.
    """

    def __init__(self, tongue: TongueMesh, name: str, ds: ufl.Measure) -> None:
        entry = tongue.muscles[name].entry
        assert entry is not None
        mesh = tongue.mesh
        self.name, self.peak_stress, self._ds = name, 0.0, ds
        self._anchor = fem.Constant(mesh, entry.anchor)
        self._level = fem.Constant(mesh, 0.0)
        self._share = fem.Function(fem.functionspace(mesh, ("P", 1)))
        at_node = np.zeros(len(mesh.geometry.x))
        at_node[entry.nodes] = entry.share
        self._share.x.array[self._share.function_space.dofmap.list] = at_node[mesh.geometry.dofmaps[0]]

    def activate(self, levels: Mapping[str, float]) -> None:
        """Set the activation, 0…1, from those of all muscles; without its own it rests."""
        self._level.value = self.peak_stress * levels.get(self.name, 0.0)

    def work(self, law: Contraction, u: Expr, v: Expr, frozen: Expr, w: Expr) -> Expr:
        """Virtual work of the pull on `w`; `frozen` is the displacement that the rate of the distance holds fixed."""
        return self._level * self.work_of_one(law, u, v, frozen, w)

    def work_of_one(self, law: Contraction, u: Expr, v: Expr, frozen: Expr, w: Expr) -> Expr:
        """The same at an active stress of 1 Pa."""
        X = ufl.SpatialCoordinate(self._ds.ufl_domain())
        line, rest = self._anchor - X - u, _norm(self._anchor - X)
        held = self._anchor - X - frozen
        tension = law.tension(_norm(line) / rest, -ufl.dot(held, v) / (_norm(held) * rest))
        return self._share * tension * ufl.dot(line, w) / _norm(line) * self._ds


def count_slots(tongue: TongueMesh, muscles: Mapping[str, MuscleCells]) -> int:
    """The largest number of these muscles in any cell of any rank."""
    index_map = tongue.mesh.topology.index_map(3)
    used = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    for muscle in muscles.values():
        used[muscle.cells] += 1
    return int(tongue.comm.allreduce(int(used.max(initial=0)), op=MPI.MAX))


def _norm(vector: Expr) -> Expr:
    return ufl.sqrt(ufl.dot(vector, vector))


def smooth_fade(distance: Floats, length: float) -> NDArray[np.float64]:
    """Tendon factor: 0 at a bonded area, 1 from `length` (m) on, smooth in between."""
    if length == 0:
        return np.ones_like(distance)
    s = np.clip(distance / length, 0, 1)
    return np.asarray(s * s * (3 - 2 * s))


def tendon_factor(model: Model) -> Callable[[Floats], Floats]:
    """The share of the active stress that is left at points (n, 3) in m: 0 at a bonded area, 1 beyond the tendon."""
    mesh = model.tongue.mesh
    mesh.topology.create_connectivity(2, 3)
    nodes = mesh.geometry.x[entities_to_geometry(mesh, 2, model.tongue.facets(model.bonded))].reshape(-1, 3, 3)
    steps = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4
    samples = np.vstack(mesh.comm.allgather(np.einsum("sv,fvd->fsd", steps, nodes).reshape(-1, 3)))
    nearest = cKDTree(samples) if len(samples) else None

    def factor(points: Floats) -> Floats:
        if nearest is None or len(points) == 0:
            return np.ones(len(points))
        return smooth_fade(nearest.query(points)[0], model.contraction.tendon_length)

    return factor
