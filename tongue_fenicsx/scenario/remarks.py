# SPDX-License-Identifier: MIT
"""What is accepted but may be a slip, and what a user should know before a run: one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from mpi4py import MPI

from ..anatomy.catalogue import peak_stress, resolve
from ..core.errors import InputError
from ..mechanics.activation import Activation, Course
from ..meshing.tongue_mesh import MuscleEntry, TongueMesh
from ..reduced.tongue import ReducedTongue
from ..simulation.simulation import Simulation
from .schema import Scenario

DENSITY = (500.0, 2000.0)
"""Densities in kg/m³ that soft tissue may have."""
STIFF = 0.49
"""Poisson's ratio from which active tissue keeps its volume to some 1.5 %."""
JUMP, AT_ONCE = 0.05, 1e-3
"""A level that changes by more than this within such a time in s jumps."""


def remarks(simulation: Simulation, courses: Mapping[str, Course], t_end: float) -> list[str]:
    """What to say of a simulation of muscles that follow `courses` until `t_end` (s); to be asked for by all ranks at once."""
    model = simulation.model
    found = [*model.tongue.notes, *_of_muscles(simulation, courses)]
    if not DENSITY[0] <= model.tissue.density <= DENSITY[1]:
        found.append(f"tissue.density: {model.tissue.density:g} kg/m³; soft tissue has about 1000, as water.")
    moved = any(course(t) > 0 for course in courses.values() for t in [0.0, *np.linspace(0, t_end, 101), *course.kinks] if t <= t_end)
    if moved and model.tissue.law.nu < STIFF:
        found.append(f"tissue.nu: {model.tissue.law.nu:g} lets active tissue shrink by some percent; {STIFF:g} and more keep its volume.")
    motions = [*model.moving.values(), *(contact.motion for contact in model.contacts.values() if contact.motion is not None)]
    if not (moved or motions or model.loads or any(model.gravity)):
        found.append("nothing moves the tongue: neither an activation above 0, gravity, a load nor a moving bone is given.")
    if not simulation.stepping.quasi_static:
        found += [
            f"activation.{name} jumps at {', '.join(f'{1e3 * t:g}' for t in times)} ms; excitation.rise lets it follow in milliseconds, "
            "as muscle does."
            for name, course in courses.items()
            if isinstance(course, Activation) and (times := list(_jumps(course, t_end)))
        ]
    return found


def _jumps(course: Activation, t_end: float) -> Iterator[float]:
    """Times in s before the end at which a course jumps, from 0 at first."""
    t, level = 0.0, 0.0
    for duration, start, target in course.pieces:
        if t < t_end and (abs(start - level) > JUMP or (duration < AT_ONCE and abs(target - start) > JUMP)):
            yield t
        t, level = t + duration, target


def _of_muscles(simulation: Simulation, courses: Mapping[str, Course]) -> Iterator[str]:
    """Of the muscles that are activated: how true their directions are, and what pulls from outside."""
    model, tongue = simulation.model, simulation.model.tongue
    for key in courses:
        for name in resolve(key, tongue.muscles, f"activation.{key}"):
            muscle = tongue.muscles[name]
            if muscle.direction_error is not None:
                yield f"{name}: the mean angle between its directions and the vectors of the mesh file is {muscle.direction_error:.1f}°."
            if muscle.entry is not None:
                force = peak_stress([name], model.tissue.peak_stress)[name] * _cross_section(tongue, muscle.entry)
                place = ", ".join(f"{1e3 * c:.1f}" for c in muscle.entry.anchor)
                yield f"{name} comes from outside and pulls toward its anchor at ({place}) mm with up to {force:.2g} N."


def _cross_section(tongue: TongueMesh, entry: MuscleEntry) -> float:
    """In m², where a muscle enters the tongue."""
    from dolfinx.mesh import entities_to_geometry

    triangles = entities_to_geometry(tongue.mesh, 2, entry.facets)
    a, b, c = tongue.mesh.geometry.x[triangles].swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    share = entry.share[np.searchsorted(entry.nodes, triangles)].mean(axis=1)
    return float(tongue.comm.allreduce(float(area @ share), op=MPI.SUM))


def not_followed(scenario: Scenario, tongue: ReducedTongue) -> list[str]:
    """The keys of a scenario that a reduced tongue does not follow, as it knows the tissue, the bones and the mesh of its runs only.

    Raises
    ------
    InputError
        If it is of another tissue or built-in tongue altogether.
    """
    s, told = scenario, tongue.told
    for key, given, known in (
        ("tissue.preset", s.tissue.preset, told["tissue"]["preset"]),
        ("mesh.parametric", s.mesh.parametric, told["mesh"]),
    ):
        if given is not None and given != known:
            raise InputError(f"{key}: {given!r}; the reduced tongue learned from runs with {known!r}.")
    usual = Scenario.model_validate(
        {"mesh": {"parametric": told["mesh"]}, "time": {"end": s.time.end}, "tissue": {"preset": s.tissue.preset}}
    )
    parts = ("tissue", "muscles", "boundary", "gravity", "load", "region")
    beyond = [name for name in parts if getattr(s, name) != getattr(usual, name)]
    return beyond + (["contact"] if sorted(s.contact) != sorted(told["contact"]) else [])
