# SPDX-License-Identifier: MIT
"""Verification that anyone can run: each row compares the model with a closed form or with another code."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc
from scipy.optimize import curve_fit

from . import jit
from .errors import InputError
from .fibres import Floats
from .model import Model, Rayleigh, WeakForm
from .passive import Expr, Yeoh, bulk_modulus
from .results import Numbering
from .simulation import Simulation, Stepping
from .solver import Tolerances
from .timestep import GeneralizedAlpha, State
from .tonguemesh import TongueMesh

CALCULIX = "ccx"


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes
    ----------
    case, reference : str
        What was computed, and what it is held against.
    error : float
        Measured deviation.
    limit : float
        Largest deviation that passes.
    note : str
        Orders, or why the row was skipped.
    skipped : bool
        Whether what it needs is not installed.
    """

    case: str
    reference: str
    error: float
    limit: float
    note: str = ""
    skipped: bool = False

    @property
    def holds(self) -> bool:
        """Whether the error is within the limit (a skipped row counts as holding)."""
        return self.skipped or bool(self.error <= self.limit)


def box(lengths: tuple[float, float, float], divisions: tuple[int, int, int]) -> TongueMesh:
    """A box from the origin, with surfaces ``wall`` (x = 0) and ``free``."""
    mesh = dmesh.create_box(MPI.COMM_WORLD, [np.zeros(3), np.array(lengths)], divisions)
    mesh.topology.create_connectivity(2, 3)
    facets = dmesh.exterior_facet_indices(mesh.topology)
    wall = dmesh.locate_entities_boundary(mesh, 2, lambda X: X[0] < 1e-9)
    return TongueMesh(mesh, dmesh.meshtags(mesh, 2, facets, np.where(np.isin(facets, wall), 1, 2).astype(np.int32)), {"wall": 1, "free": 2})


def _solve(weak: WeakForm, residual: Expr, bcs: list[fem.DirichletBC]) -> None:
    """Newton with a direct solver, from zero."""
    options = {
        "ksp_type": "preonly",
        "pc_type": "lu",
        "pc_factor_mat_solver_type": "mumps",
        "snes_rtol": 1e-12,
        "snes_error_if_not_converged": True,
    }
    problem = fem_petsc.NonlinearProblem(
        residual, weak.u, bcs=bcs, petsc_options_prefix="verify_", petsc_options=options, jit_options=jit.options()
    )
    problem.solve()


def _boundary(weak: WeakForm, value: Callable[[Floats], Floats] | fem.Expression) -> list[fem.DirichletBC]:
    """A displacement given on the whole boundary."""
    tongue = weak.model.tongue
    given = fem.Function(weak.V)
    given.interpolate(value)
    return [fem.dirichletbc(given, fem.locate_dofs_topological(weak.V, 2, tongue.facet_tags.indices))]


def patch() -> Iterator[Row]:
    """An affine boundary displacement gives the affine displacement everywhere, at finite strain."""
    weak = Model(box((0.01, 0.01, 0.01), (3, 3, 3)), fixed=["wall"]).weak_form([])
    A = np.array([[0.1, 0.2, 0.0], [-0.05, 0.1, 0.1], [0.0, 0.1, -0.1]])
    test = ufl.TestFunction(weak.V)
    _solve(weak, ufl.inner(weak.passive_stress(weak.u), ufl.grad(test)) * weak.dx, _boundary(weak, lambda X: A @ X))
    exact = fem.Function(weak.V)
    exact.interpolate(lambda X: A @ X)
    error = abs(weak.u.x.array - exact.x.array).max() / abs(exact.x.array).max()
    yield Row("patch test, 20 % strain", "affine displacement", float(MPI.COMM_WORLD.allreduce(error, op=MPI.MAX)), 1e-12)


