# SPDX-License-Identifier: MIT
"""The history of a run: quantities after every step, ``history.h5``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import BinaryIO

import h5py
import numpy as np

from ..core.types import Floats
from .reserved import Reserved
from .store import Store

FILE = "history.h5"
ROOM = 256
"""Times for which a file has room at first; each time it is full, it is made anew with twice as much."""

Row = Mapping[str, float | Floats]
"""Quantities of one time by their paths in the file, ``time`` among them; ``probes`` is (n_probe, 3)."""


class History:
    """Rows of quantities, one for each time.

    Parameters
    ----------
    store : Store
        Where the file is.
    probes : mapping
        Names of the probes to their points (3,) in m of the rest shape.
    """

    def __init__(self, store: Store, probes: Mapping[str, Floats]) -> None:
        self._store, self._probes, self._reserved = store, probes, Reserved(store, FILE)
        self._columns: dict[str, Floats] = {}
        self._room = self._written = self.n_rows = 0

    def append(self, row: Row) -> None:
        """Keep one time."""
        if not self._columns:
            self._columns = {name: np.full((ROOM, *np.shape(value)), np.nan) for name, value in row.items()}
        elif self.n_rows == len(self._columns["time"]):
            self._columns = {name: np.concatenate([of, np.full_like(of, np.nan)]) for name, of in self._columns.items()}
        for name, column in self._columns.items():
            column[self.n_rows] = row[name]
        self.n_rows += 1

    def column(self, name: str) -> Floats:
        """A quantity at all times, (n_t, …)."""
        return self._columns[name][: self.n_rows]

    def write(self) -> None:
        """Write the times that are not in the file yet; ``time`` is not a number in its room for more."""
        if self.n_rows > self._room:
            self._make(len(self._columns["time"]))
        new = slice(self._written, self.n_rows)
        for name, column in self._columns.items():
            if name == "probes":
                for probe, path in enumerate(column[new].swapaxes(0, 1)):
                    self._reserved.fill(name, path, 3 * (probe * self._room + self._written))
            elif name != "time":
                self._reserved.fill(name, column[new], self._written * column[0].size)
        self._reserved.fill("time", self._columns["time"][new], self._written)
        self._written = self.n_rows

    def close(self) -> None:
        """Write all times at once, without room for more."""
        self._make(self.n_rows)

    def _make(self, room: int) -> None:
        def write(target: BinaryIO) -> None:
            with h5py.File(target, "w", libver=("v108", "v110")) as file:  # attributes may be large
                for name, column in self._columns.items():
                    file[name] = column[:room].swapaxes(0, 1) if name == "probes" else column[:room]
                names = np.array([name.encode() for name in self._probes], dtype=bytes)
                file["probes"].attrs.update({"names": names, "rest": np.reshape(list(self._probes.values()), (-1, 3))})
                self._reserved.note(file)

        self._store.replace(FILE, write)
        self._room, self._written = room, self.n_rows

    def read(self, n_rows: int) -> None:
        """Go on after the first rows of the file.

        Raises
        ------
        ValueError
            If it has fewer.
        """
        with self._store.open(FILE) as file:
            stored = read_columns(file)
        if len(stored["time"]) < n_rows:
            raise ValueError("it has fewer times than the checkpoint")
        self._columns, self.n_rows = {name: column[:n_rows] for name, column in stored.items()}, n_rows
        self._room = 0


def read_columns(file: h5py.File) -> dict[str, Floats]:
    """All quantities of a history by their paths, (n_t, …), ``probes`` too; without the room of a run that goes on."""
    columns: dict[str, Floats] = {}

    def keep(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            columns[name] = item[()].swapaxes(0, 1) if name == "probes" else item[()]

    file.visititems(keep)
    n_rows = int(np.isfinite(columns["time"]).sum())
    return {name: column[:n_rows] for name, column in columns.items()}
