# SPDX-License-Identifier: MIT
"""The measurements: assembly, solver and the chapter's case."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
from petsc4py import PETSc

import tongue_fenicsx as tf
from tongue_fenicsx.anatomy.parametric.size import PRESETS as SIZES
from tongue_fenicsx.forms.weak_form import WeakForm
from tongue_fenicsx.meshing import build as meshing
from tongue_fenicsx.solvers.equations import Equations
from tongue_fenicsx.solvers.newton import Newton
from tongue_fenicsx.solvers.time_integration import GeneralizedAlpha
from tongue_fenicsx.solvers.tolerances import Tolerances
from tongue_fenicsx.testing import box, with_fibres

from .timing import Finished, Row, parts, run, seconds, steady

CHAPTER = Path(__file__).with_name("chapter.toml")
PRESETS: dict[str, dict[str, Any]] = {
    "ν = 0.49": {"nu": 0.49, "mixed": False},
    "ν = 0.499": {"nu": 0.499, "mixed": False},
    "ν = 0.4999, mixed": {"nu": 0.4999, "mixed": True},
}


def mesh(preset: str | float, folder: Path) -> Path:
    """The built-in tongue at a preset or an element size in m; kept in `folder`."""
    path = folder / f"tongue_{preset}.msh"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        meshing.build(tf.parametric_tongue(), path, SIZES[preset] if isinstance(preset, str) else preset)
    return path


def assembly(file: Path) -> dict[str, Row]:
    """µs per cell for residual and tangent, with GGP alone and with all muscles."""
    tongue = tf.TongueMesh.read(file)
    cells = tongue.mesh.topology.index_map(3).size_global
    found = {}
    for name, muscles in (("GGP", ["GGP_L", "GGP_R"]), ("all muscles", list(tongue.muscles))):
        weak = WeakForm(tf.Model(tongue), muscles)
        equations = Equations(weak, GeneralizedAlpha(weak.u))
        newton = Newton(equations, Tolerances(), print)
        equations.at(0.01, dict.fromkeys(muscles, 0.5))  # kernels skip muscles that do nothing
        times = steady(partial(_assemble, equations, newton))
        found[name] = {key: 1e6 * value / cells for key, value in times.items()}
        newton.destroy()
    return found


def _assemble(equations: Equations, newton: Newton) -> Row:
    return {"residual": seconds(equations.forces.unbalanced), "tangent": seconds(newton._tangent.assemble)}


def solver(n: int, preset: dict[str, Any]) -> Row:
    """One step of 5 ms of a block of 12 n³ tetrahedra, fibres at half activation: what a Newton iteration costs, in s."""
    tissue = replace(tf.Tissue.calka(), law=tf.Yeoh(192.0, 90.0, preset["nu"]))
    model = tf.Model(with_fibres(box((0.06, 0.03, 0.03), (2 * n, n, n))), tissue, fixed=["wall"], mixed=preset["mixed"])
    return steady(lambda: _one_step(model))


def _one_step(model: tf.Model) -> Row:
    before = parts(lambda event: float(PETSc.Log.Event(event).getPerfInfo()["time"]))
    stepping = tf.Stepping(step_max=5e-3, output_every=5e-3)
    with tempfile.TemporaryDirectory() as folder:
        run = tf.Simulation(model, {"tip": (0.06, 0.015, 0.015)}, stepping, Tolerances.of("tight")).run(
            {"GGP_L": tf.ramp(0.005, 0.1, 0.5)}, 5e-3, Path(folder) / "run"
        )
    s = run.summary
    row = {"unknowns": s["n_dofs"], "newton": s["newton_iterations"], "krylov": s["krylov_iterations"] / s["newton_iterations"]}
    after = parts(lambda event: float(PETSc.Log.Event(event).getPerfInfo()["time"]))
    return row | {name: (value - before[name]) / s["newton_iterations"] for name, value in after.items()}


def sweep(file: Path, n: int) -> Row:
    """One step with each of `n` values of stress, stiffness, activation and step, from an empty cache: how many forms the first compiles,
    and how many all others; s of the first, and the median of the others."""
    tongue = tf.TongueMesh.read(file)
    counts, times = [], []
    with tempfile.TemporaryDirectory() as scratch, patch.dict(os.environ, {"XDG_CACHE_HOME": scratch}):
        for i in range(n):
            tissue = tf.Tissue(tf.Yeoh(192.0 + i, 90.0, 0.49), 1000.0, tf.Rayleigh(20.0), {"GGP": 3000.0 + i})
            model = tf.Model(tongue, tissue)
            h = (5 + 0.02 * i) * 1e-3
            simulation = tf.Simulation(model, stepping=tf.Stepping(step_max=h, output_every=h))
            start = time.perf_counter()
            simulation.run({"GGP": tf.ramp(0.1, 0.25, 0.5 + 0.01 * i)}, h, Path(scratch) / f"run{i}")
            times.append(time.perf_counter() - start)
            counts.append(sum(1 for _ in Path(scratch).rglob("*.so")))
    found = {"values": n, "compiled by the first": counts[0], "by the others": counts[-1] - counts[0]}
    return found | {"seconds": median(times[1:]), "first (s)": times[0]}


def exponent(rows: list[Row], name: str = "total") -> float:
    """p of the fit cost ∝ unknownsᵖ."""
    return float(np.polyfit(np.log([row["unknowns"] for row in rows]), np.log([row[name] for row in rows]), 1)[0])


def trajectory_error(coarse: Path, fine: Path) -> float:
    """Largest difference of a probe at a time of both runs, over that probe's largest displacement."""
    a, b = tf.Run(coarse), tf.Run(fine)
    return max(
        float(np.linalg.norm(path - np.column_stack([np.interp(a.time, b.time, b.probes[name][:, i]) for i in range(3)]), axis=1).max())
        / float(np.linalg.norm(b.probes[name], axis=1).max())
        for name, path in a.probes.items()
    )


def chapter(file: Path, folder: Path, step: float, ranks: int = 1) -> Finished:
    """The chapter's case on a mesh with a step in s."""
    return run(CHAPTER, folder / f"{file.stem}-{1e3 * step:g}ms-{ranks}", f"mesh.file={file.resolve()}", f"time.step={step}", ranks=ranks)


def time_steps(file: Path, folder: Path, steps: list[float]) -> Iterator[Row]:
    """Error of the trajectories against the last, smallest step, and cost."""
    runs = {step: chapter(file, folder, step) for step in steps}
    finest = folder / f"{file.stem}-{1e3 * steps[-1]:g}ms-1"
    for step in steps[:-1]:
        error = trajectory_error(folder / f"{file.stem}-{1e3 * step:g}ms-1", finest)
        yield {"step_ms": 1e3 * step, "error": error, "newton_per_step": runs[step].newton_per_step, "seconds": runs[step].seconds}
