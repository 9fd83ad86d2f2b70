# SPDX-License-Identifier: MIT
"""The model against CalculiX, an independent code, on the same quadratic mesh."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from ..core.errors import InputError
from ..core.types import Floats
from ..mechanics.hyperelasticity import Yeoh, bulk_modulus
from ..mechanics.model import Model
from ..mechanics.tissue import Rayleigh, Tissue
from ..runs.numbering import Numbering
from ..simulation.simulation import Simulation
from ..simulation.stepping import Stepping
from ..solvers.tolerances import Tolerances
from ..testing import Row, box

CALCULIX = "ccx"


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
            tongue, Tissue(law, density, Rayleigh(alpha)), fixed=["wall"],
            gravity=(0.0, 0.0, -9.81), gravity_rise=1.0 if static else 0.1,
        )  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            path = Path(MPI.COMM_WORLD.bcast(folder))
            stepping = Stepping(step_max=step, output_every=end / 10, quasi_static=static, spectral_radius=0.9)
            run = Simulation(model, probes={"tip": probe}, stepping=stepping, tolerances=Tolerances.of("tight", rtol=1e-8)).run(
                {}, end, path / "run"
            )
            t, ours = run.time, run.probes["tip"][:, 2]
            theirs = run_calculix(model, probe, static, end, step, path) if MPI.COMM_WORLD.rank == 0 else None
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


def run_calculix(
    model: Model,
    probe: tuple[float, float, float],
    static: bool,
    end: float,
    step: float,
    folder: Path,
    solver: str = "SPOOLES",
    threads: int = 1,
) -> Floats:
    """Time and vertical displacement of a node, (n, 2), from CalculiX with one of its linear solvers."""
    V = fem.functionspace(model.tongue.mesh, ("P", 2, (3,)))
    numbering = Numbering(V)
    points, cells = numbering.points, numbering.cells
    assert points is not None
    assert cells is not None
    law = model.tissue.law
    assert isinstance(law, Yeoh)
    tip = int(np.argmin(np.linalg.norm(points - probe, axis=1)))
    lines = ["*NODE, NSET=ALL", *(f"{i + 1}, {x:.12g}, {y:.12g}, {z:.12g}" for i, (x, y, z) in enumerate(points))]
    lines += ["*ELEMENT, TYPE=C3D10, ELSET=BODY", *(", ".join(map(str, (e + 1, *(nodes + 1)))) for e, nodes in enumerate(cells))]
    lines += ["*NSET, NSET=WALL", *(str(i + 1) for i in np.flatnonzero(points[:, 0] < 1e-9)), "*NSET, NSET=TIP", str(tip + 1)]
    constants = f"{law.c10}, {law.c20}, {law.c30}, {2 / bulk_modulus(law):.12g}, 1e12, 1e12"  # D₂ = 0 would be replaced by a default
    lines += ["*MATERIAL, NAME=TISSUE", "*HYPERELASTIC, YEOH", constants]
    tissue = model.tissue
    lines += ["*DENSITY", f"{tissue.density}", f"*DAMPING, ALPHA={tissue.damping.alpha}", "*SOLID SECTION, ELSET=BODY, MATERIAL=TISSUE"]
    lines += ["*AMPLITUDE, NAME=RISE", f"0., 0., {model.gravity_rise}, 1., 100., 1.", "*BOUNDARY", "WALL, 1, 3"]
    lines += ["*STEP, NLGEOM, INC=100000", f"{'*STATIC' if static else '*DYNAMIC, ALPHA=0.'}, DIRECT, SOLVER={solver}", f"{step}, {end}"]
    lines += ["*DLOAD, AMPLITUDE=RISE", "BODY, GRAV, 9.81, 0., 0., -1."]
    lines += ["*NODE PRINT, NSET=TIP, FREQUENCY=1", "U", "*END STEP"]
    (folder / "block.inp").write_text("\n".join(lines) + "\n")
    settings = os.environ | {"OMP_NUM_THREADS": str(threads)}
    done = subprocess.run([CALCULIX, "-i", "block"], cwd=folder, env=settings, capture_output=True, text=True, timeout=600, check=False)
    data = folder / "block.dat"
    if done.returncode != 0 or not data.exists():
        raise InputError(f"{CALCULIX}: failed with exit code {done.returncode}: {' '.join(done.stdout.split())[-300:]}")
    found = re.findall(r"time\s+(\S+)\s+\n\s*(?:\d+)\s+(\S+)\s+(\S+)\s+(\S+)", data.read_text())
    return np.array([(float(t), float(z)) for t, _, _, z in found])
