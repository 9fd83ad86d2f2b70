# SPDX-License-Identifier: MIT
"""A mesh file of Gmsh, opened and held to what DOLFINx needs, which cannot report such faults itself: what is wrong, how often, where."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..core.errors import InputError, reading
from ..core.types import Floats
from . import gmsh_import as foreign

EDGES = np.array([(0, 1), (1, 2), (2, 0), (3, 0), (2, 3), (1, 3)])
"""Corners of the edges of Gmsh's quadratic tetrahedron, in the order of the nodes on them."""
FACES = np.array([(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)])
STRAIGHT = 1e-3
"""How far a node may lie from the middle of its edge, per length of the edge, for the edge to be straight."""


def open_mesh(path: Path, unit: float) -> list[str]:
    """Open a mesh in Gmsh, in m, each of its cells in one physical volume; return what a user should know of it.

    Parameters
    ----------
    path : Path
        The ``.msh`` file.
    unit : float
        Its unit in m.

    Raises
    ------
    InputError
        If it is no mesh, is not made of straight tetrahedra of a tongue's size that hang together and have positive volume, or if its
        physical groups have no names or overlap.
    """
    with reading(path, "a Gmsh .msh file (tongue build writes one)"):
        if path.suffix.lower() != ".msh" or not path.read_bytes()[:200].lstrip().startswith(b"$"):
            raise ValueError("it is no mesh of Gmsh")
        try:
            gmsh.open(str(path))
        except Exception as error:  # the gmsh module raises plain Exception
            raise ValueError(str(error) or "it is no mesh of Gmsh") from error
    tags = gmsh.model.mesh.getElements(3)[1]
    if any(len(np.unique(some)) < len(some) for some in tags):  # data that were appended to the file brought the mesh along
        gmsh.model.mesh.removeDuplicateNodes()
        gmsh.model.mesh.removeDuplicateElements()
    gmsh.model.mesh.renumberNodes()
    gmsh.model.mesh.affineTransform((unit * np.eye(3, 4)).ravel().tolist())
    notes = _take_corners(path)
    _check_size(path)
    _check_groups(path)
    _check_cells(path)
    return notes


def _points() -> Floats:
    return np.asarray(gmsh.model.mesh.getNodes()[1]).reshape(-1, 3)


def _cells(kind: int, entity: int = -1) -> NDArray[np.int64]:
    nodes = gmsh.model.mesh.getElementsByType(kind, entity)[1].astype(np.int64) - 1
    return np.asarray(nodes.reshape(-1, gmsh.model.mesh.getElementProperties(kind)[3]))


def _at(points: Floats) -> str:
    return f"at ({', '.join(f'{1e3 * c:.4g}' for c in points.mean(axis=0))}) mm"


def _take_corners(path: Path) -> list[str]:
    """Make quadratic tetrahedra linear, if they are straight."""
    types = list(gmsh.model.mesh.getElementTypes(3))
    if types == [4]:
        return []
    if types != [11]:
        found = ", ".join(gmsh.model.mesh.getElementProperties(t)[0] for t in types) or "no volume elements"
        raise InputError(f"{path}: linear tetrahedra only are expected in the volume; found {found}.")
    nodes = _points()[_cells(11)]
    ends, middles = nodes[:, EDGES], nodes[:, 4:]
    away = np.linalg.norm(middles - ends.mean(axis=2), axis=2)
    if np.any(away > STRAIGHT * np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)):
        cell, edge = np.unravel_index(np.argmax(away), away.shape)
        raise InputError(
            f"{path}: quadratic tetrahedra that are curved, by up to {1e3 * away.max():.3g} mm {_at(ends[cell, edge])}; straight ones are "
            "expected, so save the mesh with Mesh.ElementOrder = 1."
        )
    gmsh.model.mesh.setOrder(1)
    gmsh.model.mesh.renumberNodes()
    return [f"{path.name}: quadratic tetrahedra were read by their corners; displacements are quadratic on them all the same."]


def _check_size(path: Path) -> None:
    points = _points()
    if not np.isfinite(points).all():
        raise InputError(f"{path}: a coordinate is not a finite number.")
    size = np.ptp(points, axis=0).max()
    if not 1e-3 <= size <= 1.0:
        raise InputError(
            f"{path}: the mesh is {size:g} m long; 0.001 to 1 m is accepted, so convert its unit to metres or state it in mesh.unit."
        )


