# SPDX-License-Identifier: MIT
"""The mechanical model as a weak form in UFL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx import mesh as dmesh

from ..anatomy import catalogue as muscle_facts
from ..core.types import Expr
from ..geometry.tetrahedron import volumes
from ..mechanics.hyperelasticity import VOLUMETRIC, bulk_modulus
from ..mechanics.model import Model
from ..mechanics.suspension import Suspension
from . import jit, quadrature
from .contact_terms import DEGREE, NITSCHE, PENALTY, ContactSet
from .fibre_slots import FibreSlots, OuterPull, Places, tendon_factor


class WeakForm:
    """ρ(ü + α v)·w + (P_passive + P_active + P_damping) : ∇w − ρ g·w over the rest shape.

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
        self.model = model
        tongue = model.tongue
        mesh = tongue.mesh
        self.V = fem.functionspace(mesh, ("P", 2, (3,)))
        self.u = fem.Function(self.V, name="displacement")
        self.frozen = fem.Function(self.V)
        muscles = {name: tongue.muscles[name] for name in (tongue.muscles if model.contraction.passive_fibres else active)}
        sigma = muscle_facts.peak_stress(muscles, model.sigma_max)
        degree = model.quadrature_degree
        fade = tendon_factor(model)
        self.slots = FibreSlots(tongue, muscles, sigma, fade, Places.inside(degree))
        self.surface_slots: FibreSlots | None = None
        if any(contact.form == "nitsche" for contact in model.contacts.values()):
            self.surface_slots = FibreSlots(tongue, muscles, sigma, fade, Places.corners())
        self.dx = ufl.Measure("dx", mesh, metadata=quadrature.metadata(degree))
        self.dx_mass = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 4})
        passive = model.passive
        self._constants = {name: self._constant(value) for name, value in passive.parameters.items()}
        self._mu = self._constant(passive.shear_modulus)
        self._density = self._constant(model.density)
        self._alpha = self._constant(model.damping.alpha)
        self._beta = self._constant(model.damping.beta)
        self.gravity = fem.Constant(mesh, np.zeros(3, dtype=default_scalar_type))
        self._law = model.contraction.with_constants(mesh)
        self.pressure: fem.Function | None = None
        if model.mixed:
            self.pressure = fem.Function(fem.functionspace(mesh, ("P", 1)), name="pressure")
            self._compressibility = self._constant((1 - 2 * passive.nu) / passive.shear_modulus)
            self._stress = self._constant(passive.shear_modulus / _typical_edge(mesh))
        else:
            self._kappa = self._constant(bulk_modulus(passive))
        self._prescribed = fem.Function(self.V)
        self.supports = {name: fem.locate_dofs_topological(self.V, 2, tongue.facets([name])) for name in model.bonded}
        self.bcs = [fem.dirichletbc(self._prescribed, self.supports[name]) for name in (*model.fixed, *model.moving)]
        edge, mu = _typical_edge(mesh), passive.shear_modulus
        bulk = 10 * mu if model.mixed else bulk_modulus(passive)
        self.contacts = ContactSet(self, model.contacts, {"penalty": PENALTY * mu / edge, "nitsche": NITSCHE * (bulk + 4 * mu / 3) / edge})
        entries = {name: muscle.entry.facets for name, muscle in muscles.items() if muscle.entry is not None}
        crossed = [*entries.values(), *(tongue.facets([name]) for name in model.suspended)]
        parts = [fem.compute_integration_domains(fem.IntegralType.exterior_facet, mesh.topology, facets) for facets in crossed]
        numbered = list(enumerate([*parts, self.contacts.integrals.ravel()]))
        ds = ufl.Measure("ds", mesh, subdomain_data=numbered, metadata={"quadrature_degree": DEGREE})  # one for all, as DOLFINx asks
        self.pulls = [OuterPull(tongue, name, sigma[name], ds(i)) for i, name in enumerate(entries)]
        self._hung = [
            (self._over_area(ds(i), suspension), ds(i)) for i, suspension in enumerate(model.suspended.values(), start=len(entries))
        ]
        self.ds_contact = ds(len(crossed))

    def _constant(self, value: float) -> fem.Constant:
        return fem.Constant(self.V.mesh, default_scalar_type(value))

    def _over_area(self, ds: ufl.Measure, suspension: Suspension) -> fem.Constant:
        """Mass, damping and stiffness per area."""
        area = self.V.mesh.comm.allreduce(float(fem.assemble_scalar(fem.form(self._constant(1.0) * ds))))
        return fem.Constant(self.V.mesh, np.array([suspension.mass, suspension.damping, suspension.stiffness]) / area)

    def set_time(self, t: float, levels: Mapping[str, float]) -> None:
        """Set gravity, the activations and the places of moving bones for time `t` (s)."""
        rise = self.model.gravity_rise
        share = min(t / rise, 1.0) if rise > 0 else 1.0
        self.gravity.value[:] = share * np.asarray(self.model.gravity)
        for slots in (self.slots, self.surface_slots):
            if slots is not None:
                slots.activate(levels)
        self.contacts.set_time(t)
        for pull in self.pulls:
            pull.activate(levels)
        for name, motion in self.model.moving.items():
            nodes = self.supports[name]
            self._prescribed.x.array.reshape(-1, 3)[nodes] = motion.displacement(self.V.tabulate_dof_coordinates()[nodes], t)

    def hold(self) -> None:
        """Put the nodes of bonded surfaces where the bones are."""
        for bc in self.bcs:
            bc.set(self.u.x.array)

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric: not with Nitsche's method."""
        return self.surface_slots is None

    def refresh(self) -> None:
        """Follow a change of `u`: the gaps of contact."""
        self.contacts.update()

    def compiled(self, form: Expr) -> Any:
        """A form, or blocks of them, ready to assemble; `frozen` becomes `u`."""

        def thawed(part: Expr) -> Expr:
            if isinstance(part, list | tuple):
                return [thawed(inner) for inner in part]
            return part if part is None or self.frozen is self.u else ufl.replace(part, {self.frozen: self.u})

        return fem.form(thawed(form), jit_options=jit.options(), entity_maps=self.contacts.entity_maps)

    def energy_density(self, F: Expr, slots: FibreSlots | None = None) -> Expr:
        """Elastic energy density Ψ in J/m³; in the mixed form Ψ_iso + p (J − 1) − p²/(2κ), stationary in p."""
        J, C = ufl.det(F), F.T * F
        I1 = J ** (-2 / 3) * ufl.tr(C)
        I2 = (I1**2 - J ** (-4 / 3) * ufl.inner(C, C)) / 2
        passive = self.model.passive
        stiffness = (slots or self.slots).stiffness if self.model.contraction.stiffening else 1.0
        isochoric = stiffness * passive.isochoric_energy(I1, I2, self._constants)
        if self.pressure is None:
            return isochoric + stiffness * self._kappa * VOLUMETRIC[passive.volumetric](J)
        p = self._stress * self.pressure
        return isochoric + p * (J - 1) - self._compressibility / stiffness * p**2 / 2

    def passive_stress(self, u: Expr, slots: FibreSlots | None = None) -> Expr:
        """First Piola–Kirchhoff stress ∂Ψ/∂F in Pa; `slots` know the stiffening where the stress is taken, by default inside."""
        F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
        return ufl.diff(self.energy_density(F, slots), F)

    def active_stress(self, u: Expr, v: Expr) -> Expr:
        """First Piola–Kirchhoff stress of the muscles in Pa."""
        I = ufl.Identity(3)  # noqa: E741
        return self.slots.stress(self._law, I + ufl.grad(u), ufl.grad(v), I + ufl.grad(self.frozen))

    def damping_stress(self, v: Expr) -> Expr:
        """β times the rest-state stiffness on the velocity, in Pa."""
        return self._beta * self.rest_stress(v)

    def rest_stress(self, w: Expr) -> Expr:
        """Stress in Pa of a small displacement from rest; its deviatoric part alone in the mixed form."""
        strain = ufl.sym(ufl.grad(w))
        isotropic = ufl.tr(strain) * ufl.Identity(3)
        deviatoric = 2 * self._mu * (strain - isotropic / 3)
        return deviatoric if self.pressure is not None else deviatoric + self._kappa * isotropic

    def surface_stress(self, u: Expr, v: Expr) -> Expr:
        """First Piola–Kirchhoff stress of tissue, muscles and damping in Pa, to be taken on the surface."""
        I = ufl.Identity(3)  # noqa: E741
        assert self.surface_slots is not None
        active = self.surface_slots.stress(self._law, I + ufl.grad(u), ufl.grad(v), I + ufl.grad(self.frozen))
        return self.passive_stress(u, self.surface_slots) + active + self.damping_stress(v)

    def cauchy_stress(self, u: Expr, v: Expr) -> Expr:
        """Cauchy stress of tissue, muscles and damping in Pa, as a vector of nine."""
        F = ufl.Identity(3) + ufl.grad(u)
        P = self.passive_stress(u) + ufl.replace(self.active_stress(u, v), {self.frozen: u}) + self.damping_stress(v)
        sigma = P * F.T / ufl.det(F)
        return ufl.as_vector([sigma[i, j] for i in range(3) for j in range(3)])

    def fibre_state(self, u: Expr, v: Expr) -> list[Expr]:
        """Stretch, rate and active stress of each slot (see `FibreSlots.state`)."""
        return self.slots.state(self._law, ufl.Identity(3) + ufl.grad(u), ufl.grad(v))

    def inertia(self, v: Expr, a: Expr) -> Expr:
        """Body force density ρ(ü + α v − g) in N/m³."""
        return self._density * (a + self._alpha * v - self.gravity)

    def weighted(self, a: Expr, w: Expr) -> Expr:
        """Inner product of an acceleration with a test function, weighted by the density and the mass of suspended bones."""
        return self._density * ufl.inner(a, w) * self.dx_mass + sum(per[0] * ufl.inner(a, w) * ds for per, ds in self._hung)

    def outer_work(self, u: Expr, v: Expr, w: Expr) -> list[Expr]:
        """Virtual work on `w` of each muscle that pulls from outside."""
        return [pull.work(self._law, u, v, self.frozen, w) for pull in self.pulls]

    def inner_work(self, u: Expr, v: Expr, w: Expr) -> Expr:
        """Virtual work of the stresses on `w`."""
        stress = self.passive_stress(u) + self.active_stress(u, v)
        if self.model.damping.beta > 0:
            stress += self.damping_stress(v)
        return ufl.inner(stress, ufl.grad(w)) * self.dx

    def active_work(self, u: Expr, v: Expr, w: Expr) -> Expr:
        """Virtual work of the muscles' stress on `w`."""
        return ufl.inner(self.active_stress(u, v), ufl.grad(w)) * self.dx

    def damping_work(self, v: Expr, w: Expr) -> Expr:
        """Virtual work of the stress that damping by β makes, on `w`."""
        return ufl.inner(self.damping_stress(v), ufl.grad(w)) * self.dx

    def surface_work(self, u: Expr, v: Expr, w: Expr) -> Expr:
        """Virtual work on `w` of muscles from outside and of obstacles; 0 without any."""
        return sum([*self.outer_work(u, v, w), *self.contacts.work(u, v, w, self.ds_contact).values()])

    def suspension(self, u: Expr, v: Expr, a: Expr, w: Expr) -> Expr:
        """Virtual work on `w` of the inertia and the springs of suspended bones; 0 without any."""
        return sum((ufl.dot(per[0] * a + per[1] * v + per[2] * u, w) * ds for per, ds in self._hung))

    def balance(self, u: Expr, v: Expr, a: Expr, w: Expr) -> Expr:
        """Balance of forces, tested with `w`."""
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
        return -(self._stress**2) * (self._compressibility + 1 / self._mu) * p * q * self.dx


def _typical_edge(mesh: dmesh.Mesh) -> float:
    """Edge in m of the regular tetrahedron that has the mean volume of the cells."""
    owned = mesh.topology.index_map(3)
    corners = mesh.geometry.x[mesh.geometry.dofmaps[0][: owned.size_local]]
    volume = abs(volumes(corners)).sum()
    return float((6 * np.sqrt(2) * mesh.comm.allreduce(float(volume)) / owned.size_global) ** (1 / 3))
