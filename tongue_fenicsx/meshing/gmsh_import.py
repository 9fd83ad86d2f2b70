# SPDX-License-Identifier: MIT
"""Muscles of a user's own Gmsh mesh: regions from physical volumes or cell data, fibres from a JSON file or cell vectors.

A physical volume or a cell data set (0…1) named like a muscle is its region; volumes may overlap and combine names
(``GGP_L+TRANS_L``). A cell data set of vectors named like a muscle is region and fibres at once. Otherwise the fibres
stand in ``FILE.fibres.json`` beside ``FILE.msh``, for each muscle one of

- ``[[[x, y, z], …], …]``, polylines, in the unit of the mesh;
- ``{"direction": [x, y, z]}``, straight fibres;
- ``{"toward": [x, y, z]}``, a fan that meets in a point.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from ..anatomy.catalogue import CATALOGUE, base_name
from ..core.errors import InputError, reading, short, within
from ..core.types import Floats
from ..core.values import check_name
from ..geometry.fibre_bundle import FibreBundle
from ..geometry.fibre_direction import angle_between, common_sense, dyads, main_axis
from ..geometry.tetrahedron import volumes
from .muscle_fields import lump

FAR = 20.0
"""Lengths and distances of fibres may be this many times the size of their muscle."""
FIBRES = "polylines, {'direction': [x, y, z]} or {'toward': [x, y, z]}"


def partition() -> None:
    """Give every volume of the open Gmsh model one physical name: that of all its physical volumes, joined by ``+``."""
    model = gmsh.model
    owners: dict[int, list[str]] = {}
    groups = model.getPhysicalGroups(3)
    for _, tag in groups:
        for entity in model.getEntitiesForPhysicalGroup(3, tag):
            owners.setdefault(int(entity), []).append(model.getPhysicalName(3, tag))
    if all(len(names) == 1 for names in owners.values()):
        return
    model.removePhysicalGroups(groups)
    combined: dict[str, list[int]] = {}
    for entity, names in owners.items():
        combined.setdefault("+".join(sorted({part for name in names for part in name.split("+")})), []).append(entity)
    for name, entities in combined.items():
        model.addPhysicalGroup(3, entities, name=name)


def muscles_of_model(path: Path, unit: float) -> dict[str, Any] | None:
    """The muscles of the open Gmsh model, in m, in the form of ``FILE.h5``; None when it has no fibres at all.

    Parameters
    ----------
    path : Path
        Of the mesh.
    unit : float
        Unit in m of the fibre file beside it.

    Raises
    ------
    InputError
        If a data set or the fibre file is malformed, a muscle has a region without fibres or fibres without a region, or they lie apart.
    """
    tags, nodes = gmsh.model.mesh.getElementsByType(4)
    cells = nodes.astype(np.int64).reshape(-1, 4) - 1
    points = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
    row = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    row[tags.astype(np.int64)] = np.arange(len(tags))
    rules = _rules(path.with_suffix(".fibres.json"), unit)
    shares, vectors = _cell_data(path, row, len(cells), rules)
    named = {name for name in _volume_names() if base_name(name) in CATALOGUE or name in rules}
    if not rules and not vectors:
        return None
    for name in named:
        shares.setdefault(name, np.zeros(len(cells)))
    for _, tag in gmsh.model.getPhysicalGroups(3):
        for entity in gmsh.model.getEntitiesForPhysicalGroup(3, tag):
            members = row[gmsh.model.mesh.getElementsByType(4, entity)[0].astype(np.int64)]
            for name in named.intersection(gmsh.model.getPhysicalName(3, tag).split("+")):
                shares[name][members] = 1.0
    for name in rules:
        if name not in shares:
            raise InputError(f"{path}: no physical volume or cell data {name!r}, but {path.stem}.fibres.json has its fibres.")
    for name, vector in vectors.items():
        shares.setdefault(name, (np.linalg.norm(vector, axis=1) > 0).astype(float))
    muscles: dict[str, dict[str, Any]] = {}
    with within(path):
        for name in shares:
            check_name("muscle", name)
    for name, share in shares.items():
        if name not in rules and name not in vectors:
            raise InputError(f"{path}: muscle {name!r} has no fibres; give them in {path.stem}.fibres.json as {FIBRES}.")
        own = np.flatnonzero(share > 0)
        if len(own) == 0:
            raise InputError(f"{path}: muscle {name!r} has an empty region.")
        volume = abs(volumes(points[cells[own]]))
        used, weight = lump(cells[own], np.repeat((share[own] * volume / 4)[:, None], 4, axis=1), volume)
        muscles[name] = {"cells": own, "nodes": used, "weight": weight}
        if name in rules:
            with within(path.with_suffix(".fibres.json")):
                rules[name].check_place(name, points[used])
            muscles[name]["direction"] = rules[name](points[used])
        else:
            given, local = vectors[name][own], np.searchsorted(used, cells[own])
            if not given.any(axis=1).all():
                raise InputError(
                    f"{path}: the cell data {name!r} has vectors of length zero in the muscle; a direction is expected in each cell."
                )
            muscles[name]["direction"] = at_nodes = _nodal(given, local, len(used))
            field = common_sense(at_nodes[local]).mean(axis=1)
            muscles[name]["direction_error"] = float(np.average(angle_between(field, given), weights=share[own] * volume))
    return {"name": path.stem, "cells": cells, "muscles": muscles, "landmarks": {}, "bones": {}}


def _volume_names() -> set[str]:
    return {part for dim, tag in gmsh.model.getPhysicalGroups(3) for part in gmsh.model.getPhysicalName(dim, tag).split("+")}


def _cell_data(path: Path, row: np.ndarray, n_cells: int, rules: Collection[str]) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Scalar shares (n,) and fibre vectors (n, 3) of the cells by muscle, from the element data of the file."""
    shares, vectors = {}, {}
    for view in gmsh.view.getTags():
        name = gmsh.view.option.getString(view, "Name")
        kind, elements, data, _, components = gmsh.view.getModelData(view, 0)
        standard = base_name(name) in CATALOGUE
        if kind != "ElementData":
            if standard:
                raise InputError(f"{path}: the data {name!r} are of kind {kind}; a muscle is read from data of cells (ElementData).")
            continue
        if not (standard or components == 3 or name in rules):  # not of a muscle
            continue
        values = np.zeros((n_cells, components))
        values[row[np.asarray(elements, dtype=np.int64)]] = np.asarray(data, dtype=float).reshape(-1, components)
        if not np.isfinite(values).all():
            raise InputError(f"{path}: the cell data {name!r} holds a value that is not finite.")
        if components == 3:
            vectors[name] = values
        elif components == 1 and values.min() >= 0 and values.max() <= 1:
            shares[name] = values[:, 0]
        else:
            raise InputError(f"{path}: the cell data {name!r} must be shares from 0 to 1 or vectors of three components.")
    return shares, vectors


