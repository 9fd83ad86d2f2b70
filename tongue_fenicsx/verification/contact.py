# SPDX-License-Identifier: MIT
"""Contact: tangent, uniform pressure, Hertz's sphere, sliding without friction, and triangles against an analytic surface."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyvista as pv
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI
from scipy.optimize import brentq

from ..core.errors import SolveError
from ..core.types import Floats
from ..forms.contact_measures import ContactMeasures, ContactState
from ..forms.weak_form import WeakForm
from ..geometry.obstacles import Moved, Obstacle, Plane, Sphere, Triangulated
from ..geometry.rigid_motion import RigidMotion
from ..geometry.surface import Surface
from ..mechanics.contact import Contact
from ..mechanics.hyperelasticity import NeoHookean
from ..mechanics.model import Model
from ..mechanics.tissue import Rayleigh, Tissue
from ..meshing.tongue_mesh import TongueMesh
from ..runs.run import Run
from ..simulation.simulation import Simulation
from ..simulation.stepping import Stepping
from ..solvers.equations import Equations
from ..solvers.newton import Newton
from ..solvers.time_integration import QuasiStatic
from ..solvers.tolerances import Tolerances
from ..testing import Row, box, homogeneous, roller, with_fibres
from .material import closed_form, remainder

FORMS = (("penalty", 0), ("nitsche", 0), ("nitsche", 1), ("nitsche", -1))


def tangent() -> Iterator[Row]:
    """As `material.taylor`, a sphere pressed into the block, in all forms of contact."""
    block = with_fibres(box((0.02, 0.01, 0.01), (4, 3, 3)), (1.0, 0.4, -0.2))
    ball = Sphere((0.012, 0.005, -0.0102), 0.01)
    for form, theta in FORMS:
        weak = WeakForm(Model(
            block, replace(Tissue.calka(), damping=Rayleigh(20.0, 0.01), peak_stress={"GGP": 3e3}), fixed=["wall"],
            contacts={"ball": Contact(ball, form, theta)},
        ), ["GGP_L"])  # fmt: skip
        weak.load(1.0, {"GGP_L": 0.6})
        homogeneous(weak, np.array([[1.1, 0.05, 0.0], [0.0, 0.95, 0.04], [0.03, 0.0, 1.02]]))
        _place(weak, "ball", (0.0, 0.0, 8e-4))
        name = form if form == "penalty" else f"{form}, θ = {theta}"
        yield Row(f"tangent with contact, {name}", "order 2", *remainder(weak))


def _place(weak: WeakForm, name: str, offset: tuple[float, float, float]) -> None:
    """Move an obstacle by `offset` (m)."""
    term = weak.contacts.terms[name]
    term.placed = Moved(term.contact.obstacle, np.eye(3), np.array(offset))
    weak.contacts.update()


def _equilibrium(weak: WeakForm) -> ContactState:
    """Solve for the state at rest, and measure its contact."""
    tight = Tolerances.of("tight", rtol=1e-11, atol=1e-15, linear=1e-8, max_newton=40)
    newton = Newton(Equations(weak, QuasiStatic(weak.u)), tight, lambda line: None)
    converged = newton.solve().converged
    while converged and weak.contacts.augment(tight.penetration):
        converged = newton.solve().converged
    if not converged:
        raise SolveError("the block in contact did not converge.")
    newton.destroy()
    return ContactMeasures(weak, fem.Function(weak.V)).evaluate()


def pressed() -> Iterator[Row]:
    """A block pressed 10 % flat between frictionless planes bears the uniform pressure of uniaxial compression."""
    size, stretch = 0.01, 0.9
    lid = Plane((0, 0, size), (0, 0, -1))
    for theta in (0, 1, -1):
        weak = WeakForm(Model(box((size,) * 3, (2, 2, 2)), fixed=[], contacts={"lid": Contact(lid, theta=theta)}), [])
        weak.bcs[:] = [roller(weak, axis) for axis in range(3)]
        homogeneous(weak, np.diag([1.04, 1.04, 0.91]))  # a guess
        _place(weak, "lid", (0.0, 0.0, (stretch - 1) * size))
        state = _equilibrium(weak)
        side = brentq(lambda s: closed_form(np.diag([s, s, stretch]))[0, 0], 1.0, 1.2)
        expected = -closed_form(np.diag([side, side, stretch]))[2, 2] * size**2
        touch = state.touches["lid"]
        spread = state.pressure[state.pressure > 0] / (expected / (size * side) ** 2) - 1
        error = max(abs(-touch.force[2] / expected - 1), float(abs(spread).max(initial=0.0)), abs(touch.area / (size * side) ** 2 - 1))
        error = weak.V.mesh.comm.allreduce(float(error), op=MPI.MAX)
        yield Row(f"block pressed flat, Nitsche, θ = {theta}", "uniform pressure, closed form", error, 1e-8)


def hertz(divisions: tuple[int, ...] = (8, 16)) -> Iterator[Row]:
    """A sphere pressed into a half-space: force and contact radius of Hertz; far away the displacement of a point load."""
    radius, depth, mu, nu = 0.1, 1e-4, 2000.0, 0.3
    law = NeoHookean(mu / 2, nu)
    kappa = mu / (1 - 2 * nu)
    poisson = (3 * kappa - 2 * mu) / (2 * (3 * kappa + mu))
    reach = np.sqrt(radius * depth)
    force = 8 / 3 * mu / (1 - poisson) * reach * depth

    def far(X: Floats) -> Floats:
        """Boussinesq's displacement under the load, the half-space at z < 0."""
        r, z = np.hypot(X[0], X[1]), -X[2]
        R = np.hypot(r, z)
        out = force / (4 * np.pi * mu) * (z / R**3 - (1 - 2 * poisson) / (R * (R + z)))
        down = force / (4 * np.pi * mu) * (z**2 / R**3 + 2 * (1 - poisson) / R)
        return np.asarray([out * X[0], out * X[1], -down])

    errors = []
    for n in divisions:
        block = _quarter(n, 20 * reach)
        weak = WeakForm(Model(block, Tissue(law, 1000.0), fixed=["far"], contacts={"ball": Contact(Sphere((0, 0, radius), radius))}), [])
        given = fem.Function(weak.V)
        given.interpolate(lambda X: np.where(np.linalg.norm(X, axis=0) > reach, far(np.where(X == 0, 1e-12, X)), 0.0))
        nodes = weak.supports["far"]
        weak.bcs[:] = [fem.dirichletbc(given, nodes), roller(weak, 0), roller(weak, 1)]
        weak.u.x.array.reshape(-1, 3)[nodes] = given.x.array.reshape(-1, 3)[nodes]
        _place(weak, "ball", (0.0, 0.0, -depth))
        down = -_equilibrium(weak).forces[:, 2]
        place = weak.V.tabulate_dof_coordinates()[: len(down)] + weak.u.x.array.reshape(-1, 3)[: len(down)]
        total, moment = weak.V.mesh.comm.allreduce(np.array([down.sum(), down @ (place[:, :2] ** 2).sum(axis=1)]))
        errors.append((abs(4 * total / force - 1), abs(np.sqrt(5 / 2 * moment / total) / reach - 1)))  # Hertz: ⟨r²⟩ = 2a²/5
    for error, earlier, name in zip(errors[-1], errors[0], ("force", "contact radius"), strict=True):
        yield Row(f"sphere on a half-space, {name}", "Hertz", float(error), 0.02, f"coarser: {100 * earlier:.1f} %")


