# SPDX-License-Identifier: MIT
"""From a scenario to a simulation: mesh, model, activations."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from . import meshing
from .activation import Activation
from .active import Contraction
from .anatomy import Anatomy
from .model import Model, Rayleigh
from .parametric import parametric_tongue
from .scenario import MeshSection, Scenario
from .simulation import Simulation, Stepping
from .solver import Tolerances
from .subject import read_subject
from .tonguemesh import TongueMesh, on_rank_zero


def anatomy_of(source: MeshSection) -> Anatomy:
    """The anatomy that a mesh section names."""
    return parametric_tongue() if source.subject is None else read_subject(Path(source.subject))


def size_of(source: MeshSection) -> float:
    """Element size in m: as given, else of the preset (coarse for a subject)."""
    return source.size or meshing.PRESETS[source.parametric or "coarse"]


def mesh_of(source: MeshSection, workspace: Path, keep: bool = False) -> TongueMesh:
    """Read the mesh, or build it into ``workspace/mesh.msh`` (unless `keep` and it is there)."""
    comm = MPI.COMM_WORLD
    if source.file is not None:
        return TongueMesh.read(Path(source.file), comm)
    path = workspace / "mesh.msh"

    def build() -> None:
        if not (keep and path.is_file()):
            meshing.build(anatomy_of(source), path, size_of(source))

    on_rank_zero(comm, build)
    return TongueMesh.read(path, comm)


def simulation_of(scenario: Scenario, workspace: Path, keep_mesh: bool = False) -> Simulation:
    """The simulation that a scenario describes.

    Raises
    ------
    InputError
        If the scenario does not fit its mesh.
    """
    s = scenario.in_metres()
    model = Model(
        mesh_of(s.mesh, workspace, keep_mesh),
        passive=s.law(),
        contraction=Contraction(s.muscles.force_velocity, s.muscles.optimal_stretch, s.muscles.tendon_length),
        damping=Rayleigh(s.tissue_value("rayleigh_alpha"), s.tissue_value("rayleigh_beta")),
        density=s.tissue_value("density"),
        sigma_max=s.sigma_max(),
        fixed=s.boundary.fixed,
        gravity=s.gravity.acceleration,
        gravity_rise=s.gravity.rise,
    )
    step_max = s.time.step or s.time.step_max
    return Simulation(
        model,
        {name: Activation(section.pieces) for name, section in s.activation.items()},
        s.probes,
        Stepping(step_max, min(s.time.step_min, step_max), s.time.spectral_radius, s.output.every),
        Tolerances(s.solver.rtol, s.solver.atol, s.solver.linear, s.solver.max_newton),
    )
