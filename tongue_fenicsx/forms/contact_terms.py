# SPDX-License-Identifier: MIT
"""Contact in the weak form, and its measures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx import mesh as dmesh
from mpi4py import MPI
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.types import Expr, Floats
from ..geometry.obstacles import Moved
from ..mechanics.contact import Contact, Touch
from . import jit
from .assembly import assembled

if TYPE_CHECKING:
    from .weak_form import WeakForm


PENALTY = 500.0
"""Penalty in shear moduli per element edge: 0.03 mm at 1 kPa in the chapter's tissue with elements of 6 mm."""
NITSCHE = 10.0
"""Nitsche's parameter in longitudinal moduli κ + 4μ/3 per element edge, above the trace constant of quadratic tetrahedra. Ten times as
much takes three times as many Newton iterations; so it grows only while it is needed."""
RELAX = 1.2
"""By how much a γ that was made smaller grows again from step to step."""
NEAR = 1e-3
"""Gap in m beyond which θ has no effect: elsewhere the surface may bear another obstacle or a roller, so that λ is not nil."""
AUGMENTATIONS = 5
SOFTER = 10.0
"""How much softer obstacles are in the first stage of a step whose solve fails."""
DEGREE = 4
"""Of the quadrature on the surface: six points on each triangle."""


class _Term:
    """One obstacle in the weak form: its gap, normal and curvature at the quadrature points of the surface."""

    def __init__(self, contact: Contact, scale: float, surface: dmesh.Mesh) -> None:
        self.contact = contact

        def function(shape: tuple[int, ...]) -> fem.Function:
            element = basix.ufl.quadrature_element("triangle", value_shape=shape, degree=DEGREE)
            return fem.Function(fem.functionspace(surface, element))

        self.gap, self.normal, self.curvature, self.multiplier = function(()), function((3,)), function((3, 3)), function(())
        self._gamma = 1 / (contact.stiffness * scale)
        self.gamma = fem.Constant(surface, default_scalar_type(self._gamma))
        self.allowed: Floats = np.zeros(0)
        self.placed = Moved(contact.obstacle, np.eye(3), np.zeros(3))

    def set_time(self, t: float) -> None:
        """Put the obstacle where its bone is at time `t` (s), and begin a step with less augmentation."""
        self.multiplier.x.array[:] = 0.0
        self.gamma.value = min(RELAX * float(self.gamma.value), self._gamma)
        if self.contact.motion is not None:
            self.placed = Moved(self.contact.obstacle, *self.contact.motion.pose(t))

    def augment(self, depth: float) -> None:
        """Press harder where the obstacle is penetrated to `depth` (m), which is beyond the tolerance."""
        if self.contact.form == "penalty":
            self.multiplier.x.array[:] = np.maximum(self.multiplier.x.array - self.gap.x.array / float(self.gamma.value), 0.0)
        else:
            self.gamma.value *= min(0.5, (self.contact.tolerance / depth) ** 1.5)

    def update(self, points: Floats, cells: NDArray[np.int32]) -> None:
        """Evaluate the obstacle at deformed points (n_cells, q, 3) of the surface's cells."""
        gap, normal, curvature = self.placed.evaluate(points.reshape(-1, 3))
        self.gap.x.array[self.gap.function_space.dofmap.list[cells].ravel()] = gap + (self.allowed if len(self.allowed) else 0.0)
        places = self.normal.function_space.dofmap.list[cells].ravel()
        self.normal.x.array.reshape(-1, 3)[places] = normal
        self.curvature.x.array.reshape(-1, 9)[places] = curvature.reshape(-1, 9)

    def traction(self, P: Expr | None, N: Expr) -> Expr:
        """λ: the multiplier, or the stress that the tongue bears along the normal."""
        return self.multiplier if P is None else ufl.dot(self.normal, P * N)

    def pressure(self, traction: Expr) -> Expr:
        """[λ − g/γ]₊ in Pa per area at rest."""
        return ufl.max_value(traction - self.gap / self.gamma, 0.0)


