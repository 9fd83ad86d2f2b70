# SPDX-License-Identifier: MIT
"""``tongue fit``: a fit that a file tells, and what it leaves in a folder."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from ..analysis.airway import WALLS, wall_of
from ..analysis.electropalatogram import ELECTRODES, PALATES, electrodes
from ..analysis.tongue_grid import cut
from ..analysis.trajectories import write_places
from ..core.errors import InputError, SolveError, check_outputs, reading
from ..core.files import at_once
from ..core.parallel import on_rank_zero
from ..core.types import Floats
from ..geometry.surface import Surface
from ..plotting.fit_sheet import draw_contours, draw_fit
from ..reduced.tongue import ReducedTongue
from ..runs.run import Run
from ..runs.writer import SUMMARY
from ..scenario.build import activation_of, inputs_of, simulation_of
from ..scenario.files import dump, read_toml, scenario_of
from ..scenario.schema import Scenario
from ..simulation.probes import Probes
from ..simulation.simulation import Simulation
from . import fitting
from .articulography import behind_tip, lay
from .beside import BASE, Beside, nearby
from .fit_file import JAW, TOOTH, Task
from .fitting import OPENING, Fit, Opening, Surrogate
from .goals import Constriction, Contour, Cover, Goal, Touch, Within, outline_of, skin_of
from .openness import Openness, by_reduced, measured, openness
from .pool import Workers, perform, results
from .shapes import spread, spread_in_plane

BEST, PROGRESS, OPEN, SHEET, PATHS, CONTOURS = "best.toml", "fit.csv", "open.csv", "fit.png", "paths.csv", "contours.png"
"""The scenario with the activations found so far, how the search went, what the data leave open, a picture of all, where points should be,
and a picture of contours."""
TOLD = "fit.json"
"""What is looked for in a folder, as fingerprints."""
RUN, NEARBY = "run", "nearby"
"""Folders of the run of the best, and of those beside it."""
REACH_FOR = 18.0
"""In mm: points of the surface that may reach an electrode are so near at rest."""
JAWS = frozenset({"lower_teeth", "mandible"})
"""Obstacles that move with the jaw of a recording."""
MM = 1e-3
UPSIDE, ASTRAY = 90.0, 15e-3
"""In degrees and in m: a speaker who had to be turned so far, or whose sensors lie so far from their points, has other axes or units."""


def begin(task: Task, output: Path, overwrite: bool) -> None:
    """Make sure that a folder holds nothing but what the same fit has left; on one rank alone.

    Parameters
    ----------
    task : Task
        As it was read.
    output : Path
        The folder.
    overwrite : bool
        Take out what another fit has left.

    Raises
    ------
    InputError
        If the folder cannot be written, or holds a run or another fit.
    """
    left = (BEST, PROGRESS, OPEN, SHEET, PATHS, CONTOURS, TOLD)
    check_outputs(output, left)
    if (output / SUMMARY).exists():
        raise InputError(f"{output}: holds a run; another folder is expected.")
    if overwrite:
        for name in left:
            (output / name).unlink(missing_ok=True)
    if (path := output / TOLD).exists():
        with reading(path, "what a fit has left"):
            before = dict(json.loads(path.read_text(encoding="utf-8")))
        if differs := sorted(key for key, told in task.told.items() if told != before.get(key)):
            raise InputError(f"{output}: holds a fit with another {', '.join(differs)}; --overwrite replaces it, another folder leaves it.")


def glue(task: Task, say: Callable[[str], object]) -> Task:
    """A task whose scenario has the sensors of a recording as probes, and the jaw's motion, and whose paths are theirs too; says how the
    speaker was laid on the tongue.

    Raises
    ------
    InputError
        If a sensor has no place on the tongue.
    """
    told, recording = task.file.recording, task.recording
    if (opening := task.file.opening) is not None:
        data = task.scenario.model_dump(exclude_none=True)
        _turn_jaw(data, [(opening.rise, 0.0, 0.0)], opening.centre)
        task = replace(task, scenario=Scenario.model_validate(data))
    if told is None or recording is None:
        return task
    simulation = simulation_of(task.scenario, Path())
    tongue = simulation.model.tongue
    glued = {}
    for name, sensor in told.sensor.items():
        if sensor.behind_tip is not None:
            glued[name] = behind_tip(tongue, MM * sensor.behind_tip)
        elif isinstance(sensor.at, str):
            glued[name] = Probes(tongue, {name: sensor.at}).rest[name]
        else:
            glued[name] = MM * np.array(sensor.at)
    laid, apart = lay(recording, glued, told.align)
    turn = np.degrees(np.arctan2(laid.rotation[0, 2], laid.rotation[0, 0]))
    how = f"turned by {turn:.1f}°, scaled by {laid.scale:.2f}; at rest the sensors lie {1e3 * apart:.1f} mm from their points"
    if abs(turn) > UPSIDE or apart > ASTRAY:
        raise InputError(f"recording: {how}; its unit, its axes, when it is at rest and where the sensors are glued are expected to agree.")
    say(f"recording: {how}")
    data = task.scenario.model_dump(exclude_none=True)
    data["probes"] = {name: list(point) for name, point in (simulation.probes.rest | glued).items()}
    if told.jaw:
        _turn_jaw(data, recording.jaw(TOOTH, laid, MM * np.array(told.jaw.centre)), told.jaw.centre)
    paths = recording.tracks(glued, laid, told.lateral)
    file = task.file.model_copy(update={"since": max(task.file.since, told.lead)})
    return replace(task, file=file, scenario=Scenario.model_validate(data), paths={**task.paths, **paths})


def _turn_jaw(data: dict[str, Any], pieces: Sequence[tuple[float, float, float]], centre: Sequence[float]) -> None:
    """Let the jaw of a scenario turn about the transverse axis through `centre` (mm), and the obstacles with it that are part of it."""
    data["boundary"]["fixed"] = [name for name in data["boundary"]["fixed"] if name != JAW]
    motion = {"angle": list(pieces), "centre": [MM * x for x in centre], "axis": [0.0, -1.0, 0.0]}
    data["boundary"]["moving"] = data["boundary"].get("moving", {}) | {JAW: motion}
    for name in JAWS & data["contact"].keys():
        data["contact"][name]["moves_with"] = JAW


def goals_of(task: Task, simulation: Simulation, say: Callable[[str], object]) -> dict[str, Goal]:
    """What is to be reached, of a simulation's tongue and walls; says how surfaces were laid on the tongue.

    Raises
    ------
    InputError
        If it has no such wall or the tongue no mid-plane.
    """
    file, surfaces = task.file, {name: contact.obstacle.surface for name, contact in simulation.model.contacts.items()}
    goals: dict[str, Goal] = dict(task.paths)
    for name, bounds in file.point.items():
        low, high = np.transpose([span or (-np.inf, np.inf) for span in (bounds.x, bounds.y, bounds.z)])
        goals[name] = Within(name, low, high)
    if not (file.constriction or file.contour or file.touch or file.surface):
        return goals
    skin, triangles = skin_of(tongue := simulation.model.tongue)
    if file.constriction or file.contour or any(whole.midsagittal for whole in file.surface.values()):
        outline = outline_of(tongue)
    for name, shape in task.surfaces.items():
        whole = file.surface[name]
        laid, how = shape.on(Surface(skin, triangles))
        say(f"{name}: {how}")
        if whole.midsagittal:
            goals[name] = Contour(outline, spread_in_plane(laid, whole.places, name), whole.free)
        else:
            goals[name] = Cover(skin, triangles, spread(laid, whole.places))
    walls = {name: cut(surface) for name, surface in surfaces.items() if name in WALLS}
    for name, narrow in file.constriction.items():
        for wall in narrow.walls:
            if wall not in walls:
                known = f"there is {', '.join(walls)}" if walls else "the base has none, such as [contact.palate]"
                raise InputError(f"constriction.{name}: no contact with a wall {wall!r}; {known}.")
        places, part = wall_of(walls, 1e3 * outline.points[:, [0, 2]].mean(axis=0))
        low, high = narrow.x or (-np.inf, np.inf)
        there = places[np.isin(part, narrow.walls) & (low <= places[:, 0]) & (places[:, 0] <= high)]
        if len(there) == 0:
            raise InputError(f"constriction.{name}: no place of {', '.join(narrow.walls)} has an x from {low:g} to {high:g} mm.")
        goals[name] = Constriction(outline, there, narrow.degree)
    goals |= {name: Contour(outline, places, file.contour[name].free) for name, places in task.contours.items()}
    for name, wanted in file.touch.items():
        palate = next((surfaces[wall] for wall in PALATES if wall in surfaces), None)
        if palate is None:
            raise InputError(f"touch.{name}: no contact with a palate; one called {', '.join(sorted(PALATES))} is expected.")
        columns = wanted.columns or range(1, 9)
        chosen = [row + 1 in wanted.rows and column + 1 in columns for row, column in ELECTRODES]
        places = 1e3 * electrodes(palate)[chosen]
        near = [np.linalg.norm(1e3 * point - places, axis=1).min() < REACH_FOR for point in skin]
        goals[name] = Touch(skin[near], places)
    return goals


class FitRun:
    """A fit and what it leaves in its folder, which may hold an earlier one's best: it goes on from there.

    Parameters
    ----------
    task : Task
        Glued.
    output : Path
        The folder.
    report : callable
        Takes the best so far, whenever it is better.
    say : callable
        Takes sentences.

    Raises
    ------
    InputError
        If a goal, a muscle or the mesh does not fit.
    """

    def __init__(self, task: Task, output: Path, report: Callable[[Fit], object], say: Callable[[str], object]) -> None:
        self.task, self.output, self.report = task, output, report
        scenario, told = task.scenario, task.file.opening
        self._plain = simulation_of(scenario, output)
        self._goals = goals_of(task, self._plain, say)
        turning = self._plain.model.moving.get(JAW)
        self.opening = Opening(JAW, turning, told.rise, told.most) if told and turning else None
        self._simulation = fitting.following(self._plain, self._goals)
        self._search = task.search(self._goals, self.opening)
        self._given = {name: course for name, course in activation_of(scenario).items() if name not in task.file.muscles}

    @cached_property
    def _surrogate(self) -> Surrogate:
        return Surrogate(ReducedTongue.shipped(self.task.scenario.tissue.preset), self._search, self._simulation.probes.rest)

    def seek(self) -> Fit:
        """Search as the file says, and leave the best so far whenever it is better."""
        file, output = self.task.file, self.output
        best = scenario_of(read_toml(output / BEST, "a scenario"), output, str(output / BEST)) if (output / BEST).exists() else None
        angle = best.boundary.moving[JAW].angle[-1][2] if self.opening and best and JAW in best.boundary.moving else 0.0
        courses = {} if best is None else {name: course for name, course in activation_of(best).items() if name in file.muscles}
        start = {name: np.array([course(t) for t in self.task.knots]) for name, course in courses.items()}
        if file.begin == "live":
            found = self._correct(start or fitting.guess(self._surrogate), angle)
            start = found.levels
        if file.begin != "live" or file.iterations > 0:
            search, given = self._search, self._given
            found = fitting.fit(self._simulation, search, given=given, start=start, iterations=file.iterations, report=self._keep)
        return found

    def _correct(self, start: Mapping[str, Floats], angle: float, slopes: Floats | None = None) -> Fit:
        return fitting.correct(
            self._simulation,
            self._surrogate,
            start,
            given=self._given,
            angle=angle,
            rounds=self.task.file.rounds,
            slopes=slopes,
            report=self._keep,
        )

    def _keep(self, found: Fit) -> None:
        if MPI.COMM_WORLD.rank == 0:
            with at_once(self.output / TOLD) as path:
                path.write_text(json.dumps(self.task.told, indent=2) + "\n", encoding="utf-8")
            with at_once(self.output / BEST) as path:
                path.write_text(dump(self._with(found), self.output), encoding="utf-8")
            new = not (self.output / PROGRESS).exists()
            with open(self.output / PROGRESS, "a", newline="", encoding="utf-8") as table:
                writer = csv.writer(table)
                if new:
                    writer.writerow(["evaluation", "objective_mm2", *(f"{name}_mm" for name in found.distance)])
                writer.writerow([found.evaluations, f"{found.objective:.6g}", *(f"{d:.6g}" for d in found.distance.values())])
            self.report(found)

    def _with(self, found: Fit) -> Scenario:
        """The scenario with the activations that were found, and the opening."""
        data = self.task.scenario.model_dump(exclude_none=True)
        for name, course in found.activation.items():
            data["activation"][name] = {"pieces": course.description(found.knots[-1])}
        if self.opening is not None:
            data["boundary"]["moving"][JAW]["angle"] = self.opening.motion_by(found.angle).angle
        return Scenario.model_validate(data)

    def look_beside(self, found: Fit, workers: Workers) -> Beside:
        """The runs of the full tongue whose derivatives are needed: none for levels where the reduced one's are taken."""
        file, runs = self.task.file, dict[str, Run | SolveError]()
        moved = {name: fit for name, (fit, _) in nearby(found, self._search).items() if name == OPENING or not file.by_reduced}
        if moved and self.task.paths:
            cases = {name: (self._with(fit), {"moved": name}) for name, fit in {BASE: found, **moved}.items()}
            runs = results(perform(self.output / NEARBY, cases, workers))
        return Beside(found, self._search, runs)

    def finish(self, beside: Beside) -> Fit:
        """Go on with derivatives of the full tongue, from what the runs are beside.

        Raises
        ------
        SolveError
            If one of the runs failed.
        """
        slopes = np.array(list(beside.slopes(self._surrogate.along).values()))
        return self._correct(beside.found.levels, beside.found.angle, slopes)

    def leave(self, found: Fit) -> None:
        """Leave the run of a fit, with a picture of contours."""
        last, plain, folder = self._with(found), self._plain, self.output / RUN
        if self.opening:
            self.opening.move(plain, found.angle)
        plain.run(activation_of(last), last.time.end, folder, overwrite=True, inputs=inputs_of(last, plain.model.tongue))
        if contours := {name: goal for name, goal in self._goals.items() if isinstance(goal, Contour)}:
            on_rank_zero(MPI.COMM_WORLD, lambda: _draw(Run(folder), contours, found, self.output / CONTOURS))

    def slopes(self, found: Fit, beside: Beside) -> Floats:
        """Derivatives (n_numbers, n_measurements) in mm of what the tables have, from `beside` or, if those are taken, the reduced tongue.

        Raises
        ------
        SolveError
            If one of the runs failed.
        """
        paths = self.task.paths
        by_runs = np.array(list(beside.slopes(lambda run: measured(paths, run)).values()))
        if not self.task.file.by_reduced:
            return by_runs
        places = {name: self._simulation.probes.rest[name] for name in paths}
        slopes = by_reduced(found, paths, replace(self._surrogate, search=self.task.search(paths, self.opening), probes=places))
        if len(by_runs):
            slopes[-len(by_runs) :] = by_runs
        return slopes

    def look_around(self, found: Fit, beside: Beside) -> Openness:
        """What the tables leave open; leaves a table and a picture. Raises as `slopes` does."""
        paths, run, slopes = self.task.paths, Run(self.output / RUN), self.slopes(found, beside)

        def look() -> Openness:
            known = openness(found, paths, self.task.file.noise, slopes, self.opening)
            known.write(self.output / OPEN)
            levels = {}
            for name, at in found.levels.items():
                low, high = (np.append(0.0, np.broadcast_to(bound, len(at) - 1)) for bound in known.interval(name))
                levels[name] = at, low, high
            wanted = {name: (path.times, np.asarray(path.displacement)) for name, path in paths.items()}
            write_places({name: (times, run.rest[name] + u) for name, (times, u) in wanted.items()}, self.output / PATHS)
            draw_fit(run, found.knots, levels, wanted, found.distance, self.output / SHEET)
            return known

        known: Openness = on_rank_zero(MPI.COMM_WORLD, look)
        return known


def _draw(run: Run, contours: Mapping[str, Contour], found: Fit, path: Path) -> None:
    """Contours where they are laid at the end of a run."""
    nodes, moved = cKDTree(run.mesh[0]), run.field("displacement")
    laid = {}
    for name, goal in contours.items():
        ends = moved[nodes.query(goal.outline.points)[1]]
        laid[name] = goal.laid(dict(zip(goal.points, ends, strict=True))), found.distance[name]
    draw_contours(run, laid, path)


def farthest(task: Task, output: Path) -> dict[str, tuple[float, float]]:
    """How far each probe is at most from its path in the run of the best, in mm, and when, in s."""
    run, most = Run(output / RUN), {}
    counts = run.time > task.file.since
    for name, path in task.paths.items():
        away = 1e3 * np.linalg.norm(run.probes[name] - np.array([path.at(t) for t in run.time]), axis=1) * counts
        most[name] = float(away.max()), float(run.time[away.argmax()])
    return most
