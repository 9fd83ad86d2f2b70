# SPDX-License-Identifier: MIT
"""A scenario: the TOML file that says what to simulate; read and checked before anything long starts.

The values of the package are its tables, their fields the keys; here stands which tables there are, and what only a file needs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator

from ..anatomy.parametric.size import PRESETS, SPLITTABLE, TongueShape
from ..core.values import UNITS, Direction, Length, Name, OneOf, Rise, Seconds, Seed, Vector, hints, in_metres, keys
from ..geometry.obstacles import OBSTACLES
from ..geometry.rigid_motion import RigidMotion
from ..mechanics.activation import Activation, Excited, Pieces
from ..mechanics.contact import Contact
from ..mechanics.contraction import Contraction
from ..mechanics.hyperelasticity import LAWS, Passive
from ..mechanics.loads import LOADS, Pressure
from ..mechanics.suspension import Suspension
from ..mechanics.tissue import TISSUES, Density, MassDamping, PeakStress, Rayleigh, StiffnessDamping, Tissue
from ..simulation import fields as _standard_fields  # noqa: F401  they register themselves
from ..simulation.quantities import FIELDS
from ..simulation.stepping import Interval, Stepping
from ..solvers.tolerances import Accuracy, Tolerances

POSTURES = {"upright": (0.0, 0.0, -9.81), "supine": (9.81, 0.0, 0.0)}
"""Gravity in m/s² by the posture of the head: z points up, x to the back of the head."""


class Section(BaseModel):
    """A table of the scenario; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, defer_build=True)


def keys_of(kind: type, *without: str) -> dict[str, Any]:
    """The fields of a value as keys of a table, as pydantic takes them."""
    default = {item.name: item.default for item in fields(kind)}
    return {name: (hint, default[name]) for name, hint in hints(kind).items() if name not in without}


def with_keys[T: Section](**known: Any) -> Callable[[type[T]], type[T]]:
    """Give a table further keys, each with its type and default."""

    def widened(section: type[T]) -> type[T]:
        return create_model(section.__name__, __base__=section, __module__=section.__module__, __doc__=section.__doc__, **known)

    return widened


def value_of[T](kind: type[T], section: object, **others: Any) -> T:
    """A value with those of its fields that a section has as keys."""
    return kind(**{name: getattr(section, name) for name in keys(kind) if name not in others}, **others)


def make_law(name: str, section: object, other: Passive | None = None) -> Passive:
    """The passive law of a name with the numbers that a section has as keys, else those that it shares with another law.

    Raises
    ------
    ValueError
        If the section has a number of another law, or one is missing.
    """
    kind: Any = LAWS[name]
    known = keys(kind)
    given = {key: value for law in LAWS.values() for key in keys(law) if (value := getattr(section, key)) is not None}
    for key in given:
        if key not in known:
            raise ValueError(f"{key} is no number of the law {name}; it has {', '.join(known)}")
    numbers = {key: getattr(other, key) for key in known if hasattr(other, key)} | given
    missing = [item.name for item in fields(kind) if item.default is MISSING and item.name not in numbers]
    if missing:
        raise ValueError(f"the law {name} needs {', '.join(missing)}")
    made: Passive = kind(**numbers)
    return made


class MeshSection(Section):
    """Where the mesh comes from: one of a file, a preset of the parametric tongue, or a subject's folder.

    The `unit` of a file that ``tongue build`` did not write is that of the scenario, if none is given.
    """

    file: str | None = None
    parametric: Annotated[str, OneOf(names=PRESETS)] | None = None
    subject: str | None = None
    unit: Annotated[str, OneOf(names=UNITS)] | None = None
    size: Length | None = None
    shape: TongueShape | None = None
    split: list[Annotated[str, OneOf(names=SPLITTABLE)]] = []

    @model_validator(mode="after")
    def _one_source(self) -> MeshSection:
        if sum(source is not None for source in (self.file, self.parametric, self.subject)) != 1:
            raise ValueError("exactly one of file, parametric and subject is expected")
        if self.unit is not None and self.file is None:
            raise ValueError("unit belongs to file; a subject states its own in frame.toml")
        if self.size is not None and self.file is not None:
            raise ValueError("size belongs to parametric or subject; the mesh file already has one")
        if self.parametric is None and (self.shape is not None or self.split):
            raise ValueError("shape and split belong to parametric")
        return self


