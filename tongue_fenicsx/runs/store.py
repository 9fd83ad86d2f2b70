# SPDX-License-Identifier: MIT
"""Where a run keeps its files: a folder, or memory.

Small files are made in memory and put in place at once. A file that grows is made with room for what is still to come (`Store.make`) and
then filled byte by byte (`Store.write_at`): its own index never changes, so that at every instant it can be read.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Protocol

import h5py

from ..core.files import at_once


class Store(Protocol):
    """A place for named files."""

    def open(self, name: str) -> h5py.File:
        """Open an HDF5 file to read."""

    def replace(self, name: str, write: Callable[[BinaryIO], object]) -> None:
        """Write a small file at once: readers see the old one until it is whole."""

    def make(self, name: str, write: Callable[[h5py.File], object], room: int) -> None:
        """Write a large HDF5 file of about `room` bytes at once, as `replace` does."""

    def write_at(self, name: str, at: int, data: bytes) -> None:
        """Change bytes of a file, which may grow by them."""

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

    def open(self, name: str) -> h5py.File:
        """As of `Store`; nobody else's lock is in the way."""
        return h5py.File(self.path / name, "r", locking=False)

    def replace(self, name: str, write: Callable[[BinaryIO], object]) -> None:
        """As of `Store`."""
        whole = io.BytesIO()
        write(whole)
        with at_once(self.path / name) as path:
            path.write_bytes(whole.getbuffer())

    def make(self, name: str, write: Callable[[h5py.File], object], room: int) -> None:
        """As of `Store`; the disk space is taken before HDF5, which does not survive the want of it, writes."""
        with at_once(self.path / name) as path:
            with open(path, "wb") as target:
                os.posix_fallocate(target.fileno(), 0, room)
            with h5py.File(path, "w", locking=False) as file:
                write(file)
            with open(path, "rb+") as target:
                os.posix_fallocate(target.fileno(), 0, path.stat().st_size)

    def write_at(self, name: str, at: int, data: bytes) -> None:
        """As of `Store`."""
        with open(self.path / name, "rb+", buffering=0) as file:
            file.seek(at)
            view = memoryview(data)
            while view:
                view = view[file.write(view) :]

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

    def open(self, name: str) -> h5py.File:
        """As of `Store`."""
        return h5py.File(self._files[name], "r")

    def replace(self, name: str, write: Callable[[BinaryIO], object]) -> None:
        """As of `Store`."""
        file = io.BytesIO()
        write(file)
        self._files[name] = file

    def make(self, name: str, write: Callable[[h5py.File], object], room: int) -> None:
        """As of `Store`."""

        def whole(target: BinaryIO) -> None:
            with h5py.File(target, "w") as file:
                write(file)
                file.flush()
                end = file.id.get_filesize()
            target.write(bytes(max(end - target.seek(0, io.SEEK_END), 0)))

        self.replace(name, whole)

    def write_at(self, name: str, at: int, data: bytes) -> None:
        """As of `Store`."""
        self._files[name].seek(at)
        self._files[name].write(data)

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
