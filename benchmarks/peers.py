# SPDX-License-Identifier: MIT
"""The same motion of the same block in other codes: a Yeoh block swings under its own weight, Rayleigh α, steps of 1 ms."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import skfem
import ufl
from dolfinx.fem import petsc as fem_petsc
from scipy.sparse.linalg import spsolve
from skfem.helpers import ddot, det, dot, inv, mul

import tongue_fenicsx as tf
from tongue_fenicsx.forms.weak_form import WeakForm
from tongue_fenicsx.mechanics.hyperelasticity import bulk_modulus
from tongue_fenicsx.runs.numbering import Numbering
from tongue_fenicsx.solvers.time_integration import GeneralizedAlpha
from tongue_fenicsx.testing import box
from tongue_fenicsx.verification import calculix

from .timing import seconds

LAW, DENSITY, ALPHA, STEP = tf.Yeoh(1037.0, 486.0, nu=0.45), 1040.0, 20.0, 1e-3
LENGTHS = (0.02, 0.01, 0.01)
GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Peer:
    """A code: seconds of a Newton iteration, how many of them, and the tip's sag in mm at the end."""

    name: str
    newton: int
    seconds: float
    sag_mm: float

    @property
    def per_newton(self) -> float:
        """Seconds."""
        return self.seconds / self.newton


def model(n: int, steps: int) -> tf.Model:
    """The block with 2 n × n × n × 6 tetrahedra, its weight growing over all steps."""
    return tf.Model(
        box(LENGTHS, (2 * n, n, n)),
        tf.Tissue(LAW, DENSITY, tf.Rayleigh(ALPHA)),
        fixed=["wall"],
        gravity=GRAVITY,
        gravity_rise=steps * STEP,
    )


def peers(n: int, steps: int) -> Iterator[Peer]:
    """Ours, plain DOLFINx with a direct solver, CalculiX and scikit-fem where it is installed, and scikit-fem."""
    yield ours(n, steps)
    yield plain(n, steps)
    if shutil.which(calculix.CALCULIX) is not None:
        yield by_calculix(n, steps)
    yield by_scikit_fem(n, steps)


def ours(n: int, steps: int) -> Peer:
    """The steps alone, without set-up."""
    stepping = tf.Stepping(step_max=STEP, output_every=steps * STEP, spectral_radius=1.0)
    with tempfile.TemporaryDirectory() as folder:
        run = tf.Simulation(model(n, steps), probes={"tip": LENGTHS}, stepping=stepping, tolerances=tf.Tolerances.of("tight")).run(
            {}, steps * STEP, Path(folder) / "run"
        )
    s = run.summary
    return Peer("tongue_fenicsx", s["newton_iterations"], s["wall_seconds"], -1e3 * float(run.probes["tip"][-1, 2]))


def plain(n: int, steps: int) -> Peer:
    """DOLFINx as its tutorials use it: Newton, MUMPS LU, default flags; the same weak form, quadrature of degree 4."""
    block = model(n, steps)
    weak = WeakForm(block, [])
    scheme = GeneralizedAlpha(weak.u, 1.0)
    F = ufl.Identity(3) + ufl.grad(weak.u)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    w = ufl.TestFunction(weak.V)
    force = weak.gravity
    stress = ufl.derivative(weak.energy_density(F) * dx, weak.u, w)
    balance = stress + DENSITY * ufl.inner(scheme.acceleration + ALPHA * scheme.v - force, w) * dx
    options = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps", "snes_rtol": 1e-4}
    problem = fem_petsc.NonlinearProblem(balance, weak.u, bcs=weak.bcs, petsc_options_prefix="plain_", petsc_options=options)
    newton = 0

    def march() -> None:
        nonlocal newton
        for i in range(1, steps + 1):
            weak.load(i * STEP, {})
            scheme.begin(STEP)
            problem.solve()
            newton += problem.solver.getIterationNumber()
            scheme.accept(i * STEP)

    time = seconds(march)
    tip = int(np.argmin(np.linalg.norm(weak.V.tabulate_dof_coordinates() - LENGTHS, axis=1)))
    return Peer("plain DOLFINx, MUMPS LU", newton, time, -1e3 * float(weak.u.x.array[3 * tip + 2]))


def large(n: int, steps: int) -> Iterator[Peer]:
    """Ours on one core, and CalculiX with its fastest solver on two: its direct one takes ten times as long on 190 000 unknowns."""
    yield ours(n, steps)
    if shutil.which(calculix.CALCULIX) is not None:
        yield by_calculix(n, steps, "CalculiX, iterative, 2 threads", "ITERATIVE CHOLESKY", 2)


