# SPDX-License-Identifier: MIT
"""Motion in time: the integrator's order, decay, the balance of energy, finer steps, and the number of ranks."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI
from petsc4py import PETSc
from scipy.optimize import curve_fit

from ..anatomy.parametric.tongue import parametric_tongue
from ..core.errors import InputError
from ..core.parallel import on_rank_zero
from ..core.types import Floats
from ..mechanics.activation import ramp
from ..mechanics.model import Model
from ..mechanics.tissue import Rayleigh, Tissue
from ..meshing import build as meshing
from ..meshing.tongue_mesh import TongueMesh
from ..runs.run import Run
from ..simulation.simulation import Simulation
from ..simulation.stepping import Stepping
from ..solvers.time_integration import GeneralizedAlpha, State
from ..solvers.tolerances import Tolerances
from ..testing import Row, box

DAMPING, STIFFNESS = 0.8, 9.0


def oscillate(steps: list[float], radius: float) -> Floats:
    """t, u, v and ü after each step, (n, 4), of ü + 0.8 u̇ + 9 u = 0 from u = 1, with the scheme's own affine rates."""
    u = fem.Function(fem.functionspace(dmesh.create_unit_interval(MPI.COMM_SELF, 1), ("DG", 0)))
    u.x.array[:] = 1.0
    scheme = GeneralizedAlpha(u, radius)
    one, zero = np.ones_like(u.x.array), np.zeros_like(u.x.array)
    scheme.restore(State(0.0, 0.0, one, zero, -STIFFNESS * one, -STIFFNESS * one, zero, zero))
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


