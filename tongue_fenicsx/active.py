# SPDX-License-Identifier: MIT
"""Active fibre stress: Blemker's force–length law, two force–velocity laws, any number of overlapping muscles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx import mesh as dmesh
from mpi4py import MPI
from numpy.typing import NDArray

from . import quadrature
from .errors import InputError
from .fibres import Floats
from .passive import Expr
from .tonguemesh import MuscleCells, TongueMesh


def force_length(stretch: Expr) -> Expr:
    """Active force–length factor of the normalised fibre stretch λ̂, 1 at λ̂ = 1, 0 outside [0.4, 1.6] (Blemker 2005)."""
    x = stretch
    return ufl.conditional(
        ufl.lt(x, 0.6),
        ufl.conditional(ufl.lt(x, 0.4), 0.0, 9 * (x - 0.4) ** 2),
        ufl.conditional(ufl.lt(x, 1.4), 1 - 4 * (1 - x) ** 2, ufl.conditional(ufl.lt(x, 1.6), 9 * (x - 1.6) ** 2, 0.0)),
    )


def passive_tension(stretch: Expr) -> Expr:
    """Passive fibre tension over σ_max of the normalised stretch λ̂: 0 to λ̂ = 1, exponential to 1.4, then linear (Blemker 2005)."""
    return _toe_and_line(stretch, 6.6, 1.4) * 0.05


def tendon_tension(stretch: Expr) -> Expr:
    """Tendon tension over σ_max of the normalised stretch λ̂: 0 to λ̂ = 1, exponential to 1.03, then linear; 1 at 1.06.

    Form and exponent of Blemker 2005; her modulus is far above σ_max and would only stiffen the equations.
    """
    toe, slope = math.expm1(46.4 * 0.03), 46.4 * math.exp(46.4 * 0.03)
    return _toe_and_line(stretch, 46.4, 1.03) / (toe + slope * 0.03)


def _toe_and_line(stretch: Expr, exponent: float, end: float) -> Expr:
    """exp(exponent (λ̂ − 1)) − 1 from λ̂ = 1 to `end`, its tangent beyond, 0 below 1."""
    curve = ufl.exp(exponent * (ufl.min_value(stretch, end) - 1)) - 1
    line = exponent * math.exp(exponent * (end - 1)) * ufl.max_value(stretch - end, 0.0)
    return ufl.conditional(ufl.lt(stretch, 1.0), 0.0, curve + line)


def _grenoble(rate: Expr) -> Expr:
    return ufl.max_value(0.0, 0.7109 + 0.712 * ufl.atan(0.43 + 0.4444 * rate) + 0.0329 * rate)


def _hill(rate: Expr) -> Expr:
    v_max, curvature, plateau = 7.5, 0.25, 1.5
    v = rate / v_max
    shortening = ufl.max_value(0.0, (1 + v) / (1 - ufl.min_value(v, 0.0) / curvature))
    k = (1 + 1 / curvature) / (plateau - 1) * ufl.max_value(v, 0.0)
    return ufl.conditional(ufl.lt(v, 0.0), shortening, (1 + plateau * k) / (1 + k))


FORCE_VELOCITY: dict[str, Callable[[Expr], Expr]] = {
    "grenoble": _grenoble,
    "hill": _hill,
    "none": lambda rate: ufl.as_ufl(1.0),
}
"""Force–velocity factor of the isochoric stretch rate (1/s) by name, 1 at rest and clipped at 0: the λ-model form of
Grenoble (constants of Perrier 2003, after Huxley 1957); Hill's hyperbola (Winters 1990; v_max 7.5 lengths/s, curvature
0.25, 1.5 in lengthening); none."""


@dataclass(frozen=True)
class Contraction:
    """How muscle contracts.

    Attributes
    ----------
    force_velocity : str
        ``"grenoble"``, ``"hill"`` or ``"none"``.
    optimal_stretch : float
        λ_ofl, the fibre stretch of largest active force.
    tendon_length : float
        Distance in m from a bonded area over which the active stress rises from 0 to 1; where it fades, the fibres are
        tendon and carry `tendon_tension` instead.
    deviatoric : bool
        Whether λ is the isochoric stretch, so that muscle makes no pressure; False gives the plain stretch of other codes.
    passive_fibres : bool
        Whether all muscle fibres, active or not, carry `passive_tension` (Blemker 2005).
    stiffening : bool
        Whether the tissue stiffens by 1 + 9a, a the sum of the activations there up to 1 (Buchaillard 2009).
    """

    force_velocity: str = "grenoble"
    optimal_stretch: float = 1.0
    tendon_length: float = 6e-3
    deviatoric: bool = True
    passive_fibres: bool = False
    stiffening: bool = False

    def __post_init__(self) -> None:
        if self.force_velocity not in FORCE_VELOCITY:
            raise InputError(f"force_velocity: {self.force_velocity!r}; one of {', '.join(FORCE_VELOCITY)} is expected.")
        if not 0.5 <= self.optimal_stretch <= 2:
            raise InputError(f"optimal_stretch: {self.optimal_stretch}; a stretch from 0.5 to 2 is expected.")
        if not 0 <= self.tendon_length <= 0.05:
            raise InputError(f"tendon_length: {self.tendon_length} m; 0 to 0.05 m is expected.")

    def with_constants(self, mesh: dmesh.Mesh) -> Contraction:
        """The same law with its number as a constant of a form, so that another one compiles nothing."""
        law = copy(self)
        object.__setattr__(law, "optimal_stretch", fem.Constant(mesh, default_scalar_type(self.optimal_stretch)))
        return law

    def stress(
        self, F: Expr, F_rate: Expr, F_frozen: Expr, direction: Expr, tension: Expr, tendon: Expr = 0.0, passive: Expr = 0.0
    ) -> Expr:
        """First Piola–Kirchhoff stress of one fibre family, (T f_L(λ̂) f_V(λ̄̇) + T_tendon f_T(λ̂) + T_passive f_P(λ̂))/λ_ofl ∂λ̄/∂F.

        Parameters
        ----------
        F, F_rate : Expr
            Deformation gradient and its rate in 1/s.
        F_frozen : Expr
            The same deformation gradient, held fixed when the stretch rate λ̄̇ = ∂λ̄/∂F : Ḟ is differentiated: what is
            left out of the tangent is its unsymmetric part, of order λ̄̇ times half the time step.
        direction : Expr
            Unit fibre direction at rest.
        tension : Expr
            Activation times peak stress in Pa.
        tendon, passive : Expr
            Peak stress in Pa where the fibres are tendon, and where they are muscle with passive tension; 0 elsewhere.
        """
        stretch, gradient = self.stretch(F, direction)
        rate = ufl.inner(self.stretch(F_frozen, direction)[1], F_rate)
        normalised = stretch / self.optimal_stretch
        total = tension * self.tension(stretch, rate) + tendon * tendon_tension(normalised)
        if self.passive_fibres:
            total += passive * passive_tension(normalised)
        return total / self.optimal_stretch * gradient

    def stretch(self, F: Expr, direction: Expr) -> tuple[Expr, Expr]:
        """Fibre stretch, λ̄ = J^(−1/3)|F a₀| or the plain |F a₀|, and its derivative by F."""
        J, fibre = ufl.det(F), F * direction
        plain = ufl.sqrt(ufl.dot(fibre, fibre))
        if not self.deviatoric:
            return plain, ufl.outer(fibre, direction) / plain
        stretch = J ** (-1 / 3) * plain
        return stretch, J ** (-2 / 3) / stretch * ufl.outer(fibre, direction) - stretch / 3 * ufl.inv(F).T

    def tension(self, stretch: Expr, rate: Expr) -> Expr:
        """Active tension over its peak, f_L f_V, at a stretch λ and a stretch rate (1/s)."""
        normalised = stretch / self.optimal_stretch
        return force_length(normalised) * FORCE_VELOCITY[self.force_velocity](rate / self.optimal_stretch)


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
    muscles : dict
        The muscles to carry.
    sigma_max : mapping
        Peak stress in Pa of each.
    fade : callable
        Takes points (n, 3), returns the tendon factor 0…1.
    places : Places
        Where in each cell fibres are given.
    """

    def __init__(
        self,
        tongue: TongueMesh,
        muscles: dict[str, MuscleCells],
        sigma_max: Mapping[str, float],
        fade: Callable[[Floats], Floats],
        places: Places,
    ) -> None:
        mesh, points = tongue.mesh, places.points
        vertex = np.column_stack([1 - points.sum(axis=1), points])  # P1 shape functions, (q, 4)
        n_cells = mesh.topology.index_map(3).size_local + mesh.topology.index_map(3).num_ghosts
        used = np.zeros(n_cells, dtype=np.int64)
        for muscle in muscles.values():
            used[muscle.cells] += 1
        n_slots = mesh.comm.allreduce(int(used.max(initial=0)), op=MPI.MAX)
        vectors, scalars = (fem.functionspace(mesh, places.element(shape)) for shape in ((3,), ()))
        self.directions = [fem.Function(vectors, name=f"direction_{i}") for i in range(n_slots)]
        self.tensions = [fem.Function(scalars, name=f"tension_{i}") for i in range(n_slots)]
        self.tendons = [fem.Function(scalars, name=f"tendon_{i}") for i in range(n_slots)]
        self.passives = [fem.Function(scalars, name=f"passive_{i}") for i in range(n_slots)]
        self.stiffness = fem.Function(scalars, name="stiffness")
        self.names, self._places = list(muscles), places
        self._dofs = scalars.dofmap.list
        self.owners = np.full((n_slots, n_cells), -1, dtype=np.int64)
        self._stress = np.zeros((n_slots, n_cells, len(points)))
        self._share = np.zeros_like(self._stress)
        for function in self.directions:
            function.x.array[:] = np.tile([1.0, 0.0, 0.0], len(function.x.array) // 3)
        used[:] = 0
        for index, (name, muscle) in enumerate(muscles.items()):
            direction = np.einsum("qv,cvd->cqd", vertex, muscle.direction)
            direction /= np.linalg.norm(direction, axis=2, keepdims=True)
            at = np.einsum("qv,cvd->cqd", vertex, mesh.geometry.x[mesh.geometry.dofmaps[0][muscle.cells]])
            share = muscle.weight @ vertex.T
            peak = sigma_max[name] * share
            muscular = fade(at.reshape(-1, 3)).reshape(at.shape[:2])
            slot = used[muscle.cells]
            used[muscle.cells] += 1
            self.owners[slot, muscle.cells] = index
            self._stress[slot, muscle.cells] = peak * muscular
            self._share[slot, muscle.cells] = share
            for i in range(n_slots):
                mine = slot == i
                self.directions[i].x.array.reshape(-1, 3)[self._dofs[muscle.cells[mine]]] = direction[mine]
                self.tendons[i].x.array[self._dofs[muscle.cells[mine]]] = (peak * (1 - muscular))[mine]
                self.passives[i].x.array[self._dofs[muscle.cells[mine]]] = (peak * muscular)[mine]

    def activate(self, levels: Mapping[str, float]) -> None:
        """Set the activation of each muscle, 0…1; those that are not named rest."""
        level = np.array([*(levels.get(name, 0.0) for name in self.names), 0.0])  # the last serves empty slots
        total = np.zeros(self._dofs.shape)
        for i, tension in enumerate(self.tensions):
            in_slot = level[self.owners[i]][:, None]
            tension.x.array[self._dofs] = in_slot * self._stress[i]
            total += in_slot * self._share[i]
        self.stiffness.x.array[self._dofs] = 1 + 9 * np.minimum(total, 1.0)

    def stress(self, law: Contraction, F: Expr, F_rate: Expr, F_frozen: Expr) -> Expr:
        """Sum of the first Piola–Kirchhoff stresses of all slots."""
        zero = 0.0 * F
        directions = [d / _norm(d) if self._places.interpolates else d for d in self.directions]
        slots = zip(directions, self.tensions, self.tendons, self.passives, strict=True)
        return sum((law.stress(F, F_rate, F_frozen, *slot) for slot in slots), zero)

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
    sigma_max : float
        Peak stress in Pa.
    ds : ufl.Measure
        The surface that it crosses.
    """

    def __init__(self, tongue: TongueMesh, name: str, sigma_max: float, ds: ufl.Measure) -> None:
        entry = tongue.muscles[name].entry
        assert entry is not None
        mesh = tongue.mesh
        self.name, self._sigma_max, self._ds = name, sigma_max, ds
        self._anchor = fem.Constant(mesh, entry.anchor)
        self._level = fem.Constant(mesh, 0.0)
        self._share = fem.Function(fem.functionspace(mesh, ("P", 1)))
        at_node = np.zeros(len(mesh.geometry.x))
        at_node[entry.nodes] = entry.share
        self._share.x.array[self._share.function_space.dofmap.list] = at_node[mesh.geometry.dofmaps[0]]

    def activate(self, levels: Mapping[str, float]) -> None:
        """Set the activation, 0…1."""
        self._level.value = self._sigma_max * levels[self.name]

    def work(self, law: Contraction, u: Expr, v: Expr, frozen: Expr, w: Expr) -> Expr:
        """Virtual work of the pull on `w`; `frozen` is the displacement that the rate of the distance holds fixed."""
        X = ufl.SpatialCoordinate(self._ds.ufl_domain())
        line, rest = self._anchor - X - u, _norm(self._anchor - X)
        held = self._anchor - X - frozen
        tension = law.tension(_norm(line) / rest, -ufl.dot(held, v) / (_norm(held) * rest))
        return self._level * self._share * tension * ufl.dot(line, w) / _norm(line) * self._ds


def _norm(vector: Expr) -> Expr:
    return ufl.sqrt(ufl.dot(vector, vector))


def smooth_fade(distance: Floats, length: float) -> NDArray[np.float64]:
    """Tendon factor: 0 at a bonded area, 1 from `length` (m) on, smooth in between."""
    if length == 0:
        return np.ones_like(distance)
    s = np.clip(distance / length, 0, 1)
    return np.asarray(s * s * (3 - 2 * s))
