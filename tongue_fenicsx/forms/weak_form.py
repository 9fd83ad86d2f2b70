# SPDX-License-Identifier: MIT
"""The mechanical model as a weak form in UFL."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx import mesh as dmesh
from mpi4py import MPI
from numpy.typing import NDArray

from ..anatomy.catalogue import peak_stress
from ..core.errors import InputError
from ..core.types import Expr, Floats
from ..geometry.tetrahedron import volumes
from ..mechanics.hyperelasticity import bulk_modulus
from ..mechanics.kinematics import Kinematics
from ..mechanics.model import Model
from ..meshing.tongue_mesh import MuscleCells
from . import jit, quadrature
from .cell_kernels import CellKernels, Term
from .contact_forms import ContactForms
from .contact_terms import DEGREE, NITSCHE, PENALTY, ContactSet, find_touchable_facets
from .fibre_slots import FibreSlots, OuterPull, Places, count_slots, tendon_factor
from .load_terms import LoadTerms
from .passive_terms import PassiveTerms
from .supports import Springs, Supports


class WeakForm:
    """ρ(ü + α v)·w + (P_passive + P_active + P_damping) : ∇w − ρ g·w over the rest shape.

    Parameters
    ----------
    model : Model
        What is simulated.
    active : sequence of str
        The muscles, with sides, that can contract.

    Attributes
    ----------
    V : dolfinx.fem.FunctionSpace
        Quadratic displacement.
    u, frozen : dolfinx.fem.Function
        Displacement, and the stand-in for it that is held fixed when the tangent is derived (see `Contraction.stress`).
    pressure : dolfinx.fem.Function or None
        In the mixed form, the mean stress (tension counts positive) times a typical edge over the shear modulus, in m: so
        both residuals are in N.
    bcs : list of dolfinx.fem.DirichletBC
        Of the bonded surfaces.
    supports : dict
        Bonded surface to its nodes on this rank, ghosts included.
    contacts : ContactSet
        The obstacles, on the surface that `ds_contact` integrates over.
    slots : FibreSlots
        The muscles.
    pulls : list of OuterPull
        Of those that come from outside the tongue.
    """

    def __init__(self, model: Model, active: Sequence[str]) -> None:
        tongue = model.tongue
        mesh = tongue.mesh
        self.V = fem.functionspace(mesh, ("P", 2, (3,)))
        self.u = fem.Function(self.V, name="displacement")
        self.frozen = fem.Function(self.V)
        self.pressure = fem.Function(fem.functionspace(mesh, ("P", 1)), name="pressure") if model.mixed else None
        self.dx = ufl.Measure("dx", mesh, metadata=quadrature.metadata(model.quadrature_degree))
        self.dx_mass = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 4})
        self.gravity = fem.Constant(mesh, np.zeros(3, dtype=default_scalar_type))
        self._density, self._alpha, self._beta = (fem.Constant(mesh, default_scalar_type(0.0)) for _ in range(3))
        self._edge = _typical_edge(mesh)
        self._passive = PassiveTerms(model)
        self.law = model.contraction.with_constants(mesh)
        self._optimal_stretch: Any = self.law.optimal_stretch
        self._supports = Supports(model, self.u)
        muscles = _carried(model, active)
        n_slots = count_slots(tongue, muscles)
        self.slots = FibreSlots(tongue, n_slots, Places.inside(model.quadrature_degree))
        nitsche = any(contact.form == "nitsche" for contact in model.contacts.values())
        self.surface_slots = FibreSlots(tongue, n_slots, Places.corners()) if nitsche else None
        self._fibre = _fibre_field(model, self.slots.places)
        self._surface_fibre = _fibre_field(model, Places.corners()) if nitsche else None
        facets = find_touchable_facets(model, self.V, self.supports) if model.contacts else np.empty(0, dtype=np.int32)
        if model.contacts and mesh.comm.allreduce(len(facets)) == 0:
            raise InputError("contact: no surface can touch, as all of it is bonded or beside what is; a free surface is expected.")
        self.contacts = ContactSet(self.u, facets, model.contacts)
        entries = {name: muscle.entry.facets for name, muscle in muscles.items() if muscle.entry is not None}
        crossed = [*entries.values(), *(tongue.facets([name]) for name in (*model.suspended, *model.loads))]
        parts = [fem.compute_integration_domains(fem.IntegralType.exterior_facet, mesh.topology, facets) for facets in crossed]
        numbered = list(enumerate([*parts, self.contacts.integrals.ravel()]))
        ds = ufl.Measure("ds", mesh, subdomain_data=numbered, metadata={"quadrature_degree": DEGREE})  # one for all, as DOLFINx asks
        measures = [ds(i) for i in range(len(crossed))]
        self.pulls = [OuterPull(tongue, name, measure) for name, measure in zip(entries, measures, strict=False)]
        self._springs = Springs(model, measures[len(entries) : len(entries) + len(model.suspended)])
        self._loads = LoadTerms(model, measures[len(entries) + len(model.suspended) :])
        self.ds_contact = ds(len(crossed))
        self._carried: tuple[list[str], dict[str, float], float] | None = None
        self.renew(model, active)

    def fits(self, model: Model, active: Sequence[str]) -> bool:
        """Whether this form, with other numbers, is that of another model and other muscles."""
        muscles = _carried(model, active)
        return (
            model.structure == self.model.structure
            and count_slots(model.tongue, muscles) == len(self.slots.directions)
            and [name for name, muscle in muscles.items() if muscle.entry is not None] == [pull.name for pull in self.pulls]
        )

    def renew(self, model: Model, active: Sequence[str]) -> None:
        """Take the numbers of a model that `fits`, and its muscles."""
        self.model = model
        tissue, muscles = model.tissue, _carried(model, active)
        peak = peak_stress(muscles, tissue.peak_stress)
        carried = list(muscles), peak, model.contraction.tendon_length
        for slots in (self.slots, self.surface_slots):
            if slots is not None and carried != self._carried:
                slots.carry(muscles, peak, tendon_factor(model))
            elif slots is not None:
                slots.activate({})
        self._carried = carried
        for pull in self.pulls:
            pull.peak_stress = peak[pull.name]
        self._density.value, self._alpha.value, self._beta.value = tissue.density, tissue.damping.alpha, tissue.damping.beta
        self._optimal_stretch.value = model.contraction.optimal_stretch
        self._passive.renew(model, self._edge)
        mu = tissue.law.shear_modulus
        bulk = 10 * mu if model.mixed else bulk_modulus(tissue.law)
        self.contacts.renew({"penalty": PENALTY * mu / self._edge, "nitsche": NITSCHE * (bulk + 4 * mu / 3) / self._edge})

    @property
    def bcs(self) -> list[fem.DirichletBC]:
        """Of the surfaces that are fixed or move."""
        return self._supports.bcs

    @property
    def supports(self) -> dict[str, NDArray[np.int32]]:
        """Bonded surface to its nodes on this rank, ghosts included."""
        return self._supports.nodes

    @property
    def fixed_dofs(self) -> NDArray[np.int32]:
        """Unknowns of this rank that the bones hold."""
        return self._supports.fixed_dofs

    @property
    def suspended_nodes(self) -> list[NDArray[np.int32]]:
        """Nodes of each surface on springs."""
        return self._supports.suspended_nodes

    def load(self, t: float, levels: Mapping[str, float]) -> None:
        """Set gravity, loads, activations and the places of bones and obstacles for time `t` (s)."""
        rise = self.model.gravity_rise
        share = min(t / rise, 1.0) if rise > 0 else 1.0
        self.gravity.value[:] = share * np.asarray(self.model.gravity)
        for slots in (self.slots, self.surface_slots):
            if slots is not None:
                slots.activate(levels)
        for pull in self.pulls:
            pull.activate(levels)
        for part in (self._loads, self.contacts, self._supports):
            part.place(t)

    def hold(self) -> None:
        """Put the nodes of bonded surfaces where the bones are."""
        self._supports.hold()

    def update(self) -> None:
        """Follow a change of `u`: the gaps of contact."""
        self.contacts.update()

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric: not with Nitsche's method or a load that follows the surface."""
        return self.surface_slots is None and not self.model.loads

    def compile(self, form: Expr) -> Any:
        """A form, or blocks of them, ready to assemble; `frozen` becomes `u`."""

        def thaw(part: Expr) -> Expr:
            if isinstance(part, list | tuple):
                return [thaw(inner) for inner in part]
            return None if part is None else self._thaw(part)

        return jit.compile_form(thaw(form), self.V.mesh.comm, entity_maps=self.contacts.entity_maps)

    def compile_contacts(self, form: Callable[[str], ufl.Form]) -> ContactForms:
        """A form of each obstacle, made for its name, ready to assemble where it is near; `frozen` becomes `u`."""
        return ContactForms(self.contacts, lambda name: self._thaw(form(name)))

    def _thaw(self, form: Expr) -> Expr:
        return form if self.frozen is self.u else ufl.replace(form, {self.frozen: self.u})

    def expression(self, value: Expr, points: Floats) -> fem.Expression:
        """A value ready to be evaluated at reference points (q, 3) of cells; `frozen` becomes `u`."""
        return jit.compile_expression(ufl.replace(value, {self.frozen: self.u}), points, self.V.mesh.comm)

    def kinematics(self, F: Expr, *, surface: bool = False) -> Kinematics:
        """What a passive law sees, inside or on the surface."""
        return Kinematics(F, self._surface_fibre if surface else self._fibre)

    def energy_density(self, F: Expr, *, surface: bool = False) -> Expr:
        """Elastic energy density Ψ in J/m³; in the mixed form Ψ_iso + p (J − 1) − p²/(2κ), stationary in p."""
        slots = self.surface_slots if surface else self.slots
        assert slots is not None
        stiffening = slots.stiffness if self.model.contraction.stiffening else 1.0
        return self._passive.energy_density(self.kinematics(F, surface=surface), stiffening, self.pressure)

    def passive_stress(self, u: Expr, *, surface: bool = False) -> Expr:
        """First Piola–Kirchhoff stress ∂Ψ/∂F in Pa, inside or on the surface."""
        F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
        return ufl.diff(self.energy_density(F, surface=surface), F)

    def active_stress(self, u: Expr, v: Expr) -> Expr:
        """First Piola–Kirchhoff stress of the muscles in Pa."""
        I = ufl.Identity(3)  # noqa: E741
        return self.slots.stress(self.law, I + ufl.grad(u), ufl.grad(v), I + ufl.grad(self.frozen))

    def damping_stress(self, v: Expr) -> Expr:
        """β times the rest-state stiffness on the velocity, in Pa."""
        return self._beta * self._passive.rest_stress(v)

    def surface_stress(self, u: Expr, v: Expr) -> Expr:
        """First Piola–Kirchhoff stress of tissue and muscles in Pa, to be taken on the surface. Without that of damping: of a displacement
        it makes β/Δt times as much stress as the tissue does, which in a short step outweighs Nitsche's parameter."""
        I = ufl.Identity(3)  # noqa: E741
        assert self.surface_slots is not None
        active = self.surface_slots.stress(self.law, I + ufl.grad(u), ufl.grad(v), I + ufl.grad(self.frozen))
        return self.passive_stress(u, surface=True) + active

    def cauchy_stress(self, u: Expr, v: Expr) -> Expr:
        """Cauchy stress of tissue, muscles and damping in Pa, as a vector of nine."""
        F = ufl.Identity(3) + ufl.grad(u)
        P = self.passive_stress(u) + ufl.replace(self.active_stress(u, v), {self.frozen: u}) + self.damping_stress(v)
        sigma = P * F.T / ufl.det(F)
        return ufl.as_vector([sigma[i, j] for i in range(3) for j in range(3)])

    def fibre_state(self, u: Expr, v: Expr) -> list[Expr]:
        """Stretch, rate and active stress of each slot (see `FibreSlots.state`)."""
        return self.slots.state(self.law, ufl.Identity(3) + ufl.grad(u), ufl.grad(v))

    def inertia(self, v: Expr, a: Expr) -> Expr:
        """Body force density ρ(ü + α v − g) in N/m³."""
        return self._density * (a + self._alpha * v - self.gravity)

    def weighted(self, a: Expr, w: Expr) -> Expr:
        """Inner product of an acceleration with a test function, weighted by the density and the mass of suspended bones."""
        return self._density * ufl.inner(a, w) * self.dx_mass + self._springs.weight(a, w)

    def outer_work(self, u: Expr, v: Expr, w: Expr) -> list[Expr]:
        """Virtual work on `w` of each muscle that pulls from outside."""
        return [pull.work(self.law, u, v, self.frozen, w) for pull in self.pulls]

    def inner_work(self, u: Expr, v: Expr, w: Expr) -> Expr:
        """Virtual work of the stresses on `w`."""
        return ufl.inner(self._tissue_stress(u, v) + self.active_stress(u, v), ufl.grad(w)) * self.dx

    def _tissue_stress(self, u: Expr, v: Expr) -> Expr:
        passive = self.passive_stress(u)
        return passive + self.damping_stress(v) if self.model.tissue.damping.beta > 0 else passive

    def kernels(self, v: Expr, a: Expr) -> CellKernels | None:
        """Kernels of the stresses and the inertia. None, as FFCx's forms serve, in the mixed form, for a law with something that kernels do
        not know, and where nothing is frozen, as the tangent is then unsymmetric."""
        if self.pressure is not None or self.frozen is self.u:
            return None
        terms = [Term(self._tissue_stress(self.u, v))]
        if self.slots.directions:
            I = ufl.Identity(3)  # noqa: E741
            terms.append(self.slots.term(self.law, I + ufl.grad(self.u), ufl.grad(v), I + ufl.grad(self.frozen)))
        try:
            return CellKernels(self.u, self.frozen, terms, self.inertia(v, a), self.model.quadrature_degree)
        except NotImplementedError:
            return None

    def active_work(self, u: Expr, v: Expr, w: Expr) -> Expr:
        """Virtual work of the muscles' stress on `w`."""
        return ufl.inner(self.active_stress(u, v), ufl.grad(w)) * self.dx

    def damping_work(self, v: Expr, w: Expr) -> Expr:
        """Virtual work of the stress that damping by β makes, on `w`."""
        return ufl.inner(self.damping_stress(v), ufl.grad(w)) * self.dx

    def surface_work(self, u: Expr, v: Expr, w: Expr) -> Expr:
        """Virtual work on `w` of muscles from outside and of loads; 0 without any."""
        return sum([*self.outer_work(u, v, w), self.load_work(u, w)])

    def contact_work(self, name: str, u: Expr, v: Expr, w: Expr) -> Expr:
        """Virtual work on `w` of an obstacle."""
        stress = None if self.surface_slots is None else self.surface_stress(u, v)
        return self.contacts.work(name, stress, self._passive.rest_stress(w), w, self.ds_contact)

    def load_work(self, u: Expr, w: Expr) -> Expr:
        """Virtual work on `w` of the loads; 0 without any."""
        return self._loads.work(u, w)

    def suspension(self, u: Expr, v: Expr, a: Expr, w: Expr) -> Expr:
        """Virtual work on `w` of the inertia and the springs of suspended bones; 0 without any."""
        return self._springs.work(u, v, a, w)

    def surface_tangent(self, v: Expr, a: Expr, V: fem.FunctionSpace) -> Expr:
        """Derivative of the surface's part of the balance but for contact, in displacements of `V`; 0 without any."""
        w = ufl.TestFunction(V)
        work = self.suspension(self.u, v, a, w) - self.surface_work(self.u, v, w)
        return ufl.derivative(work, self.u, ufl.TrialFunction(V)) if isinstance(work, ufl.Form) else 0

    def contact_tangent(self, name: str, v: Expr, V: fem.FunctionSpace) -> Expr:
        """Derivative of an obstacle's part of the balance, in displacements of `V`."""
        work = self.contact_work(name, self.u, v, ufl.TestFunction(V))
        return ufl.derivative(-work, self.u, ufl.TrialFunction(V), self.contacts.derivatives())

    def balance(self, u: Expr, v: Expr, a: Expr, w: Expr) -> Expr:
        """Balance of forces, tested with `w`."""
        return self.free_balance(u, v, a, w) - sum(self.contact_work(name, u, v, w) for name in self.contacts.terms)

    def free_balance(self, u: Expr, v: Expr, a: Expr, w: Expr) -> Expr:
        """The same without contact."""
        inertia = ufl.inner(self.inertia(v, a), w) * self.dx_mass
        return self.inner_work(u, v, w) + inertia - self.surface_work(u, v, w) + self.suspension(u, v, a, w)

    def volume_balance(self, q: Expr) -> Expr:
        """In the mixed form, what ties pressure and volume, tested with `q`."""
        return ufl.derivative(self.energy_density(ufl.Identity(3) + ufl.grad(self.u)) * self.dx, self.pressure, q)

    def equations(self, v: Expr, a: Expr) -> tuple[Expr, Expr]:
        """Residual and tangent at `u` (and `pressure`) with velocity and acceleration as functions of it; as blocks in the mixed form."""
        if self.pressure is None:
            residual = self.balance(self.u, v, a, ufl.TestFunction(self.V))
            return residual, ufl.derivative(residual, self.u, ufl.TrialFunction(self.V), self.contacts.derivatives())
        W = ufl.MixedFunctionSpace(self.V, self.pressure.function_space)
        (w, q), (du, dp) = ufl.TestFunctions(W), ufl.TrialFunctions(W)
        residual = self.balance(self.u, v, a, w) + self.volume_balance(q)
        tangent = ufl.derivative(residual, self.u, du, self.contacts.derivatives()) + ufl.derivative(residual, self.pressure, dp)
        return ufl.extract_blocks(residual), ufl.extract_blocks(tangent)

    def pressure_weight(self) -> Expr:
        """What the Schur complement of the pressure is like: its mass matrix over the moduli."""
        assert self.pressure is not None
        p, q = ufl.TrialFunction(self.pressure.function_space), ufl.TestFunction(self.pressure.function_space)
        passive = self._passive
        return -(passive.stress_scale**2) * (passive.compressibility + 1 / passive.shear_modulus) * p * q * self.dx


