# SPDX-License-Identifier: MIT
"""The history of a run: quantities after every step, ``history.h5``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np

from ..core.types import Floats
from .store import Store

FILE = "history.h5"

Row = Mapping[str, float | Floats]
"""Quantities of one time by their paths in the file, ``time`` among them; ``probes`` is (n_probe, 3)."""


class History:
    """Rows of quantities, one for each time.

    Parameters
    ----------
    probes : mapping
        Names of the probes to their points (3,) in m of the rest shape.
    """

    def __init__(self, probes: Mapping[str, Floats]) -> None:
        self._probes = probes
        self.rows: list[Row] = []

    def append(self, row: Row) -> None:
        """Keep one time."""
        self.rows.append(row)

    def column(self, name: str) -> Floats:
        """A quantity at all times, (n_t, …)."""
        return np.array([row[name] for row in self.rows])

    def write(self, store: Store) -> None:
        """Write all times at once."""

        def write(target: Any) -> None:
            with h5py.File(target, "w") as file:
                for name in self.rows[0]:
                    values = self.column(name)
                    file[name] = values.reshape(len(values), -1, 3).transpose(1, 0, 2) if name == "probes" else values
                file["probes"].attrs.update({"names": list(self._probes), "rest": np.reshape(list(self._probes.values()), (-1, 3))})

        store.replace(FILE, write)


def read_rows(store: Store, n_rows: int) -> list[Row]:
    """The first rows of a history that was written."""
    columns: dict[str, Floats] = {}

    def keep(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            values = item[()]
            columns[name] = values.transpose(1, 0, 2) if name == "probes" else values

    with store.open(FILE) as file:
        file.visititems(keep)
    if any(len(values) < n_rows for values in columns.values()):
        raise ValueError("it has fewer times than the checkpoint")
    return [{name: values[i] if values.ndim > 1 else float(values[i]) for name, values in columns.items()} for i in range(n_rows)]
