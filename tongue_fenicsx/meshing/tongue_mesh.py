# SPDX-License-Identifier: MIT
"""A tongue mesh in DOLFINx: tags by name, overlapping muscles, landmarks, on any number of ranks."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import gmsh
import h5py
import numpy as np
from dolfinx import mesh as dmesh
from dolfinx.io import gmsh as dgmsh
from mpi4py import MPI
from numpy.typing import NDArray

from ..anatomy.anatomy import Anatomy
from ..core.errors import InputError, reading
from ..core.fingerprint import digest, fingerprint
from ..core.parallel import on_rank_zero
from ..core.types import Floats
from ..core.values import UNITS, text
from ..geometry.surface import Surface
from . import build as meshing
from . import gmsh_import as foreign
from .mesh_file import open_mesh

Ints = NDArray[np.int32]


@dataclass(frozen=True)
class MuscleEntry:
    """Where a muscle from outside enters the tongue, on this rank.

    Attributes
    ----------
    facets : (k,) int array
        Local facets that it crosses, of owned cells.
    nodes, share : (n,) int and float arrays
        Geometry nodes of those facets, and the muscle's cross-section per area of surface there.
    anchor : (3,) float array
        Where it pulls to, in m.
    """

    facets: Ints
    nodes: Ints
    share: Floats
    anchor: Floats


@dataclass(frozen=True)
class MuscleCells:
    """One muscle on this rank.

    Attributes
    ----------
    cells : (k,) int array
        Local cells (ghosts too) that it touches.
    weight : (k, 4) float array
        Its share at the vertices of each cell, 0…1.
    direction : (k, 4, 3) float array
        Unit fibre direction there; its sense means nothing.
    entry : MuscleEntry, optional
        For a muscle that comes from outside.
    direction_error : float, optional
        Mean angle in degrees between the directions and the cell vectors that they were made of.
    """

    cells: Ints
    weight: Floats
    direction: Floats
    entry: MuscleEntry | None = None
    direction_error: float | None = None


@dataclass(frozen=True)
class TongueMesh:
    """A mesh with everything the mechanics asks of it.

    Attributes
    ----------
    mesh : dolfinx.mesh.Mesh
        Straight-sided tetrahedra in m.
    facet_tags : dolfinx.mesh.MeshTags
        Tagged boundary facets.
    surfaces : dict
        Name of each tagged surface to its tag.
    muscles : dict
        Name with side to `MuscleCells`.
    landmarks : dict
        Name to point (3,) in m in the rest shape.
    bones : dict
        Name to the surface of a bone or wall around it, for contact.
    digest : str
        Hash of the files that it was read from.
    source : Path, optional
        The ``.msh`` file that it was read from.
    unit : str
        Of that file.
    name : str
        What the tongue is called.
    volumes : dict
        Name of each physical volume to its local cells, ghosts too; where muscles overlap, names are joined by ``+``.
    notes : tuple of str
        What a user should know of how it was read.
    """

    mesh: dmesh.Mesh
    facet_tags: dmesh.MeshTags
    surfaces: dict[str, int]
    muscles: dict[str, MuscleCells] = field(default_factory=dict)
    landmarks: dict[str, Floats] = field(default_factory=dict)
    name: str = "mesh"
    bones: dict[str, Surface] = field(default_factory=dict)
    volumes: dict[str, Ints] = field(default_factory=dict)
    digest: str = ""
    notes: tuple[str, ...] = ()
    source: Path | None = None
    unit: str = "m"
    _scratch: tempfile.TemporaryDirectory[str] | None = None

    @cached_property
    def fingerprint(self) -> str:
        """What makes the mesh: the files, or where there are none cells, surfaces and muscles; to be asked for by all ranks at once."""
        if self.digest:
            return self.digest
        mesh, owned = self.mesh, self.mesh.topology.index_map(3).size_local
        nodes, numbers = mesh.geometry.dofmaps[0], mesh.geometry.input_global_indices
        mesh.topology.create_connectivity(2, 3)

        def table(cells: Ints, values: Floats) -> Floats:
            """Numbers of the vertices of each cell, and values (n_cells, 4, …) there, in their order."""
            order = np.argsort(numbers[nodes[cells]], axis=1)
            sorted_values = np.take_along_axis(values.reshape(len(cells), 4, -1), order[..., None], axis=1)
            return np.column_stack([np.sort(numbers[nodes[cells]], axis=1), sorted_values.reshape(len(cells), -1)])

        tables = {"cells": table(np.arange(owned, dtype=np.int32), mesh.geometry.x[nodes[:owned]])}
        for name, muscle in self.muscles.items():
            mine = muscle.cells < owned
            tables[f"muscle {name}"] = table(muscle.cells[mine], np.dstack([muscle.weight, muscle.direction])[mine])
        for name in self.surfaces:
            tables[f"surface {name}"] = np.sort(numbers[dmesh.entities_to_geometry(mesh, 2, self.facets([name]))], axis=1)
        gathered = {name: self.comm.gather(rows) for name, rows in tables.items()}
        parts = {name: np.unique(np.concatenate(rows), axis=0) for name, rows in gathered.items() if rows is not None}
        return str(self.comm.bcast(fingerprint(parts)))

    @property
    def box(self) -> tuple[Floats, Floats]:
        """Least and greatest coordinates (3,) in m; to be asked for by all ranks at once."""
        x = self.mesh.geometry.x
        ends = np.array(self.comm.allgather((x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf))))
        return ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)

    @property
    def comm(self) -> MPI.Intracomm:
        """The communicator of the mesh."""
        return self.mesh.comm

    @classmethod
    def from_anatomy(cls, anatomy: Anatomy, size: float, comm: MPI.Intracomm = MPI.COMM_WORLD) -> TongueMesh:
        """Mesh an anatomy with elements of `size` (m) and load it; its files are kept as long as it is."""
        scratch = tempfile.TemporaryDirectory() if comm.rank == 0 else None
        path = Path(comm.bcast(scratch and scratch.name)) / "tongue.msh"
        on_rank_zero(comm, lambda: meshing.build(anatomy, path, size))
        return replace(cls.read(path, comm), _scratch=scratch)

    @classmethod
    def read(cls, path: Path, comm: MPI.Intracomm = MPI.COMM_WORLD, unit: str = "m") -> TongueMesh:
        """Read ``FILE.msh`` and ``FILE.h5`` beside it, or a mesh made elsewhere (see `foreign`).

        Parameters
        ----------
        path : Path
            ``FILE.msh``.
        comm : MPI communicator
            Of the mesh.
        unit : str
            ``m``, ``cm`` or ``mm``, of a mesh made elsewhere and the fibres beside it; one with an ``.h5`` is in m.

        Raises
        ------
        InputError
            If the file is missing, is not a mesh that `open_mesh` takes, or does not belong to the ``.h5`` beside it.
        """

        def open_and_check() -> tuple[dict[str, Any] | None, list[str]]:
            gmsh.initialize(interruptible=False)
            gmsh.option.setNumber("General.Terminal", 0)
            h5 = path.with_suffix(".h5")
            metres = 1.0 if h5.exists() else UNITS[unit]
            try:
                notes = open_mesh(path, metres)
                return _read_h5(h5) or foreign.muscles_of_model(path, metres), notes
            except BaseException:
                gmsh.finalize()
                raise

        stored, notes = on_rank_zero(comm, open_and_check)
        read = on_rank_zero(comm, lambda: digest([path, path.with_suffix(".h5"), path.with_suffix(".fibres.json")]))
        read += "" if unit == "m" else f" in {unit}"
        try:
            data = dgmsh.model_to_mesh(gmsh.model if comm.rank == 0 else None, comm, 0)
        finally:
            if comm.rank == 0:
                gmsh.finalize()
        mesh, facet_tags = data.mesh, data.facet_tags
        assert facet_tags is not None
        facet_tags.name = "surfaces"
        surfaces = {name: group.tag for name, group in data.physical_groups.items() if group.dim == 2}
        tags = data.cell_tags
        volumes = {name: tags.find(group.tag).astype(np.int32) for name, group in data.physical_groups.items() if group.dim == 3}
        if stored is None:
            return cls(mesh, facet_tags, surfaces, name=path.stem, volumes=volumes, digest=read, notes=tuple(notes), source=path, unit=unit)
        row = _match_cells(mesh, stored["cells"], path)
        nodes = mesh.geometry.input_global_indices[mesh.geometry.dofmaps[0]]
        muscles = {}
        for name, muscle in stored["muscles"].items():
            touched = np.zeros(len(stored["cells"]), dtype=bool)
            touched[muscle["cells"]] = True
            cells = np.flatnonzero(touched[row]).astype(np.int32)
            at = np.searchsorted(muscle["nodes"], nodes[cells])
            entry = _entry(mesh, facet_tags.indices, muscle["entry"]) if "entry" in muscle else None
            muscles[name] = MuscleCells(cells, muscle["weight"][at], muscle["direction"][at], entry, muscle.get("direction_error"))
        where = stored["landmarks"], stored["name"], stored["bones"]
        return cls(mesh, facet_tags, surfaces, muscles, *where, volumes, read, tuple(notes), path)

    def region(self, name: str) -> Ints:
        """Local cells, ghosts too, of a physical volume, also of its parts that others share.

        Raises
        ------
        InputError
            If the mesh has no such volume.
        """
        parts = [cells for joined, cells in self.volumes.items() if name == joined or name in joined.split("+")]
        if not parts:
            known = ", ".join(sorted({part for joined in self.volumes for part in joined.split("+")})) or "none"
            raise InputError(f"region.{name}: the mesh has no volume {name!r}; it has {known}.")
        return np.concatenate(parts)

    def facets(self, names: list[str]) -> Ints:
        """Local facets of the named surfaces."""
        tags = [self.surfaces[name] for name in names]
        return np.asarray(self.facet_tags.indices[np.isin(self.facet_tags.values, tags)], dtype=np.int32)


def _read_h5(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    with reading(path, "the undamaged fibre file of the mesh (tongue build writes both)"), h5py.File(path, "r") as file:
        stored = {
            "name": text(file.attrs["name"]),
            "cells": file["cells"][:],
            "muscles": {name: _tree(group) for name, group in file.get("muscles", {}).items()},
            "bones": {name: Surface.read(group) for name, group in file.get("bones", {}).items()},
            "landmarks": {name: data[:] for name, data in file.get("landmarks", {}).items()},
        }
        if stored["cells"].ndim != 2 or stored["cells"].shape[1] != 4:
            raise ValueError("cells has the wrong shape")
        for name, muscle in stored["muscles"].items():
            cells, nodes, weight, direction = (muscle[key] for key in ("cells", "nodes", "weight", "direction"))
            fits = len(nodes) == len(weight) == len(direction) and np.array_equal(nodes, np.unique(stored["cells"][cells]))
            if not fits or cells.min() < 0 or not np.all((weight >= -1e-9) & (weight <= 1 + 1e-9)):
                raise ValueError(f"muscles/{name} is damaged")
            if not np.allclose(np.linalg.norm(direction, axis=1), 1.0):
                raise ValueError(f"muscles/{name}/direction is not of unit length")
            if not all(np.isfinite(part).all() for part in muscle.get("entry", {}).values()):
                raise ValueError(f"muscles/{name}/entry is damaged")
        for name, point in stored["landmarks"].items():
            if point.shape != (3,) or not np.isfinite(point).all():
                raise ValueError(f"landmarks/{name} is not three finite numbers")
        return stored


def _tree(group: h5py.Group) -> dict[str, Any]:
    return {key: _tree(item) if isinstance(item, h5py.Group) else item[:] for key, item in group.items()}


def _entry(mesh: dmesh.Mesh, facets: Ints, stored: dict[str, Any]) -> MuscleEntry:
    """The part of a muscle's entry on this rank."""
    mesh.topology.create_connectivity(2, 3)
    geometry = dmesh.entities_to_geometry(mesh, 2, facets)
    given = mesh.geometry.input_global_indices
    row = {tuple(sorted(triple)): i for i, triple in enumerate(stored["facets"].tolist())}
    rows = np.array([row.get(tuple(sorted(triple)), -1) for triple in given[geometry].tolist()], dtype=np.int64)
    mine = np.flatnonzero(rows >= 0)
    values = dict(zip(stored["facets"].ravel().tolist(), stored["share"].ravel().tolist(), strict=True))
    nodes = np.unique(geometry[mine])
    share = np.array([values[node] for node in given[nodes].tolist()], dtype=float)
    return MuscleEntry(facets[mine].astype(np.int32), nodes.astype(np.int32), share, stored["anchor"])


def _match_cells(mesh: dmesh.Mesh, stored: Ints, path: Path) -> NDArray[np.int64]:
    """Row in the stored cell table of each local cell, found by its vertices."""
    local = np.sort(mesh.geometry.input_global_indices[mesh.geometry.dofmaps[0]], axis=1)
    _, inverse = np.unique(np.vstack([np.sort(stored, axis=1), local]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    row = np.full(inverse.max() + 1, -1, dtype=np.int64)
    row[inverse[: len(stored)]] = np.arange(len(stored))
    found = row[inverse[len(stored) :]]
    if mesh.comm.allreduce(int((found < 0).sum())) > 0:
        raise InputError(f"{path}: does not belong to {path.with_suffix('.h5').name} beside it; build both again with tongue build.")
    return found