def manufactured(divisions: tuple[int, ...] = (2, 4, 8)) -> Iterator[Row]:
    """A smooth displacement and the body force that holds it: third order in L², second in H¹."""
    size, errors = 0.01, []
    for n in divisions:
        weak = Model(box((size, size, size), (n, n, n)), fixed=["wall"], quadrature_degree=4).weak_form([])
        mesh = weak.V.mesh
        X = ufl.SpatialCoordinate(mesh)
        k = np.pi / size
        exact = 0.05 * size * ufl.as_vector([ufl.sin(k * X[1]) * ufl.cos(k * X[2]), ufl.sin(k * X[2]) * X[0] / size, ufl.sin(k * X[0])])
        test = ufl.TestFunction(weak.V)
        load = -ufl.div(weak.passive_stress(exact))
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 6})
        bcs = _boundary(weak, fem.Expression(exact, weak.V.element.interpolation_points))
        _solve(weak, ufl.inner(weak.passive_stress(weak.u), ufl.grad(test)) * dx - ufl.inner(load, test) * dx, bcs)
        difference = weak.u - exact
        squares = [ufl.inner(difference, difference) * dx, ufl.inner(ufl.grad(difference), ufl.grad(difference)) * dx]
        errors.append([np.sqrt(mesh.comm.allreduce(float(fem.assemble_scalar(fem.form(s))))) for s in squares])
    table = np.array(errors)
    orders = np.log(table[-2] / table[-1]) / np.log(divisions[-1] / divisions[-2])
    for order, expected, norm in zip(orders, (3.0, 2.0), ("L²", "H¹"), strict=True):
        yield Row(f"manufactured solution, {norm}", f"order {expected:g}", abs(order - expected), 0.1, f"order {order:.2f}")


DAMPING, STIFFNESS = 0.8, 9.0


def oscillate(steps: list[float], radius: float) -> Floats:
    """t, u, v and ü after each step, (n, 4), of ü + 0.8 u̇ + 9 u = 0 from u = 1, with the scheme's own affine rates."""
    u = fem.Function(fem.functionspace(dmesh.create_unit_interval(MPI.COMM_SELF, 1), ("DG", 0)))
    u.x.array[:] = 1.0
    scheme = GeneralizedAlpha(u, radius)
    one, zero = np.ones_like(u.x.array), np.zeros_like(u.x.array)
    scheme.restore(State(0.0, 0.0, one, zero, -STIFFNESS * one, -STIFFNESS * one))
    t, path = 0.0, []
    for h in steps:
        scheme.begin(h)
        (v_factor, v_part), (a_factor, a_part) = scheme.rates
        u.x.array[:] = -(a_part + DAMPING * v_part) / (a_factor + DAMPING * v_factor + STIFFNESS)
        t += h
        scheme.accept(t)
        s = scheme.state
        path.append([t, s.u[0], s.v[0], s.acceleration[0]])
    return np.array(path)


def oscillation(t: Floats) -> Floats:
    """The exact u, v and ü of that oscillator, (3, n)."""
    rate, omega = DAMPING / 2, np.sqrt(STIFFNESS - DAMPING**2 / 4)
    u = np.exp(-rate * t) * (np.cos(omega * t) + rate / omega * np.sin(omega * t))
    v = -np.exp(-rate * t) * STIFFNESS / omega * np.sin(omega * t)
    return np.array([u, v, -DAMPING * v - STIFFNESS * u])


def _petsc_oscillation(n: int, end: float, radius: float) -> float:
    """u at the end from PETSc's TSALPHA2 with n equal steps."""
    ts = PETSc.TS().create(PETSc.COMM_SELF)
    u, v, F = (PETSc.Vec().createSeq(1) for _ in range(3))
    J = PETSc.Mat().createDense((1, 1), comm=PETSc.COMM_SELF)
    J.setUp()

    def balance(_: PETSc.TS, t: float, U: PETSc.Vec, V: PETSc.Vec, A: PETSc.Vec, out: PETSc.Vec) -> None:
        out.array[:] = A.array_r + DAMPING * V.array_r + STIFFNESS * U.array_r

    def tangent(
        _: PETSc.TS, t: float, U: PETSc.Vec, V: PETSc.Vec, A: PETSc.Vec, shift_v: float, shift_a: float, jacobian: PETSc.Mat, P: PETSc.Mat
    ) -> None:
        P.setValue(0, 0, shift_a + DAMPING * shift_v + STIFFNESS)
        P.assemble()

    ts.setType("alpha2")
    ts.setOptionsPrefix("verify_ts_")
    PETSc.Options()["verify_ts_ts_alpha_radius"] = radius  # the setter of petsc4py is ignored by alpha2
    ts.setI2Function(balance, F)
    ts.setI2Jacobian(tangent, J)
    ts.setTimeStep(end / n)
    ts.setMaxTime(end)
    ts.setMaxSteps(10 * n)
    ts.setExactFinalTime(PETSc.TS.ExactFinalTime.MATCHSTEP)
    ts.getSNES().setTolerances(rtol=1e-13, atol=1e-14)
    ts.setFromOptions()
    u.set(1.0)
    v.set(0.0)
    ts.setSolution2(u, v)
    ts.solve(u)
    value = float(ts.getSolution2()[0].array_r[0])
    for item in (ts, u, v, F, J):
        item.destroy()
    return value


