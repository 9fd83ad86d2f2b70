# SPDX-License-Identifier: MIT
"""From an `Anatomy` to files: a Gmsh mesh with overlapping muscles, its fibre fields and its figures.

A cell may belong to several muscles, but Gmsh and DOLFINx want one physical volume per cell. So there is one physical
volume per combination, named like ``GGP_L+TRANS_L`` (``passive`` where no muscle is). Beside ``FILE.msh`` lie
``FILE.h5`` with the weight and fibre direction of each muscle at the vertices of its cells, and ``FILE.json`` with the
figures an anatomist asks for.

The weight of a muscle is its region averaged over the elements around a vertex, so that the muscle's edge is smooth on
any mesh while the integral of the weight is the volume of the region. A cell is counted to a muscle when at least half
of it lies in the region.
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import gmsh
import h5py
import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..anatomy import catalogue as muscle_facts
from ..anatomy.anatomy import Anatomy, Muscle, gaps, measure
from ..core.errors import InputError, check_outputs
from ..core.types import Floats
from ..geometry import tetrahedron
from ..geometry.fibre_bundle import FibreBundle
from ..geometry.fibre_direction import angle_between, common_sense
from ..geometry.surface import Surface

Ints = NDArray[np.int64]

REFINEMENT, REFINED_WITHIN = 0.7, 10e-3
"""Elements at a bonded area have this fraction of the size; it grows back to 1 over the distance in m."""

PER_RADIUS, GROWTH, CURVATURE_SCALE = 0.55, 0.3, 4e-3
"""Elements on the surface are at most this fraction of its radius of curvature, measured over the scale in m, but not
finer than at a bonded area; below the surface they grow by the second number per distance."""

SUBPOINTS = np.array([i for i in product(range(4), repeat=4) if sum(i) == 3]) / 4 + 1 / 16
"""Barycentric coordinates of 20 evenly spread points of a tetrahedron."""

FACET_SUBPOINTS = np.array([i for i in product(range(6), repeat=3) if sum(i) == 5]) / 6 + 1 / 18
"""Barycentric coordinates of 21 evenly spread points of a triangle."""


@dataclass(frozen=True)
class Tetrahedra:
    """A tetrahedral mesh with labelled boundary triangles.

    Attributes
    ----------
    points : (n, 3) float array
        Vertices in m.
    cells : (m, 4) int array
        Vertex numbers, positively oriented.
    facets : (k, 3) int array
        Boundary triangles.
    labels : (k,) str array
        What each boundary triangle is bonded to, or ``free``.
    """

    points: Floats
    cells: Ints
    facets: Ints
    labels: NDArray[np.str_]

    @property
    def volumes(self) -> Floats:
        """Volume of each cell, (m,), in m³."""
        return tetrahedron.volumes(self.points[self.cells])

    @property
    def n_quadratic_nodes(self) -> int:
        """Vertices and edge midpoints."""
        edges = np.sort(self.cells[:, [0, 1, 0, 2, 0, 3, 1, 2, 1, 3, 2, 3]].reshape(-1, 2), axis=1)
        return len(self.points) + len(np.unique(edges, axis=0))


@dataclass(frozen=True)
class Entry:
    """Where the part of a muscle outside the tongue pulls at the surface.

    Attributes
    ----------
    facets : (k, 3) int array
        Boundary triangles that its fibres cross.
    share : (k, 3) float array
        Cross-section of the muscle per area of surface at their corners.
    anchor : (3,) float array
        Where it pulls to, in m.
    """

    facets: Ints
    share: Floats
    anchor: Floats


@dataclass(frozen=True)
class MuscleField:
    """One muscle on a mesh.

    Attributes
    ----------
    cells : (k,) int array
        Cells that its region touches.
    nodes : (n,) int array
        Their vertices.
    weight : (n,) float array
        Share of the region around each vertex, 0…1.
    direction : (n, 3) float array
        Unit fibre direction.
    share : (k,) float array
        Share of each cell that lies in the region.
    volume : float
        Volume of the region in m³.
    entry : Entry, optional
        Where it enters from outside.
    """

    cells: Ints
    nodes: Ints
    weight: Floats
    direction: Floats
    share: Floats
    volume: float
    entry: Entry | None = None


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
    if not 1e-3 <= size <= 20e-3:
        raise InputError(f"size: {1e3 * size:g} mm is out of range; 1 to 20 mm is accepted.")
    if path.suffix != ".msh":
        raise InputError(f"{path}: the mesh file must end in .msh.")
    files = [path, path.with_suffix(".h5"), path.with_suffix(".json")]
    check_outputs(path.parent, [file.name for file in files])
    mesh = tetrahedralise(anatomy, size)
    fields = project_muscles(anatomy, mesh)
    shape = measure(anatomy.surface, anatomy.genial_spine)
    surface_nodes = mesh.points[np.unique(mesh.facets)]
    landmarks = {name: surface_nodes[np.argmin(((surface_nodes - p) ** 2).sum(axis=1))] for name, p in shape.landmarks.items()}
    partial = [file.with_name(f".partial-{file.name}") for file in files]
    owned, quality = _write_msh(mesh, fields, partial[0])
    _write_h5(anatomy, mesh, fields, landmarks, partial[1])
    locate = _Locator(mesh)
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
        "n_nodes": mesh.n_quadratic_nodes,
        "n_cells": len(mesh.cells),
        "min_sicn": quality,
        "muscles": {
            name: {
                "volume_m3": field.volume,
                "measured_volume_m3": anatomy.muscles[name].measured_volume,
                "n_cells": int(owned[name].sum()),
                "mean_length_m": anatomy.fibre_length(name),
                "direction_error_deg": locate.direction_error(anatomy.muscles[name].fibres, field),
                "pcsa_m2": anatomy.muscles[name].pcsa,
                **_facts(name),
            }
            for name, field in fields.items()
        },
        "landmarks": {name: p.tolist() for name, p in landmarks.items()},
        "notes": anatomy.notes,
    }
    partial[2].write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    for written, file in zip(partial, files, strict=True):
        os.replace(written, file)
    return figures


def _facts(name: str) -> dict[str, Any]:
    """Full name, origin and insertion, peak stress by tissue and source of a muscle, as far as the catalogue has it."""
    base = muscle_facts.base_name(name)
    facts = muscle_facts.CATALOGUE.get(base)
    if facts is None:
        return {}
    stress = {tissue: table[base] for tissue, table in muscle_facts.PEAK_STRESS.items()}
    return {"full_name": facts.full_name, "course": facts.course, "peak_stress_pa": stress, "source": facts.source}


class _Locator:
    """Interpolates vertex data of a mesh at points inside it."""

    def __init__(self, mesh: Tetrahedra) -> None:
        self.mesh = mesh
        self._grid = pv.UnstructuredGrid({pv.CellType.TETRA: mesh.cells}, mesh.points)

    def direction_error(self, fibres: FibreBundle, field: MuscleField) -> float | None:
        """Mean angle in degrees between fibres and the direction field of the mesh along them, inside the muscle's cells, if any is."""
        points, tangents, lengths = fibres.segments
        cells = np.atleast_1d(self._grid.find_containing_cell(points))
        inside = np.isin(cells, field.cells)
        if not inside.any():
            return None
        corners = self.mesh.cells[cells[inside]]
        a, b, c, d = (self.mesh.points[corners[:, i]] for i in range(4))
        bary = np.linalg.solve(np.stack([b - a, c - a, d - a], axis=2), (points[inside] - a)[..., None])[..., 0]
        weights = np.column_stack([1 - bary.sum(axis=1), bary])
        mean = np.einsum("nv,nvd->nd", weights, common_sense(field.direction[np.searchsorted(field.nodes, corners)]))
        return float(np.average(angle_between(mean, tangents[inside]), weights=lengths[inside]))


