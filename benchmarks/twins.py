# SPDX-License-Identifier: MIT
"""``python -m benchmarks.twins [--seeds FIRST LAST] [--jobs N]``: muscles from a movement whose muscles are known.

Eleven muscles at random (knots every 50 ms, levels to 0.5) move the coarse tongue among all bones for 300 ms; the paths of five points,
each coordinate every 10 ms with 0.2 mm of noise, are what the fit sees. It begins with the reduced tongue; runs beside what that finds
correct it and say what the data leave open. Of the combinations of levels that they determine, and of intervals, the table says how far
from the truth they are.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tongue_fenicsx.core.tables import markdown
from tongue_fenicsx.core.types import Floats
from tongue_fenicsx.reduced.tongue import ReducedTongue
from tongue_fenicsx.scenario.build import activation_of, simulation_of
from tongue_fenicsx.scenario.schema import Scenario
from tongue_fenicsx.studies import designs
from tongue_fenicsx.studies.fit_file import SLOPES, FitFile, Task
from tongue_fenicsx.studies.fit_run import FitRun
from tongue_fenicsx.studies.goals import Track
from tongue_fenicsx.studies.openness import DETERMINED, openness
from tongue_fenicsx.studies.pool import Workers

from . import measure
from .__main__ import FOLDER, say

END, KNOT, EVERY, NOISE = 0.3, 0.05, 0.01, 0.2
"""Of the movement, between knots and between measurements, in s; of each coordinate, in mm."""
BONES = ("palate", "velum", "upper_teeth", "lower_teeth", "mandible", "pharynx")
LOOKED_AT = ("tip", "dorsum", "root")
HEAD = "seed, tip (mm), dorsum (mm), root (mm), left of the data (mm), combinations determined, off of these: rms and most, "
HEAD += "levels within their intervals, levels off (rms), runs, s"


def twin(seed: int, muscles: list[str], slopes: str, jobs: int) -> list[str]:
    """A line of the table."""
    scenario = Scenario.model_validate(
        {
            "mesh": {"file": str(measure.mesh("coarse", FOLDER).absolute())},
            "tissue": {"preset": "buchaillard"},
            "time": {"end": END, "step": 0.005},
            "output": {"every": KNOT},
            "contact": {name: {} for name in BONES},
        }
    )
    (change,) = designs.random_activations(muscles, 1, seed, END, level=(0.0, 0.5), spacing=(KNOT, 3 * KNOT), rest=0.5, hold=0.3, grid=KNOT)
    pieces = {key.removeprefix("activation."): {"pieces": value} for key, value in change.items()}
    truth = activation_of(Scenario.model_validate(scenario.model_dump(exclude_none=True) | {"activation": pieces}))
    begin = time.perf_counter()
    simulation = simulation_of(scenario, FOLDER)
    run = simulation.run(truth, END)
    random, times = np.random.default_rng(seed), np.linspace(EVERY, END, round(END / EVERY))
    paths = {}
    for name, displacement in run.probes.items():
        place = np.column_stack([np.interp(times, run.time, along) for along in displacement.T])
        paths[name] = Track(times, place + 1e-3 * NOISE * random.standard_normal(place.shape), name)
    file = FitFile(base=None, muscles=muscles, knots=KNOT, begin="live", slopes=slopes, iterations=0)
    task = Task(file, scenario, paths, contours={}, surfaces={})
    with TemporaryDirectory() as folder:
        fitting = FitRun(task, Path(folder), lambda best: say(f"{seed}: {best.distance}"), say)
        found = fitting.seek()
        beside = fitting.look_beside(found, Workers(jobs))
        if slopes == "full":
            found = fitting.finish(beside)
        by_numbers = fitting.slopes(found, beside)
    again = simulation.run(found.activation, END)
    off = [_rms(1e3 * np.linalg.norm(np.array([again.probes[n] - run.probes[n]]), axis=2)) for n in LOOKED_AT]
    known = openness(found, paths, NOISE, by_numbers)
    wrong = {name: levels[1:] - [truth[name](t) for t in found.knots[1:]] for name, levels in found.levels.items()}
    sure = [
        sum(float(along @ wrong[name]) for name, along in shares.items()) for sigma, shares in known.combinations if sigma <= DETERMINED
    ]
    within = [abs(along) <= 2 * known.deviations[name] for name, along in wrong.items()]
    return [
        str(seed), *(f"{d:.2f}" for d in off), f"{_rms(np.array(list(found.distance.values()))):.2f}",
        f"{len(sure)} of {len(known.combinations)}", f"{_rms(np.array(sure)):.3f} {max(map(abs, sure)):.3f}",
        f"{100 * float(np.mean(within)):.0f} %", f"{_rms(np.array(list(wrong.values()))):.2f}",
        str(found.evaluations), f"{time.perf_counter() - begin:.0f}",
    ]  # fmt: skip


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Print the table as it comes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.twins", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 10), metavar=("FIRST", "LAST"))
    parser.add_argument("--slopes", choices=SLOPES, default="full", help="whether it stops with the reduced tongue")
    parser.add_argument("--jobs", type=int, default=2, help="processes of the runs beside that of a fit")
    chosen = parser.parse_args()
    muscles, rows = list(ReducedTongue.shipped().muscles), list[list[str]]()
    for seed in range(chosen.seeds[0], chosen.seeds[1] + 1):
        rows.append(twin(seed, muscles, chosen.slopes, chosen.jobs))
        say(" | ".join(rows[-1]))
    print(markdown(HEAD.split(", "), rows))


if __name__ == "__main__":
    main()
