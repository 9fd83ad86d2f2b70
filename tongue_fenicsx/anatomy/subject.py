# SPDX-License-Identifier: MIT
"""A real subject: a folder with a tongue surface, fibre polylines, attachments and bones.

===================== ==================================================================================
file                  content
===================== ==================================================================================
tongue_surface.*      closed surface (STL, OBJ, PLY, VTP, VTU)
fibres.json           ``{"GGP_L": [[[x, y, z], …], …], …}``, polylines; or a folder ``fibres/`` with one VTP a muscle
attachments.json      ``{"mandible": …, "hyoid": …}``: nodes of the volume mesh, ``[x, y, z]``, or a patch's file name
frame.toml            optional: ``unit``, ``axes``, ``mid_plane``, ``genial_spine`` (metres, PRS, 0, found), and more
tongue_hex.vtu        optional: volume mesh with one 0/1 cell array per muscle, its region
*.stl, *.obj, …       optional: bones and walls, named by file
===================== ==================================================================================
"""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.errors import InputError, quiet, reading, within
from ..core.types import Bools, Floats
from ..core.values import UNITS, Real
from ..geometry.fibre_bundle import FibreBundle
from ..geometry.surface import SUFFIXES, Surface, close_surface, read_surface
from . import catalogue as muscle_facts
from .anatomy import Anatomy, Muscle
from .carry_over import CarriedOver
from .frame_guess import HULL, LENGTH, hull, in_metres, is_tongue, likely_unit

SYNONYMS = {"STY": "SG"}
AXES = {"P": (0, 1), "A": (0, -1), "R": (1, 1), "L": (1, -1), "S": (2, 1), "I": (2, -1)}
"""Directions by their letters (posterior, anterior, right, left, superior, inferior): axis of ours and sign."""

BONE = (3e-3, 0.6)
"""How long a bone or wall may be, in m."""

MUSCLES = ("measured", "built-in")
"""Where a subject's muscles come from."""

OUTSIDE = 10e-3
"""Fibres that end farther than this from the tongue, in m, belong to a muscle that comes from a bone out there."""


def check_axes(axes: str) -> str:
    """Refuse what does not say where x, y and z point, with a ValueError."""
    letters = list(axes) if isinstance(axes, str) else []
    if sorted(AXES[letter][0] for letter in letters if letter in AXES) != [0, 1, 2]:
        raise ValueError(f"{axes!r}; three letters are expected, one each of P or A, R or L, S or I")
    return axes


@dataclass(frozen=True)
class Frame:
    """How a folder's coordinates are meant, from its ``frame.toml``.

    Attributes
    ----------
    unit : str or float
        ``m``, ``cm`` or ``mm``, or the length of another in m.
    axes : str
        Where x, y and z point: three letters of P/A, R/L and S/I, such as ``LPS``; ours is ``PRS``.
    mid_plane : float
        Lateral coordinate of the mid-sagittal plane.
    genial_spine : sequence of float, optional
        The superior genial spine; without it the mean start of the genioglossus fibres.
    repair : float
        How far a repair of crossing triangles may move the tongue's surface; 0 for none.
    cap : bool
        Close the holes of the tongue's surface.
    muscles : str
        ``measured``, or ``built-in`` for those of the built-in tongue, carried over, with its attachments.
    """

    unit: str | float = "m"
    axes: str = "PRS"
    mid_plane: float = 0.0
    genial_spine: tuple[float, float, float] | None = None
    repair: float = 0.0
    cap: bool = False
    muscles: str = "measured"

    @classmethod
    def read(cls, path: Path) -> Frame:
        """Read ``frame.toml``, or take the defaults where there is none."""
        if not path.exists():
            return cls()
        with reading(path, "a table in TOML"):
            data = tomllib.loads(path.read_text(encoding="utf-8"))
        known = [item.name for item in fields(cls)]
        for key in data:
            if key not in known:
                raise InputError(f"{path}: unknown key {key!r}; known are {', '.join(known)}.")
        frame = cls(**data)
        number = isinstance(frame.unit, int | float) and not isinstance(frame.unit, bool) and 0 < frame.unit < np.inf
        if not number and frame.unit not in list(UNITS):
            raise InputError(f"{path}: unit: {frame.unit!r} is not one of {', '.join(UNITS)}, nor the length of another in m.")
        if not isinstance(frame.cap, bool):
            raise InputError(f"{path}: cap: {frame.cap!r}; true or false is expected.")
        if frame.muscles not in MUSCLES:
            raise InputError(f"{path}: muscles: {frame.muscles!r} is not one of {', '.join(MUSCLES)}.")
        try:
            check_axes(frame.axes)
        except ValueError as error:
            raise InputError(f"{path}: axes: {error}.") from error
        for key, expected in (("mid_plane", Real()), ("repair", Real(low=0))):
            try:
                expected.check(getattr(frame, key))
            except ValueError as error:
                raise InputError(f"{path}: {key}: {error}.") from error
        if frame.genial_spine is not None and (
            np.shape(frame.genial_spine) != (3,) or not all(isinstance(c, int | float) and np.isfinite(c) for c in frame.genial_spine)
        ):
            raise InputError(f"{path}: genial_spine: {frame.genial_spine!r}; three numbers are expected.")
        return frame

    @property
    def metre(self) -> float:
        """Length of the unit in m."""
        return in_metres(self.unit)

    def metres(self, points: Any) -> Floats:
        """Points (n, 3) of the folder in our frame: metres, x posterior, y right, z up."""
        given = np.asarray(points, dtype=float).reshape(-1, 3)
        ours = np.empty_like(given)
        for column, letter in enumerate(self.axes):
            axis, sign = AXES[letter]
            ours[:, axis] = sign * (given[:, column] - (self.mid_plane if axis == 1 else 0.0))
        return self.metre * ours

    def surface(self, path: Path) -> Surface:
        """Read a surface of the folder."""
        surface = read_surface(path).transform(self.metres)
        if np.prod([AXES[letter][1] for letter in self.axes]) * _parity(self.axes) < 0:  # a mirrored frame turns normals
            surface = Surface(surface.points, surface.triangles[:, ::-1].copy())
        return surface