def tetrahedralise(anatomy: Anatomy, size: float) -> Tetrahedra:
    """Fill the surface with tetrahedra, finer at the bonded areas; a mirrored tongue is meshed by halves.

    Raises
    ------
    InputError
        If Gmsh cannot parametrise or fill the surface.
    """
    surface = anatomy.surface
    if anatomy.mirrored:
        right = surface.centroids[:, 1] > 0
        surface = Surface(surface.points, surface.triangles[right], surface.labels[right])
    try:
        points, cells = _gmsh_fill(surface, size)
    except Exception as error:  # the gmsh module raises plain Exception
        raise InputError(f"{anatomy.name}: Gmsh could not mesh the surface at {1e3 * size:g} mm: {error}") from error
    if anatomy.mirrored:
        points[abs(points[:, 1]) < 1e-9, 1] = 0.0
        off_plane = points[:, 1] > 0
        twin = np.arange(len(points))
        twin[off_plane] = len(points) + np.arange(off_plane.sum())
        points = np.vstack([points, points[off_plane] * (1, -1, 1)])
        cells = np.vstack([cells, twin[cells][:, [1, 0, 2, 3]]])
    faces = cells[:, [1, 2, 3, 0, 3, 2, 0, 1, 3, 0, 2, 1]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    facets = faces[first[count == 1]]
    centroids = points[facets].mean(axis=1)
    if anatomy.mirrored:
        centroids[:, 1] = abs(centroids[:, 1])  # the same label on both sides
    labels = surface.labels[surface.nearest_triangle(centroids)[0]]
    return Tetrahedra(points, cells, facets, labels)


def _gmsh_fill(surface: Surface, size: float) -> tuple[Floats, Ints]:
    """Remesh a discrete surface and fill it; a flat hole at y = 0 is closed by the mid-sagittal plane."""
    bonded = surface.triangles[surface.labels != "free"]
    near = cKDTree(1e3 * surface.points[np.unique(bonded)]) if len(bonded) else None
    h = 1e3 * size
    used, triangles = np.unique(surface.triangles, return_inverse=True)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", h)
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.3 * h)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.RandomSeed", 1)
        model = gmsh.model
        model.addDiscreteEntity(2, 1)
        model.mesh.addNodes(2, 1, np.arange(1, len(used) + 1), (1e3 * surface.points[used]).ravel())
        model.mesh.addElementsByType(1, 2, [], triangles.reshape(-1) + 1)
        model.mesh.classifySurfaces(math.pi, boundary=True, forReparametrization=True, curveAngle=math.pi)
        model.mesh.createGeometry()
        on_plane = [tag for _, tag in model.getEntities(1) if np.ptp(model.getBoundingBox(1, tag)[1::3]) < 1e-3 and _is_rim(tag)]
        if on_plane:
            loop = model.geo.addCurveLoop(on_plane, reorient=True)
            model.geo.addPlaneSurface([loop])
            model.geo.synchronize()
        model.geo.addVolume([model.geo.addSurfaceLoop([tag for _, tag in model.getEntities(2)])])
        model.geo.synchronize()

        lookup = _SizeLookup(near, surface, h)
        model.mesh.setSizeCallback(lambda dim, tag, x, y, z, lc: lookup(x, y, z))
        model.mesh.generate(3)
        model.mesh.optimize("Netgen")
        tags, coordinates, _ = model.mesh.getNodes()
        _, nodes = model.mesh.getElementsByType(4)
    finally:
        gmsh.finalize()
    points = coordinates.reshape(-1, 3)
    index = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    index[tags.astype(np.int64)] = np.arange(len(tags))
    cells = index[nodes.astype(np.int64)].reshape(-1, 4)
    kept, cells = np.unique(cells, return_inverse=True)
    return points[kept] * 1e-3, cells.reshape(-1, 4).astype(np.int64)


