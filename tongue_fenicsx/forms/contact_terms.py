# SPDX-License-Identifier: MIT
"""Contact in the weak form, and its measures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

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
from ..mechanics.contact import Contact
from ..mechanics.model import Model
from . import jit

PENALTY = 500.0
"""Penalty in shear moduli per element edge: 0.03 mm at 1 kPa in the chapter's tissue with elements of 6 mm."""
NITSCHE = 10.0
"""Nitsche's parameter in longitudinal moduli κ + 4μ/3 per element edge, above the trace constant of quadratic tetrahedra. Ten times as
much takes three times as many Newton iterations; so it grows only while it is needed."""
RELAX = 1.2
"""By how much a γ that was made smaller grows again from step to step."""
REACH = 1e-3
"""Gap in m beyond which an obstacle does nothing, whatever the stress at the surface, which may bear another obstacle or a roller there: so
the facets that are farther need no assembly."""
STIFFER = 3.0
"""By how much Nitsche's parameter grows where a solve fails: tissue that is stretched to several times its length is that much stiffer
than at rest, by which the parameter is measured."""
SOFTER = 10.0
"""How much softer obstacles are in the first stage of a step whose solve fails."""
DEGREE = 4
"""Of the quadrature on the surface: six points on each triangle."""


def find_touchable_facets(model: Model, V: fem.FunctionSpace, supports: Mapping[str, NDArray[np.int32]]) -> NDArray[np.int32]:
    """Free facets that touch no bonded one; `supports` has the nodes of each bonded surface."""
    mesh, tongue = V.mesh, model.tongue
    bonded = np.zeros(V.dofmap.index_map.size_local + V.dofmap.index_map.num_ghosts, dtype=bool)
    for nodes in supports.values():
        bonded[nodes] = True
    free = np.setdiff1d(tongue.facet_tags.indices, tongue.facets(model.bonded)).astype(np.int32)
    mesh.topology.create_connectivity(2, 0)
    to_node = np.full(mesh.topology.index_map(0).size_local + mesh.topology.index_map(0).num_ghosts, -1, dtype=np.int64)
    to_node[np.asarray(mesh.topology.connectivity(3, 0).array).reshape(-1, 4)] = V.dofmap.list[:, :4]
    corners = np.array([mesh.topology.connectivity(2, 0).links(f) for f in free], dtype=np.int64).reshape(-1, 3)
    return free[~bonded[to_node[corners]].any(axis=1)]


class _Term:
    """One obstacle in the weak form: its gap, normal and curvature at the quadrature points of the surface, the cells of the surface that
    are near, and how soft it is now and at most, γ in m/Pa."""

    def __init__(self, contact: Contact, surface: dmesh.Mesh) -> None:
        self.contact = contact

        def function(shape: tuple[int, ...]) -> fem.Function:
            element = basix.ufl.quadrature_element("triangle", value_shape=shape, degree=DEGREE)
            return fem.Function(fem.functionspace(surface, element))

        self.gap, self.normal, self.curvature, self.multiplier = function(()), function((3,)), function((3, 3)), function(())
        self.softest = np.inf
        self.gamma = fem.Constant(surface, default_scalar_type(1.0))
        self.allowed: Floats = np.zeros(0)
        self.near: NDArray[np.int32] = np.zeros(0, dtype=np.int32)
        self.placed = Moved(contact.obstacle, np.eye(3), np.zeros(3))

    @property
    def kind(self) -> tuple[str, float]:
        """Of obstacles of one kind all forms are the same but for `data`."""
        return self.contact.form, self.contact.theta

    @property
    def data(self) -> list[fem.Function | fem.Constant]:
        """What its forms depend on."""
        return [self.gap, self.normal, self.curvature, self.multiplier, self.gamma]

    def place(self, t: float) -> None:
        """Put the obstacle where its bone is at time `t` (s)."""
        if self.contact.motion is not None:
            self.placed = Moved(self.contact.obstacle, *self.contact.motion.pose(t))

    def augment(self, depth: float, allowed: float) -> None:
        """Press harder where the obstacle is penetrated to `depth` (m), which is beyond what is `allowed`."""
        if self.contact.form == "penalty":
            self.multiplier.x.array[:] = np.maximum(self.multiplier.x.array - self.gap.x.array / float(self.gamma.value), 0.0)
        else:
            self.gamma.value *= min(0.5, (allowed / depth) ** 1.5)

    def update(self, points: Floats, cells: NDArray[np.int32]) -> None:
        """Evaluate the obstacle at deformed points (n_cells, q, 3) of the surface's cells."""
        gap, normal, curvature = self.placed.evaluate(points.reshape(-1, 3))
        gap = gap + (self.allowed if len(self.allowed) else 0.0)
        nearest = gap.reshape(points.shape[:2]).min(axis=1)
        if not np.isin(np.flatnonzero(nearest < REACH), self.near).all():
            self.near = np.flatnonzero(nearest < 2 * REACH).astype(np.int32)
        self.gap.x.array[self.gap.function_space.dofmap.list[cells].ravel()] = gap
        places = self.normal.function_space.dofmap.list[cells].ravel()
        self.normal.x.array.reshape(-1, 3)[places] = normal
        self.curvature.x.array.reshape(-1, 9)[places] = curvature.reshape(-1, 9)

    def traction(self, P: Expr | None, N: Expr) -> Expr:
        """λ: the multiplier, or the stress that the tongue bears along the normal."""
        return self.multiplier if P is None else ufl.dot(self.normal, P * N)

    def pressure(self, traction: Expr) -> Expr:
        """[λ − g/γ]₊ in Pa per area at rest, nil beyond `REACH`."""
        return self.near_only(ufl.max_value(traction - self.gap / self.gamma, 0.0))

    def near_only(self, value: Expr) -> Expr:
        """A value, 0 beyond `REACH`."""
        return ufl.conditional(ufl.lt(self.gap, REACH), value, 0.0)