def by_calculix(n: int, steps: int, name: str = "CalculiX", solver: str = "SPOOLES", threads: int = 1) -> Peer:
    """CalculiX on the same mesh; its whole process, with its implicit direct steps."""
    with tempfile.TemporaryDirectory() as folder:
        path, found, end = Path(folder), [], steps * STEP
        time = seconds(lambda: found.append(calculix.run_calculix(model(n, steps), LENGTHS, False, end, STEP, path, solver, threads)))
        newton = sum(int(line.split()[3]) for line in (path / "block.sta").read_text().splitlines() if line.split()[:1] == ["1"])
    return Peer(name, newton, time, -1e3 * float(found[0][-1, 1]))


def by_scikit_fem(n: int, steps: int) -> Peer:
    """scikit-fem with NumPy kernels and SciPy's SuperLU: the same steps by the trapezoidal rule, Newton to 1e-4."""
    numbering = Numbering(WeakForm(model(n, steps), []).V)
    assert numbering.points is not None
    assert numbering.cells is not None
    corners, cells = np.unique(numbering.cells[:, :4], return_inverse=True)
    mesh = skfem.MeshTet(numbering.points[corners].T, cells.reshape(-1, 4).T)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP2()), intorder=4)
    kappa, eye = bulk_modulus(LAW), np.eye(3)[:, :, None, None]

    def kinematics(u: Any) -> tuple[Any, ...]:
        F = u.grad + eye
        J, invFT = det(F), np.swapaxes(inv(F), 0, 1)
        I1 = J ** (-2 / 3) * ddot(F, F)
        return F, J, invFT, I1, LAW.c10 + 2 * LAW.c20 * (I1 - 3)

    @skfem.LinearForm  # type: ignore[untyped-decorator]
    def force(w: Any, at: Any) -> Any:
        F, J, T, I1, slope = kinematics(at["u"])
        return ddot(2 * slope * (J ** (-2 / 3) * F - I1 / 3 * T) + kappa * (J - 1) * J * T, w.grad)

    @skfem.BilinearForm  # type: ignore[untyped-decorator]
    def tangent(du: Any, w: Any, at: Any) -> Any:
        F, J, T, I1, slope = kinematics(at["u"])
        G, H = du.grad, w.grad
        back = -mul(T, mul(np.swapaxes(G, 0, 1), T))
        tr = ddot(T, G)
        dI1 = 2 * (J ** (-2 / 3) * ddot(F, G) - I1 / 3 * tr)
        bar = J ** (-2 / 3) * F - I1 / 3 * T
        dbar = J ** (-2 / 3) * (G - 2 / 3 * tr * F) - dI1 / 3 * T - I1 / 3 * back
        volume = kappa * ((2 * J - 1) * J * tr * T + (J - 1) * J * back)
        return ddot(4 * LAW.c20 * dI1 * bar + 2 * slope * dbar + volume, H)

    mass = DENSITY * skfem.BilinearForm(lambda u, w, _: dot(u, w)).assemble(basis)
    weight = DENSITY * skfem.LinearForm(lambda w, _: GRAVITY[2] * w[2]).assemble(basis)
    fixed = basis.get_dofs(lambda x: x[0] < 1e-9).all()
    free = np.setdiff1d(np.arange(basis.N), fixed)
    u, v, a = (np.zeros(basis.N) for _ in range(3))
    newton = 0

    def march() -> None:
        nonlocal u, v, a, newton
        for i in range(1, steps + 1):
            new, start = u + STEP * v, None
            while True:
                acceleration = 4 / STEP**2 * (new - u - STEP * v) - a
                velocity = v + STEP / 2 * (a + acceleration)
                state = basis.interpolate(new)
                residual = (force.assemble(basis, u=state) + mass @ (acceleration + ALPHA * velocity) - i / steps * weight)[free]
                start = start or np.linalg.norm(residual)
                if np.linalg.norm(residual) <= 1e-4 * start:
                    break
                A = tangent.assemble(basis, u=state) + (4 / STEP**2 + 2 * ALPHA / STEP) * mass
                new[free] -= spsolve(A[np.ix_(free, free)].tocsc(), residual)
                newton += 1
            u, v, a = new, velocity, acceleration

    time = seconds(march)
    tip = int(np.argmin(np.linalg.norm(basis.doflocs.T - LENGTHS, axis=1)))
    return Peer("scikit-fem, SuperLU", newton, time, -1e3 * float(u[tip + 2 - tip % 3]))
