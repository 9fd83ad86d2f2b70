# SPDX-License-Identifier: MIT
"""``python -m benchmarks.gradients``: what a gradient costs, in runs forward.

Eleven muscles move the coarse tongue among all its bones for 100 ms; runs and gradients in turn, and the ratio of their medians.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from statistics import median

import tongue_fenicsx as tf
from tongue_fenicsx.core.types import Floats
from tongue_fenicsx.reduced.tongue import ReducedTongue
from tongue_fenicsx.scenario.build import simulation_of
from tongue_fenicsx.scenario.schema import Scenario

from . import measure
from .__main__ import FOLDER, say
from .twins import BONES

END, LEVEL, REPEATS = 0.1, 0.2, 3
"""Of the run in s; of each muscle; of both."""


def distance(t: float, h: float, probes: Mapping[str, Floats]) -> tuple[float, Mapping[str, Floats]]:
    """How far the tip is from rest, over time."""
    return h * float(probes["tip"] @ probes["tip"]), {"tip": 2 * h * probes["tip"]}


def seconds(call: Callable[[], object]) -> float:
    """How long a call takes."""
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def main() -> None:
    """Print the medians and their ratio."""
    told = {"time": {"end": END, "step": 0.005}, "output": {"every": END}, "contact": {name: {} for name in BONES}}
    scenario = Scenario.model_validate({"mesh": {"file": str(measure.mesh("coarse", FOLDER).absolute())}, **told})
    simulation = simulation_of(scenario, FOLDER)
    activation = {name: tf.ramp(END / 2, END, LEVEL) for name in ReducedTongue.shipped().muscles}
    simulation.gradient(distance, activation, END / 10)  # makes all forms
    runs, gradients = [], []
    for _ in range(REPEATS):
        runs.append(seconds(lambda: simulation.run(activation, END)))
        gradients.append(seconds(lambda: simulation.gradient(distance, activation, END)))
        say(f"run {runs[-1]:.1f} s, gradient with its run {gradients[-1]:.1f} s")
    print(f"a gradient takes {median(gradients) / median(runs):.2f} runs, the one forward among them")


if __name__ == "__main__":
    main()
