# SPDX-License-Identifier: MIT
"""A scenario: the TOML file that says what to simulate. Read and checked before anything long starts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from ..anatomy import catalogue as muscles
from ..anatomy.parametric.size import SPLITTABLE, TongueShape
from ..geometry.rigid_motion import RigidMotion
from ..mechanics import hyperelasticity as passive
from ..mechanics.activation import Activation
from ..mechanics.contact import FORMS
from ..mechanics.contraction import FORCE_VELOCITY
from ..meshing.presets import PRESETS
from ..simulation.fields import EXTRA_FIELDS

Number = Annotated[float, Field(strict=True)]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Flag = Annotated[bool, Field(strict=True)]
Seconds = Annotated[float, Field(strict=True, ge=1e-6, le=100)]
"""Times that make sense for a tongue, so that no run is endless by a slip."""

TISSUES: dict[str, dict[str, float]] = {
    "calka": {"density": 1000.0, "rayleigh_alpha": 20.0, "rayleigh_beta": 0.0},
    "buchaillard": {"density": 1040.0, "rayleigh_alpha": 40.0, "rayleigh_beta": 0.03},
    "kappert": {"density": 1040.0, "rayleigh_alpha": 20.0, "rayleigh_beta": 0.0},
}
"""Density in kg/m³ and Rayleigh damping in 1/s and s that go with each passive preset: the chapter; Buchaillard 2009;
Kappert 2021 with the chapter's damping."""


POSTURES = {"upright": (0.0, 0.0, -9.81), "supine": (9.81, 0.0, 0.0)}
"""Gravity in m/s² by the posture of the head: z points up, x to the back of the head."""


def one_of(names: Collection[str]) -> AfterValidator:
    """Accept these names only, and say which they are."""

    def known(value: str) -> str:
        if value not in names:
            raise ValueError(f"{value!r} is not one of {', '.join(names)}")
        return value

    return AfterValidator(known)


class Section(BaseModel):
    """A table of the scenario; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class ShapeSection(Section):
    """Another size or form of the parametric tongue (see `shape.TongueShape`)."""

    length: Finite | None = None
    width: Finite | None = None
    height: Finite | None = None
    root: Finite | None = None
    tip: Finite | None = None
    scale: Finite | None = None

    def shape(self) -> TongueShape:
        """The shape, with the drawing's values where none is given; lengths in m."""
        return TongueShape(**self.model_dump(exclude_none=True))


class MeshSection(Section):
    """Where the mesh comes from: one of a file, a preset of the parametric tongue, or a subject's folder."""

    file: str | None = None
    parametric: Annotated[str, one_of(PRESETS)] | None = None
    subject: str | None = None
    size: Positive | None = None
    shape: ShapeSection = ShapeSection()
    split: list[Annotated[str, one_of(SPLITTABLE)]] = []

    @model_validator(mode="after")
    def _one_source(self) -> MeshSection:
        if sum(source is not None for source in (self.file, self.parametric, self.subject)) != 1:
            raise ValueError("exactly one of file, parametric and subject is expected")
        if self.size is not None and self.file is not None:
            raise ValueError("size belongs to parametric or subject; the mesh file already has one")
        if self.parametric is None and (self.shape.model_fields_set or self.split):
            raise ValueError("shape and split belong to parametric")
        return self


class TissueSection(Section):
    """Passive tissue: a preset and what differs from it; another law takes C₁₀, ν, density and damping of the preset."""

    preset: Annotated[str, one_of(TISSUES)] = "calka"
    law: Annotated[str, one_of(passive.LAWS)] = "yeoh"
    c10: Positive | None = None
    c20: NotNegative | None = None
    c30: NotNegative | None = None
    c01: NotNegative | None = None
    nu: Annotated[float, Field(strict=True, gt=-1, le=0.5)] | None = None
    volumetric: Annotated[str, one_of(passive.VOLUMETRIC)] = "quadratic"
    formulation: Literal["displacement", "mixed"] = "displacement"
    density: Positive | None = None
    rayleigh_alpha: NotNegative | None = None
    rayleigh_beta: NotNegative | None = None

    @model_validator(mode="after")
    def _of_the_law(self) -> TissueSection:
        known = [item.name for item in fields(passive.LAWS[self.law])]
        for name in ("c20", "c30", "c01"):
            if getattr(self, name) is not None and name not in known:
                raise ValueError(f"{name} is no number of the law {self.law}; it has {', '.join(known)}")
        return self