def _quarter(n: int, size: float) -> TongueMesh:
    """A quarter of the half-space z < 0, finest at the origin, with the surfaces ``far`` and ``free``."""
    mesh = dmesh.create_box(MPI.COMM_WORLD, [np.zeros(3), np.ones(3)], (n, n, n))
    mesh.geometry.x[:] = size * (0.1 * mesh.geometry.x + 0.9 * mesh.geometry.x**3) * (1, 1, -1)
    mesh.topology.create_connectivity(2, 3)
    facets = dmesh.exterior_facet_indices(mesh.topology)
    far = dmesh.locate_entities_boundary(mesh, 2, lambda X: np.isclose(abs(X).max(axis=0), size))
    far = far[np.isin(far, facets)]
    return TongueMesh(mesh, dmesh.meshtags(mesh, 2, facets, np.where(np.isin(facets, far), 1, 2).astype(np.int32)), {"far": 1, "free": 2})


def incline(end: float = 0.1) -> Iterator[Row]:
    """A free block on a plane of 30°, undamped: it slides with g sin 30°, and its energy is conserved while it bounces."""
    angle = np.radians(30)
    gravity = 9.81 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    block = box((0.02, 0.01, 0.01), (4, 2, 2))
    model = Model(
        block, Tissue(Tissue.buchaillard().law, 1000.0), fixed=[], gravity=gravity.tolist(), gravity_rise=0.0,
        contacts={"plane": Contact(Plane((0, 0, 0), (0, 0, 1)), "penalty")},
    )  # fmt: skip
    stepping = Stepping(step_max=5e-4, output_every=end, spectral_radius=1.0)
    run = _run(model, {"middle": (0.01, 0.005, 0.005)}, stepping, end)
    fallen = run.probes["middle"][:, 0]
    acceleration = 2 * fallen[-1] / run.time[-1] ** 2
    yield Row("block on an incline, acceleration", "g sin 30°", float(abs(acceleration / gravity[0] - 1)), 5e-3)
    energy = run.energy["kinetic"] + run.energy["elastic"] - run.energy["gravity_work"]
    stored = np.maximum.accumulate(run.energy["kinetic"])
    error = float(abs(energy[-1] - run.energy["contact_work"][-1]) / stored[-1])
    yield Row("block on an incline, energy", "conserved", error, 5e-3, f"{len(run.time) - 1} steps")