def _parity(axes: str) -> int:
    order = [AXES[letter][0] for letter in axes]
    return 1 if order in ([0, 1, 2], [1, 2, 0], [2, 0, 1]) else -1


class CellSets:
    """Muscle regions given as cells of a volume mesh.

    Parameters
    ----------
    path : Path
        A VTU file whose 0/1 cell arrays are named after muscles.
    frame : Frame
        Of its coordinates.
    """

    def __init__(self, path: Path, frame: Frame) -> None:
        self.path = path
        with reading(path, "a volume mesh in VTU"), quiet():
            self.grid = pv.read(path)
            if self.grid.n_cells == 0:
                raise ValueError("it holds no cells")
            for name, values in self.grid.cell_data.items():
                if values.ndim != 1 or not np.isin(values, (0, 1)).all():
                    raise ValueError(f"the cell array {name!r} is not made of 0 and 1")
            self.grid.points = frame.metres(self.grid.points)
            self._volumes = abs(self.grid.compute_cell_sizes(length=False, area=False).cell_data["Volume"])
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

    def volume(self, name: str) -> float:
        """Volume of a muscle's cells in m³."""
        return float(self._volumes[np.asarray(self.grid.cell_data[name], dtype=bool)].sum())


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
        If a file is missing or malformed, the surface cannot be closed, a muscle has no fibres or they run outside the
        tongue, or an attachment lies away from the surface.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: the subject folder does not exist.")
    frame = Frame.read(folder / "frame.toml")
    surfaces = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.name != "tongue_hex.vtu")
    tongue = [p for p in surfaces if p.stem == "tongue_surface"]
    if not tongue:
        raise InputError(f"{folder}: no tongue_surface.stl (or {', '.join(SUFFIXES[1:])}) in this folder.")
    seen = frame.surface(tongue[0])
    if not is_tongue(seen.points):
        raise InputError(f"{tongue[0]}: {_wrong_size(seen.points, frame)}")
    surface, repair = close_surface(seen, tongue[0], frame.metre * frame.repair, cap=frame.cap)
    hex_path, attachments = folder / "tongue_hex.vtu", folder / "attachments.json"
    cell_sets = CellSets(hex_path, frame) if hex_path.is_file() else None
    notes: list[str] = [repair] if repair else []
    patches: list[str] = []
    spine: Floats | None = None
    if frame.muscles == "built-in":
        with within(tongue[0]):
            carried = CarriedOver(seen, surface, bonded=not attachments.exists())
        muscles, surface, spine = carried.muscles, carried.surface, carried.genial_spine
        notes += carried.notes
    if frame.muscles == "measured" or attachments.exists():
        surface, patches = _bond(surface, attachments, cell_sets, frame)
    if frame.muscles == "measured":
        muscles, said = _muscles(_fibre_lines(folder, frame), surface, cell_sets, radius)
        notes += said
    if frame.genial_spine is not None:
        spine = frame.metres(frame.genial_spine)[0]
    elif spine is None:
        starts = [np.mean([line[0] for line in m.fibres.lines], axis=0) for m in muscles.values() if m.name.startswith("GG")]
        spine = np.mean(starts, axis=0) * (1, 0, 1) if starts else np.zeros(3)
    bones = {p.stem: _bone(frame.surface(p), p) for p in surfaces if p not in tongue and p.name not in patches}
    return Anatomy(folder.name, surface, muscles, spine, bones, notes=notes)


