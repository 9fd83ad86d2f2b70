# SPDX-License-Identifier: MIT
"""Where a run keeps its files: a folder, or memory."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import h5py


class Store(Protocol):
    """A place for named files."""

    def open(self, name: str, mode: str = "r") -> h5py.File:
        """Open an HDF5 file to read (``r``), change (``r+``, ``a``) or write anew (``w``)."""

    def replace(self, name: str, write: Callable[[Any], object]) -> None:
        """Write a file at once: `write` takes a path or a binary file; readers see the old one until it is whole."""

    def read(self, name: str) -> bytes:
        """What a file holds."""

    def has(self, name: str) -> bool:
        """Whether there is such a file."""

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""


class Folder:
    """Files in a folder.

    Parameters
    ----------
    path : Path
        It exists and can be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def open(self, name: str, mode: str = "r") -> h5py.File:
        """As of `Store`."""
        return h5py.File(self.path / name, mode)

    def replace(self, name: str, write: Callable[[Any], object]) -> None:
        """As of `Store`."""
        path = self.path / name
        temporary = path.with_name(f"{name}.partial")
        write(temporary)
        os.replace(temporary, path)

    def read(self, name: str) -> bytes:
        """As of `Store`."""
        return (self.path / name).read_bytes()

    def has(self, name: str) -> bool:
        """As of `Store`."""
        return (self.path / name).is_file()

    def remove(self, name: str) -> None:
        """As of `Store`."""
        (self.path / name).unlink(missing_ok=True)


class Memory:
    """Files in memory, for runs without a folder."""

    def __init__(self, files: dict[str, bytes] | None = None) -> None:
        self._files = {name: io.BytesIO(data) for name, data in (files or {}).items()}

    def open(self, name: str, mode: str = "r") -> h5py.File:
        """As of `Store`."""
        if mode == "w":
            self._files[name] = io.BytesIO()
        return h5py.File(self._files[name], mode)

    def replace(self, name: str, write: Callable[[Any], object]) -> None:
        """As of `Store`."""
        file = io.BytesIO()
        write(file)
        self._files[name] = file

    def read(self, name: str) -> bytes:
        """As of `Store`."""
        return self._files[name].getvalue()

    def has(self, name: str) -> bool:
        """As of `Store`."""
        return name in self._files

    def remove(self, name: str) -> None:
        """As of `Store`."""
        self._files.pop(name, None)

    @property
    def files(self) -> dict[str, bytes]:
        """All files by name."""
        return {name: file.getvalue() for name, file in self._files.items()}
