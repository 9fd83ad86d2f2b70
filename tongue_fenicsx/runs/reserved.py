# SPDX-License-Identifier: MIT
"""Datasets that lie in a file with room for what is still to come, and are filled in place.

HDF5 changes the index of a file that grows in many small writes, and a process that is killed between two of them leaves a file that
nothing can read. Here the index is whole before the first value is known. Values are then written as bytes where they belong: at every
instant the file can be read, no lock of a reader is in the way, and a value costs the same however many there are.
"""

from __future__ import annotations

import h5py
import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from .store import Store


class Reserved:
    """Where the values of a file's contiguous datasets lie.

    Parameters
    ----------
    store : Store
        Where the file is.
    name : str
        Of the file.
    """

    def __init__(self, store: Store, name: str) -> None:
        self._store, self._name = store, name
        self._at: dict[str, tuple[int, np.dtype]] = {}

    def note(self, file: h5py.File) -> None:
        """Remember where the datasets of the file, which is open, lie."""

        def keep(path: str, item: h5py.Dataset | h5py.Group) -> None:
            if isinstance(item, h5py.Dataset) and item.size:
                self._at[path] = item.id.get_offset(), item.dtype

        self._at.clear()
        file.visititems(keep)

    def fill(self, path: str, values: ArrayLike, first: int = 0) -> None:
        """Write values of a dataset, from its number `first` on in the order of the file."""
        data = np.asarray(values)
        if data.size:
            at, kind = self._at[path]
            self._store.write_at(self._name, at + first * kind.itemsize, data.astype(kind).tobytes())


def reserve(file: h5py.File, path: str, shape: tuple[int, ...], kind: DTypeLike) -> None:
    """Make a dataset whose place is taken but not yet written."""
    made, link = h5py.h5p.create(h5py.h5p.DATASET_CREATE), h5py.h5p.create(h5py.h5p.LINK_CREATE)
    made.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    made.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    link.set_create_intermediate_group(True)
    h5py.h5d.create(file.id, path.encode(), h5py.h5t.py_create(np.dtype(kind)), h5py.h5s.create_simple(shape), made, link)