def _wrong_size(points: Floats, frame: Frame) -> str:
    """What is wrong with the size of a surface of points (n, 3) in m, and the unit in which it would be a tongue's."""
    size, around, unit = float(np.ptp(points, axis=0).max()), 1e6 * hull(points), likely_unit(points / frame.metre)
    return (
        f"the surface is {size:g} m long, with {around:.3g} cm³ in its convex hull; a tongue of {LENGTH[0]:g} to {LENGTH[1]:g} m and "
        f"{1e6 * HULL[0]:g} to {1e6 * HULL[1]:g} cm³ is expected, so state its unit in frame.toml (unit = {unit!r}, not {frame.unit!r}, "
    ) + ("would make it one)." if isinstance(unit, str) else "would make it as large as the built-in tongue).")


def _bone(surface: Surface, path: Path) -> Surface:
    size = float(np.ptp(surface.points, axis=0).max())
    if not BONE[0] <= size <= BONE[1]:
        raise InputError(f"{path}: the bone is {size:g} m long; {BONE[0]:g} to {BONE[1]:g} m is expected, in the unit of the folder.")
    return surface


def _read_json(path: Path, expected: str) -> dict[str, Any]:
    with reading(path, expected):
        data = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(data, dict) or not data:
        raise InputError(f"{path}: {expected} is expected.")
    for name in data:
        _check_name(path, name)
    return data


def _check_name(path: Path, name: str) -> None:
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9]{0,15}(_[A-Za-z]+)*", name) or name == "free":
        raise InputError(f"{path}: {name!r} is not accepted as a name; letters and digits are, with _L or _R for a side.")


def _bond(surface: Surface, path: Path, cell_sets: CellSets | None, frame: Frame) -> tuple[Surface, list[str]]:
    """Label the triangles bonded to each bone; say which files are patches."""
    data = _read_json(path, 'an object {"mandible": [node, …], "hyoid": [node, …]}')
    labels, patches = surface.labels.copy(), []
    for bone, given in data.items():
        if bone.endswith("_m"):  # anchors outside the tongue
            continue
        if isinstance(given, str):
            patch = frame.surface(path.parent / given)
            patches.append(given)
            bonded = abs(patch.signed_distance(surface.centroids)) < 5e-4
        else:
            bonded = _find_spanned(surface, path, bone, given, cell_sets, frame)
        if not bonded.any():
            raise InputError(f"{path}: {bone!r} spans no triangle of the surface; list all the nodes of the bonded patch.")
        for other in {*labels[bonded]} - {"free"}:
            shared = surface.centroids[bonded & (labels == other)]
            place = ", ".join(f"{1e3 * c:.1f}" for c in shared[0])
            raise InputError(
                f"{path}: {bone!r} and {str(other)!r} share {len(shared)} triangles, the first at ({place}) mm; each belongs to one bone."
            )
        labels[bonded] = bone
    if (labels == "free").all():
        raise InputError(f"{path}: nothing is bonded; list the nodes bonded to the mandible and to the hyoid.")
    return Surface(surface.points, surface.triangles, labels), patches


def _find_spanned(surface: Surface, path: Path, bone: str, given: Any, cell_sets: CellSets | None, frame: Frame) -> Bools:
    """The triangles whose corners are all attachment nodes of a bone."""
    with reading(path, f"{bone!r} as a list of node numbers or of [x, y, z]"):
        values = np.asarray(given)
        if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
            raise ValueError("something is not a finite number")
    if values.dtype.kind in "iu" and values.ndim == 1:
        if cell_sets is None:
            raise InputError(f"{path}: {bone!r} holds node numbers, but there is no tongue_hex.vtu that they refer to.")
        if values.size and not 0 <= values.min() <= values.max() < cell_sets.grid.n_points:
            raise InputError(f"{path}: {bone!r} holds node numbers outside 0…{cell_sets.grid.n_points - 1} of tongue_hex.vtu.")
        points = np.asarray(cell_sets.grid.points)[values]
    elif values.ndim == 2 and values.shape[1] == 3:
        points = frame.metres(values)
    else:
        raise InputError(f"{path}: {bone!r} must be a list of node numbers, a list of [x, y, z], or the name of a surface file.")
    distance, index = cKDTree(surface.points).query(points)
    if distance.max(initial=0.0) > 1e-3:
        worst = int(np.argmax(distance))
        raise InputError(
            f"{path}: {bone!r}, entry {worst}, lies {1e3 * distance[worst]:.1f} mm from the tongue surface; "
            "attachments must be on the surface (within 1 mm)."
        )
    return np.asarray(np.isin(surface.triangles, index[distance < 1e-4]).all(axis=1))


