# SPDX-License-Identifier: MIT
"""A real subject: a folder with a tongue surface, fibre polylines, attachments and bones.

===================== ==================================================================================
file                  content (metres; x posterior, y right, z up)
===================== ==================================================================================
tongue_surface.*      closed surface (STL, OBJ, PLY, VTP)
fibres.json           ``{"GGP_L": [[[x, y, z], …], …], …}``, each polyline from origin to insertion
attachments.json      ``{"mandible": [node, …], "hyoid": […]}``, nodes of the hexahedral mesh or ``[x, y, z]``
tongue_hex.vtu        optional: volume mesh with one 0/1 cell array per muscle, its region
*.stl, *.obj, *.vtp   optional: bones and walls, named by file
===================== ==================================================================================
"""

from __future__ import annotations

import json
import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .anatomy import Anatomy, Muscle
from .errors import InputError, quiet, reading
from .fibres import Bools, FibreBundle, Floats
from .surface import Surface, closed, read_surface

SURFACE_SUFFIXES = (".stl", ".obj", ".ply", ".vtp")
SYNONYMS = {"STY": "SG"}


class CellSets:
    """Muscle regions given as cells of a volume mesh.

    Parameters
    ----------
    path : Path
        A VTU file whose 0/1 cell arrays are named after muscles.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with reading(path, "a volume mesh in VTU"), quiet():
            self.grid = pv.read(path)
            if self.grid.n_cells == 0:
                raise ValueError("it holds no cells")
            for name, values in self.grid.cell_data.items():
                if values.ndim != 1 or not np.isin(values, (0, 1)).all():
                    raise ValueError(f"the cell array {name!r} is not made of 0 and 1")
        self.names = [name for name in self.grid.cell_data if name]
        self._points: Floats | None = None
        self._cells: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def locate(self, points: Floats) -> NDArray[np.int64]:
        """The cell of each point, (n,); outside the mesh the nearest. The last answer is kept for the next muscle."""
        if self._points is not points:
            cells = np.atleast_1d(self.grid.find_containing_cell(points))
            outside = cells < 0
            if outside.any():
                cells[outside] = np.atleast_1d(self.grid.find_closest_cell(points[outside]))
            self._points, self._cells = points, cells.astype(np.int64)
        return self._cells

    def region(self, name: str, points: Floats) -> Bools:
        """Whether each point lies in a cell of the muscle."""
        inside: Bools = np.asarray(self.grid.cell_data[name], dtype=bool)[self.locate(points)]
        return inside


def read_subject(folder: Path, radius: float = 4e-3) -> Anatomy:
    """Read a subject's folder.

    Parameters
    ----------
    folder : Path
        The folder described in the module's documentation.
    radius : float
        Distance in m from its polylines that a muscle fills when no cell set gives its region.

    Raises
    ------
    InputError
        If a file is missing or malformed, the surface cannot be closed, a muscle has no fibres or an attachment lies
        away from the surface.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: the subject folder does not exist.")
    surfaces = sorted(p for p in folder.iterdir() if p.suffix.lower() in SURFACE_SUFFIXES)
    tongue = [p for p in surfaces if p.stem == "tongue_surface"]
    if not tongue:
        raise InputError(f"{folder}: no tongue_surface.stl (or .obj, .ply, .vtp) in this folder.")
    surface, repair = closed(read_surface(tongue[0]), tongue[0])
    size = float(np.ptp(surface.points, axis=0).max())
    if not 0.03 < size < 0.3:
        raise InputError(f"{tongue[0]}: the surface is {size:g} long; a tongue in metres (0.03 to 0.3) is expected, so convert the unit.")
    hex_path = folder / "tongue_hex.vtu"
    cell_sets = CellSets(hex_path) if hex_path.is_file() else None
    surface = _bond(surface, folder / "attachments.json", cell_sets)
    muscles, how = _muscles(folder / "fibres.json", surface, cell_sets, radius)
    starts = [np.mean([line[0] for line in m.fibres.lines], axis=0) for m in muscles.values() if m.name.startswith("GG")]
    spine = np.mean(starts, axis=0) * (1, 0, 1) if starts else np.zeros(3)
    bones = {p.stem: read_surface(p) for p in surfaces if p not in tongue}
    notes = [note for note in (repair, how) if note]
    return Anatomy(folder.name, surface, muscles, spine, bones, notes=notes)


