# SPDX-License-Identifier: MIT
"""From an `Anatomy` to files: a Gmsh mesh with overlapping muscles, its fibre fields and its figures.

A cell may belong to several muscles, but Gmsh and DOLFINx want one physical volume per cell. So there is one physical
volume per combination, named like ``GGP_L+TRANS_L`` (``passive`` where no muscle is). Beside ``FILE.msh`` lie
``FILE.h5`` with the weight and fibre direction of each muscle at the vertices of its cells, and ``FILE.json`` with the
figures an anatomist asks for. A cell is counted to a muscle when at least half of it lies in the region.
"""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import gmsh
import h5py
import numpy as np
from numpy.typing import NDArray

from ..anatomy import catalogue as muscle_facts
from ..anatomy.anatomy import Anatomy, gaps, measure
from ..core.errors import InputError, check_outputs
from ..core.files import at_once
from ..core.types import Floats
from .muscle_fields import MuscleField, direction_errors, project_muscles
from .tetrahedra import Tetrahedra, tetrahedralise


def build(anatomy: Anatomy, path: Path, size: float) -> dict[str, Any]:
    """Mesh a tongue and write ``FILE.msh``, ``FILE.h5`` and ``FILE.json``.

    Parameters
    ----------
    anatomy : Anatomy
        The tongue.
    path : Path
        The ``.msh`` file; the others lie beside it.
    size : float
        Element size in m; 0.7 of it at bonded areas.

    Returns
    -------
    dict
        What ``FILE.json`` holds: volume, arc, chord, width, mid-sagittal area, node and cell counts, quality, muscles,
        landmarks and notes, in SI units.

    Raises
    ------
    InputError
        If the size is out of range, the surface cannot be meshed, a muscle's region is empty or the folder is unwritable.
    """
    files = check_request(path, size)
    mesh = tetrahedralise(anatomy, size)
    fields = project_muscles(anatomy, mesh)
    shape = measure(anatomy.surface, anatomy.genial_spine)
    surface_nodes = mesh.points[np.unique(mesh.facets)]
    landmarks = {name: surface_nodes[np.argmin(((surface_nodes - p) ** 2).sum(axis=1))] for name, p in shape.landmarks.items()}
    errors = direction_errors(anatomy, mesh, fields)
    with ExitStack() as stack:  # what lies beside the mesh is put in place first: it is there when the mesh is
        msh, h5, beside = (stack.enter_context(at_once(file)) for file in files)
        owned, quality = _write_msh(mesh, fields, msh)
        _write_h5(anatomy, mesh, fields, landmarks, h5)
        figures = {
            "name": anatomy.name,
            "origin_m": anatomy.genial_spine.tolist(),
            "volume_m3": float(mesh.volumes.sum()),
            "proper_volume_m3": shape.proper_volume,
            "arc_length_m": shape.arc_length,
            "chord_m": shape.chord,
            "width_m": shape.width,
            "midsagittal_area_m2": shape.midsagittal_area,
            "gaps_m": gaps(anatomy, shape),
            "bones_m": {name: np.ptp(bone.points, axis=0).tolist() for name, bone in anatomy.bones.items()},
            "n_nodes": mesh.n_quadratic_nodes,
            "n_cells": len(mesh.cells),
            "min_sicn": quality,
            "muscles": {
                name: {
                    "volume_m3": field.volume,
                    "measured_volume_m3": anatomy.muscles[name].measured_volume,
                    "n_cells": int(owned[name].sum()),
                    "mean_length_m": anatomy.fibre_length(name),
                    "direction_error_deg": errors[name],
                    "pcsa_m2": anatomy.muscles[name].pcsa,
                    **_facts(name),
                }
                for name, field in fields.items()
            },
            "landmarks": {name: p.tolist() for name, p in landmarks.items()},
            "notes": anatomy.notes,
        }
        beside.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return figures


def check_request(path: Path, size: float) -> list[Path]:
    """The files that `build` writes, if it may.

    Raises
    ------
    InputError
        If the size is out of range, the name is not of a mesh, or the folder is unwritable.
    """
    if not 1e-3 <= size <= 20e-3:
        raise InputError(f"size: {1e3 * size:g} mm is out of range; 1 to 20 mm is accepted.")
    if path.suffix != ".msh":
        raise InputError(f"{path}: the mesh file must end in .msh.")
    files = [path, path.with_suffix(".h5"), path.with_suffix(".json")]
    check_outputs(path.parent, [file.name for file in files])
    return files