def _fibre_lines(folder: Path, frame: Frame) -> dict[str, tuple[Path, list[Floats]]]:
    """Polylines in our frame and the file that they come from, by bundle."""
    path = folder / "fibres.json"
    if (folder / "fibres").is_dir() and not path.exists():
        found = {}
        for file in sorted((folder / "fibres").glob("*.vtp")):
            _check_name(file, file.stem)
            with reading(file, "polylines in VTP"), quiet():
                mesh = pv.read(file)
                found[file.stem] = file, [frame.metres(mesh.get_cell(i).points) for i in range(mesh.n_cells)]
        if not found:
            raise InputError(f"{folder / 'fibres'}: no .vtp file in this folder; one a muscle is expected, such as GGP_L.vtp.")
        return found
    lines = {}
    for bundle, polylines in _read_json(path, 'an object {"GGP_L": [[[x, y, z], …], …], …}').items():
        with reading(path, f"{bundle!r} as a list of polylines of [x, y, z]"):
            arrays = [np.asarray(line, dtype=float) for line in polylines]
            if not all(line.ndim == 2 and line.shape[1] == 3 and np.isfinite(line).all() for line in arrays):
                raise ValueError("a point is not three finite numbers")
        lines[bundle] = path, [frame.metres(line) for line in arrays]
    return lines


def _muscles(
    bundles: dict[str, tuple[Path, list[Floats]]], surface: Surface, cell_sets: CellSets | None, radius: float
) -> tuple[dict[str, Muscle], list[str]]:
    muscles: dict[str, Muscle] = {}
    by_radius, unknown = [], []
    for bundle, (path, polylines) in bundles.items():
        base, _, side = bundle.partition("_")
        name = "_".join(filter(None, (SYNONYMS.get(base, base), side)))
        if name in muscles:
            raise InputError(f"{path}: {bundle!r} is {name} a second time; STY is another name of SG.")
        with within(path), within(repr(bundle)):
            fibres = FibreBundle(polylines, smoothing=1.5e-3)
        points, _, lengths = fibres.segments
        share = lengths[surface.contains(points, 1e-3)].sum() / lengths.sum()
        if share < 0.2:
            raise InputError(
                f"{path}: only {100 * share:.0f} % of the fibre length of {bundle!r} lies inside the tongue surface; at least 20 % is "
                "expected, in the same frame and unit as the surface."
            )
        facts = muscle_facts.CATALOGUE.get(muscle_facts.base_name(name))
        pcsa = facts.pcsa / (2 if side in ("L", "R") else 1) if facts else None
        if facts is None:
            unknown.append(name)
        anchor = _anchor(fibres, surface)
        if cell_sets is not None and bundle in cell_sets.names:
            region = partial(cell_sets.region, bundle)
            muscles[name] = Muscle(name, fibres, region, pcsa, anchor, cell_sets.volume(bundle))
        else:
            muscles[name] = Muscle(name, fibres, partial(fibres.within, radius=radius), pcsa, anchor)
            by_radius.append(name)
    notes = [f"muscle regions: {len(muscles) - len(by_radius)} from cell sets"]
    if by_radius:
        notes[0] += f", {len(by_radius)} within {1e3 * radius:g} mm of their polylines ({', '.join(by_radius)})"
    if unknown:
        notes.append(f"{', '.join(unknown)}: no standard name, so a scenario must give the peak stress in muscles.sigma_max")
    return muscles, [note + "." for note in notes]


def _anchor(fibres: FibreBundle, surface: Surface) -> Floats | None:
    """Mean end of the fibres that come from far outside the tongue."""
    ends = np.vstack([line[[0, -1]] for line in fibres.lines])
    outside = ends[surface.signed_distance(ends) > OUTSIDE]
    return outside.mean(axis=0) if len(outside) else None
