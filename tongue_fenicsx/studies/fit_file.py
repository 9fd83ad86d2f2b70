# SPDX-License-Identifier: MIT
"""``tongue fit``: a fit from a file, and what it leaves in a folder."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI
from pydantic import ValidationError

from ..core.errors import InputError, reading, within
from ..core.files import at_once
from ..core.parallel import on_rank_zero
from ..core.types import Floats
from ..core.values import UNITS, Name, NotNegative, OneOf, Positive, Real, Seconds, explain
from ..plotting.fit_sheet import draw_fit
from ..runs.run import Run
from ..scenario.build import activation_of, inputs_of, simulation_of
from ..scenario.files import dump, read_toml, scenario_of
from ..scenario.schema import Scenario, Section
from . import fitting
from .fitting import Fit
from .openness import Openness, nearby, openness
from .pool import Workers, perform, results
from .sweep_file import base_of

BEST, PROGRESS, OPEN, SHEET = "best.toml", "fit.csv", "open.csv", "fit.png"
"""The scenario with the activations found so far, how the search went, what the data leave open, and a picture of all."""
RUN, NEARBY = "run", "nearby"
"""Folders of the run of the best, and of those beside it."""


class TargetSection(Section):
    """Where a probe should be: a table with time in s and displacement from rest, backward, to the right and up."""

    table: str
    unit: Annotated[str, OneOf(names=UNITS)] = "mm"


class FitFile(Section):
    """A scenario, the muscles that may act in it, and where probes should be."""

    base: Any
    muscles: list[Name]
    knots: Seconds = 0.05
    effort: NotNegative = 1e-2
    haste: NotNegative = 1e-2
    iterations: Annotated[int, Real(low=1, high=10_000, whole=True)] = 30
    noise: Positive = 0.5
    target: Mapping[Name, TargetSection]


@dataclass(frozen=True)
class Task:
    """A fit that is to be done."""

    file: FitFile
    scenario: Scenario
    paths: Mapping[str, fitting.Track]

    @property
    def knots(self) -> Floats:
        """Times in s, from 0 to the end, at least as dense as the file says."""
        end = self.scenario.time.end
        return np.linspace(0.0, end, int(np.ceil(end / self.file.knots - 1e-9)) + 1)


def read(path: Path, changes: list[str] | None = None) -> Task:
    """Read a fit; paths in it are relative to it.

    Raises
    ------
    InputError
        If a file cannot be read, or a key or value is not accepted.
    """
    try:
        file = FitFile.model_validate(read_toml(path, "a fit in TOML"))
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, FitFile)}") from error
    if not file.target or not file.muscles:
        raise InputError(f"{path}: {'muscles' if file.target else 'target'}: at least one is expected.")
    paths = {name: _path_of(path.parent / section.table, UNITS[section.unit]) for name, section in file.target.items()}
    return Task(file, scenario_of(*base_of(file.base, path, changes), f"{path}: base"), paths)


def _path_of(table: Path, unit: float) -> fitting.Track:
    """A table of four columns; a first line of names is skipped."""
    with reading(table, "four columns, time in s and displacement backward, to the right and up,"):
        lines = [line for line in table.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
        rows = np.loadtxt(lines[1:] if lines and lines[0].lstrip()[:1].isalpha() else lines, delimiter=",", ndmin=2)
        if rows.shape[1] != 4 or len(rows) == 0:
            raise ValueError(f"{rows.shape[1]} columns")
        with within(table):
            return fitting.Track(rows[:, 0], unit * rows[:, 1:])


def fit(task: Task, output: Path, report: Callable[[Fit], object]) -> Fit:
    """Fit, leave the best so far in the folder whenever it is better, and the run of the best at the end; goes on from what is there."""
    output.mkdir(parents=True, exist_ok=True)
    scenario, file, rank = task.scenario, task.file, MPI.COMM_WORLD.rank
    simulation = simulation_of(scenario, output)
    given = {name: course for name, course in activation_of(scenario).items() if name not in file.muscles}
    best = scenario_of(read_toml(output / BEST, "a scenario"), output, str(output / BEST)) if (output / BEST).exists() else None
    start = {} if best is None else {n: np.array([c(t) for t in task.knots]) for n, c in activation_of(best).items() if n in file.muscles}

    def keep(found: Fit) -> None:
        if rank == 0:
            with at_once(output / BEST) as path:
                path.write_text(dump(_with(scenario, found)), encoding="utf-8")
            new = not (output / PROGRESS).exists()
            with open(output / PROGRESS, "a", newline="", encoding="utf-8") as table:
                writer = csv.writer(table)
                if new:
                    writer.writerow(["evaluation", "objective_mm2", *(f"{name}_mm" for name in found.distance)])
                writer.writerow([found.evaluations, f"{found.objective:.6g}", *(f"{d:.6g}" for d in found.distance.values())])
            report(found)

    found = fitting.fit(
        simulation, task.paths, file.muscles, task.knots, effort=file.effort, haste=file.haste, given=given, start=start,
        iterations=file.iterations, report=keep,
    )  # fmt: skip
    last = _with(scenario, found)
    inputs = inputs_of(last, simulation.model.tongue)
    simulation.run(activation_of(last), scenario.time.end, output / RUN, overwrite=True, inputs=inputs)
    return found


def look_around(task: Task, found: Fit, output: Path, workers: Workers) -> Openness:
    """What the data leave open, by runs beside that of a fit; leaves a table and a picture.

    Raises
    ------
    SolveError
        If one of them fails.
    """
    cases = {name: (_with(task.scenario, replace(found, levels=levels)), {"moved": name}) for name, levels in nearby(found)}
    moved = results(perform(output / NEARBY, cases, workers))
    run = Run(output / RUN)

    def look() -> Openness:
        known = openness(found, task.paths, task.file.noise, run, moved)
        known.write(output / OPEN)
        levels = {}
        for name, at in found.levels.items():
            low, high = known.interval(name)
            levels[name] = at, np.insert(low, 0, 0.0), np.insert(high, 0, 0.0)
        paths = {name: (path.times, np.asarray(path.displacement)) for name, path in task.paths.items()}
        draw_fit(run, found.knots, levels, paths, found.distance, output / SHEET)
        return known

    known: Openness = on_rank_zero(MPI.COMM_WORLD, look)
    return known


def farthest(task: Task, output: Path) -> dict[str, tuple[float, float]]:
    """How far each probe is at most from its path in the run of the best, in mm, and when, in s."""
    run, most = Run(output / RUN), {}
    for name, path in task.paths.items():
        away = 1e3 * np.linalg.norm(run.probes[name] - np.array([path.at(t) for t in run.time]), axis=1)
        most[name] = float(away.max()), float(run.time[away.argmax()])
    return most


def _with(scenario: Scenario, found: Fit) -> Scenario:
    """A scenario with the activations that were found."""
    data = scenario.model_dump(exclude_none=True)
    for name, course in found.activation.items():
        data["activation"][name] = {"pieces": course.description(found.knots[-1])}
    return Scenario.model_validate(data)