@dataclass(frozen=True)
class _Rule:
    """Directions (n, 3) at points (n, 3) in m: along polylines, along a vector, or toward a point."""

    lines: FibreBundle | None = None
    along: Floats | None = None
    point: Floats | None = None

    @classmethod
    def read(cls, given: Any, unit: float) -> _Rule:
        """The rule that stands in a fibre file, whose unit is `unit` (m)."""
        if isinstance(given, list):
            lines = [unit * np.asarray(line, dtype=float) for line in given]
            if not lines or any(line.ndim != 2 or line.shape[1] != 3 or len(line) < 2 or not np.isfinite(line).all() for line in lines):
                raise ValueError("a polyline of two or more finite points is expected")
            return cls(FibreBundle(lines))
        if not isinstance(given, dict) or len(given) != 1:
            raise ValueError(f"{short(given)}; one of {FIBRES} is expected")
        ((kind, value),) = given.items()
        vector = np.array([float(c) for c in value])
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise ValueError(f"{short(value)} is not three finite numbers")
        if kind == "direction" and np.any(vector):
            return cls(along=vector / abs(vector).max())
        if kind == "toward":
            return cls(point=unit * vector)
        raise ValueError(f"{kind!r}: direction (of some length) or toward is expected")

    def __call__(self, points: Floats) -> Floats:
        if self.lines is not None:
            return self.lines.direction(points)
        if self.along is not None:
            return _unit(np.broadcast_to(self.along, points.shape))
        return _unit(np.asarray(self.point) - points)

    def check_place(self, name: str, points: Floats) -> None:
        """Make sure that the fibres have to do with the muscle at points (n, 3).

        Raises
        ------
        InputError
            If polylines lie beside it or are of another order of length, or the point is so far away that its unit is another one.
        """
        extent = float(np.ptp(points, axis=0).max())
        if self.point is not None and (far := float(np.linalg.norm(points - self.point, axis=1).min())) > FAR * extent:
            raise InputError(
                f"muscle {name!r}: its fibres meet {1e3 * far:.4g} mm away from it, {far / extent:.0f} times its size; a point near it is "
                "expected, in the unit of the mesh, or a direction."
            )
        if self.lines is None:
            return
        away = float(np.median(self.lines.distance(points)))
        longest = max(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in self.lines.lines)
        if away > extent or not extent / FAR < longest < FAR * extent:
            units = (("mm", 1e-3), ("cm", 1e-2), ("m", 1e3))
            likely = [f"they may be in {unit}; " for unit, factor in units if 0.2 < factor * longest / extent < 5]
            raise InputError(
                f"muscle {name!r}: its fibres, up to {1e3 * longest:.4g} mm long, lie {1e3 * away:.4g} mm from it, which is "
                f"{1e3 * extent:.4g} mm long; {''.join(likely)}fibres that run through it are expected, in the unit of the mesh."
            )


def _rules(path: Path, unit: float) -> dict[str, _Rule]:
    if not path.exists():
        return {}
    with reading(path, f"an object of muscle names to {FIBRES}"):
        data = json.loads(path.read_text(encoding="utf-8-sig"))
        if not isinstance(data, dict):
            raise ValueError("it holds no object")
        rules = {}
        for name, given in data.items():
            try:
                rules[name] = _Rule.read(given, unit)
            except (ValueError, TypeError) as error:
                raise ValueError(f"{name!r}: {error}") from error
        return rules


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), [1.0, 0.0, 0.0])


def _nodal(vectors: Floats, local: np.ndarray, n_nodes: int) -> Floats:
    """Unit directions at nodes (n, 3), of either sense: the mean axis of the vectors (k, 3) of the cells (k, 4) around each."""
    total, one = np.zeros((n_nodes, 3, 3)), np.zeros((n_nodes, 3))
    np.add.at(total, local, dyads(_unit(vectors))[:, None])
    one[local] = vectors[:, None]
    return main_axis(total, one)
