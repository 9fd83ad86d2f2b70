# SPDX-License-Identifier: MIT
"""A state in numbers: what fields, history, control and call-backs see of a simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from ..core.errors import InputError
from ..core.types import Expr, Floats
from ..forms.contact_measures import ContactMeasures, ContactState
from ..mechanics.contact import Touch
from ..solvers.equations import Equations
from . import strain
from .energy import EnergyBalance
from .probes import Probes
from .quadrature_points import QuadraturePoints
from .quantities import FIELDS


class Sensors:
    """Reads states of equations; made once for an engine.

    Parameters
    ----------
    equations : Equations
        What is simulated.
    probes : Probes
        Points that are followed.
    """

    def __init__(self, equations: Equations, probes: Probes) -> None:
        self.equations, self.probes = equations, probes
        self.points = QuadraturePoints(equations.weak)
        self.energy = EnergyBalance(equations, self.points)
        self.contact = ContactMeasures(equations.weak, equations.scheme.v)


class Snapshot:
    """The accepted state of a simulation; values are computed when they are first asked for, by all ranks at once.

    Attributes
    ----------
    t, h : float
        Time, and length of the step that led here, in s.
    state : State
        All of it.
    u, v : (n,) float arrays
        Displacement in m and velocity in m/s, local and flat.
    levels : mapping
        Activation 0…1 of each muscle that can contract.
    """

    def __init__(self, sensors: Sensors, levels: Mapping[str, float]) -> None:
        self._sensors, self._weak, self._comm = sensors, sensors.equations.weak, sensors.equations.weak.V.mesh.comm
        self.state = state = sensors.equations.state
        self.t, self.h, self.u, self.v, self.levels = state.t, state.h, state.u, state.v, dict(levels)
        self.mean_velocity = sensors.equations.scheme.mean_velocity

    @property
    def _live(self) -> Sensors:
        """What reads the state, as long as it is the present one."""
        if self._sensors.equations.state is not self.state:
            raise InputError(f"the state of t = {self.t:g} s is past; read what is wanted of it before the next step.")
        return self._sensors

    # -- for anyone

    @cached_property
    def probes(self) -> dict[str, Floats]:
        """Displacement (3,) in m of each probe."""
        return dict(zip(self._live.probes.names, self._live.probes.values(self._weak.u), strict=True))

    def field(self, name: str) -> Floats:
        """A registered field on this rank by its name: nodal values (n, 3) of the owned nodes, or a value per owned cell.

        Raises
        ------
        InputError
            If no field has this name.
        """
        for quantity in FIELDS.values():
            if name == quantity.name or name.startswith(f"{quantity.name}_"):
                values: dict[str, Floats] = quantity.values(self)
                if name in values:
                    owned = self._weak.V.dofmap.index_map.size_local
                    return values[name].reshape(-1, 3)[:owned] if quantity.centre == "Node" else values[name]
        raise InputError(f"field: {name!r} is not one of {', '.join(FIELDS)} (of muscles: followed by _NAME, such as fibre_stretch_GGP_L).")

    def length(self, muscle: str) -> float:
        """Mean length of a muscle's fibres, 1 at rest, weighted by the volume that is the muscle's."""
        return self._of_muscle(muscle)[0]

    def rate(self, muscle: str) -> float:
        """Rate of `length` in 1/s, negative while it shortens."""
        return self._of_muscle(muscle)[1]

    # -- for quantities

    @cached_property
    def F(self) -> Floats:
        """Deformation gradient at the quadrature points of owned cells, (n_cells, q, 3, 3)."""
        return self._live.points.deformation_gradient()

    @cached_property
    def J(self) -> Floats:
        """Its determinant, (n_cells, q)."""
        return strain.determinant(self.F)

    def mean(self, values: Floats) -> Floats:
        """Mean over each owned cell, (n_cells, …), of values at its quadrature points, (n_cells, q, …)."""
        return self._sensors.points.mean(values)

    def evaluate(self, name: str, build: Callable[[Any, Expr, Expr], Expr]) -> Floats:
        """A vector at the quadrature points, (n_cells, q, n), from UFL: `build` takes the weak form, displacement and velocity, and is
        called when this name is first asked for."""
        return self._live.points.evaluate(name, lambda: build(self._weak, self._weak.u, self._sensors.equations.scheme.v))

    @cached_property
    def volume_ratio(self) -> float:
        """Present volume over rest volume."""
        return self._sensors.points.integrate(self.J) / self._sensors.points.volume

    @cached_property
    def min_jacobian(self) -> float:
        """Smallest J at a quadrature point of any rank."""
        return float(self._comm.allreduce(float(self.J.min(initial=np.inf)), op=MPI.MIN))

    @cached_property
    def hencky_von_mises(self) -> Floats:
        """Von Mises measure of the Hencky strain at the quadrature points, (n_cells, q)."""
        return strain.hencky_von_mises(self.F)

    @cached_property
    def hencky_extremes(self) -> tuple[float, float]:
        """Its 99th percentile by volume and its maximum, over all ranks."""
        gathered = self._comm.gather((self.hencky_von_mises.ravel(), self._sensors.points.weights.ravel()))
        figures = None
        if gathered is not None:
            everything, weights = (np.concatenate(part) for part in zip(*gathered, strict=True))
            figures = strain.weighted_percentile(everything, weights, 99), float(everything.max())
        found: tuple[float, float] = self._comm.bcast(figures)
        return found

    @cached_property
    def peak_speed(self) -> float:
        """Largest speed of a node in m/s: of its displacement over the step, because its own velocity jitters in contact."""
        speed = np.linalg.norm(self.mean_velocity.reshape(-1, 3), axis=1).max(initial=0.0)
        return float(self._comm.allreduce(float(speed), op=MPI.MAX))

    @cached_property
    def reaction(self) -> Floats:
        """Forces in N that are missing for balance, (owned nodes, 3): at bonded nodes those of the bones, elsewhere nil."""
        return self._live.equations.forces.unbalanced()

    @cached_property
    def support_forces(self) -> dict[str, Floats]:
        """Force (3,) in N of each bone on the tongue."""
        owned = len(self.reaction)
        return {
            name: np.asarray(self._comm.allreduce(self.reaction[nodes[nodes < owned]].sum(axis=0)))
            for name, nodes in self._weak.supports.items()
        }

    @cached_property
    def contact(self) -> ContactState:
        """Forces and pressures of contact."""
        return self._live.contact.evaluate()

    @property
    def touches(self) -> dict[str, Touch]:
        """What each obstacle does."""
        return self.contact.touches

    @property
    def balance(self) -> Any:
        """Energies up to here (see `energy.Balance`)."""
        return self._live.energy.balance

    @cached_property
    def fibres(self) -> Floats:
        """Stretch, rate (1/s) and active stress (Pa) of each slot in turn at the quadrature points, (n_cells, q, 3 n_slots)."""
        if not self._weak.slots.directions:
            return np.zeros((*self._sensors.points.weights.shape, 0))
        return self.evaluate("fibres", lambda weak, u, v: ufl.as_vector(weak.fibre_state(u, v)))

    def per_muscle(self, column: int, elsewhere: float) -> dict[str, Floats]:
        """Muscle to the mean over each owned cell of a column of its fibres (0 stretch, 1 rate, 2 stress), and `elsewhere`."""
        mean = self.mean(self.fibres).reshape(len(self.F), -1, 3)
        found = {}
        for index, muscle in enumerate(self._weak.slots.names):
            values = np.full(len(mean), elsewhere)
            for slot, owner in enumerate(self._weak.slots.owners[:, : len(mean)]):
                values[owner == index] = mean[owner == index, slot, column]
            found[muscle] = values
        return found

    def _of_muscle(self, muscle: str) -> tuple[float, float]:
        """Mean stretch and rate of a muscle."""
        slots = self._weak.slots
        if muscle not in slots.names:
            raise InputError(f"control: {muscle!r} is not one of the muscles that can contract: {', '.join(slots.names) or 'none'}.")
        index = slots.names.index(muscle)
        values, sums = self.fibres.reshape(*self._sensors.points.weights.shape, -1, 3), np.zeros(3)
        for slot in range(len(slots.owners)):
            mine = slots.owners[slot, : len(values)] == index
            weight = self._sensors.points.weights[mine] * slots.share(slot)[: len(values)][mine]
            sums += [weight.sum(), (weight * values[mine, :, slot, 0]).sum(), (weight * values[mine, :, slot, 1]).sum()]
        volume, stretch, rate = self._comm.allreduce(sums)
        return float(stretch / volume), float(rate / volume)