def _check_groups(path: Path) -> None:
    """Every volume in one physical group, joined by ``+`` where there were several; no surface in two; all with names."""
    model = gmsh.model
    for dim, what in ((3, "volume"), (2, "surface")):
        names = {tag: model.getPhysicalName(dim, tag) for _, tag in model.getPhysicalGroups(dim)}
        unnamed = [tag for tag, name in names.items() if not name]
        if unnamed:
            raise InputError(f"{path}: physical {what} {unnamed[0]} has no name of its own; every physical {what} needs one.")
        if dim == 3:
            foreign.partition()
        groups = {tag: set(model.getEntitiesForPhysicalGroup(dim, tag).tolist()) for _, tag in model.getPhysicalGroups(dim)}
        owners = Counter(entity for group in groups.values() for entity in group)
        for entity, count in owners.items():
            if count > 1:
                inside = [names[tag] for tag, group in groups.items() if entity in group]
                raise InputError(f"{path}: {what} {entity} is in the physical groups {' and '.join(inside)}; exactly one is accepted.")
        if dim == 2 and not names:
            raise InputError(f"{path}: no physical surface; name at least the one to be fixed.")
        alone = np.vstack([_cells(4, e) for _, e in model.getEntities(3) if e not in owners] or [np.empty((0, 4), int)])
        if dim == 3 and len(alone):
            raise InputError(
                f"{path}: some volume is in no physical group, {len(alone)} tetrahedra, the first {_at(_points()[alone[0]])}; "
                "give every volume one physical name."
            )


def _check_cells(path: Path) -> None:
    """No cell twice, inverted or flat, and one body."""
    points, cells, facets = _points(), _cells(4), _cells(2)
    for elements, what in ((cells, "tetrahedra are"), (facets, "triangles of physical surfaces are")):
        _, first, count = np.unique(np.sort(elements, axis=1), axis=0, return_index=True, return_counts=True)
        if np.any(count > 1):
            where = _at(points[elements[first[count > 1].min()]])
            raise InputError(f"{path}: {np.sum(count > 1)} {what} there twice or more, the first {where}; once is expected.")
    tags = gmsh.model.mesh.getElementsByType(4)[0]
    quality = gmsh.model.mesh.getElementQualities(tags, "minSICN")
    bad = np.flatnonzero(quality <= 0)
    if len(bad):
        worst = int(np.argmin(quality))
        raise InputError(
            f"{path}: tetrahedron {tags[worst]} is inverted or flat (SICN {quality[worst]:.3g}) {_at(points[cells[worst]])}"
            f"{f', and {len(bad) - 1} more are' if len(bad) > 1 else ''}; every one must have positive volume."
        )
    faces = np.sort(cells[:, FACES].reshape(-1, 3), axis=1)
    _, face, count = np.unique(faces, axis=0, return_inverse=True, return_counts=True)
    face = face.ravel()
    if np.any(count > 2):
        first = faces[np.flatnonzero(count[face] > 2)[0]]
        raise InputError(
            f"{path}: {np.sum(count > 2)} triangles belong to three or more tetrahedra, the first {_at(points[first])}; two at most are "
            "expected, as tetrahedra must not overlap."
        )
    owner = np.repeat(np.arange(len(cells)), 4)
    joined = coo_array((np.ones(len(face)), (owner, len(cells) + face)), shape=2 * (len(cells) + len(count),))
    piece = connected_components(joined, directed=False)[1][: len(cells)]
    sizes = np.unique(piece, return_counts=True)[1]
    if len(sizes) > 1:
        small = piece == np.unique(piece)[np.argmin(sizes)]
        own, others = np.unique(cells[small]), np.unique(cells[~small])
        touching = cKDTree(points[others]).query(points[own])[0].min() < 1e-6 * np.ptp(points, axis=0).max()
        raise InputError(
            f"{path}: {len(sizes)} pieces that no common face joins, the smallest of {small.sum()} tetrahedra {_at(points[own])}; "
            f"one is expected{', so merge nodes that lie in one place' if touching else ''}."
        )