def _facts(name: str) -> dict[str, Any]:
    """Full name, origin and insertion, peak stress by tissue and source of a muscle, as far as the catalogue has it."""
    base = muscle_facts.base_name(name)
    facts = muscle_facts.CATALOGUE.get(base)
    if facts is None:
        return {}
    stress = {tissue: table[base] for tissue, table in muscle_facts.PEAK_STRESS.items()}
    return {"full_name": facts.full_name, "course": facts.course, "peak_stress_pa": stress, "source": facts.source}


def _order(names: set[str]) -> list[str]:
    order = list(muscle_facts.CATALOGUE)
    return sorted(names, key=lambda n: (order.index(b) if (b := muscle_facts.base_name(n)) in order else len(order), n))


def _write_msh(mesh: Tetrahedra, fields: dict[str, MuscleField], path: Path) -> tuple[dict[str, NDArray[np.bool_]], float]:
    """Write the mesh; return which cells count to each muscle and the smallest SICN quality."""
    names = _order(set(fields))
    owned = {}
    for name in names:
        owned[name] = np.zeros(len(mesh.cells), dtype=bool)
        owned[name][fields[name].cells] = fields[name].share >= 0.5
    combination, of_cell = np.zeros((1, 0), dtype=bool), np.zeros(len(mesh.cells), dtype=np.int64)
    if names:
        combination, inverse = np.unique(np.stack([owned[n] for n in names], axis=1), axis=0, return_inverse=True)
        of_cell = inverse.reshape(-1)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.Binary", 1)
        model = gmsh.model
        next_tag = 1
        for i, row in enumerate(combination):
            volume = model.addDiscreteEntity(3)
            if i == 0:
                model.mesh.addNodes(3, volume, np.arange(1, len(mesh.points) + 1), mesh.points.ravel())
            cells = mesh.cells[of_cell == i]
            model.mesh.addElementsByType(volume, 4, np.arange(next_tag, next_tag + len(cells)), cells.ravel() + 1)
            next_tag += len(cells)
            model.addPhysicalGroup(3, [volume], name="+".join(n for n, own in zip(names, row, strict=True) if own) or "passive")
        for label in sorted(set(mesh.labels.tolist())):
            surface = model.addDiscreteEntity(2)
            facets = mesh.facets[mesh.labels == label]
            model.mesh.addElementsByType(surface, 2, np.arange(next_tag, next_tag + len(facets)), facets.ravel() + 1)
            next_tag += len(facets)
            model.addPhysicalGroup(2, [surface], name=label)
        tags, _ = model.mesh.getElementsByType(4)
        quality = float(model.mesh.getElementQualities(tags, "minSICN").min())
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return owned, quality


def _write_h5(anatomy: Anatomy, mesh: Tetrahedra, fields: dict[str, MuscleField], landmarks: dict[str, Floats], path: Path) -> None:
    with h5py.File(path, "w", libver="v110") as file:  # with check sums, so that a damaged file is known as one
        file.attrs["name"] = np.bytes_(anatomy.name.encode())  # of fixed length: the heap of others has no check sum
        file.create_dataset("cells", data=mesh.cells.astype(np.int32), compression="gzip")
        for name, field in fields.items():
            group = file.create_group(f"muscles/{name}")
            group.create_dataset("cells", data=field.cells.astype(np.int32), compression="gzip")
            group.create_dataset("nodes", data=field.nodes.astype(np.int32), compression="gzip")
            group.create_dataset("weight", data=field.weight)
            group.create_dataset("direction", data=field.direction)
            if field.entry is not None:
                group.create_dataset("entry/facets", data=field.entry.facets.astype(np.int32))
                group.create_dataset("entry/share", data=field.entry.share)
                group.create_dataset("entry/anchor", data=field.entry.anchor)
        for name, point in landmarks.items():
            file.create_dataset(f"landmarks/{name}", data=point)
        for name, bone in anatomy.bones.items():
            bone.write(file.create_group(f"bones/{name}"))
