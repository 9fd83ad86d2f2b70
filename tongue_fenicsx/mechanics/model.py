# SPDX-License-Identifier: MIT
"""The mechanical model: tissue, muscles, damping, gravity and bonded surfaces, as a weak form in UFL."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated

import numpy as np

from ..anatomy.anatomy import Anatomy
from ..anatomy.catalogue import CATALOGUE, base_name, resolve
from ..core.errors import InputError
from ..core.fingerprint import fingerprint
from ..core.types import Floats
from ..core.values import Direction, Flag, Name, Real, Rise, checked
from ..geometry.rigid_motion import RigidMotion
from ..meshing.tongue_mesh import TongueMesh
from .contact import Contact
from .contraction import Contraction
from .hyperelasticity import Passive
from .loads import Pressure
from .suspension import Suspension
from .tissue import Tissue


@dataclass(frozen=True)
@checked("model")
class Model:
    """A tongue with its material, ready to simulate.

    Attributes
    ----------
    tongue : TongueMesh
        Mesh, tags, muscles.
    tissue : Tissue
        Passive law, density, damping and the peak stress of each muscle.
    contraction : Contraction
        Active law of all muscles.
    regions : mapping
        Physical volumes of the mesh that have a passive law of their own, to it.
    fibre : (3,) sequence of float or callable, optional
        What passive laws see as the fibre direction at rest, of any length: the same everywhere, or a function of points (n, 3) in m.
    fixed : sequence of str
        Tagged surfaces that do not move.
    moving : mapping
        Tagged surfaces that move as bones do, and how.
    suspended : mapping
        Tagged surfaces that are rigid and held by springs.
    mixed : bool
        Whether the pressure is an unknown of its own (linear, beside the quadratic displacement), which stays accurate up
        to ν = 0.5; otherwise it comes from the change of volume.
    contacts : mapping
        Obstacles by name, and how the tongue meets them.
    loads : mapping
        Tagged surfaces to the loads on them.
    gravity : (3,) sequence of float
        Acceleration in m/s².
    gravity_rise : float
        Time in s over which gravity grows from 0.
    quadrature_degree : int
        Of the stress terms; the mass is integrated exactly.

    Raises
    ------
    InputError
        If a surface or a region is not in the mesh, the mixed form does not know the law, or a number is out of range.
    """

    tongue: TongueMesh
    tissue: Tissue = field(default_factory=Tissue.calka)
    contraction: Contraction = field(default_factory=Contraction)
    regions: Mapping[str, Passive] = field(default_factory=dict)
    fibre: Sequence[float] | Callable[[Floats], Floats] | None = None
    fixed: Sequence[Name] = ("mandible", "hyoid")
    moving: Mapping[Name, RigidMotion] = field(default_factory=dict)
    suspended: Mapping[Name, Suspension] = field(default_factory=dict)
    mixed: Flag = False
    contacts: Mapping[Name, Contact] = field(default_factory=dict)
    loads: Mapping[Name, Pressure] = field(default_factory=dict)
    gravity: Direction = (0.0, 0.0, 0.0)
    gravity_rise: Rise = 0.1
    quadrature_degree: Annotated[int, Real(low=1, high=30, whole=True)] = 3

    def __post_init__(self) -> None:
        if not isinstance(self.tongue, TongueMesh):
            hint = "; its .mesh(size=…) gives one" if isinstance(self.tongue, Anatomy) else ""
            raise InputError(f"model.tongue: {type(self.tongue).__name__} is given, a TongueMesh is expected{hint}.")
        for name in self.tissue.peak_stress:
            if base_name(name) not in CATALOGUE:
                resolve(name, self.tongue.muscles, f"peak_stress.{name}")
        known = ", ".join(sorted(self.tongue.surfaces))
        for key, names in (("fixed", self.fixed), ("moving", self.moving), ("suspended", self.suspended)):
            for name in names:
                if name not in self.tongue.surfaces:
                    raise InputError(f"boundary.{key}: the mesh has no surface {name!r}; it has {known}.")
        for name in self.loads:
            if name not in self.tongue.surfaces:
                raise InputError(f"load.{name}: the mesh has no surface {name!r}; it has {known}.")
        for name in self.regions:
            self.tongue.region(name)
        for name, count in Counter(self.bonded).items():
            if count > 1:
                raise InputError(f"boundary: {name} is named {count} times among fixed, moving and suspended; name it once.")
        if not self.contacts and self.tongue.comm.allreduce(len(self.tongue.facets(self.bonded))) == 0:
            raise InputError(f"boundary.fixed: nothing is fixed, the tongue would float away; name one or more of {known}.")
        for law in self.laws:
            if not self.mixed and law.nu >= 0.5:
                raise InputError("nu: 0.5 needs the mixed form (tissue.formulation); below 0.5 is expected without it.")
            if self.mixed and law.volumetric != "quadratic":
                raise InputError(f"volumetric: {law.volumetric!r} is not known to the mixed form; 'quadratic' is expected.")

    def fingerprint(self) -> dict[str, str]:
        """Hash of each part, by the name of its argument; models that have all in common move alike."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        if callable(self.fibre):
            values["fibre"] = self.fibre(self._grid())
        return {name: fingerprint(value) for name, value in values.items()}

    def _grid(self) -> Floats:
        """Points (1000, 3) in m all over the box around the mesh, the same on all ranks."""
        low, high = self.tongue.box
        shares = np.stack(np.meshgrid(*3 * [np.linspace(0, 1, 10)]), axis=-1).reshape(-1, 3)
        return np.asarray(low + shares * (high - low))

    @property
    def bonded(self) -> list[str]:
        """Surfaces on bone, fixed, moving and suspended."""
        return [*self.fixed, *self.moving, *self.suspended]

    @property
    def laws(self) -> list[Passive]:
        """The passive law of the tissue, then those of the regions."""
        return [self.tissue.law, *self.regions.values()]

    @property
    def kinks(self) -> list[float]:
        """Times in s that a step must end on: of moving bones and obstacles, loads, and the rise of gravity."""
        motions = [*self.moving.values(), *(contact.motion for contact in self.contacts.values() if contact.motion is not None)]
        times = [kink for motion in motions for kink in motion.kinks] + [kink for load in self.loads.values() for kink in load.kinks]
        return [*times, self.gravity_rise] if any(self.gravity) else times

    @property
    def structure(self) -> list[object]:
        """What forms and solvers are built from: models that have it in common differ in numbers only, which change without building."""
        named = (self.moving, self.suspended, self.contacts, self.loads)
        parts = [(name, id(value)) for values in named for name, value in values.items()]
        laws = [(type(law), law.volumetric) for law in self.laws]
        contraction = replace(self.contraction, optimal_stretch=1.0, tendon_length=0.0)
        damped = self.tissue.damping.beta > 0
        which = [id(self.tongue), id(self.fibre), list(self.regions), list(self.fixed)]
        return [*which, parts, laws, contraction, self.mixed, damped, self.quadrature_degree]
