# SPDX-License-Identifier: MIT
"""A run, read from its folder or from memory; needs no solver."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..core.errors import InputError, check_outputs
from ..core.types import Floats, Ints
from ..geometry.surface import Surface
from .store import Folder, Memory

WHOLE = "a whole run folder"
HISTORY, SUMMARY, FIELDS = "history.h5", "summary.json", "fields.h5"


class Run:
    """A finished (or stopped) run, read from its folder or from memory.

    Parameters
    ----------
    source : path or Memory
        The run folder, or the files of a run that has none.

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

    def __init__(self, source: str | Path | Memory) -> None:
        self.store = source if isinstance(source, Memory) else Folder(Path(source))
        with self._reading(HISTORY, "holds no run (history.h5 is missing); a folder written by tongue run is expected") as file:
            self.time: Floats = file["time"][:]
            names, rest = (file["probes"].attrs[key] for key in ("names", "rest"))
            self.probes: dict[str, Floats] = dict(zip(names, file["probes"][:], strict=True))
            self.rest: dict[str, Floats] = dict(zip(names, rest, strict=True))
            self.energy: dict[str, Floats] = {name: data[:] for name, data in file["energy"].items()}
            self.activation: dict[str, Floats] = {name: data[:] for name, data in file.get("activation", {}).items()}
            self.support: dict[str, Floats] = {name: data[:] for name, data in file.get("support", {}).items()}
            self.contact: dict[str, dict[str, Floats]] = {
                name: {column: data[:] for column, data in group.items()} for name, group in file.get("contact", {}).items()
            }
            self.volume_ratio: Floats = file["volume_ratio"][:]
        self.summary: dict[str, Any] = {}
        if self.store.has(SUMMARY):
            with self._understanding(SUMMARY):
                self.summary = json.loads(self.store.read(SUMMARY))

    @property
    def folder(self) -> Path:
        """The run folder.

        Raises
        ------
        InputError
            If the run is in memory.
        """
        if isinstance(self.store, Memory):
            raise InputError("the run is in memory; save(folder) writes it to one.")
        return self.store.path

    def save(self, folder: str | Path) -> Run:
        """Write a run that is in memory to a folder, and return it from there.

        Raises
        ------
        InputError
            If the folder holds a run or cannot be written.
        """
        target = Path(folder)
        check_outputs(target)
        if (target / HISTORY).exists():
            raise InputError(f"{target}: holds a run; another folder is expected.")
        if isinstance(self.store, Folder):
            raise InputError(f"the run is in {self.store.path} already.")
        for name, data in self.store.files.items():
            (target / name).write_bytes(data)
        return Run(target)

    @contextmanager
    def _reading(self, name: str, missing: str = f"{WHOLE} is expected") -> Iterator[h5py.File]:
        """An HDF5 file of the run; trouble with it is said in one sentence."""
        if not self.store.has(name):
            raise InputError(f"{self._where}: {missing}.")
        with self._understanding(name), self.store.open(name) as file:
            yield file

    @contextmanager
    def _understanding(self, name: str) -> Iterator[None]:
        try:
            yield
        except InputError:
            raise
        except (OSError, ValueError, KeyError, TypeError) as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(f"{self._where}/{name}: cannot be read ({reason}); {WHOLE} is expected.") from error

    @property
    def _where(self) -> str:
        return "memory" if isinstance(self.store, Memory) else str(self.store.path)

    def field(self, name: str, index: int = -1) -> Floats:
        """A stored field, (n_nodes, 3) or (n_cells,), at the output `index`."""
        with self.store.open(FIELDS) as file:
            return np.asarray(file[name][sorted(file[name])[index]][:], dtype=float)

    @property
    def output_times(self) -> Floats:
        """Times in s of the stored fields, (n_outputs,)."""
        with self.store.open(FIELDS) as file:
            return np.asarray(file.attrs["time"])

    @property
    def mesh(self) -> tuple[Floats, Ints]:
        """Rest coordinates (n_nodes, 3) in m and quadratic tetrahedra (n_cells, 10) in VTK order."""
        with self.store.open(FIELDS) as file:
            return file["mesh/points"][:], file["mesh/cells"][:].astype(np.int64)

    @cached_property
    def farthest(self) -> int:
        """The output at which the tongue is farthest from rest."""
        return int(np.argmax([(self.field("displacement", index) ** 2).sum() for index in range(len(self.output_times))]))

    @cached_property
    def obstacles_at_rest(self) -> dict[str, Surface]:
        """The surfaces of the obstacles at rest."""
        with self.store.open(FIELDS) as file:
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

    def plot_trajectories(self) -> Path:
        """Draw the probe trajectories into ``figures/`` and return the file."""
        from ..plotting import run_figures as figures

        return figures.trajectories(self)

    def plot(self) -> list[Path]:
        """Draw all figures of the run into ``figures/`` and return the files."""
        from ..analysis import trajectories as kinematics
        from ..analysis.airway import WALLS, airway
        from ..analysis.electropalatogram import PALATES, electropalatogram
        from ..plotting import run_figures as figures

        paths = [figures.midsagittal(self), figures.view3d(self)]
        if self.probes:
            kinematics.write(self, self.folder / "trajectories.csv")
            paths.append(figures.trajectories(self))
        if self.contact:
            paths.append(figures.contact(self))
        if PALATES.intersection(self.contact):
            record = electropalatogram(self)
            record.write(self.folder / "epg.csv")
            paths.append(figures.electropalatogram(self, record))
        if self.contact.keys() & set(WALLS):
            passage = airway(self)
            passage.write(self.folder / "airway.csv")
            paths.append(figures.airway(self, passage))
        return paths
