# SPDX-License-Identifier: MIT
"""A run, read from its folder; needs no solver."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..core.errors import InputError, reading
from ..core.types import Floats, Ints
from ..geometry.surface import Surface
from .figures import FIGURES

WHOLE = "a whole run folder"


class Run:
    """A finished (or stopped) run, read from its folder.

    Parameters
    ----------
    folder : path
        The run folder.

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

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        history, summary = self.folder / "history.h5", self.folder / "summary.json"
        if not history.is_file():
            raise InputError(f"{self.folder}: holds no run (history.h5 is missing); a folder written by tongue run is expected.")
        with reading(history, WHOLE), h5py.File(history, "r") as file:
            self.time: Floats = file["time"][:]
            names, rest = (file["probes"].attrs[key] for key in ("names", "rest"))
            self.probes: dict[str, Floats] = dict(zip(names, file["probes"][:], strict=True))
            self.rest: dict[str, Floats] = dict(zip(names, rest, strict=True))
            self.energy: dict[str, Floats] = {name: data[:] for name, data in file["energy"].items()}
            self.support: dict[str, Floats] = {name: data[:] for name, data in file.get("support", {}).items()}
            self.contact: dict[str, dict[str, Floats]] = {
                name: {column: data[:] for column, data in group.items()} for name, group in file.get("contact", {}).items()
            }
            self.volume_ratio: Floats = file["volume_ratio"][:]
        self.summary: dict[str, Any] = {}
        if summary.is_file():
            with reading(summary, WHOLE):
                self.summary = json.loads(summary.read_text(encoding="utf-8"))

    def field(self, name: str, index: int = -1) -> Floats:
        """A stored field, (n_nodes, 3) or (n_cells,), at the output `index`."""
        with h5py.File(self.folder / "fields.h5", "r") as file:
            return np.asarray(file[name][sorted(file[name])[index]][:], dtype=float)

    @property
    def output_times(self) -> Floats:
        """Times in s of the stored fields, (n_outputs,)."""
        with h5py.File(self.folder / "fields.h5", "r") as file:
            return np.asarray(file.attrs["time"])

    @property
    def mesh(self) -> tuple[Floats, Ints]:
        """Rest coordinates (n_nodes, 3) in m and quadratic tetrahedra (n_cells, 10) in VTK order."""
        with h5py.File(self.folder / "fields.h5", "r") as file:
            return file["mesh/points"][:], file["mesh/cells"][:].astype(np.int64)

    @cached_property
    def farthest(self) -> int:
        """The output at which the tongue is farthest from rest."""
        return int(np.argmax([(self.field("displacement", index) ** 2).sum() for index in range(len(self.output_times))]))

    @cached_property
    def obstacles_at_rest(self) -> dict[str, Surface]:
        """The surfaces of the obstacles at rest."""
        with h5py.File(self.folder / "fields.h5", "r") as file:
            return {name: Surface.read(group) for name, group in file.get("obstacles", {}).items()}

    def pose(self, obstacle: str, index: int = -1) -> tuple[Floats, Floats]:
        """Where an obstacle is at the output `index`: rotation (3, 3) and offset (3,) in m."""
        row = int(np.argmin(abs(self.time - self.output_times[index])))
        of = self.contact[obstacle]
        return of["rotation"][row].reshape(3, 3), of["offset"][row]

    def obstacles(self, index: int = -1) -> dict[str, Surface]:
        """The surfaces of the obstacles where they are at the output `index`."""

        def place(surface: Surface, rotation: Floats, offset: Floats) -> Surface:
            return surface.moved(lambda X: X @ rotation.T + offset)

        return {name: place(surface, *self.pose(name, index)) for name, surface in self.obstacles_at_rest.items()}

    def plot(self, *names: str) -> list[Path]:
        """Draw figures into ``figures/``, with their tables beside it, and return the pictures.

        Parameters
        ----------
        *names : str
            Which of `figures.FIGURES`; by default all that apply to the run.

        Raises
        ------
        InputError
            If the run has no figure of a name.
        """
        figures = {name: figure for name, figure in FIGURES.items() if figure.applies(self)}
        for name in names:
            if name not in figures:
                raise InputError(f"plot: the run has no figure {name!r}; it has {', '.join(figures)}.")
        (self.folder / "figures").mkdir(exist_ok=True)
        return [figures[name].draw(self) for name in names or figures]