def decay(step: float = 2e-3) -> Iterator[Row]:
    """A soft block released from a small stretch: its lowest mode decays with the rate α/2."""
    alpha = 4.0
    tongue = box((0.02, 0.01, 0.01), (4, 2, 2))
    tissue = replace(Tissue.calka(), damping=Rayleigh(alpha))
    model = Model(tongue, tissue, fixed=["wall"], gravity=(0.0, 0.0, -0.05), gravity_rise=0.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(MPI.COMM_WORLD.bcast(folder))
        stepping = Stepping(step_max=step, output_every=1.0, spectral_radius=1.0)
        simulation = Simulation(
            model, probes={"end": (0.02, 0.005, 0.005)}, stepping=stepping, tolerances=Tolerances.of("tight", rtol=1e-8, atol=1e-14)
        )
        run = simulation.run({}, 1.2, path)
        t, z = run.time, run.probes["end"][:, 2]
        MPI.COMM_WORLD.barrier()

    def mode(t: Floats, rate: float, omega: float, a: float, b: float, rest: float) -> Floats:
        return np.asarray(np.exp(-rate * t) * (a * np.cos(omega * t) + b * np.sin(omega * t)) + rest)

    turns = np.flatnonzero(np.diff(np.sign(np.diff(z)))) + 1
    omega = np.pi / np.diff(t[turns]).mean()
    found = curve_fit(mode, t, z, p0=(alpha / 2, omega, np.ptp(z) / 2, 0.0, z.mean()))[0]
    note = f"{t[-1] * found[1] / (2 * np.pi):.1f} periods of {2e3 * np.pi / found[1]:.0f} ms"
    yield Row("decay of a passive mode", "α/2", abs(found[0] / (alpha / 2) - 1), 0.02, note)


def _tongue(folder: Path, size: float) -> Path:
    """The parametric tongue with elements of `size` in m."""
    path = folder / "tongue.msh"
    on_rank_zero(MPI.COMM_WORLD, lambda: meshing.build(parametric_tongue(), path, size))
    return path


def contraction(end: float = 0.35, step: float = 5e-3) -> Iterator[Row]:
    """Full GGP over 350 ms on the parametric tongue, with force–length and force–velocity: energies balance, finer steps converge."""
    paths, times = [], np.linspace(0, end, 8)
    with tempfile.TemporaryDirectory() as folder:
        home = Path(MPI.COMM_WORLD.bcast(folder))
        model = Model(TongueMesh.read(_tongue(home, 8e-3)))
        for refinement in (1, 2, 4):
            stepping = Stepping(step_max=step / refinement, output_every=end)
            run = Simulation(model, stepping=stepping, tolerances=Tolerances.of("tight")).run({"GGP": ramp(0.1, 0.25)}, end)
            moved = np.hstack([run.probes[name] for name in ("tip", "dorsum", "root")])
            paths.append([np.interp(times, run.time, column) for column in moved.T])
            if refinement == 1:
                note = f"{run.summary['n_steps']} steps, {run.summary['n_rejected']} rejected"
                yield Row(
                    f"energy balance, GGP for {1e3 * end:.0f} ms", "peak muscle work", run.summary["energy_balance_error"], 0.01, note
                )
            MPI.COMM_WORLD.barrier()
    gaps = [float(abs(np.subtract(fine, coarse)).max()) for coarse, fine in pairwise(paths)]
    note = f"{1e3 * gaps[0]:.3f}, {1e3 * gaps[1]:.3f} mm from step to half the step"
    yield Row("halved steps, force–length and –velocity on", "difference shrinks", gaps[1] / gaps[0], 0.5, note)


def ranks(counts: tuple[int, ...] = (2, 4), end: float = 0.02) -> Iterator[Row]:
    """The same scenario on one rank and on several, with fixed steps and tight tolerances: the same motion, also against a plane."""
    roof = "contact.roof.plane={point=[0.0, 0.0, 0.0394], normal=[0.0, 0.0, -1.0]}"
    strong = "activation.GGP.pieces=[[0.02, 0.0, 1.0]]"
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        if MPI.COMM_WORLD.size == 1:
            _tongue(home, 1e-2)
        for name, several, changes, limit in (("", counts, (), 1e-8), (", in contact", counts[:1], (roof, strong), 1e-6)):
            case = f"1 and {' and '.join(map(str, several))} ranks, tight tolerances{name}"
            if MPI.COMM_WORLD.size > 1:
                yield Row(case, "the same probes", float("nan"), limit, "runs only from one rank", skipped=True)
                continue
            found = {n: _on_ranks(n, home, end, changes) for n in (1, *several)}
            scale = max(abs(path).max() for path in found[1].probes.values())
            gaps = [max(float(abs(found[n].probes[probe] - path).max()) for probe, path in found[1].probes.items()) for n in several]
            force = found[1].summary["contact_force_max_N"]
            note = f"of {1e3 * scale:.2f} mm" + (f", {force:.2g} N" if changes else "")
            yield Row(case, "the same probes", max(gaps) / scale, limit, note)


def write_scenario(home: Path, end: float) -> Path:
    """GGP on the tongue in `home`, with fixed steps and tight tolerances, to `end` in s."""
    path = home / "ranks.toml"
    path.write_text(
        f"""[mesh]
file = "tongue.msh"
[time]
end = {end}
step = 0.005
[solver]
accuracy = "tight"
rtol = 1e-11
atol = 1e-14
linear = 1e-9
[activation.GGP]
pieces = [[0.02, 0.0, 0.2]]
"""
    )
    return path


def _on_ranks(n: int, home: Path, end: float, changes: tuple[str, ...] = ()) -> Run:
    """GGP on the tongue in `home`, run by `mpiexec` on `n` ranks."""
    scenario = write_scenario(home, end)
    options = [part for change in changes for part in ("--set", change)]
    program = [sys.executable, "-m", "tongue_fenicsx", "run", scenario.name, "-o", f"on_{n}", "--overwrite", "--no-figures", *options]
    launcher = [] if n == 1 else [str(Path(sys.executable).with_name("mpiexec")), "-n", str(n)]
    done = subprocess.run(
        [*launcher, *program], cwd=home, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=600, check=False
    )
    if done.returncode != 0:
        raise InputError(f"mpiexec -n {n}: failed with exit code {done.returncode}: {' '.join((done.stdout + done.stderr).split())[-300:]}")
    return Run(home / f"on_{n}")