def _run(model: Model, probes: dict[str, tuple[float, float, float]], stepping: Stepping, end: float) -> Run:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(MPI.COMM_WORLD.bcast(folder))
        run = Simulation(model, probes=probes, stepping=stepping, tolerances=Tolerances.of("tight", rtol=1e-6)).run({}, end, path)
        MPI.COMM_WORLD.barrier()
    return run


def triangles() -> Iterator[Row]:
    """A ball pressed into a block, slid and lifted through equilibria: as triangles and as a formula it exerts the same force."""
    block = box((0.02, 0.01, 0.01), (6, 3, 3))
    path = RigidMotion(
        translation=[
            (0.05, (0, 0, 0), (0, 0, -1.5e-3)),
            (0.05, (0, 0, -1.5e-3), (-5e-3, 0, -1.5e-3)),
            (0.05, (-5e-3, 0, -1.5e-3), (-5e-3, 0, 2e-3)),
        ]
    )
    mesh = pv.Sphere(radius=0.005, center=(0.015, 0.005, 0.0152), theta_resolution=200, phi_resolution=200)
    balls: tuple[Obstacle, Obstacle] = (Sphere((0.015, 0.005, 0.0152), 0.005), Triangulated(Surface.from_pyvista(mesh), spacing=0.4e-3))
    times, forces = np.linspace(0, 0.15, 31), []
    for ball in balls:
        met = {"ball": Contact(ball, motion=path)}
        model = Model(block, replace(Tissue.calka(), law=Tissue.buchaillard().law), fixed=["wall"], contacts=met)
        run = _run(model, {}, Stepping(step_max=5e-3, output_every=5e-3, quasi_static=True), 0.15)
        forces.append(np.array([np.interp(times, run.time, column) for column in run.contact["ball"]["force"].T]).T)
    largest = np.linalg.norm(forces[0], axis=1).max()
    error = float(np.linalg.norm(forces[1] - forces[0], axis=1).max() / largest)
    yield Row("ball pressed, slid, lifted: triangles", "analytic sphere", error, 0.01, f"up to {1e3 * largest:.1f} mN")
