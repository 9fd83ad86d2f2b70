# SPDX-License-Identifier: MIT
"""``python -m benchmarks.accuracy [--size MM] [--only NAME]``: what `solver.accuracy` costs and how far its trajectories are off.

Each scenario runs at every accuracy, and with tight tolerances at a quarter of the step of ``"trajectory"``. The error is the largest
distance of tip, dorsum or root from where they are then at the same time, over the largest displacement of the three.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import tongue_fenicsx as tf
from tongue_fenicsx.core.tables import markdown
from tongue_fenicsx.scenario.build import activation_of, simulation_of
from tongue_fenicsx.scenario.schema import Scenario
from tongue_fenicsx.solvers.tolerances import ACCURACIES, Tolerances
from tongue_fenicsx.studies.atlas import MUSCLES
from tongue_fenicsx.studies.single_muscle import CONTACT, walls_in

from . import measure
from .__main__ import FOLDER, say

POINTS = ("tip", "dorsum", "root")
END = 0.2


def _up(level: float, rise: float = 0.1) -> dict[str, Any]:
    return {"pieces": [(rise, 0.0, level)]}


def _random(seed: int, largest: float = 0.5) -> dict[str, Any]:
    """All muscles from level to level every 50 ms."""
    levels = np.random.default_rng(seed).uniform(0.0, largest, (len(MUSCLES), 4)).round(3).tolist()
    return {
        name: {"pieces": [(0.05, a, b) for a, b in zip([0.0, *row], row, strict=False)]} for name, row in zip(MUSCLES, levels, strict=True)
    }


def scenarios(mesh: Path) -> dict[str, dict[str, Any]]:
    """The six, by name."""
    among = dict.fromkeys(walls_in(mesh), CONTACT)
    roof: dict[str, Any] = {name: {} for name in ("palate", "velum", "upper_teeth")}
    rise = {"MH": _up(0.5), "GGP": _up(0.6), "SL": _up(0.2)}
    opening = {"mandible": {"angle": [(0.2, 0.0, 10.0)], "centre": [0.075, 0.0, 0.045], "axis": [0.0, -1.0, 0.0]}}
    return {
        "GGP": {"activation": {"GGP": _up(1.0)}},
        "GGP among the bones": {"activation": {"GGP": _up(1.0)}, "contact": among},
        "HG among the bones": {"activation": {"HG": _up(1.0)}, "contact": among, "tissue": {"preset": "buchaillard"}},
        "to the palate": {"activation": rise, "contact": roof, "tissue": {"preset": "buchaillard"}},
        "eleven muscles at random": {"activation": _random(1), "tissue": {"preset": "buchaillard"}},
        "jaw and gravity": {
            "boundary": {"moving": opening},
            "gravity": {"posture": "upright"},
            "contact": {"lower_teeth": {"moves_with": "mandible"}},
            "tissue": {"preset": "buchaillard"},
        },
    }


def _run(case: dict[str, Any], mesh: Path, **changes: Any) -> tuple[tf.Run, float]:
    """A scenario in memory, and s of processor time from its first step to its last."""
    given = {"mesh": {"file": str(mesh)}, "time": {"end": END}, "output": {"every": 0.025}, "probes": {name: name for name in POINTS}}
    scenario = Scenario.model_validate(given | case | {key: given.get(key, {}) | value for key, value in changes.items()})
    clock: list[float] = []
    simulation = simulation_of(scenario, FOLDER)
    run = simulation.run(activation_of(scenario), END, report=lambda p: clock.append(time.process_time()))
    simulation.close()
    return run, clock[-1] - clock[0]


def _error(run: tf.Run, reference: tf.Run) -> float:
    largest = max(np.linalg.norm(path, axis=1).max() for path in reference.probes.values())
    off = [
        np.linalg.norm(path - np.column_stack([np.interp(run.time, reference.time, column) for column in reference.probes[name].T]), axis=1)
        for name, path in run.probes.items()
    ]
    return float(np.max(off) / largest)


def rows(mesh: Path, only: str | None) -> Iterator[list[str]]:
    """A line for each scenario and accuracy: error, steps, Newton and Krylov iterations, and time as a share of the reference's."""
    for name, case in scenarios(mesh).items():
        if only not in (None, name):
            continue
        say(name)
        quarter = {"solver": {"accuracy": "tight"}, "time": {"step": Tolerances.step / 4}}
        reference, slowest = _run(case, mesh, **quarter)
        for label, changes in [(key, {"solver": {"accuracy": key}}) for key in ACCURACIES] + [("a quarter of the step, tight", quarter)]:
            run, seconds = (reference, slowest) if changes is quarter else _run(case, mesh, **changes)
            s = run.summary
            error = "" if changes is quarter else f"{100 * _error(run, reference):.2f} %"
            work = (s["n_steps"], s["n_rejected"], s["newton_iterations"], s["krylov_iterations"])
            yield [name, label, error, *map(str, work), f"{seconds:.1f}", f"{slowest / seconds:.1f}"]


def main() -> None:
    """Run, and print the table as it comes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accuracy", description=__doc__)
    parser.add_argument("--size", type=float, default=6.4, help="element size in mm")
    parser.add_argument("--only", help="one scenario")
    chosen = parser.parse_args()
    mesh = measure.mesh(1e-3 * chosen.size, FOLDER)
    head = ["scenario", "accuracy", "error", "steps", "rejected", "Newton", "Krylov", "processor time (s)", "times as fast"]
    found = []
    for row in rows(mesh, chosen.only):
        say(" | ".join(row))
        found.append(row)
    print(markdown(head, found))


if __name__ == "__main__":
    main()
