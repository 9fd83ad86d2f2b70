# SPDX-License-Identifier: MIT
"""``python -m benchmarks.projection [--runs N] [--level L]``: the other way to reduce a tongue, its equations in a few shapes.

The balance of forces is projected on the shapes of the reduced tongue that comes along (Galerkin) and solved in their coordinates, step
by step, with all cells and contact points: what sampling of cells (hyper-reduction) would approach, at best, in accuracy. Beside it are
the learned tongue and the error that the best coordinates would leave, on runs of ``demos/sweep_rom.toml`` of a seed that neither knows.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import tomllib
from pathlib import Path
from unittest import mock

import numpy as np
from petsc4py import PETSc
from scipy.spatial import cKDTree

import tongue_fenicsx as tf
from tongue_fenicsx.core.tables import markdown
from tongue_fenicsx.core.types import Floats
from tongue_fenicsx.reduced.judging import displacement_of, judge
from tongue_fenicsx.reduced.tongue import ReducedTongue
from tongue_fenicsx.scenario.build import Workbench, activation_of
from tongue_fenicsx.scenario.schema import Scenario
from tongue_fenicsx.solvers.newton import Newton, Outcome
from tongue_fenicsx.studies import cases, designs

from . import measure
from .__main__ import FOLDER, say

SWEEP = Path(__file__).parents[1] / "demos" / "sweep_rom.toml"
SEED = 1001
MOST = 30
"""Newton iterations of a step; the tenth halving of one of them ends it."""


class Galerkin:
    """Solves a step in the coordinates of shapes; takes the place of `Newton.solve`."""

    def __init__(self, tongue: ReducedTongue) -> None:
        self._tongue = tongue
        self._shapes: dict[int, tuple[Floats, PETSc.Mat]] = {}

    def _basis(self, newton: Newton) -> tuple[Floats, PETSc.Mat]:
        """The shapes (unknowns, modes), orthonormal and zero where something is held, and the same as a matrix."""
        if id(newton) not in self._shapes:
            weak = newton._weak
            distance, node = cKDTree(self._tongue.points).query(weak.V.tabulate_dof_coordinates())
            assert distance.max() < 1e-6
            modes = self._tongue.modes[:, node].reshape(len(self._tongue.modes), -1).T
            modes[weak.fixed_dofs] = 0.0
            basis = np.linalg.qr(modes)[0]
            dense = PETSc.Mat().createDense(basis.shape, array=np.asfortranarray(basis), comm=PETSc.COMM_SELF)
            dense.assemble()
            self._shapes[id(newton)] = basis, dense
        return self._shapes[id(newton)]

    def solve(self, newton: Newton) -> Outcome:
        """Newton's method with halved steps."""
        basis, dense = self._basis(newton)
        x, b, weak = newton._x, newton._b, newton._weak
        q = basis.T @ weak.u.x.array[: len(basis)]

        def residual(q: Floats) -> Floats:
            x.array[:] = basis @ q
            newton._evaluate(x, b)
            return np.asarray(basis.T @ b.array_r)

        r = residual(q)
        for iteration in range(MOST):
            if np.linalg.norm(r) <= newton._enough:
                return Outcome(True, iteration, 0, "projected", "converged")
            newton._tangent.assemble(coarse=False)
            product = newton._tangent.matrix.matMult(dense)
            dq = -np.linalg.solve(basis.T @ product.getDenseArray(), r)
            product.destroy()
            for halving in range(10):
                after = residual(q + dq / 2**halving)
                if np.linalg.norm(after) < np.linalg.norm(r):
                    break
            q, r = q + dq / 2**halving, after
        return Outcome(False, MOST, 0, "projected", "diverged")


def _run(scenario: Scenario, folder: Path, bench: Workbench) -> tuple[tf.Run, float]:
    """A run, and s of processor time from its first step to its last."""
    clock: list[float] = []
    simulation = bench.simulation(scenario)
    run = simulation.run(activation_of(scenario), scenario.time.end, folder, report=lambda p: clock.append(time.process_time()))
    return run, clock[-1] - clock[0]


def main() -> None:
    """Run both, and print the table as it comes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.projection", description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--level", type=float, default=0.5)
    chosen = parser.parse_args()
    given = tomllib.loads(SWEEP.read_text(encoding="utf-8"))
    given["random_activations"] |= {"n": chosen.runs, "seed": SEED, "level": [0.0, chosen.level]}
    given["base"]["mesh"] = {"file": str(measure.mesh("coarse", FOLDER).absolute())}
    design = designs.random_activations(**given["random_activations"], end=given["base"]["time"]["end"])
    tongue = ReducedTongue.shipped()
    galerkin, bench, rows = Galerkin(tongue), Workbench(), []
    with tempfile.TemporaryDirectory() as place:
        for index, (scenario, _) in enumerate(cases.scenarios(given["base"], SWEEP.parent, design)):
            full, seconds = _run(scenario, Path(place) / f"{index}", bench)
            with mock.patch.object(Newton, "solve", lambda newton: galerkin.solve(newton)):
                projected, other = _run(scenario, Path(place) / f"{index}-projected", bench)
            off = 1e3 * np.linalg.norm(displacement_of(projected) - displacement_of(full), axis=2)
            learned = judge(tongue, full)
            s, p = full.summary, projected.summary
            row = [
                str(index),
                f"{off.mean():.2f}",
                f"{np.percentile(off, 95):.2f}",
                f"{learned.mean:.2f}",
                f"{learned.p95:.2f}",
                f"{learned.projection:.2f}",
                f"{seconds:.1f}",
                f"{other:.1f}",
                f"{s['n_steps']}, {s['newton_iterations']}",
                f"{p['n_steps']}, {p['newton_iterations']}",
            ]
            say(" | ".join(row))
            rows.append(row)
    head = "run, projected: mean (mm), 95th percentile, learned: mean (mm), 95th percentile, best of the shapes: mean (mm), "
    head += "full (s), projected (s), full: steps and Newton, projected: steps and Newton"
    print(markdown(head.split(", "), rows))


if __name__ == "__main__":
    main()
