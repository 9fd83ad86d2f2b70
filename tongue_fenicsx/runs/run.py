# SPDX-License-Identifier: MIT
"""A run, read from where it is kept; needs no solver."""

from __future__ import annotations

import json
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..core.errors import InputError, check_outputs, reading
from ..core.types import Floats, Ints
from ..core.values import text
from ..geometry.surface import Surface
from .figures import FIGURES
from .history import FILE, read_columns
from .store import Folder, Memory, Store

WHOLE = "a whole run folder"


def _count(file: h5py.File) -> int:
    """Outputs that a file of fields has; it may have room for more."""
    return int(np.isfinite(file["time"][:]).sum())


class Run:
    """A finished (or stopped) run, read from its folder or from memory.

    Parameters
    ----------
    source : path or Store
        The run folder, or a store with its files.

    Attributes
    ----------
    summary : dict
        What ``summary.json`` holds; empty where the run was killed or still goes on.
    time : (n_t,) float array
        Times of all steps in s.
    probes : dict
        Name to displacement (n_t, 3) in m.
    rest : dict
        Name of each probe to its point (3,) in m of the rest shape.
    energy : dict
        Name to energy or work (n_t,) in J.
    activation : dict
        Muscle to its activation (n_t,), 0…1.
    support : dict
        Bonded surface to the force (n_t, 3) in N that its bone exerts on the tongue.
    contact : dict
        Obstacle to ``force`` (n_t, 3) in N on the tongue, ``area`` in m², ``pressure`` (largest) in Pa, ``penetration`` in m,
        and its place, ``rotation`` (n_t, 9) and ``offset`` (n_t, 3) in m.
    volume_ratio : (n_t,) float array
        Volume over rest volume.

    Raises
    ------
    InputError
        If the folder holds no run or its files are damaged.
    """

    def __init__(self, source: str | Path | Store) -> None:
        self.store: Store = Folder(Path(source)) if isinstance(source, str | Path) else source
        if not self.store.has(FILE):
            raise InputError(f"{self}: holds no run ({FILE} is missing); a folder written by tongue run is expected.")
        with self.reading(FILE), self.store.open(FILE) as file:
            columns = read_columns(file)
            names, rest = list(map(text, file["probes"].attrs["names"])), file["probes"].attrs["rest"]
        parts: dict[str, dict[str, Floats]] = {}
        for path, column in columns.items():
            group, _, name = path.partition("/")
            parts.setdefault(group, {})[name] = column
        self.time, self.volume_ratio = columns["time"], columns["volume_ratio"]
        self.probes = dict(zip(names, columns["probes"].swapaxes(0, 1), strict=True))
        self.rest: dict[str, Floats] = dict(zip(names, rest, strict=True))
        self.energy, self.activation, self.support = (parts.get(group, {}) for group in ("energy", "activation", "support"))
        self.contact: dict[str, dict[str, Floats]] = {}
        for path, column in parts.get("contact", {}).items():
            name, _, part = path.rpartition("/")
            self.contact.setdefault(name, {})[part] = column
        self.summary: dict[str, Any] = {}
        if self.store.has("summary.json"):
            with self.reading("summary.json"):
                self.summary = json.loads(self.store.read("summary.json"))

    @property
    def folder(self) -> Path:
        """The run folder.

        Raises
        ------
        InputError
            If the run is in memory.
        """
        if not isinstance(self.store, Folder):
            raise InputError("the run is in memory and has no folder; save it into one, or give output when it is run.")
        return self.store.path

    def __str__(self) -> str:
        return str(self.store.path) if isinstance(self.store, Folder) else "a run in memory"

    def __repr__(self) -> str:
        status = self.summary.get("status", "not over")
        return f"Run({str(self)!r}): {status}, {len(self.time) - 1} steps to {self.time[-1]:g} s; probes {', '.join(self.probes) or 'none'}"

    def to_dict(self) -> dict[str, Floats]:
        """Everything over time as columns (n_t,) in SI units, such as ``tip_x``, ``activation_GGP_L``, ``energy_elastic`` and
        ``contact_palate_area``; ``pandas.DataFrame(run.to_dict())`` is a table."""
        columns = {"time": self.time, "volume_ratio": self.volume_ratio}
        vectors = dict(self.probes) | {f"support_{name}": force for name, force in self.support.items()}
        for name, touch in self.contact.items():
            vectors[f"contact_{name}_force"] = touch["force"]
            columns |= {f"contact_{name}_{part}": touch[part] for part in ("area", "pressure", "penetration") if part in touch}
        columns |= {f"{name}_{axis}": values[:, i] for name, values in vectors.items() for i, axis in enumerate("xyz")}
        columns |= {f"activation_{name}": level for name, level in self.activation.items()}
        return columns | {f"energy_{name}": energy for name, energy in self.energy.items()}

    def sample(self, points: Floats, name: str = "displacement", index: int = -1) -> Floats:
        """A stored field at points (n, 3) of the rest shape in m, such as along a line: (n,), (n, 3) or (n, 3, 3).

        Fields of nodes are interpolated as the quadratic elements do, those of cells are of the cell around a point.

        Raises
        ------
        InputError
            If the run stored no such field, or a point lies outside the tongue.
        """
        import pyvista as pv

        values, (nodes, cells) = self.field(name, index), self.mesh
        grid = pv.UnstructuredGrid({pv.CellType.QUADRATIC_TETRA: cells}, nodes)
        (grid.point_data if len(values) == len(nodes) else grid.cell_data)["values"] = values.reshape(len(values), -1)
        found = pv.PolyData(np.atleast_2d(np.asarray(points, dtype=float))).sample(grid, tolerance=1e-9)  # VTK's own finds cells beside
        outside = np.flatnonzero(np.asarray(found["vtkValidPointMask"]) == 0)
        if len(outside):
            place = ", ".join(f"{1e3 * x:.1f}" for x in found.points[outside[0]])
            raise InputError(f"sample: the point ({place}) mm lies outside the tongue; points of the rest shape are expected.")
        return np.asarray(found["values"]).reshape(len(found.points), *values.shape[1:])

    def reading(self, name: str) -> AbstractContextManager[None]:
        """Say in one sentence that a file of the run is missing or damaged (see `errors.reading`)."""
        return reading(self.store.path / name, WHOLE) if isinstance(self.store, Folder) else nullcontext()

    def save(self, folder: str | Path) -> Run:
        """Write a run that is in memory into a folder, and return it as it is there.

        Raises
        ------
        InputError
            If the run is in a folder already, or this one cannot be written.
        """
        if not isinstance(self.store, Memory):
            raise InputError(f"{self}: is in a folder already; only a run in memory is saved.")
        files = self.store.files
        check_outputs(Path(folder), files)
        for name, data in files.items():
            (Path(folder) / name).write_bytes(data)
        return Run(folder)

    def field(self, name: str, index: int = -1) -> Floats:
        """A stored field, (n_nodes, 3), (n_cells,) or (n_cells, 3, 3), at the output `index`.

        Raises
        ------
        InputError
            If the run stored no such field.
        """
        if name not in self.fields:
            raise InputError(f"field: {self} has no field {name!r}; it has {', '.join(self.fields)}.")
        with self.reading("fields.h5"), self.store.open("fields.h5") as file:
            return np.asarray(file[f"{name}/{range(_count(file))[index]:05d}"][:], dtype=float)

    @cached_property
    def fields(self) -> list[str]:
        """Names of the stored fields."""
        with self.reading("fields.h5"), self.store.open("fields.h5") as file:
            return sorted(file.keys() - {"mesh", "obstacles", "time"})

    @cached_property
    def output_times(self) -> Floats:
        """Times in s of the stored fields, (n_outputs,)."""
        with self.reading("fields.h5"), self.store.open("fields.h5") as file:
            return np.asarray(file["time"][: _count(file)])

    @cached_property
    def mesh(self) -> tuple[Floats, Ints]:
        """Rest coordinates (n_nodes, 3) in m and quadratic tetrahedra (n_cells, 10) in VTK order."""
        with self.reading("fields.h5"), self.store.open("fields.h5") as file:
            return file["mesh/points"][:], file["mesh/cells"][:].astype(np.int64)

    @cached_property
    def farthest(self) -> int:
        """The output at which the tongue is farthest from rest."""
        return int(np.argmax([(self.field("displacement", index) ** 2).sum() for index in range(len(self.output_times))]))

    @cached_property
    def obstacles_at_rest(self) -> dict[str, Surface]:
        """The surfaces of the obstacles at rest."""
        with self.reading("fields.h5"), self.store.open("fields.h5") as file:
            return {name: Surface.read(group) for name, group in file.get("obstacles", {}).items()}

    def pose(self, obstacle: str, index: int = -1) -> tuple[Floats, Floats]:
        """Where an obstacle is at the output `index`: rotation (3, 3) and offset (3,) in m."""
        row = int(np.argmin(abs(self.time - self.output_times[index])))
        of = self.contact[obstacle]
        return of["rotation"][row].reshape(3, 3), of["offset"][row]

    def obstacles(self, index: int = -1) -> dict[str, Surface]:
        """The surfaces of the obstacles where they are at the output `index`."""
        return {name: surface.moved(*self.pose(name, index)) for name, surface in self.obstacles_at_rest.items()}

    def plot(self, *names: str) -> list[Path]:
        """Draw figures into ``figures/``, with their tables beside it, and return the pictures.

        Parameters
        ----------
        *names : str
            Which of `figures.FIGURES`; by default all that apply to the run.

        Raises
        ------
        InputError
            If the run has no figure of a name, or is in memory.
        """
        figures = {name: figure for name, figure in FIGURES.items() if figure.applies(self)}
        for name in names:
            if name not in figures:
                raise InputError(f"plot: the run has no figure {name!r}; it has {', '.join(figures)}.")
        (self.folder / "figures").mkdir(exist_ok=True)
        return [figures[name].draw(self) for name in names or figures]