class MuscleSection(Section):
    """The active law; ``sigma_max`` (Pa, by muscle) replaces values of the tissue's table."""

    force_velocity: Annotated[str, one_of(FORCE_VELOCITY)] = "grenoble"
    optimal_stretch: Annotated[float, Field(strict=True, ge=0.5, le=2)] = 1.0
    tendon_length: NotNegative = 6e-3
    deviatoric: Flag = True
    passive_fibres: Flag = False
    stiffening: Flag = False
    sigma_max: dict[str, NotNegative] = {}


Point = tuple[Finite, Finite, Finite]


class MotionSection(Section):
    """The motion of a bone: pieces of duration in s, start and target, of an angle in degrees and of a translation."""

    angle: list[tuple[Seconds, Finite, Finite]] = []
    translation: list[tuple[Seconds, Point, Point]] = []
    centre: Point = (0.0, 0.0, 0.0)
    axis: Point = (0.0, 1.0, 0.0)

    @model_validator(mode="after")
    def _moves(self) -> MotionSection:
        self.motion()
        return self

    def motion(self) -> RigidMotion:
        """The motion."""
        return RigidMotion(**dict(self))


class SuspensionSection(Section):
    """A rigid bone on springs: mass in kg, stiffness in N/m, damping in N s/m."""

    mass: NotNegative = 5e-3
    stiffness: NotNegative = 1760.0
    damping: NotNegative = 0.0


class BoundarySection(Section):
    """Tagged surfaces that do not move (mandible and hyoid by default), those that move with a bone, and bones on springs."""

    fixed: list[str]
    moving: dict[str, MotionSection] = {}
    suspended: dict[str, SuspensionSection] = {}

    @model_validator(mode="before")
    @classmethod
    def _bones(cls, data: Any) -> Any:
        if isinstance(data, dict) and "fixed" not in data:
            others = [name for key in ("moving", "suspended") if isinstance(data.get(key), dict) for name in data[key]]
            return data | {"fixed": [name for name in ("mandible", "hyoid") if name not in others]}
        return data


class PlaneSection(Section):
    """A point of a plane and its normal, which points to the free side."""

    point: Point
    normal: Point


class SphereSection(Section):
    """A ball."""

    centre: Point
    radius: Positive


class ContactSection(Section):
    """An obstacle, and how it is met: a bone of the mesh or a surface file, a plane or a sphere; else the bone of the table's name."""

    surface: str | None = None
    plane: PlaneSection | None = None
    sphere: SphereSection | None = None
    form: Annotated[str, one_of(FORMS)] = "nitsche"
    theta: Literal[-1, 0, 1] = 0
    stiffness: Positive = 1.0
    tolerance: Positive = 0.05e-3
    touching: Positive = 0.2e-3
    moves_with: str | None = None

    @model_validator(mode="after")
    def _one_obstacle(self) -> ContactSection:
        if sum(source is not None for source in (self.surface, self.plane, self.sphere)) > 1:
            raise ValueError("one of surface, plane and sphere is expected")
        return self


class GravitySection(Section):
    """Gravity in m/s², also by the posture of the head, and the time in s over which it grows from zero."""

    acceleration: Point = (0.0, 0.0, 0.0)
    posture: Literal["upright", "supine"] | None = None
    rise: NotNegative = 0.1

    @model_validator(mode="after")
    def _one_direction(self) -> GravitySection:
        if self.posture is not None and any(self.acceleration):
            raise ValueError("either acceleration or posture is expected")
        return self

    @property
    def vector(self) -> Point:
        """Gravity in m/s²."""
        return self.acceleration if self.posture is None else POSTURES[self.posture]


class TimeSection(Section):
    """Time in s."""

    end: Seconds
    step: Seconds | None = None
    step_max: Seconds = 5e-3
    step_min: Seconds | None = None
    tolerance: Annotated[float, Field(strict=True, gt=0, lt=1)] | None = None
    spectral_radius: Annotated[float, Field(strict=True, ge=0, le=1)] = 0.8
    quasi_static: Flag = False


class OutputSection(Section):
    """Time in s between stored fields, and which beside the usual ones."""

    every: Annotated[float, Field(strict=True, ge=1e-4, le=100)] = 0.01
    fields: list[Annotated[str, one_of(EXTRA_FIELDS)]] = []


