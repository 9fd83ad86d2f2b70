# SPDX-License-Identifier: MIT
"""From a scenario to a simulation: mesh, model, activations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import tomli_w
from mpi4py import MPI

from ..anatomy.anatomy import Anatomy
from ..anatomy.catalogue import peak_stress, resolve
from ..anatomy.parametric.size import PRESETS
from ..core.errors import InputError, within
from ..core.parallel import on_rank_zero
from ..geometry.obstacles import OBSTACLES, Obstacle, Triangulated, check_orientation
from ..geometry.surface import SUFFIXES, read_surface
from ..mechanics.activation import Course, Excited
from ..mechanics.contact import Contact
from ..mechanics.contraction import Contraction
from ..mechanics.control import OpenLoop
from ..mechanics.model import Model
from ..meshing.tongue_mesh import TongueMesh
from ..runs.inputs import MESH, Inputs, copy_of, mesh_files
from ..simulation.simulation import Simulation, resolve_sides
from ..simulation.stepping import Stepping
from .schema import ContactSection, MeshSection, Scenario, value_of


def anatomy_of(source: MeshSection) -> Anatomy:
    """The anatomy that a mesh section names."""
    if source.subject is not None:
        from ..anatomy.subject import read_subject

        return read_subject(Path(source.subject))
    from ..anatomy.parametric.tongue import parametric_tongue  # a second of imports, which a run on a mesh does without

    return parametric_tongue(source.shape, source.split)


def size_of(source: MeshSection) -> float:
    """Element size in m: as given, else of the preset (coarse for a subject)."""
    return source.size or PRESETS[source.parametric or "coarse"]


def simulation_of(scenario: Scenario, workspace: Path, keep_mesh: bool = False, comm: MPI.Comm = MPI.COMM_WORLD) -> Simulation:
    """The simulation that a scenario describes, on the ranks of `comm`.

    A mesh that has to be built is kept as long as the simulation is, and copied into its run folders; with `keep_mesh` the one that a run
    left in `workspace` is taken again.

    Raises
    ------
    InputError
        If the scenario does not fit its mesh.
    """
    s = scenario
    if s.mesh.file is not None:
        return _simulation(s, TongueMesh.read(Path(s.mesh.file), comm, s.mesh.unit or "m"))
    kept = workspace / MESH
    if keep_mesh and comm.bcast(kept.is_file()):
        return _simulation(s, TongueMesh.read(kept, comm))
    anatomy = on_rank_zero(comm, lambda: anatomy_of(s.mesh))
    for name in s.activation:  # before the mesh, which takes longer
        resolve(name, anatomy.muscles, f"activation.{name}")
    return _simulation(s, TongueMesh.from_anatomy(anatomy, size_of(s.mesh), comm))


def inputs_of(scenario: Scenario, tongue: TongueMesh, link: bool = False) -> Inputs:
    """What makes the run of a scenario on its mesh again from any folder: the mesh (a hard `link` to it, if that is wanted and can be) and
    surfaces as files beside the scenario, tables of activations as pieces in it."""
    s = scenario
    assert tongue.source is not None
    files = mesh_files(tongue.source, link)
    data = s.model_dump(exclude_none=True)
    source = ", ".join(f"{key} = {value}" for key, value in data["mesh"].items() if value)
    data["mesh"] = {"file": MESH} | ({"unit": s.mesh.unit} if s.mesh.unit else {})
    for name, section in s.contact.items():
        if section.surface is not None and (suffix := Path(section.surface).suffix).lower() in SUFFIXES:
            data["contact"][name]["surface"] = f"surface-{name}{suffix}"
            files[f"surface-{name}{suffix}"] = copy_of(Path(section.surface))
    for name, course in s.activation.items():
        data["activation"][name] = {"pieces": [list(piece) for piece in course.course().pieces]}
    return Inputs(f"# Mesh: {source}\n\n{tomli_w.dumps(data)}", files)


def _contacts(s: Scenario, tongue: TongueMesh) -> dict[str, Contact]:
    """The obstacles of a scenario, in m."""
    motions = s.boundary.moving
    contacts = {}
    for name, section in s.contact.items():
        if section.moves_with is not None and section.moves_with not in motions:
            known = ", ".join(motions) or "none"
            raise InputError(f"contact.{name}.moves_with: {section.moves_with!r} does not move; moving in boundary.moving: {known}.")
        obstacle = on_rank_zero(tongue.comm, lambda name=name, section=section: _obstacle(name, section, tongue))
        motion = motions.get(section.moves_with or "")
        contacts[name] = value_of(Contact, section, obstacle=obstacle, motion=motion)
    return contacts


def _obstacle(name: str, section: ContactSection, tongue: TongueMesh) -> Obstacle:
    for kind in OBSTACLES:
        if (obstacle := getattr(section, kind)) is not None:
            return cast(Obstacle, obstacle)
    source = section.surface or name
    if Path(source).suffix.lower() in SUFFIXES:
        surface = read_surface(Path(source))
    elif source in tongue.bones:
        surface = tongue.bones[source]
    else:
        known = ", ".join(tongue.bones) or "none"
        raise InputError(
            f"contact.{name}.surface: the mesh has no bone {source!r} (it has {known}); one of them or a file in "
            f"{', '.join(SUFFIXES)} is expected."
        )
    size = float(np.ptp(surface.points, axis=0).max())
    if not 1e-3 <= size <= 1.0:
        raise InputError(
            f"contact.{name}: the surface {source} is {size:g} m long; 0.001 to 1 m is accepted, so convert its unit to metres."
        )
    with within(f"contact.{name}"):
        found = Triangulated(surface)
    check_orientation(found, f"contact.{name}", tongue.mesh.geometry.x)
    return found


class Workbench:
    """Simulations of scenarios one after another: mesh, obstacles, forms and solver of the last are used again as far as they serve.

    Parameters
    ----------
    comm : MPI.Comm
        The ranks that take part, all at once.
    """

    def __init__(self, comm: MPI.Comm = MPI.COMM_WORLD) -> None:
        self.comm = comm
        self._last: tuple[Scenario, Simulation] | None = None

    def simulation(self, scenario: Scenario) -> Simulation:
        """The simulation of a scenario whose mesh is a file.

        Raises
        ------
        InputError
            If the scenario does not fit its mesh.
        """
        if self._last is None or self._last[0].mesh != scenario.mesh:
            self.clear()
            made = _simulation(scenario, TongueMesh.read(Path(str(scenario.mesh.file)), self.comm, scenario.mesh.unit or "m"))
        else:
            made = self._from_last(scenario, *self._last)
        self._last = scenario, made
        return made

    def _from_last(self, s: Scenario, last: Scenario, simulation: Simulation) -> Simulation:
        before = simulation.model
        model = _model(s, before.tongue, None if (s.contact, s.boundary) != (last.contact, last.boundary) else before.contacts)
        if s.boundary == last.boundary:  # the same values, not their like, so that the engine knows them
            model = replace(model, moving=before.moving, suspended=before.suspended)
        if s.load == last.load:
            model = replace(model, loads=before.loads)
        if (s.probes, s.solver, s.output, _stepping(s)) != (last.probes, last.solver, last.output, _stepping(last)):
            simulation.close()
            return Simulation(model, s.probes, _stepping(s), s.solver.tolerances())
        _check_muscles(s, model)
        simulation.model = model
        return simulation

    def clear(self) -> None:
        """Forget the last simulation, on all ranks at once."""
        if self._last is not None:
            self._last[1].close()
            self._last = None


def _check_muscles(s: Scenario, model: Model) -> None:
    """Make sure that the mesh has the muscles that are activated, and that each has a peak stress."""
    for names in resolve_sides(OpenLoop(activation_of(s)), model).values():
        peak_stress(names, model.tissue.peak_stress)


def _simulation(s: Scenario, tongue: TongueMesh) -> Simulation:
    model = _model(s, tongue)
    _check_muscles(s, model)
    return Simulation(model, s.probes, _stepping(s), s.solver.tolerances())


def _model(s: Scenario, tongue: TongueMesh, contacts: Mapping[str, Contact] | None = None) -> Model:
    for name in s.muscles.sigma_max:
        resolve(name, tongue.muscles, f"muscles.sigma_max.{name}")
    return Model(
        tongue,
        tissue=s.tissue.tissue(s.muscles.sigma_max),
        contraction=value_of(Contraction, s.muscles),
        fixed=s.boundary.fixed,
        moving=s.boundary.moving,
        suspended=s.boundary.suspended,
        regions={name: section.passive() for name, section in s.region.items()},
        contacts=_contacts(s, tongue) if contacts is None else contacts,
        loads={name: section.load for name, section in s.load.items()},
        mixed=s.tissue.formulation == "mixed",
        gravity=s.gravity.vector,
        gravity_rise=s.gravity.rise,
    )


def _stepping(s: Scenario) -> Stepping:
    step_max = s.time.step or s.time.step_max or s.solver.tolerances().step
    step_min = min(Stepping.step_min, step_max) if s.time.step_min is None else s.time.step_min
    steps = {"step_max": step_max, "step_min": step_min, "output_every": s.output.every, "fields": s.output.fields}
    return value_of(Stepping, s.time, **steps)


def activation_of(scenario: Scenario) -> dict[str, Course]:
    """What moves the muscles of a scenario; reads the tables that it names."""
    courses = {name: section.course() for name, section in scenario.activation.items()}
    if scenario.excitation is None:
        return dict(courses)
    return {name: value_of(Excited, scenario.excitation, excitation=course) for name, course in courses.items()}
