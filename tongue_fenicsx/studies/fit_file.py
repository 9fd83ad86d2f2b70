# SPDX-License-Identifier: MIT
"""``tongue fit``: a fit from a file, and what it leaves in a folder."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI
from pydantic import Field, ValidationError, field_validator, model_validator

from ..analysis.airway import WALLS, wall_of
from ..analysis.electropalatogram import ELECTRODES, PALATES, electrodes
from ..analysis.tongue_grid import cut
from ..anatomy.subject import Frame, check_axes
from ..core.errors import InputError, reading, within
from ..core.files import at_once
from ..core.parallel import on_rank_zero
from ..core.types import Floats
from ..core.values import UNITS, Flag, Name, NotNegative, OneOf, Positive, Real, Seconds, Share, Vector, explain
from ..geometry.registration import scatter
from ..geometry.surface import read_surface
from ..plotting.fit_sheet import draw_fit
from ..reduced.tongue import ReducedTongue
from ..runs.run import Run
from ..scenario.build import activation_of, inputs_of, simulation_of
from ..scenario.files import dump, read_toml, scenario_of
from ..scenario.schema import Scenario, Section
from ..simulation.probes import Probes
from ..simulation.simulation import Simulation
from . import fitting
from .articulography import ALIGNMENTS, Recording, Timing, behind_tip, lay
from .fitting import Fit, Search, Surrogate
from .goals import Constriction, Contour, Cover, Goal, Touch, Track, Within, outline_of, skin_of
from .openness import Openness, by_reduced, by_runs, nearby, openness
from .pool import Workers, perform, results
from .sweep_file import base_of

BEST, PROGRESS, OPEN, SHEET = "best.toml", "fit.csv", "open.csv", "fit.png"
"""The scenario with the activations found so far, how the search went, what the data leave open, and a picture of all."""
RUN, NEARBY = "run", "nearby"
"""Folders of the run of the best, and of those beside it."""
REACH_FOR = 18.0
"""In mm: points of the surface that may reach an electrode are so near at rest."""
Span = tuple[float, float]
Columns = Annotated[list[str], Field(min_length=3, max_length=3)]
JAW = "mandible"
"""The bone that a sensor on the lower teeth moves; it turns about an axis to the left, so that opening is positive."""
BEGINS = ("flat", "live")
JAWS = frozenset({"lower_teeth", "mandible"})
"""Obstacles that move with the jaw of a recording."""
MM = 1e-3


class TargetSection(Section):
    """Where a probe should be: a table with time in s and displacement from rest, backward, to the right and up."""

    table: str
    unit: Annotated[str, OneOf(names=UNITS)] = "mm"


class PointSection(Section):
    """Bounds in mm of the displacement of a probe, backward, to the right and up."""

    x: Span | None = None
    y: Span | None = None
    z: Span | None = None


class ConstrictionSection(Section):
    """How near the tongue should come to walls of the airway in the mid-sagittal plane, in mm, and where along x."""

    walls: list[Name]
    degree: Span
    x: Span | None = None


class ContourSection(Section):
    """A mid-sagittal contour: a table of x and z."""

    table: str
    unit: Annotated[str, OneOf(names=UNITS)] = "mm"


class SurfaceSection(Section):
    """The whole surface, or a part of it, in the frame of the tongue, and how many places spread over it count."""

    file: str
    unit: Annotated[str, OneOf(names=UNITS)] = "mm"
    places: Annotated[int, Real(low=10, high=5000, whole=True)] = 400


class TouchSection(Section):
    """Electrodes of the palate that should be touched: rows from the front, columns from the left, counted from 1."""

    rows: list[Annotated[int, Real(low=1, high=8, whole=True)]]
    columns: list[Annotated[int, Real(low=1, high=8, whole=True)]] | None = None


class SensorSection(Section):
    """A sensor glued to the tongue: the columns of its place, and where it is on ours: so many mm behind the tip along the mid-line of the
    dorsum, or at a point in mm of the rest shape or a landmark."""

    columns: Columns
    behind_tip: NotNegative | None = None
    at: Annotated[str | Sequence[float], Vector(named=True)] | None = None

    @model_validator(mode="after")
    def _one_place(self) -> SensorSection:
        if (self.behind_tip is None) == (self.at is None):
            raise ValueError("either behind_tip, in mm, or at, a point in mm or a landmark, is expected")
        return self


class JawSection(Section):
    """A sensor glued to the lower teeth, which tells how the jaw turns about the transverse axis through `centre` (mm)."""

    columns: Columns
    centre: Annotated[Sequence[float], Vector()]


class RecordingSection(Section):
    """Sensors on a speaker: the table, where its axes point, when in it the tongue is at rest, when the movement begins, and how long
    before that the run begins, at rest; times in s."""

    table: str
    sensor: Mapping[Name, SensorSection]
    jaw: JawSection | None = None
    time: str = "time_s"
    unit: Annotated[str, OneOf(names=UNITS)] = "mm"
    axes: str = "PRS"
    rest: NotNegative = 0.0
    begin: NotNegative | None = None
    lead: Seconds = 0.1
    align: Annotated[str, OneOf(names=ALIGNMENTS)] = "rigid"
    lateral: Flag = False

    @field_validator("axes")
    @classmethod
    def _known(cls, axes: str) -> str:
        check_axes(axes)
        return axes


class FitFile(Section):
    """A scenario, the muscles that may act in it, and what probes, outline and palate should do."""

    base: Any
    muscles: list[Name]
    knots: Seconds = 0.05
    hold: Flag = False
    since: NotNegative = 0.0
    most: Share = 1.0
    begin: Annotated[str, OneOf(names=BEGINS)] = "flat"
    effort: NotNegative = 1e-2
    haste: NotNegative = 1e-2
    rounds: Annotated[int, Real(low=1, high=100, whole=True)] = 6
    iterations: Annotated[int, Real(low=0, high=10_000, whole=True)] = 30
    noise: Positive = 0.5
    target: Mapping[Name, TargetSection] = {}
    point: Mapping[Name, PointSection] = {}
    constriction: Mapping[Name, ConstrictionSection] = {}
    contour: Mapping[Name, ContourSection] = {}
    surface: Mapping[Name, SurfaceSection] = {}
    touch: Mapping[Name, TouchSection] = {}
    recording: RecordingSection | None = None

    @property
    def aims(self) -> list[str]:
        """Names of all that is to be reached."""
        sensors = self.recording.sensor if self.recording else ()
        return [*self.target, *self.point, *self.constriction, *self.contour, *self.surface, *self.touch, *sensors]


@dataclass(frozen=True)
class Task:
    """A fit that is to be done."""

    file: FitFile
    scenario: Scenario
    paths: Mapping[str, Track]
    contours: Mapping[str, Floats]
    surfaces: Mapping[str, Floats]
    recording: Recording | None = None

    def search(self, goals: Mapping[str, Goal]) -> Search:
        """What is sought, with these goals."""
        terms = {name: getattr(self.file, name) for name in ("hold", "since", "most", "effort", "haste")}
        return Search(goals, self.file.muscles, self.knots, **terms)

    @property
    def knots(self) -> Floats:
        """Times in s, from 0 to the end, at least as dense as the file says; of a level that is held, its rise and the end."""
        end = self.scenario.time.end
        if self.file.hold:
            return np.array([0.0, min(self.file.knots, end / 2), end])
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
    if not file.aims or not file.muscles:
        raise InputError(f"{path}: {'muscles' if file.aims else 'target'}: at least one is expected.")
    if len(set(file.aims)) < len(file.aims):
        raise InputError(f"{path}: two of {', '.join(sorted(file.aims))} have one name; names of their own are expected.")
    paths, contours = {}, {}
    for name, section in file.target.items():
        table = path.parent / section.table
        rows = _rows_of(table, 4, "four columns, time in s and displacement backward, to the right and up,")
        with within(table):
            paths[name] = Track(rows[:, 0], UNITS[section.unit] * rows[:, 1:], name)
    recording = None
    if (told := file.recording) is not None:
        columns = {name: sensor.columns for name, sensor in told.sensor.items()} | ({JAW: told.jaw.columns} if told.jaw else {})
        recording = Recording.read(path.parent / told.table, told.time, columns, Frame(told.unit, told.axes))
    for name, drawn in file.contour.items():
        contours[name] = 1e3 * UNITS[drawn.unit] * _rows_of(path.parent / drawn.table, 2, "two columns, backward and up,")
    surfaces = {
        name: 1e3 * UNITS[whole.unit] * scatter(read_surface(path.parent / whole.file), whole.places)
        for name, whole in file.surface.items()
    }
    return Task(file, scenario_of(*base_of(file.base, path, changes), f"{path}: base"), paths, contours, surfaces, recording)


def glue(task: Task, output: Path, say: Callable[[str], object]) -> Task:
    """A task whose scenario has the sensors of a recording as probes, and the jaw's motion, and whose paths are theirs too; says how the
    speaker was laid on the tongue.

    Raises
    ------
    InputError
        If a sensor has no place on the tongue, or the jaw moves already.
    """
    told, recording = task.file.recording, task.recording
    if told is None or recording is None:
        return task
    output.mkdir(parents=True, exist_ok=True)
    simulation = simulation_of(task.scenario, output)
    tongue = simulation.model.tongue
    glued = {}
    for name, sensor in told.sensor.items():
        if sensor.behind_tip is not None:
            glued[name] = behind_tip(tongue, MM * sensor.behind_tip)
        elif isinstance(sensor.at, str):
            glued[name] = Probes(tongue, {name: sensor.at}).rest[name]
        else:
            glued[name] = MM * np.array(sensor.at)
    timing = Timing(told.rest if told.begin is None else told.begin, told.lead)
    laid, apart = lay(recording, told.rest, glued, told.align)
    turn = np.degrees(np.arctan2(laid.rotation[0, 2], laid.rotation[0, 0]))
    say(f"recording: turned by {turn:.1f}°, scaled by {laid.scale:.2f}; at rest the sensors lie {1e3 * apart:.1f} mm from their points")
    data = task.scenario.model_dump(exclude_none=True)
    data["probes"] = {name: list(point) for name, point in (simulation.probes.rest | glued).items()}
    if told.jaw:
        if JAW in task.scenario.boundary.moving:
            raise InputError(f"recording.jaw: the {JAW} moves already, in boundary.moving; one of both is expected.")
        centre = MM * np.array(told.jaw.centre)
        pieces = recording.jaw(JAW, laid, told.rest, timing, centre)
        data["boundary"]["fixed"] = [name for name in data["boundary"]["fixed"] if name != JAW]
        data["boundary"]["moving"] = data["boundary"].get("moving", {}) | {
            JAW: {"angle": pieces, "centre": list(centre), "axis": [0.0, -1.0, 0.0]}
        }
        for name in JAWS & data["contact"].keys():
            data["contact"][name]["moves_with"] = JAW
    paths = recording.tracks(list(glued), laid, told.rest, timing, told.lateral)
    file = task.file.model_copy(update={"since": max(task.file.since, told.lead)})
    return replace(task, file=file, scenario=Scenario.model_validate(data), paths={**task.paths, **paths})


def _rows_of(table: Path, columns: int, what: str) -> Floats:
    """A table of numbers in so many columns; a first line of names is skipped."""
    with reading(table, what):
        lines = [line for line in table.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
        rows = np.loadtxt(lines[1:] if lines and lines[0].lstrip()[:1].isalpha() else lines, delimiter=",", ndmin=2)
        if rows.shape[1] != columns or len(rows) == 0 or not np.isfinite(rows).all():
            raise ValueError(f"{rows.shape[1]} columns")
        return np.asarray(rows)


def goals_of(task: Task, simulation: Simulation) -> dict[str, Goal]:
    """What is to be reached, of a simulation's tongue and walls.

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
    goals |= {name: Cover(skin, triangles, places) for name, places in task.surfaces.items()}
    if file.constriction or file.contour:
        outline = outline_of(tongue)
    walls = {name: cut(surface) for name, surface in surfaces.items() if name in WALLS}
    for name, narrow in file.constriction.items():
        for wall in narrow.walls:
            if wall not in walls:
                raise InputError(f"constriction.{name}: no contact with a wall {wall!r}; there is {', '.join(walls) or 'none'}.")
        places, part = wall_of(walls, 1e3 * outline.points[:, [0, 2]].mean(axis=0))
        low, high = narrow.x or (-np.inf, np.inf)
        there = places[np.isin(part, narrow.walls) & (low <= places[:, 0]) & (places[:, 0] <= high)]
        if len(there) == 0:
            raise InputError(f"constriction.{name}: no place of {', '.join(narrow.walls)} has an x from {low:g} to {high:g} mm.")
        goals[name] = Constriction(outline, there, narrow.degree)
    goals |= {name: Contour(outline, places) for name, places in task.contours.items()}
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


