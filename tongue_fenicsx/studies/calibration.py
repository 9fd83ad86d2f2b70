# SPDX-License-Identifier: MIT
"""Peak active stresses from the strain that a muscle reaches alone: the chapter prints the strain only, "of the order of 50 %"."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from ..core.errors import InputError, SolveError
from ..core.versions import versions
from ..runs.run import Run
from ..scenario.schema import Scenario
from . import single_muscle as solo
from .pool import Workers, perform, results

TONGUE_MUSCLES = ("GGP", "GGM", "GGA", "SG", "HG", "IL", "SL", "VERT", "TRANS")
"""Calibrated; geniohyoid and mylohyoid, bonded at both ends, keep their published ratio to GGP."""
START, BOUND = 4e3, 200e3
"""First stress tried and largest accepted, in Pa; 220 kPa is the specific tension of muscle (Van Lunteren 1990)."""
TOLERANCE = 0.02
FASTEST = 0.28
"""Peak speed in m/s beyond which a stress is too much: the chapter's muscles reach 0.1 to 0.2, and among bones, which guide the tissue,
the fastest (SL) is a twentieth faster than in the free tongue."""
MAX_RUNS = 10
SLOPE = 0.15
"""Strain per e-fold of stress, assumed until two runs are known (0.12 to 0.2 on the parametric tongue)."""


@dataclass(frozen=True)
class Found:
    """Outcome for one muscle.

    Attributes
    ----------
    stress : float
        Peak active stress in Pa; of the runs that converged, the one nearest to the target.
    strain : float
        What it reaches.
    reached : bool
        Whether that is the target within the tolerance.
    limit : float
        The smallest stress in Pa at which the solve failed or the tongue was too fast, else the largest accepted one.
    runs : int
        How many were needed.
    """

    stress: float
    strain: float
    reached: bool
    limit: float
    runs: int


def search(target: float, tolerance: float = TOLERANCE, bound: float = BOUND) -> Generator[float, float, Found]:
    """The stress, to two digits, at which a strain that grows with it reaches a target: secant in its logarithm, kept between what is
    too little and what is too much.

    Parameters
    ----------
    target, tolerance : float
        Strain to reach, and how nearly.
    bound : float
        Largest stress in Pa.

    Yields
    ------
    float
        A stress in Pa; its strain is to be sent, infinite where the solve fails or the tongue is too fast, which counts as too much.

    Raises
    ------
    SolveError
        If all of the stresses tried were too much.
    """
    trials: dict[float, float] = {}
    stress = float(f"{min(START, bound):.2g}")
    while stress not in trials and len(trials) < MAX_RUNS:
        trials[stress] = yield stress
        if abs(trials[stress] - target) <= tolerance:
            break
        stress = float(f"{min(_next(trials, target), bound):.2g}")
    solved = {stress: reached for stress, reached in trials.items() if math.isfinite(reached)}
    if not solved:
        raise SolveError(f"the solve failed, or the tongue was too fast, at every stress tried, down to {1e-3 * min(trials):g} kPa.")
    best = min(solved, key=lambda stress: abs(solved[stress] - target))
    limit = min(trials.keys() - solved.keys(), default=bound)
    return Found(best, solved[best], abs(solved[best] - target) <= tolerance, limit, len(trials))


def _next(trials: Mapping[float, float], target: float) -> float:
    """The stress to try next, in Pa."""
    below = max((stress for stress, strain in trials.items() if strain < target), default=None)
    above = min((stress for stress, strain in trials.items() if strain >= target), default=None)
    if below is not None and above is not None:
        share = min(max((target - trials[below]) / (trials[above] - trials[below]), 0.1), 0.9) if math.isfinite(trials[above]) else 0.5
        return math.exp((1 - share) * math.log(below) + share * math.log(above))
    solved = sorted((s for s, strain in trials.items() if math.isfinite(strain)), key=lambda s: abs(trials[s] - target))
    if not solved:
        return min(trials) / 4
    near, *others = solved
    slope = max((trials[near] - trials[others[0]]) / math.log(near / others[0]), SLOPE / 4) if others else SLOPE
    return near * math.exp(min(max((target - trials[near]) / slope, -math.log(4)), math.log(4)))


def check_target(strain: float) -> None:
    """Refuse a target that no muscle is made for.

    Raises
    ------
    InputError
        If it is not between 0.05 and 1.5.
    """
    if not 0.05 <= strain <= 1.5:
        raise InputError(f"--strain: {strain:g}; a number from 0.05 to 1.5 is expected.")


def calibrate(
    folder: Path, mesh: Path, muscles: list[str], tissue: str, target: float, say: Callable[[str], None], workers: Workers
) -> dict[str, Found]:
    """Find the stress of each muscle with which it alone reaches a `hencky_von_mises_max`; all muscles take their next step at once.

    Parameters
    ----------
    folder : Path
        Where the run folders go; what is there from an earlier call is taken.
    mesh : Path
        Mesh file.
    muscles : list of str
        Without sides.
    tissue : str
        Preset of the tissue.
    target : float
        The 99th percentile of the von Mises Hencky strain by volume, the largest over the outputs.
    say : callable
        Is told of each run.
    workers : Workers
        Who does the runs.

    Raises
    ------
    SolveError
        If no stress of a muscle could be solved.
    """
    found: dict[str, Found] = {}
    searches = {muscle: search(target) for muscle in muscles}
    asked = {muscle: next(steps) for muscle, steps in searches.items()}
    cases: dict[str, tuple[Scenario, dict[str, Any]]] = {}
    while asked:
        names = {muscle: f"{muscle}-{stress:g}Pa" for muscle, stress in asked.items()}
        for muscle, name in names.items():
            case = solo.scenario(muscle, mesh, tissue, asked[muscle]).model_copy(update={"probes": None})
            cases[name] = case, {"muscle": muscle, "stress_Pa": asked[muscle]}
        ended = results(perform(folder, cases, workers))
        for muscle, name in names.items():
            strain, words = _reached(ended[name])
            stress = asked.pop(muscle)
            say(f"{muscle}: {1e-3 * stress:g} kPa, {words}")
            try:
                asked[muscle] = searches[muscle].send(strain)
            except StopIteration as end:
                found[muscle] = end.value
    return {muscle: found[muscle] for muscle in muscles}


def _reached(run: Run | SolveError) -> tuple[float, str]:
    """The strain of a run, infinite if the stress is too much; and in words."""
    if isinstance(run, SolveError):
        return math.inf, "the solve fails"
    strain, speed = float(run.summary["hencky_von_mises_max"]), float(run.summary["peak_speed_m_s"])
    words = f"strain {strain:.3f}, peak speed {100 * speed:.0f} cm/s"
    return (strain, words) if speed <= FASTEST else (math.inf, f"{words}: too fast")


def write(found: Mapping[str, Found], path: Path, mesh: str, tissue: str, target: float) -> None:
    """Write the stresses and how they were found as a piece of a scenario."""
    text = tomli_w.dumps(table(found, mesh, tissue, target))
    path.write_text("# Peak active stresses in Pa, written by tongue calibrate.\n" + text, encoding="utf-8")


def table(found: Mapping[str, Found], mesh: str, tissue: str, target: float) -> dict[str, Any]:
    """What is written: the stresses as a scenario takes them, and how they were found."""
    return {
        "muscles": {"sigma_max": {muscle: f.stress for muscle, f in found.items()}},
        "calibration": {
            "protocol": f"each muscle alone, 0 to 1 in {1e3 * solo.RISE:g} ms, held to {1e3 * (solo.RISE + solo.HOLD):g} ms",
            "quantity": "hencky_von_mises_max: 99th percentile by volume, largest over the outputs",
            "tissue": tissue,
            "mesh": mesh,
            "target": target,
            "tolerance": TOLERANCE,
            "bound": BOUND,
            "fastest": FASTEST,
            "strain": {muscle: round(f.strain, 3) for muscle, f in found.items()},
            "not_reached_up_to": {muscle: f.limit for muscle, f in found.items() if not f.reached},
            "versions": versions(),
        },
    }