class ContactSet:
    """All obstacles of a weak form, on the free surface away from bonded areas.

    Parameters
    ----------
    weak : WeakForm
        The weak form; its spaces and supports exist.
    contacts : mapping
        Name to `Contact`.
    scales : mapping
        Form to 1/γ in Pa/m.

    Attributes
    ----------
    integrals : (n, 2) int array
        Cell and local facet of each facet that may touch.
    entity_maps : list
        For the compilation of forms with contact.
    """

    def __init__(self, weak: WeakForm, contacts: Mapping[str, Contact], scales: Mapping[str, float]) -> None:
        self._weak = weak
        mesh = weak.V.mesh
        self._comm = mesh.comm
        self.terms: dict[str, _Term] = {}
        self.entity_maps: list[dmesh.EntityMap] = []
        self.integrals = np.empty((0, 2), dtype=np.int32)
        if not contacts:
            return
        mesh.topology.create_connectivity(2, 3)
        mesh.topology.create_connectivity(3, 2)
        facets = self._away_from_bones(mesh)
        surface, entity_map, _, _ = dmesh.create_submesh(mesh, 2, facets)
        self.entity_maps = [entity_map]
        self._cells = np.arange(surface.topology.index_map(2).size_local, dtype=np.int32)
        parents = entity_map.sub_topology_to_topology(self._cells, False)
        cell_of, facets_of = mesh.topology.connectivity(2, 3), mesh.topology.connectivity(3, 2)
        owners = np.array([cell_of.links(f)[0] for f in parents], dtype=np.int32)
        places = [int(np.flatnonzero(facets_of.links(c) == f)[0]) for c, f in zip(owners, parents, strict=True)]
        self.integrals = np.column_stack([owners, places]).astype(np.int32)
        points, _ = basix.make_quadrature(basix.CellType.triangle, DEGREE)
        X = ufl.SpatialCoordinate(mesh)
        self._deformed = fem.Expression(X + weak.u, points, jit_options=jit.options())
        self.terms = {name: _Term(contact, scales[contact.form], surface) for name, contact in contacts.items()}
        self.set_time(0.0)
        self.update()
        for name, term in self.terms.items():
            self._accept_touching(name, term)

    def _away_from_bones(self, mesh: dmesh.Mesh) -> NDArray[np.int32]:
        """Free facets that touch no bonded one."""
        V = self._weak.V
        bonded = np.zeros(V.dofmap.index_map.size_local + V.dofmap.index_map.num_ghosts, dtype=bool)
        for nodes in self._weak.supports.values():
            bonded[nodes] = True
        tags = self._weak.model.tongue.facet_tags
        held = self._weak.model.tongue.facets(self._weak.model.bonded)
        free = np.setdiff1d(tags.indices, held).astype(np.int32)
        mesh.topology.create_connectivity(2, 0)
        to_node = np.full(mesh.topology.index_map(0).size_local + mesh.topology.index_map(0).num_ghosts, -1, dtype=np.int64)
        to_node[np.asarray(mesh.topology.connectivity(3, 0).array).reshape(-1, 4)] = V.dofmap.list[:, :4]
        corners = np.array([mesh.topology.connectivity(2, 0).links(f) for f in free], dtype=np.int64).reshape(-1, 3)
        return free[~bonded[to_node[corners]].any(axis=1)]

    def _accept_touching(self, name: str, term: _Term) -> None:
        """Take a little penetration at rest as zero gap, and refuse more."""
        gap = term.gap.x.array[term.gap.function_space.dofmap.list[self._cells].ravel()]
        deepest = int(np.argmin(gap)) if len(gap) else 0
        found = (float(gap[deepest]), self._points.reshape(-1, 3)[deepest].tolist()) if len(gap) else (np.inf, [0.0] * 3)
        depth, place = min(self._comm.allgather(found))
        if depth < -term.contact.touching:
            x, y, z = (1e3 * c for c in place)
            raise InputError(
                f"contact.{name}: at rest the tongue is {-1e3 * depth:.2f} mm inside it at ({x:.1f}, {y:.1f}, {z:.1f}) mm; at most "
                f"{1e3 * term.contact.touching:g} mm is accepted (touching), so move one of the two surfaces, turn its normals to the "
                "free side, or refine the mesh."
            )
        term.allowed = np.maximum(-gap, 0.0)
        self.update()

    def set_time(self, t: float) -> None:
        """Put moving obstacles where they are at time `t` (s), and begin a step with less augmentation."""
        for term in self.terms.values():
            term.set_time(t)

    def update(self) -> None:
        """Evaluate the obstacles at the present displacement."""
        if self.terms:
            values = self._deformed.eval(self._weak.V.mesh, self.integrals)
            self._points = np.asarray(values).reshape(len(self.integrals), -1, 3)
        for term in self.terms.values():
            term.update(self._points, self._cells)

    def augment(self) -> bool:
        """Press harder against each obstacle that is penetrated beyond its tolerance; whether there is one."""
        deep = [(term, depth) for term in self.terms.values() if (depth := self._penetration(term)) > term.contact.tolerance]
        for term, depth in deep:
            term.augment(depth)
        return bool(deep)

    @property
    def gammas(self) -> list[float]:
        """γ of each obstacle in m/Pa; settable, as a run that goes on needs."""
        return [float(term.gamma.value) for term in self.terms.values()]

    @gammas.setter
    def gammas(self, values: list[float]) -> None:
        for term, value in zip(self.terms.values(), values, strict=True):
            term.gamma.value = value

    @contextmanager
    def softened(self) -> Iterator[None]:
        """Make all obstacles `SOFTER` times as soft, so that less of them touches and pushes at once."""
        hard = self.gammas
        self.gammas = [SOFTER * gamma for gamma in hard]
        try:
            yield
        finally:
            self.gammas = hard

    def _penetration(self, term: _Term) -> float:
        gap = term.gap.x.array[term.gap.function_space.dofmap.list[self._cells].ravel()]
        return float(self._comm.allreduce(float(max(-gap.min(initial=0.0), 0.0)), op=MPI.MAX))

    def derivatives(self) -> dict[fem.Function, Expr]:
        """Derivatives of gaps and normals by the displacement, for `ufl.derivative`."""
        return {f: d for term in self.terms.values() for f, d in ((term.gap, term.normal), (term.normal, term.curvature))}

    def work(self, u: Expr, v: Expr, w: Expr, ds: ufl.Measure) -> dict[str, Expr]:
        """Virtual work of each obstacle on `w`."""
        N = ufl.FacetNormal(self._weak.V.mesh)
        works = {}
        for name, term in self.terms.items():
            P = self._weak.surface_stress(u, v) if term.contact.form == "nitsche" else None
            traction = term.traction(P, N)
            pressure = term.pressure(traction)
            works[name] = pressure * ufl.dot(term.normal, w) * ds
            if P is not None and term.contact.theta != 0:
                change = ufl.dot(term.normal, self._weak.rest_stress(w) * N)
                near = ufl.conditional(ufl.lt(term.gap, NEAR), 1.0, 0.0)
                works[name] -= term.contact.theta * term.gamma * near * (pressure - traction) * change * ds
        return works