def fit(task: Task, output: Path, report: Callable[[Fit], object]) -> Fit:
    """Fit, leave the best so far in the folder whenever it is better, and the run of the best at the end; goes on from what is there."""
    output.mkdir(parents=True, exist_ok=True)
    scenario, file, rank = task.scenario, task.file, MPI.COMM_WORLD.rank
    goals = goals_of(task, plain := simulation_of(scenario, output))
    simulation, search = fitting.following(plain, goals), task.search(goals)
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

    if file.begin == "live":
        surrogate = Surrogate(ReducedTongue.shipped(scenario.tissue.preset), search, simulation.probes.rest)
        found = fitting.correct(simulation, surrogate, start or fitting.guess(surrogate), given=given, rounds=file.rounds, report=keep)
        start = found.levels
    if file.begin != "live" or file.iterations > 0:
        found = fitting.fit(simulation, search, given=given, start=start, iterations=file.iterations, report=keep)
    last = _with(scenario, found)
    inputs = inputs_of(last, simulation.model.tongue)
    plain.run(activation_of(last), scenario.time.end, output / RUN, overwrite=True, inputs=inputs)
    return found


def look_around(task: Task, found: Fit, output: Path, workers: Workers) -> Openness:
    """What the tables leave open, as the reduced tongue says where a fit began with it, else by runs beside that of the fit; leaves a table
    and a picture.

    Raises
    ------
    SolveError
        If one of the runs fails.
    """
    run = Run(output / RUN)
    if task.file.begin == "live":
        tongue = ReducedTongue.shipped(task.scenario.tissue.preset)
        slopes = by_reduced(found, task.paths, Surrogate(tongue, task.search(task.paths), {name: run.rest[name] for name in task.paths}))
    else:
        cases = {name: (_with(task.scenario, replace(found, levels=levels)), {"moved": name}) for name, levels in nearby(found)}
        slopes = by_runs(found, task.paths, run, results(perform(output / NEARBY, cases, workers)))

    def look() -> Openness:
        known = openness(found, task.paths, task.file.noise, slopes)
        known.write(output / OPEN)
        levels = {}
        for name, at in found.levels.items():
            low, high = (np.append(0.0, np.broadcast_to(bound, len(at) - 1)) for bound in known.interval(name))
            levels[name] = at, low, high
        paths = {name: (path.times, np.asarray(path.displacement)) for name, path in task.paths.items()}
        draw_fit(run, found.knots, levels, paths, found.distance, output / SHEET)
        return known

    known: Openness = on_rank_zero(MPI.COMM_WORLD, look)
    return known


def farthest(task: Task, output: Path) -> dict[str, tuple[float, float]]:
    """How far each probe is at most from its path in the run of the best, in mm, and when, in s."""
    run, most = Run(output / RUN), {}
    counts = run.time > task.file.since
    for name, path in task.paths.items():
        away = 1e3 * np.linalg.norm(run.probes[name] - np.array([path.at(t) for t in run.time]), axis=1) * counts
        most[name] = float(away.max()), float(run.time[away.argmax()])
    return most


def _with(scenario: Scenario, found: Fit) -> Scenario:
    """A scenario with the activations that were found."""
    data = scenario.model_dump(exclude_none=True)
    for name, course in found.activation.items():
        data["activation"][name] = {"pieces": course.description(found.knots[-1])}
    return Scenario.model_validate(data)