class SolverSection(Section):
    """Accuracy of each step: residual over that of the first guess, residual in N, and the linear solves."""

    rtol: Annotated[float, Field(strict=True, gt=0, lt=1)] = 1e-4
    atol: Positive = 1e-9
    linear: Annotated[float, Field(strict=True, gt=0, lt=1)] = 1e-3
    max_newton: Annotated[int, Field(strict=True, ge=1, le=1000)] = 15


class ActivationSection(Section):
    """Pieces of duration in s, start level and target level, or a CSV table of times in s and levels."""

    pieces: list[tuple[Seconds, Number, Number]] | None = None
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


class ExcitationSection(Section):
    """Time constants in s with which activation follows the given levels."""

    rise: Seconds = 0.01
    fall: Seconds = 0.04


class Scenario(Section):
    """A whole scenario, lengths as in the file; `in_metres` gives the one to compute with."""

    units: Literal["m", "mm"] = "m"
    mesh: MeshSection
    tissue: TissueSection = TissueSection()
    muscles: MuscleSection = MuscleSection()
    boundary: BoundarySection = Field(default_factory=lambda: BoundarySection.model_validate({}))
    gravity: GravitySection = GravitySection()
    contact: dict[str, ContactSection] = {}
    time: TimeSection
    output: OutputSection = OutputSection()
    solver: SolverSection = SolverSection()
    activation: dict[str, ActivationSection] = {}
    excitation: ExcitationSection | None = None
    probes: dict[str, str | Point] | None = None

    def in_metres(self) -> Scenario:
        """The same scenario with every length in m (gravity is always in m/s²)."""
        if self.units == "m":
            return self
        given = {} if self.mesh.shape is None else self.mesh.shape.model_dump(exclude_none=True)
        form = {name: value if name == "scale" else 1e-3 * value for name, value in given.items()}
        mesh = self.mesh.model_copy(
            update={
                "size": None if self.mesh.size is None else 1e-3 * self.mesh.size,
                "shape": ShapeSection(**form),
            }
        )
        written = self.muscles.model_fields_set
        tendon = 1e-3 * self.muscles.tendon_length if "tendon_length" in written else self.muscles.tendon_length
        probes = self.probes and {name: p if isinstance(p, str) else _metres(p) for name, p in self.probes.items()}
        moving = {
            name: m.model_copy(
                update={"centre": _metres(m.centre), "translation": [(d, _metres(a), _metres(b)) for d, a, b in m.translation]}
            )
            for name, m in self.boundary.moving.items()
        }
        contact = {name: section.model_copy(update=_lengths(section)) for name, section in self.contact.items()}
        return self.model_copy(
            update={
                "units": "m",
                "contact": contact,
                "mesh": mesh,
                "muscles": self.muscles.model_copy(update={"tendon_length": tendon}),
                "boundary": self.boundary.model_copy(update={"moving": moving}),
                "probes": probes,
            }
        )

    def law(self) -> passive.Passive:
        """The passive law with the preset's numbers where none is given."""
        kind = passive.LAWS[self.tissue.law]
        base = asdict(getattr(passive.Yeoh, self.tissue.preset)()) | {"c01": 0.0}
        given = {name: value for name in (*base, "volumetric") if (value := getattr(self.tissue, name)) is not None}
        return kind(**{item.name: (base | given)[item.name] for item in fields(kind)})

    def tissue_value(self, name: str) -> float:
        """Density or Rayleigh damping, given or of the preset."""
        value = getattr(self.tissue, name)
        return float(TISSUES[self.tissue.preset][name] if value is None else value)

    def sigma_max(self) -> dict[str, float]:
        """Peak stress in Pa by muscle: the tissue's table with the scenario's values in place."""
        return muscles.PEAK_STRESS[self.tissue.preset] | self.muscles.sigma_max


def _metres(point: Point) -> Point:
    """A point or length that is given in mm."""
    return (1e-3 * point[0], 1e-3 * point[1], 1e-3 * point[2])


def _lengths(contact: ContactSection) -> dict[str, Any]:
    """What of a contact changes from mm to m."""
    update: dict[str, Any] = {}
    if contact.plane is not None:
        update["plane"] = contact.plane.model_copy(update={"point": _metres(contact.plane.point)})
    if contact.sphere is not None:
        update["sphere"] = SphereSection(centre=_metres(contact.sphere.centre), radius=1e-3 * contact.sphere.radius)
    for name in {"tolerance", "touching"} & contact.model_fields_set:
        update[name] = 1e-3 * getattr(contact, name)
    return update