class ContactMeasures:
    """Force, area and pressure of contact at the state of a weak form.

    Parameters
    ----------
    weak : WeakForm
        The weak form.
    v : fem.Function
        Velocity.
    """

    def __init__(self, weak: WeakForm, v: fem.Function) -> None:
        self._weak = weak
        mesh = weak.V.mesh
        self._comm = mesh.comm
        F = ufl.Identity(3) + ufl.grad(weak.u)
        N = ufl.FacetNormal(mesh)
        cofactor = ufl.det(F) * ufl.inv(F).T * N
        stretch = ufl.sqrt(ufl.dot(cofactor, cofactor))
        w, q = ufl.TestFunction(weak.V), ufl.TestFunction(fem.functionspace(mesh, ("DG", 0)))
        self._forms = {}
        for name, term in weak.contacts.terms.items():
            P = weak.surface_stress(weak.u, v) if term.contact.form == "nitsche" else None
            pressure = term.pressure(term.traction(P, N))
            touched = ufl.conditional(ufl.gt(pressure, 0.0), stretch, 0.0)
            ds = weak.ds_contact
            forms = (pressure * ufl.dot(term.normal, w) * ds, pressure * q * ds, touched * q * ds)
            self._forms[name] = [weak.compiled(form) for form in forms]

    def evaluate(self) -> None:
        """Read the present state: `touches` by obstacle, `forces` (owned nodes, 3) in N, `pressure` (owned cells,) in Pa."""
        V = self._weak.V
        self.forces = np.zeros((V.dofmap.index_map.size_local, 3))
        self.pressure = np.zeros(V.mesh.topology.index_map(3).size_local)
        self.touches: dict[str, Touch] = {}
        for name, (force_form, load_form, area_form) in self._forms.items():
            forces = assembled(force_form)[: self.forces.size].reshape(-1, 3)
            load, area = (assembled(form)[: len(self.pressure)] for form in (load_form, area_form))
            pressure = np.divide(load, area, out=np.zeros_like(load), where=area > 0)
            self.forces += forces
            self.pressure += pressure
            term = self._weak.contacts.terms[name]
            self.touches[name] = Touch(
                np.asarray(self._comm.allreduce(forces.sum(axis=0))),
                float(self._comm.allreduce(float(area.sum()))),
                float(self._comm.allreduce(float(pressure.max(initial=0.0)), op=MPI.MAX)),
                self._weak.contacts._penetration(term),
                term.placed.rotation,
                term.placed.offset,
            )