def time_order() -> Iterator[Row]:
    """A damped oscillator: second order of u, v, ü with equal and with alternating steps, and PETSc's own integrator."""
    end, radius = 2.0, 0.8
    for name, pattern in (("equal", (1.0, 1.0)), ("alternating", (0.5, 1.5))):
        errors = []
        for n in (320, 640):
            t, *path = oscillate([end / n * pattern[i % 2] for i in range(n)], radius).T
            errors.append(abs(path - oscillation(t)).max(axis=1))
        orders = np.log2(errors[0] / errors[1])
        note = "orders " + ", ".join(f"{order:.2f}" for order in orders)
        yield Row(f"generalized-alpha, {name} steps: u, v, ü", "order 2", float(abs(orders - 2).max()), 0.1, note)
    gap = [abs(oscillate([end / n] * n, radius)[-1, 1] - _petsc_oscillation(n, end, radius)) for n in (160, 320)]
    order = float(np.log2(gap[0] / gap[1]))
    yield Row(
        "generalized-alpha against TSALPHA2", "difference of order 2", abs(order - 2), 0.1, f"order {order:.2f}, {gap[1]:.1e} at n = 320"
    )


def decay() -> Iterator[Row]:
    """A soft block released from a small stretch: its lowest mode decays with the rate α/2."""
    alpha = 4.0
    tongue = box((0.02, 0.01, 0.01), (4, 2, 2))
    model = Model(tongue, Yeoh.calka(), damping=Rayleigh(alpha), fixed=["wall"], gravity=(0.0, 0.0, -0.05), gravity_rise=0.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(MPI.COMM_WORLD.bcast(folder))
        stepping = Stepping(step_max=2e-3, output_every=1.0, spectral_radius=1.0)
        simulation = Simulation(
            model, probes={"end": (0.02, 0.005, 0.005)}, stepping=stepping, tolerances=Tolerances(rtol=1e-8, atol=1e-14)
        )
        run = simulation.run(1.2, path)
        t, z = run.time, run.probes["end"][:, 2]
        MPI.COMM_WORLD.barrier()

    def mode(t: Floats, rate: float, omega: float, a: float, b: float, rest: float) -> Floats:
        return np.asarray(np.exp(-rate * t) * (a * np.cos(omega * t) + b * np.sin(omega * t)) + rest)

    turns = np.flatnonzero(np.diff(np.sign(np.diff(z)))) + 1
    omega = np.pi / np.diff(t[turns]).mean()
    found = curve_fit(mode, t, z, p0=(alpha / 2, omega, np.ptp(z) / 2, 0.0, z.mean()))[0]
    note = f"{t[-1] * found[1] / (2 * np.pi):.1f} periods of {2e3 * np.pi / found[1]:.0f} ms"
    yield Row("decay of a passive mode", "α/2", abs(found[0] / (alpha / 2) - 1), 0.02, note)


def calculix() -> Iterator[Row]:
    """A Yeoh block under its own weight in CalculiX, with the same quadratic mesh: at rest, and swinging with Rayleigh α."""
    if shutil.which(CALCULIX) is None:
        yield Row("block under its weight", "CalculiX", float("nan"), 0.01, "ccx is not installed (Debian: calculix-ccx)", skipped=True)
        return
    tongue = box((0.02, 0.01, 0.01), (4, 2, 2))
    law, density, alpha = Yeoh(1037.0, 486.0, nu=0.45), 1040.0, 20.0
    probe = (0.02, 0.005, 0.005)
    for kind, end, step in (("static", 1.0, 0.05), ("dynamic", 0.3, 1e-3)):
        static = kind == "static"
        model = Model(
            tongue, law, damping=Rayleigh(alpha), density=density, fixed=["wall"],
            gravity=(0.0, 0.0, -9.81), gravity_rise=1.0 if static else 0.1,
        )  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            path = Path(MPI.COMM_WORLD.bcast(folder))
            stepping = Stepping(step_max=step, output_every=end / 10, quasi_static=static, spectral_radius=0.9)
            run = Simulation(model, probes={"tip": probe}, stepping=stepping, tolerances=Tolerances(rtol=1e-8)).run(end, path / "run")
            t, ours = run.time, run.probes["tip"][:, 2]
            theirs = _run_calculix(model, probe, static, end, step, path) if MPI.COMM_WORLD.rank == 0 else None
            theirs = MPI.COMM_WORLD.bcast(theirs)
            assert theirs is not None
        error = float(abs(np.interp(theirs[:, 0], t, ours) - theirs[:, 1]).max() / abs(theirs[:, 1]).max())
        yield Row(
            f"block under its weight, {kind}",
            "CalculiX, same mesh",
            error,
            0.01,
            f"{len(theirs)} times, sag {-1e3 * theirs[:, 1].min():.2f} mm",
        )


def _run_calculix(model: Model, probe: tuple[float, float, float], static: bool, end: float, step: float, folder: Path) -> Floats:
    """Time and vertical displacement of a node, (n, 2), from CalculiX."""
    V = fem.functionspace(model.tongue.mesh, ("P", 2, (3,)))
    numbering = Numbering(V)
    points, cells = numbering.points, numbering.cells
    assert points is not None
    assert cells is not None
    law = model.passive
    assert isinstance(law, Yeoh)
    tip = int(np.argmin(np.linalg.norm(points - probe, axis=1)))
    lines = ["*NODE, NSET=ALL", *(f"{i + 1}, {x:.12g}, {y:.12g}, {z:.12g}" for i, (x, y, z) in enumerate(points))]
    lines += ["*ELEMENT, TYPE=C3D10, ELSET=BODY", *(", ".join(map(str, (e + 1, *(nodes + 1)))) for e, nodes in enumerate(cells))]
    lines += ["*NSET, NSET=WALL", *(str(i + 1) for i in np.flatnonzero(points[:, 0] < 1e-9)), "*NSET, NSET=TIP", str(tip + 1)]
    constants = f"{law.c10}, {law.c20}, {law.c30}, {2 / bulk_modulus(law):.12g}, 1e12, 1e12"  # D₂ = 0 would be replaced by a default
    lines += ["*MATERIAL, NAME=TISSUE", "*HYPERELASTIC, YEOH", constants]
    lines += ["*DENSITY", f"{model.density}", f"*DAMPING, ALPHA={model.damping.alpha}", "*SOLID SECTION, ELSET=BODY, MATERIAL=TISSUE"]
    lines += ["*AMPLITUDE, NAME=RISE", f"0., 0., {model.gravity_rise}, 1., 100., 1.", "*BOUNDARY", "WALL, 1, 3"]
    lines += ["*STEP, NLGEOM, INC=100000", "*STATIC, DIRECT" if static else "*DYNAMIC, DIRECT, ALPHA=0.", f"{step}, {end}"]
    lines += ["*DLOAD, AMPLITUDE=RISE", "BODY, GRAV, 9.81, 0., 0., -1."]
    lines += ["*NODE PRINT, NSET=TIP, FREQUENCY=1", "U", "*END STEP"]
    (folder / "block.inp").write_text("\n".join(lines) + "\n")
    done = subprocess.run([CALCULIX, "-i", "block"], cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    data = folder / "block.dat"
    if done.returncode != 0 or not data.exists():
        raise InputError(f"{CALCULIX}: failed with exit code {done.returncode}: {' '.join(done.stdout.split())[-300:]}")
    found = re.findall(r"time\s+(\S+)\s+\n\s*(?:\d+)\s+(\S+)\s+(\S+)\s+(\S+)", data.read_text())
    return np.array([(float(t), float(z)) for t, _, _, z in found])


CASES: dict[str, Callable[[], Iterator[Row]]] = {
    "patch": patch,
    "manufactured": manufactured,
    "time": time_order,
    "decay": decay,
    "calculix": calculix,
}
"""The cases by name; each yields rows."""