def _read_json(path: Path, expected: str) -> dict[str, Any]:
    with reading(path, expected):
        data = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(data, dict) or not data:
        raise InputError(f"{path}: {expected} is expected.")
    for name in data:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9]{0,15}(_[A-Za-z]+)*", name) or name == "free":
            raise InputError(f"{path}: {name!r} is not accepted as a name; letters and digits are, with _L or _R for a side.")
    return data


def _bond(surface: Surface, path: Path, cell_sets: CellSets | None) -> Surface:
    """Label the triangles whose corners are all attachment nodes of one bone."""
    data = _read_json(path, 'an object {"mandible": [node, …], "hyoid": [node, …]}')
    tree = cKDTree(surface.points)
    labels = surface.labels.copy()
    for bone, nodes in data.items():
        if bone.endswith("_m"):  # anchors outside the tongue
            continue
        with reading(path, f"{bone!r} as a list of node numbers or of [x, y, z] in m"):
            values = np.asarray(nodes)
            if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
                raise ValueError("something is not a finite number")
        if values.dtype.kind in "iu" and values.ndim == 1:
            if cell_sets is None:
                raise InputError(f"{path}: {bone!r} holds node numbers, but there is no tongue_hex.vtu that they refer to.")
            if values.size and not 0 <= values.min() <= values.max() < cell_sets.grid.n_points:
                raise InputError(f"{path}: {bone!r} holds node numbers outside 0…{cell_sets.grid.n_points - 1} of tongue_hex.vtu.")
            values = np.asarray(cell_sets.grid.points)[values]
        if values.ndim != 2 or values.shape[1] != 3:
            raise InputError(f"{path}: {bone!r} must be a list of node numbers or of [x, y, z] in m.")
        distance, index = tree.query(values)
        if distance.max() > 1e-3:
            worst = int(np.argmax(distance))
            raise InputError(
                f"{path}: {bone!r}, entry {worst}, lies {1e3 * distance[worst]:.1f} mm from the tongue surface; "
                "attachments must be on the surface (within 1 mm)."
            )
        bonded = np.isin(surface.triangles, index[distance < 1e-4]).all(axis=1)
        if not bonded.any():
            raise InputError(f"{path}: {bone!r} spans no triangle of the surface; list all the nodes of the bonded patch.")
        labels[bonded] = bone
    if (labels == "free").all():
        raise InputError(f"{path}: nothing is bonded; list the nodes bonded to the mandible and to the hyoid.")
    return Surface(surface.points, surface.triangles, labels)


def _muscles(path: Path, surface: Surface, cell_sets: CellSets | None, radius: float) -> tuple[dict[str, Muscle], str]:
    data = _read_json(path, 'an object {"GGP_L": [[[x, y, z], …], …], …}')
    muscles, by_radius = {}, []
    for bundle, polylines in data.items():
        with reading(path, f"{bundle!r} as a list of polylines of [x, y, z] in m"):
            lines = [np.asarray(line, dtype=float) for line in polylines]
            if not all(line.ndim == 2 and line.shape[1] == 3 and np.isfinite(line).all() for line in lines):
                raise ValueError("a point is not three finite numbers")
        lines = [line[np.r_[True, np.any(np.diff(line, axis=0) != 0, axis=1)]] for line in lines]
        lines = [line for line in lines if len(line) > 1]
        if not lines:
            raise InputError(f"{path}: {bundle!r} has no polyline of two or more points.")
        away = np.linalg.norm(np.vstack(lines) - surface.points.mean(axis=0), axis=1).min()
        if away > np.ptp(surface.points, axis=0).max():
            raise InputError(
                f"{path}: {bundle!r} lies {1e3 * away:.0f} mm from the tongue; coordinates in m, like the surface's, are expected."
            )
        base, _, side = bundle.partition("_")
        name = "_".join(filter(None, (SYNONYMS.get(base, base), side)))
        if name in muscles:
            raise InputError(f"{path}: {bundle!r} is {name} a second time; STY is another name of SG.")
        fibres = FibreBundle(lines, smoothing=5e-3)
        if cell_sets is not None and bundle in cell_sets.names:
            muscles[name] = Muscle(name, fibres, partial(cell_sets.region, bundle))
        else:
            muscles[name] = Muscle(name, fibres, partial(fibres.within, radius=radius))
            by_radius.append(name)
    how = f"muscle regions: {len(muscles) - len(by_radius)} from cell sets"
    if by_radius:
        how += f", {len(by_radius)} within {1e3 * radius:g} mm of their polylines ({', '.join(by_radius)})"
    return muscles, how + "."