@with_keys(**{name: (hint | None, None) for law in LAWS.values() for name, hint in hints(law).items()})
class TissueSection(Section):
    """A preset and what differs from it, with the numbers of the law as further keys; another law takes those that it shares."""

    preset: Annotated[str, OneOf(names=TISSUES)] = "calka"
    law: Annotated[str, OneOf(names=LAWS)] = "yeoh"
    formulation: Annotated[str, OneOf(names=("displacement", "mixed"))] = "displacement"
    density: Density | None = None
    rayleigh_alpha: MassDamping | None = None
    rayleigh_beta: StiffnessDamping | None = None

    @model_validator(mode="after")
    def _of_the_law(self) -> TissueSection:
        self.tissue()
        return self

    def tissue(self, peak_stress: Mapping[str, float] | None = None) -> Tissue:
        """The tissue: the preset with the section's values in place, and these peak stresses (Pa)."""
        preset = TISSUES[self.preset]
        law = make_law(self.law, self, preset.law)
        alpha, beta = self.rayleigh_alpha, self.rayleigh_beta
        damping = Rayleigh(preset.damping.alpha if alpha is None else alpha, preset.damping.beta if beta is None else beta)
        density = preset.density if self.density is None else self.density
        return Tissue(law, density, damping, {**preset.peak_stress, **(peak_stress or {})}, preset.source)


@dataclass(frozen=True)
class MuscleSection(Contraction):
    """The active law; ``sigma_max`` (Pa, by muscle) replaces values of the tissue's table."""

    sigma_max: Mapping[str, PeakStress] = field(default_factory=dict)


@with_keys(**{name: (hint | None, None) for law in LAWS.values() for name, hint in hints(law).items()})
class RegionSection(Section):
    """The passive law of a physical volume of the mesh, with all its numbers."""

    law: Annotated[str, OneOf(names=LAWS)]

    @model_validator(mode="after")
    def _whole(self) -> RegionSection:
        self.passive()
        return self

    def passive(self) -> Passive:
        """The law."""
        return make_law(self.law, self)


@with_keys(**{name: (kind | None, None) for name, kind in LOADS.items()})
class LoadSection(Section):
    """A load on the tagged surface of the table's name."""

    @model_validator(mode="after")
    def _one_load(self) -> LoadSection:
        if sum(getattr(self, name) is not None for name in LOADS) != 1:
            raise ValueError(f"one of {', '.join(LOADS)} is expected")
        return self

    @property
    def load(self) -> Pressure:
        """The load."""
        given: list[Pressure] = [value for name in LOADS if (value := getattr(self, name)) is not None]
        return given[0]


class BoundarySection(Section):
    """Tagged surfaces that do not move (mandible and hyoid by default), those that move with a bone, and bones on springs."""

    fixed: list[str]
    moving: dict[str, RigidMotion] = {}
    suspended: dict[str, Suspension] = {}

    @model_validator(mode="before")
    @classmethod
    def _bones(cls, data: Any) -> Any:
        if isinstance(data, dict) and "fixed" not in data:
            others = [name for key in ("moving", "suspended") if isinstance(data.get(key), dict) for name in data[key]]
            return data | {"fixed": [name for name in ("mandible", "hyoid") if name not in others]}
        return data


@with_keys(**{name: (kind | None, None) for name, kind in OBSTACLES.items()}, **keys_of(Contact, "obstacle", "motion"))
class ContactSection(Section):
    """An obstacle, and how it is met: a bone of the mesh or a surface file, a plane or a sphere; else the bone of the table's name."""

    surface: str | None = None
    moves_with: str | None = None

    @model_validator(mode="after")
    def _one_obstacle(self) -> ContactSection:
        if sum(getattr(self, name) is not None for name in ("surface", *OBSTACLES)) > 1:
            raise ValueError(f"one of surface, {' and '.join(OBSTACLES)} is expected")
        return self


