# SPDX-License-Identifier: MIT
"""What a file for ``tongue fit`` says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, ValidationError, model_validator

from ..anatomy.subject import Frame, check_axes
from ..core.errors import InputError, reading, within
from ..core.fingerprint import fingerprint
from ..core.number_tables import numbers_in
from ..core.types import Floats
from ..core.values import UNITS, Flag, Name, NotNegative, OneOf, Positive, Real, Seconds, Share, Vector, explain
from ..scenario.files import read_toml, scenario_of
from ..scenario.schema import Scenario, Section
from .articulography import ALIGNMENTS, Recording
from .fitting import Opening, Search
from .goals import Goal, Track
from .shapes import LAYS, Shape
from .sweep_file import base_of


def ordered(span: tuple[float, float]) -> tuple[float, float]:
    """Refuse a greatest value before the least, with a ValueError."""
    if not span[0] <= span[1]:
        raise ValueError(f"[{span[0]:g}, {span[1]:g}]; the least value first is expected")
    return span


Span = Annotated[tuple[float, float], AfterValidator(ordered)]
Columns = Annotated[list[str], Field(min_length=3, max_length=3)]
Axes = Annotated[str, AfterValidator(check_axes)]
JAW, TOOTH = "mandible", "(tooth)"
"""The bone that a sensor on the lower teeth moves, about an axis to the left, so that opening is positive; and that sensor, whose name no
other can have."""
POSE = 3
"""Numbers by which free places are laid, so that fewer places than these say nothing."""
FAR = 0.15
"""In m: no place of a tongue lies or moves farther."""
BEGINS, SLOPES = ("flat", "live"), ("reduced", "full")


class GoalSection(Section):
    """How much a goal counts in the mean over all."""

    weight: Positive = 1.0


class TargetSection(GoalSection):
    """Where a probe should be: a table with time in s and displacement from rest, backward, to the right and up."""

    table: str
    unit: Annotated[str, OneOf(names=UNITS)] = "mm"


class PointSection(GoalSection):
    """Bounds in mm of the displacement of a probe, backward, to the right and up."""

    x: Span | None = None
    y: Span | None = None
    z: Span | None = None


class ConstrictionSection(GoalSection):
    """How near the tongue should come to walls of the airway in the mid-sagittal plane, in mm, and where along x."""

    walls: list[Name]
    degree: Span
    x: Span | None = None


class ContourSection(GoalSection):
    """A mid-sagittal contour: a table of x and z. A `free` one may be turned and shifted to where it is nearest."""

    table: str
    unit: Annotated[str, OneOf(names=UNITS)] = "mm"
    free: Flag = False


class SurfaceSection(GoalSection):
    """The whole surface, or a part of it, where its axes point and its mid-plane is (in its unit), and how many places count, spread over
    it or along its mid-sagittal contour. With one of the same speaker at rest it is laid on the tongue as that one is on ours."""

    file: str
    rest: str | None = None
    align: Annotated[str, OneOf(names=LAYS)] = "scale"
    unit: Annotated[str, OneOf(names=UNITS)] = "mm"
    axes: Axes = "PRS"
    mid_plane: Annotated[float, Real()] = 0.0
    places: Annotated[int, Real(low=10, high=5000, whole=True)] = 400
    midsagittal: Flag = False
    free: Flag = False

    @model_validator(mode="after")
    def _in_the_plane(self) -> SurfaceSection:
        if self.free and not self.midsagittal:
            raise ValueError("free: it is the mid-sagittal contour that may be turned and shifted; midsagittal = true is expected too")
        return self


class TouchSection(GoalSection):
    """Electrodes of the palate that should be touched: rows from the front, columns from the left, counted from 1."""

    rows: list[Annotated[int, Real(low=1, high=8, whole=True)]]
    columns: list[Annotated[int, Real(low=1, high=8, whole=True)]] | None = None


class SensorSection(GoalSection):
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


class OpeningSection(Section):
    """By how many degrees the jaw may open at most, about the transverse axis through `centre` (mm), in `rise` seconds; it then stays so.
    The angle is found with the levels."""

    centre: Annotated[Sequence[float], Vector()]
    rise: Seconds = 0.1
    most: Positive = 12.0


class RecordingSection(Section):
    """Sensors on a speaker: the table, where its axes point, when in it the tongue is at rest, when the movement begins, and how long
    before that the run begins, at rest; times in s."""

    table: str
    sensor: Annotated[Mapping[Name, SensorSection], Field(min_length=1)]
    jaw: JawSection | None = None
    time: str = "time_s"
    unit: Annotated[str, OneOf(names=UNITS)] = "mm"
    axes: Axes = "PRS"
    rest: NotNegative = 0.0
    begin: NotNegative | None = None
    lead: Seconds = 0.1
    align: Annotated[str, OneOf(names=ALIGNMENTS)] = "rigid"
    lateral: Flag = False


class FitFile(Section):
    """A scenario, the muscles that may act in it, and what probes, outline and palate should do."""

    base: Any
    muscles: list[Name]
    knots: Seconds = 0.05
    hold: Flag = False
    since: NotNegative = 0.0
    most: Share = 1.0
    bounds: Mapping[Name, tuple[Share, Share]] = {}
    begin: Annotated[str, OneOf(names=BEGINS)] = "flat"
    effort: NotNegative = 1e-2
    haste: NotNegative = 1e-2
    slopes: Annotated[str, OneOf(names=SLOPES)] = "reduced"
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
    opening: OpeningSection | None = None

    @property
    def by_reduced(self) -> bool:
        """Whether what the data leave open is told by derivatives of the reduced tongue."""
        return self.begin == "live" and self.slopes == "reduced"

    @property
    def aims(self) -> list[tuple[str, GoalSection]]:
        """All that is to be reached, with names."""
        sensors = self.recording.sensor if self.recording else dict[Name, SensorSection]()
        groups: tuple[Mapping[Name, GoalSection], ...] = (
            self.target, self.point, self.constriction, self.contour, self.surface, self.touch, sensors,
        )  # fmt: skip
        return [named for group in groups for named in group.items()]


@dataclass(frozen=True)
class Task:
    """A fit that is to be done; `told` has fingerprints, by what they are of, of all that says what is looked for."""

    file: FitFile
    scenario: Scenario
    paths: Mapping[str, Track]
    contours: Mapping[str, Floats]
    surfaces: Mapping[str, Shape]
    recording: Recording | None = None
    told: Mapping[str, str] = field(default_factory=dict)

    def search(self, goals: Mapping[str, Goal], opening: Opening | None = None) -> Search:
        """What is sought, with these goals."""
        terms = {name: getattr(self.file, name) for name in ("hold", "since", "most", "bounds", "effort", "haste")}
        weights = {name: section.weight for name, section in self.file.aims}
        return Search(goals, self.file.muscles, self.knots, **terms, opening=opening, weights=weights)

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
    data = read_toml(path, "a fit in TOML")
    if "base" not in data and {"mesh", "time"} & data.keys():
        raise InputError(f"{path}: it is a scenario; a fit, which has one as its base, is expected.")
    try:
        file = FitFile.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, FitFile)}") from error
    with within(path):
        _check_names(file)
        scenario = scenario_of(*base_of(file.base, path, changes), f"{path}: base")
        _check_choices(file, scenario)
        folder, end = path.parent, scenario.time.end
        paths = {name: _path(name, section, folder, end) for name, section in file.target.items()}
        recording = _recording(file.recording, folder, end) if file.recording else None
        contours, surfaces = {}, {}
        for name, drawn in file.contour.items():
            with within(f"contour.{name}"):
                contours[name] = 1e3 * UNITS[drawn.unit] * _rows_of(folder / drawn.table, 2, "two columns, backward and up,")
                _check_near(contours[name] / 1e3)
                if drawn.free and len(contours[name]) < POSE:
                    raise InputError(f"{len(contours[name])} places that are free; at least {POSE} are expected.")
        for name, whole in file.surface.items():
            frame = Frame(whole.unit, whole.axes, whole.mid_plane)
            with within(f"surface.{name}"):
                rest = frame.surface(folder / whole.rest) if whole.rest else None
                surfaces[name] = Shape(frame.surface(folder / whole.file), rest, whole.align)
                if rest is None:
                    _check_near(surfaces[name].surface.points)
    task = Task(file, scenario, paths, contours, surfaces, recording)
    return replace(task, told=_tell(task))


def _tell(task: Task) -> dict[str, str]:
    """What is looked for; how, and what it weighs, may change from one call to the next, and files may have moved."""
    file = task.file
    moved: Any = {"mesh": {"file", "subject"}, "contact": {"__all__": {"surface"}}, "activation": {"__all__": {"table"}}}
    parts: dict[str, Any] = {"base": task.scenario.model_dump(exclude=moved)}
    parts |= {"muscles": file.muscles, "hold": file.hold, "since": file.since}
    for key in ("target", "point", "constriction", "contour", "surface", "touch"):
        parts[key] = {name: one.model_dump(exclude={"weight", "table", "file", "rest"}) for name, one in getattr(file, key).items()}
    recording: Any = file.recording and file.recording.model_dump(exclude={"table": True, "sensor": {"__all__": {"weight"}}})
    parts |= {"opening": file.opening and file.opening.model_dump(), "recording": [recording, task.recording]}
    for key, data in (("target", task.paths), ("contour", task.contours), ("surface", task.surfaces)):
        parts[key] = [parts[key], data]
    return {key: fingerprint(part) for key, part in parts.items()}


def _check_names(file: FitFile) -> None:
    """Refuse names that are missing, twice or unknown."""
    if not file.aims or not file.muscles:
        raise InputError(f"{'muscles' if file.aims else 'target'}: at least one is expected.")
    names = [name for name, _ in file.aims]
    for key, given in (("muscles", file.muscles), ("goals", names)):
        if twice := sorted({name for name in given if given.count(name) > 1}):
            raise InputError(f"{key}: {twice[0]!r} is named twice; names of their own are expected.")
    for name, (low, high) in file.bounds.items():
        if name not in file.muscles or low > high:
            expected = f"one of muscles, {', '.join(file.muscles)}," if name not in file.muscles else "the least level first"
            raise InputError(f"bounds.{name}: [{low:g}, {high:g}]; {expected} is expected.")


def _check_choices(file: FitFile, scenario: Scenario) -> None:
    """Refuse what does not go together."""
    of_points = len(file.target) + len(file.recording.sensor if file.recording else ())
    if file.slopes == "full" and (file.begin != "live" or len(file.aims) > of_points):
        raise InputError('slopes: "full" goes on from begin = "live", with tables of points as targets only.')
    if file.opening is not None and (file.begin != "live" or file.iterations > 0):
        raise InputError('opening: an angle is found with begin = "live" and iterations = 0 only.')
    of_jaw = file.recording is not None and file.recording.jaw is not None
    if (file.opening or of_jaw) and JAW in scenario.boundary.moving:
        key = "opening" if file.opening else "recording.jaw"
        raise InputError(f"{key}: the {JAW} moves already, in boundary.moving; one of both is expected.")
    if file.opening and of_jaw:
        raise InputError(f"opening: the {JAW} moves already, as recording.jaw says; one of both is expected.")


def _path(name: str, section: TargetSection, folder: Path, end: float) -> Track:
    """The path that a table tells."""
    with within(f"target.{name}"):
        rows = _rows_of(folder / section.table, 4, "four columns, time in s and displacement backward, to the right and up,")
        times, track = rows[:, 0], Track(rows[:, 0], UNITS[section.unit] * rows[:, 1:], name)
        if (most := float(abs(track.displacement).max())) > FAR:
            raise InputError(f"it moves by up to {1e3 * most:.0f} mm, which no tongue does; its own unit is expected.")
        if not ((times > 0) & (times <= end + 1e-9)).any():
            raise InputError(f"times from {times[0]:g} to {times[-1]:g} s; some after 0 and up to time.end, {end:g} s, are expected.")
    return track


def _recording(told: RecordingSection, folder: Path, end: float) -> Recording:
    """The recording that a table tells."""
    columns = {name: sensor.columns for name, sensor in told.sensor.items()} | ({TOOTH: told.jaw.columns} if told.jaw else {})
    recording = Recording.read(folder / told.table, told.time, columns, Frame(told.unit, told.axes), told.rest, told.begin, told.lead)
    if told.lead >= end:
        raise InputError(f"recording.lead: {told.lead:g} s; less than time.end, {end:g} s, is expected.")
    times, last = recording.times, recording.begin + end - told.lead
    if np.count_nonzero((times >= recording.begin) & (times <= last)) < 2:
        raise InputError(f"recording: no two times from {recording.begin:g} to {last:g} s, which the run lasts; times in s are expected.")
    return recording


def _rows_of(table: Path, columns: int, what: str) -> Floats:
    """A table of numbers in so many columns."""
    with reading(table, what):
        rows = numbers_in(table.read_text(encoding="utf-8-sig"), columns)
        if len(rows) == 0 or len(bad := np.flatnonzero(~np.isfinite(rows).all(axis=1))):
            raise ValueError(f"line {bad[0] + 1} of its numbers is not finite" if len(rows) else "it has no line of numbers")
        return rows


def _check_near(places: Floats) -> None:
    """Refuse places in m that are far from any tongue."""
    if (most := float(abs(places).max())) > FAR:
        raise InputError(f"it lies up to {1e3 * most:.0f} mm from the origin, where no tongue is; its own unit and axes are expected.")
