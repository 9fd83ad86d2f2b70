# SPDX-License-Identifier: MIT
"""One muscle alone: the chapter's protocol (Figure 4.4, in red), which calibration, atlas and verification share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..anatomy.catalogue import CATALOGUE, base_name, resolve
from ..core.errors import InputError
from ..core.parallel import on_rank_zero
from ..core.types import Floats
from ..meshing.tongue_mesh import MuscleCells, TongueMesh
from ..scenario.schema import MeshSection, Scenario
from .pool import shared_mesh

LANDMARKS = ("tip", "dorsum", "root", "edge_left", "edge_right")
RISE, HOLD = 0.1, 0.25
"""In s: full activation after 100 ms, held to 350 ms."""
CONTACT = {"touching": 1e-3}
"""Overlap at rest that measured bones may have, in m."""


def mesh_of(mesh: Path | None, preset: str, folder: Path) -> Path:
    """The mesh file: the given one, or that of the parametric tongue, built in `folder` if it is not there yet."""
    return mesh or _built(MeshSection(parametric=preset), folder, f"{preset}.msh")


def subject_mesh(subject: Path, folder: Path) -> Path:
    """The mesh file of a real subject at the coarse size, built in `folder` if it is not there yet.

    Raises
    ------
    InputError
        If the subject's folder cannot be used (see `subject.read_subject`).
    """
    return _built(MeshSection(subject=str(subject)), folder, f"{subject.resolve().name}.msh")


def _built(source: MeshSection, folder: Path, name: str) -> Path:
    return Path(on_rank_zero(MPI.COMM_WORLD, lambda: shared_mesh(source, folder, name)).file)


def muscles_in(mesh: Path, wanted: Sequence[str], some: Sequence[str] | None) -> list[str]:
    """Those of the `wanted` muscles that the mesh has; or `some`, if given.

    Raises
    ------
    InputError
        If the mesh cannot be read, has not `some` of them, or none at all.
    """
    tongue = TongueMesh.read(mesh, MPI.COMM_WORLD)
    for name in some or ():
        resolve(name, tongue.muscles, "--muscle")
    available = set(map(base_name, tongue.muscles))
    found = list(dict.fromkeys(some or [name for name in CATALOGUE if name in wanted and name in available]))
    if not found:
        raise InputError(f"{mesh}: has none of the muscles {', '.join(wanted)}.")
    return found


def regions_in(mesh: Path, muscles: Sequence[str]) -> dict[str, Floats]:
    """The tetrahedra (n, 4, 3) in m that are at least half of each muscle, both sides in one; read on this rank alone."""
    tongue = TongueMesh.read(mesh, MPI.COMM_SELF)
    corners = tongue.mesh.geometry.x[tongue.mesh.geometry.dofmaps[0]]
    return {
        name: np.concatenate([_mostly(corners, of) for side, of in tongue.muscles.items() if base_name(side) == name]) for name in muscles
    }


def _mostly(corners: Floats, muscle: MuscleCells) -> Floats:
    return np.asarray(corners[muscle.cells[muscle.weight.mean(axis=1) >= 0.5]])


def walls_in(mesh: Path) -> list[str]:
    """The bones and walls of a mesh that the tongue may lean on; not the hyoid, which it surrounds."""
    return [name for name in TongueMesh.read(mesh, MPI.COMM_WORLD).bones if name != "hyoid"]


def scenario(muscle: str, mesh: Path, tissue: str, stress: float, level: float = 1.0, walls: Sequence[str] = ()) -> Scenario:
    """Both sides of a muscle from 0 to a level in 100 ms, held to 350 ms: no gravity or stiffening; the landmarks are the probes.

    Parameters
    ----------
    muscle : str
        Without side.
    mesh : Path
        Mesh file.
    tissue : str
        Preset.
    stress : float
        Peak active stress in Pa.
    level : float
        Activation that is held.
    walls : sequence of str
        Bones of the mesh in contact.
    """
    return Scenario.model_validate(
        {
            "mesh": {"file": str(mesh)},
            "tissue": {"preset": tissue},
            "muscles": {"sigma_max": {muscle: stress}},
            "time": {"end": RISE + HOLD},
            "output": {"every": 0.025},
            "activation": {muscle: {"pieces": [(RISE, 0.0, level), (HOLD, level, level)]}},
            "contact": dict.fromkeys(walls, CONTACT),
            "probes": {name: name for name in LANDMARKS},
        }
    )