class GravitySection(Section):
    """Gravity in m/s², also by the posture of the head, and the time in s over which it grows from zero."""

    acceleration: Direction = (0.0, 0.0, 0.0)
    posture: Annotated[str, OneOf(names=POSTURES)] | None = None
    rise: Rise = 0.1

    @model_validator(mode="after")
    def _one_direction(self) -> GravitySection:
        if self.posture is not None and any(self.acceleration):
            raise ValueError("either acceleration or posture is expected")
        return self

    @property
    def vector(self) -> Sequence[float]:
        """Gravity in m/s²."""
        return self.acceleration if self.posture is None else POSTURES[self.posture]


@with_keys(**keys_of(Stepping, "step_max", "step_min", "output_every", "fields"))
class TimeSection(Section):
    """Time in s: one fixed `step`, or the largest and, with a tolerance, the smallest one; else the step of the solver's accuracy."""

    end: Seconds
    step: Seconds | None = None
    step_max: Seconds | None = None
    step_min: Seconds | None = None

    @model_validator(mode="after")
    def _one_step(self) -> TimeSection:
        if self.step is not None and self.step_max is not None:
            raise ValueError("either step or step_max is expected, not both")
        return self


@with_keys(**{name: (hint | None, None) for name, hint in hints(Tolerances).items() if name not in ("step", "penetration")})
class SolverSection(Section):
    """How accurate a run is, and what differs from that."""

    accuracy: Accuracy = "trajectory"

    def tolerances(self) -> Tolerances:
        """The tolerances of the accuracy with the section's values in place."""
        return Tolerances.of(**self.model_dump(exclude_none=True))


class OutputSection(Section):
    """Time in s between stored fields, and which beside the usual ones."""

    every: Interval = Stepping.output_every
    fields: list[Annotated[str, OneOf(names=FIELDS)]] = []


class ActivationSection(Section):
    """Pieces of duration in s, start level and target level, or a CSV table of times in s and levels."""

    pieces: Pieces | None = None
    table: str | None = None

    @model_validator(mode="after")
    def _levels(self) -> ActivationSection:
        if (self.pieces is None) == (self.table is None):
            raise ValueError("either pieces or table is expected")
        if self.pieces is not None:
            Activation(self.pieces)
        return self

    def course(self) -> Activation:
        """The activation; reads the table."""
        return Activation(self.pieces) if self.pieces is not None else Activation.from_table(Path(str(self.table)))


@with_keys(**keys_of(Excited, "excitation"))
class ExcitationSection(Section):
    """Time constants in s with which activation follows the given levels."""


class Scenario(Section):
    """A whole scenario; lengths that a file gives in mm are in m here (gravity is always in m/s²). The seed is that of the design which the
    scenario comes from, for its record."""

    units: Annotated[str, OneOf(names=("m", "mm"))] = "m"
    seed: Seed | None = None
    mesh: MeshSection
    tissue: TissueSection = Field(default_factory=TissueSection)
    muscles: MuscleSection = MuscleSection()
    boundary: BoundarySection = Field(default_factory=lambda: BoundarySection.model_validate({}))
    gravity: GravitySection = Field(default_factory=GravitySection)
    contact: dict[Name, ContactSection] = {}
    load: dict[str, LoadSection] = {}
    region: dict[str, RegionSection] = {}
    time: TimeSection
    output: OutputSection = Field(default_factory=OutputSection)
    solver: SolverSection = Field(default_factory=SolverSection)
    activation: dict[str, ActivationSection] = {}
    excitation: ExcitationSection | None = None
    probes: dict[Name, Annotated[str | Sequence[float], Vector("m", named=True)]] | None = None

    @model_validator(mode="before")
    @classmethod
    def _in_metres(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("units") != "mm":
            return data
        mesh = data.get("mesh")
        if isinstance(mesh, dict) and "file" in mesh:
            data = data | {"mesh": {"unit": "mm"} | mesh}
        return in_metres(cls, data) | {"units": "m"}
