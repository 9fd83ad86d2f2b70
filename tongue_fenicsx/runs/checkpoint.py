# SPDX-License-Identifier: MIT
"""Where a run can go on: the whole state of its last output, ``checkpoint.h5``."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

import h5py
import numpy as np

from ..core.errors import InputError
from ..core.types import Floats
from .store import Store

FILE = "checkpoint.h5"

Identity = Callable[[float], Mapping[str, str]]
"""Fingerprint of each part of a problem up to a time in s."""


@dataclass(frozen=True)
class Checkpoint:
    """What is saved.

    Attributes
    ----------
    identity : dict
        Fingerprint of each part of the problem, so that no other one continues from it.
    numbers : dict
        Plain numbers of the state, such as time and step in s.
    arrays : dict
        Nodal arrays (n_nodes, 3) of the state in the order of the files.
    progress : dict
        What a run counts and sums up, in plain numbers.
    times : list of float
        Times in s of the stored fields.
    n_rows : int
        Rows of the history.
    """

    identity: Mapping[str, str]
    numbers: dict[str, Any]
    arrays: Mapping[str, Floats]
    progress: Mapping[str, Any]
    times: list[float]
    n_rows: int

    def write(self, store: Store) -> None:
        """Save it at once."""

        def write(target: BinaryIO) -> None:
            with h5py.File(target, "w", libver=("v108", "v110")) as file:  # with check sums, which texts of any length have not
                for name in ("identity", "numbers", "progress"):
                    file.attrs[name] = np.bytes_(json.dumps(dict(getattr(self, name))))
                file.attrs["rows"] = self.n_rows
                file["times"] = self.times
                for name, values in self.arrays.items():
                    file[f"state/{name}"] = values

        store.replace(FILE, write)

    @classmethod
    def read(cls, store: Store, identity: Identity, n_nodes: int) -> Checkpoint:
        """The checkpoint of the problem whose fingerprints at a time `identity` tells.

        Raises
        ------
        InputError
            If it belongs to another problem.
        ValueError
            If it is damaged.
        """
        with store.open(FILE) as file:
            saved, numbers, progress = (json.loads(file.attrs[name]) for name in ("identity", "numbers", "progress"))
            ours = identity(numbers["t"])
            differs = sorted(key for key in saved.keys() | ours.keys() if saved.get(key) != ours.get(key))
            if differs:
                raise InputError(
                    f"{FILE}: was saved by a run that differs in {', '.join(differs)}; run without --resume, or in another folder."
                )
            arrays = {name: data[:] for name, data in file["state"].items()}
            found = cls(saved, numbers, arrays, progress, list(map(float, file["times"][:])), int(file.attrs["rows"]))
        for name, values in arrays.items():
            if values.shape != (n_nodes, 3) or not np.isfinite(values).all():
                raise ValueError(f"{name} is damaged")
        if not np.isfinite([numbers["t"], numbers["h"]]).all() or not progress:
            raise ValueError("it is not complete")
        return found