def _carried(model: Model, active: Sequence[str]) -> dict[str, MuscleCells]:
    """The muscles that a form must know: the active ones, or all where passive fibres bear, too."""
    muscles = model.tongue.muscles
    return {name: muscles[name] for name in (muscles if model.contraction.passive_fibres else active)}


def _fibre_field(model: Model, places: Places) -> Expr | None:
    """The unit fibre direction that passive laws see; None without any.

    Raises
    ------
    InputError
        If there is no direction somewhere.
    """
    if model.fibre is None:
        return None
    mesh = model.tongue.mesh
    field = fem.Function(fem.functionspace(mesh, places.element((3,))), name="fibre")
    vertex = np.column_stack([1 - places.points.sum(axis=1), places.points])
    at = np.einsum("qv,cvd->cqd", vertex, mesh.geometry.x[mesh.geometry.dofmaps[0]])
    points = at.reshape(-1, 3)
    direction = np.asarray(model.fibre(points) if callable(model.fibre) else np.broadcast_to(model.fibre, points.shape), dtype=float)
    length = np.linalg.norm(direction, axis=1, keepdims=True) if direction.shape == points.shape else np.zeros(1)
    if mesh.comm.allreduce(not (np.isfinite(length) & (length > 0)).all(), op=MPI.LOR):
        raise InputError("model.fibre: a direction, three finite numbers that are not all zero, is expected at every point.")
    direction = direction / length
    field.x.array.reshape(-1, 3)[field.function_space.dofmap.list] = direction.reshape(at.shape)
    return field


def _typical_edge(mesh: dmesh.Mesh) -> float:
    """Edge in m of the regular tetrahedron that has the mean volume of the cells."""
    owned = mesh.topology.index_map(3)
    corners = mesh.geometry.x[mesh.geometry.dofmaps[0][: owned.size_local]]
    volume = abs(volumes(corners)).sum()
    return float((6 * np.sqrt(2) * mesh.comm.allreduce(float(volume)) / owned.size_global) ** (1 / 3))
