# SPDX-License-Identifier: MIT
"""A run that was made in Python, told as a scenario, so that its folder makes it again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ..anatomy.catalogue import base_name
from ..core.types import Floats
from ..geometry.obstacles import OBSTACLES, Triangulated
from ..geometry.surface import Surface
from ..mechanics.activation import Activation, Course, Excited
from ..mechanics.control import Control, OpenLoop
from ..mechanics.hyperelasticity import LAWS
from ..mechanics.loads import LOADS
from ..mechanics.model import Model
from ..runs.inputs import MESH, Inputs, mesh_files
from ..solvers.tolerances import Tolerances
from .stepping import Stepping

STEP = 1e-3
"""Seconds between the samples of an activation that is a function."""


def as_scenario(
    model: Model, stepping: Stepping, tolerances: Tolerances, probes: Mapping[str, Floats], control: Control, t_end: float
) -> Inputs:
    """The scenario of a run and the files that it names; what cannot be said in one stands in its first lines.

    Parameters
    ----------
    model, stepping, tolerances : Model, Stepping, Tolerances
        Of the simulation.
    probes : mapping
        Name to point (3,) in m of the rest shape.
    control : Control
        What moves the muscles.
    t_end : float
        In s.
    """
    told = _Told(model)
    tissue = model.tissue
    sections: dict[str, Any] = {
        "mesh": {"file": MESH, "unit": model.tongue.unit},
        "tissue": {
            **told.law(tissue.law, "tissue"),
            "formulation": "mixed" if model.mixed else "displacement",
            "density": tissue.density,
            "rayleigh_alpha": tissue.damping.alpha,
            "rayleigh_beta": tissue.damping.beta,
        },
        "muscles": {**_numbers(model.contraction), "sigma_max": told.peak_stress()},
        "boundary": {"fixed": list(model.fixed), "moving": _each(model.moving), "suspended": _each(model.suspended)},
        "gravity": {"acceleration": list(map(float, model.gravity)), "rise": model.gravity_rise},
        "contact": told.contacts(tolerances.penetration),
        "load": {name: {kind: _numbers(load) for kind, of in LOADS.items() if type(load) is of} for name, load in model.loads.items()},
        "region": {name: told.law(law, f"region.{name}") for name, law in model.regions.items()},
        "time": {"end": t_end, "step_max": tolerances.step, **_numbers(stepping, "output_every", "fields")},
        "output": {"every": stepping.output_every, "fields": list(stepping.fields)},
        "solver": _numbers(tolerances, "step", "penetration"),
        **told.activation(control, t_end),
        "probes": {name: np.asarray(point).tolist() for name, point in probes.items()},
    }
    told.refuse("model.fibre", model.fibre is not None)
    told.refuse("model.quadrature_degree", model.quadrature_degree != Model.quadrature_degree)
    head = ["# Made in Python, and told here as a scenario."]
    head += [f"# {note}" for note in told.notes]
    return Inputs("\n".join(head) + "\n\n" + tomli_w.dumps(sections), told.files)


class _Told:
    """What has been told of a model: files beside the scenario, and notes on what differs."""

    def __init__(self, model: Model) -> None:
        self._model, self._tongue = model, model.tongue
        self.notes: list[str] = []
        self.files: dict[str, Callable[[Path], object]] = {}
        if self._tongue.source is None:
            self.refuse("the mesh, which came from no file (fields.h5 has its nodes and cells)", True)
        else:
            self.files |= mesh_files(self._tongue.source)

    def refuse(self, what: str, really: bool) -> None:
        """Note what a scenario cannot say."""
        if really:
            self.notes.append(f"Not told: {what}.")

    def law(self, law: Any, where: str) -> dict[str, Any]:
        name = next((name for name, kind in LAWS.items() if type(law) is kind), None)
        if name is None:
            self.refuse(f"the law {type(law).__name__} of {where}", True)
            return {}
        return {"law": name, **_numbers(law)}

    def peak_stress(self) -> dict[str, float]:
        known = {*self._tongue.muscles, *map(base_name, self._tongue.muscles)}
        return {name: float(stress) for name, stress in self._model.tissue.peak_stress.items() if name in known}

    def contacts(self, tolerance: float) -> dict[str, Any]:
        told: dict[str, Any] = {}
        for name, contact in self._model.contacts.items():
            section = {"tolerance": tolerance, **self._obstacle(name, contact.obstacle), **_numbers(contact, "obstacle", "motion")}
            if contact.motion is not None:
                bone = next((bone for bone, motion in self._model.moving.items() if motion is contact.motion), None)
                self.refuse(f"the motion of contact.{name}, which is that of no bone", bone is None)
                section |= {} if bone is None else {"moves_with": bone}
            told[name] = section
        return told

    def _obstacle(self, name: str, obstacle: Any) -> dict[str, Any]:
        for kind, of in OBSTACLES.items():
            if type(obstacle) is of:
                return {kind: _numbers(obstacle)}
        if not isinstance(obstacle, Triangulated):
            self.refuse(f"the obstacle {type(obstacle).__name__} of contact.{name}", True)
            return {}
        ours = (obstacle.surface.points, obstacle.surface.triangles)
        for bone, surface in self._tongue.bones.items():
            if all(map(np.array_equal, ours, (surface.points, surface.triangles))):
                return {"surface": bone}
        file = f"surface-{name}.vtp"
        self.files[file] = partial(_save, obstacle.surface)
        return {"surface": file}

    def activation(self, control: Control, t_end: float) -> dict[str, Any]:
        if not isinstance(control, OpenLoop):
            self.refuse(f"the control {type(control).__name__} (history.h5 has the activations that it gave)", True)
            return {}
        courses = dict(control.courses)
        told: dict[str, Any] = {}
        excited = {(course.rise, course.fall) for course in courses.values() if isinstance(course, Excited)}
        if len(excited) == 1 and all(isinstance(course, Excited) for course in courses.values()):
            told["excitation"] = dict(zip(("rise", "fall"), excited.pop(), strict=True))
            courses = {name: course.excitation for name, course in courses.items() if isinstance(course, Excited)}
        told["activation"] = {name: {"pieces": self._pieces(name, course, t_end)} for name, course in courses.items()}
        return told

    def _pieces(self, name: str, course: Course, t_end: float) -> list[list[float]]:
        if isinstance(course, Activation):
            return [list(map(float, piece)) for piece in course.pieces]
        self.notes.append(f"activation.{name}: a function of time, sampled every {1e3 * STEP:g} ms.")
        times = np.append(np.arange(0.0, t_end - STEP / 2, STEP), t_end)
        levels = [course(float(t)) for t in times]
        return [[float(t1 - t0), a, b] for t0, t1, a, b in zip(times, times[1:], levels, levels[1:], strict=False)]


def _save(surface: Surface, path: Path) -> None:
    surface.to_pyvista().save(path)


def _numbers(value: Any, *without: str) -> dict[str, Any]:
    """The fields of a value as keys of a table; what is None is left out."""
    found = {item.name: getattr(value, item.name) for item in fields(value) if item.name not in without}
    return {name: _plain(part) for name, part in found.items() if part is not None}


def _each(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _numbers(value) for name, value in values.items()}


def _plain(value: Any) -> Any:
    """A value as TOML takes it."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(part) for part in value]
    return value