def _is_rim(curve: int) -> bool:
    """Whether only one surface meets at a curve."""
    return len(gmsh.model.getAdjacencies(1, curve)[0]) == 1


class _SizeLookup:
    """Element size in mm near a point, from a grid of 2 mm (Gmsh asks some hundred thousand times).

    The size falls toward bonded areas and where the surface is more curved than the elements can follow.
    """

    def __init__(self, bonded: cKDTree | None, surface: Surface, h: float) -> None:
        lower, upper = 1e3 * surface.points.min(axis=0) - 4, 1e3 * surface.points.max(axis=0) + 4
        axes = [np.arange(lower[i], upper[i] + 2, 2.0) for i in range(3)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        distance, nearest = cKDTree(1e3 * surface.centroids).query(grid)
        finest = np.clip(PER_RADIUS * 1e3 * surface.curvature_radius(CURVATURE_SCALE), REFINEMENT * h, h)
        size = np.minimum(h, finest[nearest] + GROWTH * distance)
        if bonded is not None:
            ramp = np.clip(bonded.query(grid)[0] / (1e3 * REFINED_WITHIN), 0, 1)
            size = np.minimum(size, h * (REFINEMENT + (1 - REFINEMENT) * ramp))
        self._size = size.tolist()
        self._lower = lower.tolist()
        self._last = [len(a) - 1 for a in axes]

    def __call__(self, x: float, y: float, z: float) -> float:
        i, j, k = (min(max(round((value - low) / 2), 0), last) for value, low, last in zip((x, y, z), self._lower, self._last, strict=True))
        return float(self._size[i][j][k])


def project_muscles(anatomy: Anatomy, mesh: Tetrahedra) -> dict[str, MuscleField]:
    """Weights and directions of every muscle at the vertices of the cells that its region touches.

    Raises
    ------
    InputError
        If a muscle's region touches no cell.
    """
    points = np.einsum("sv,cvd->csd", SUBPOINTS, mesh.points[mesh.cells]).reshape(-1, 3)
    volumes = mesh.volumes
    fields = {}
    for name, muscle in anatomy.muscles.items():
        inside = muscle.region(points).reshape(len(mesh.cells), len(SUBPOINTS))
        cells = np.flatnonzero(inside.any(axis=1))
        if len(cells) == 0:
            raise InputError(f"{anatomy.name}: muscle {name!r} has an empty region; its fibres must run inside the tongue surface.")
        share = np.einsum("cs,sv->cv", inside[cells], SUBPOINTS) / len(SUBPOINTS) * volumes[cells, None]
        nodes, weight = lump(mesh.cells[cells], share, volumes[cells])
        fields[name] = MuscleField(
            cells,
            nodes,
            weight,
            muscle.fibres.direction(mesh.points[nodes]),
            inside[cells].mean(axis=1),
            float(share.sum()),
            _entry(muscle, anatomy.surface, mesh),
        )
    return fields


def lump(elements: Ints, share: Floats, measure: Floats) -> tuple[Ints, Floats]:
    """Vertices of some cells or facets, and weights there whose linear interpolation has a given integral.

    Parameters
    ----------
    elements : (k, n) int array
        Vertices of each simplex.
    share : (k, n) float array
        Integral over each simplex of the quantity times each linear shape function.
    measure : (k,) float array
        Volume or area of each simplex.
    """
    nodes, local = np.unique(elements, return_inverse=True)
    n = elements.shape[1]
    total = np.bincount(local.ravel(), share.ravel())
    capacity = np.bincount(local.ravel(), np.repeat(measure / n, n))
    return nodes, total / capacity


def _entry(muscle: Muscle, surface: Surface, mesh: Tetrahedra) -> Entry | None:
    """The free facets that a muscle crosses on its way from its anchor, and its cross-section per area there."""
    if muscle.anchor is None:
        return None
    track = muscle.fibres.segments[0]
    depth = -surface.signed_distance(track)
    track = track[(depth < 2e-3) & (depth > -6e-3) & (np.linalg.norm(track - muscle.anchor, axis=1) > 6e-3)]
    facets = mesh.facets[mesh.labels == "free"]
    corners = mesh.points[facets]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points = np.einsum("sv,fvd->fsd", FACET_SUBPOINTS, corners)
    flat = points.reshape(-1, 3)
    inside = np.zeros(len(flat), dtype=bool)
    near = np.isfinite(cKDTree(track).query(flat, distance_upper_bound=5e-3)[0])
    toward = ((muscle.anchor - points) * normal[:, None]).sum(axis=2).ravel() > 0
    candidates = np.flatnonzero(near & toward)
    below = flat[candidates] - 3e-4 * np.repeat(normal, len(FACET_SUBPOINTS), axis=0)[candidates]
    inside[candidates] = muscle.region(below)
    cosine = abs((muscle.fibres.direction(flat).reshape(points.shape) * normal[:, None]).sum(axis=2))
    crossed = np.where(inside.reshape(cosine.shape), cosine, 0.0)
    touched = crossed.any(axis=1)
    facets, crossed = facets[touched], crossed[touched]
    sides = corners[touched, 1:] - corners[touched, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    share = np.einsum("fs,sv->fv", crossed, FACET_SUBPOINTS) / len(FACET_SUBPOINTS) * area[:, None]
    nodes, value = lump(facets, share, area)
    return Entry(facets, value[np.searchsorted(nodes, facets)], muscle.anchor)


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
    with h5py.File(path, "w") as file:
        file.attrs["name"] = anatomy.name
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