class ContactSet:
    """All obstacles, on the free surface away from bonded areas.

    Parameters
    ----------
    u : fem.Function
        The displacement.
    facets : (n,) int array
        Those that may touch.
    contacts : mapping
        Name to `Contact`.

    Attributes
    ----------
    mesh : dolfinx.mesh.Mesh
        Of the tongue.
    integrals : (n, 2) int array
        Cell and local facet of each facet that may touch.
    entity_maps : list
        For the compilation of forms with contact.
    """

    def __init__(self, u: fem.Function, facets: NDArray[np.int32], contacts: Mapping[str, Contact]) -> None:
        mesh = u.function_space.mesh
        self.mesh, self._comm, self._u = mesh, mesh.comm, u
        self._seen: Floats | None = None
        self.terms: dict[str, _Term] = {}
        self.entity_maps: list[dmesh.EntityMap] = []
        self.integrals = np.empty((0, 2), dtype=np.int32)
        if not contacts:
            return
        mesh.topology.create_connectivity(2, 3)
        mesh.topology.create_connectivity(3, 2)
        surface, entity_map, _, _ = dmesh.create_submesh(mesh, 2, facets)
        self.entity_maps = [entity_map]
        self._cells = np.arange(surface.topology.index_map(2).size_local, dtype=np.int32)
        parents = entity_map.sub_topology_to_topology(self._cells, False)
        cell_of, facets_of = mesh.topology.connectivity(2, 3), mesh.topology.connectivity(3, 2)
        owners = np.array([cell_of.links(f)[0] for f in parents], dtype=np.int32)
        places = [int(np.flatnonzero(facets_of.links(c) == f)[0]) for c, f in zip(owners, parents, strict=True)]
        self.integrals = np.column_stack([owners, places]).astype(np.int32)
        points, _ = basix.make_quadrature(basix.CellType.triangle, DEGREE)
        self._deformed = jit.compile_expression(ufl.SpatialCoordinate(mesh) + u, points, mesh.comm)
        self.terms = {name: _Term(contact, surface) for name, contact in contacts.items()}
        self.place(0.0)
        self.update()
        for name, term in self.terms.items():
            self._accept_touching(name, term)

    def renew(self, scales: Mapping[str, float]) -> None:
        """Make each obstacle as stiff as a tissue needs; `scales` has 1/γ in Pa/m by form."""
        for term in self.terms.values():
            term.softest = 1 / (term.contact.stiffness * scales[term.contact.form])
        self.begin((), relax=False)

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
        term.update(self._points, self._cells)

    def place(self, t: float) -> None:
        """Put moving obstacles where they are at time `t` (s)."""
        for term in self.terms.values():
            term.place(t)
        self._seen = None

    def begin(self, gammas: tuple[float, ...], relax: bool) -> None:
        """Begin without augmentation, with obstacles as soft as `gammas` (m/Pa) say (as they are by themselves, if empty), or a little
        softer than that."""
        for term, gamma in zip(self.terms.values(), gammas or self.softest, strict=True):
            term.multiplier.x.array[:] = 0.0
            term.gamma.value = min(RELAX * gamma, term.softest) if relax else gamma

    def update(self) -> None:
        """Evaluate the obstacles at the present displacement, unless that was done last."""
        if not self.terms or (self._seen is not None and np.array_equal(self._seen, self._u.x.array)):
            return
        self._seen = self._u.x.array.copy()
        values = self._deformed.eval(self.mesh, self.integrals)
        self._points = np.asarray(values).reshape(len(self.integrals), -1, 3)
        for term in self.terms.values():
            term.update(self._points, self._cells)

    def augment(self, default: float) -> bool:
        """Press harder against each obstacle that is penetrated beyond its tolerance, or the `default` (m); whether there is one."""
        deep = False
        for term in self.terms.values():
            depth, allowed = self.penetration(term), term.contact.tolerance or default
            if depth > allowed:
                term.augment(depth, allowed)
                deep = True
        return deep

    def stiffen(self) -> bool:
        """Make Nitsche's parameter greater for the obstacles that are touched; whether there is one."""
        touched = [term for term in self.terms.values() if term.contact.form == "nitsche" and self.penetration(term) > 0.0]
        for term in touched:
            term.gamma.value /= STIFFER
        return bool(touched)

    @property
    def gammas(self) -> tuple[float, ...]:
        """γ of each obstacle in m/Pa."""
        return tuple(float(term.gamma.value) for term in self.terms.values())

    @property
    def softest(self) -> tuple[float, ...]:
        """The same of obstacles that were not made stiffer."""
        return tuple(term.softest for term in self.terms.values())

    @contextmanager
    def soften(self) -> Iterator[None]:
        """Make all obstacles `SOFTER` times as soft, so that less of them touches and pushes at once."""
        hard = self.gammas
        for term, gamma in zip(self.terms.values(), hard, strict=True):
            term.gamma.value = SOFTER * gamma
        try:
            yield
        finally:
            for term, gamma in zip(self.terms.values(), hard, strict=True):
                term.gamma.value = gamma

    @property
    def touched(self) -> bool:
        """Whether the surface may be in an obstacle at the present displacement, which may not be finite."""
        finite = self._comm.allreduce(bool(np.isfinite(self._u.x.array).all()), op=MPI.LAND)
        return bool(self.terms) and (not finite or any(self.penetration(term) > 0.0 for term in self.terms.values()))

    def penetration(self, term: _Term) -> float:
        """How deep in m any point of the surface is in an obstacle, 0 if none is."""
        gap = term.gap.x.array[term.gap.function_space.dofmap.list[self._cells].ravel()]
        return float(self._comm.allreduce(float(max(-gap.min(initial=0.0), 0.0)), op=MPI.MAX))

    def derivatives(self) -> dict[fem.Function, Expr]:
        """Derivatives of gaps and normals by the displacement, for `ufl.derivative`."""
        return {f: d for term in self.terms.values() for f, d in ((term.gap, term.normal), (term.normal, term.curvature))}

    def work(self, name: str, stress: Expr | None, rest_stress: Expr, w: Expr, ds: ufl.Measure) -> Expr:
        """Virtual work of an obstacle on `w`, with the stress in the tongue (for Nitsche's method) and that of `w` as a small
        displacement from rest, both in Pa."""
        term, N = self.terms[name], ufl.FacetNormal(self.mesh)
        nitsche = term.contact.form == "nitsche"
        traction = term.traction(stress if nitsche else None, N)
        pressure = term.pressure(traction)
        work = pressure * ufl.dot(term.normal, w) * ds
        if nitsche and term.contact.theta != 0:
            change = ufl.dot(term.normal, rest_stress * N)
            work -= term.contact.theta * term.gamma * term.near_only(pressure - traction) * change * ds
        return work
