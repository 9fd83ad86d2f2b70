# SPDX-License-Identifier: MIT
"""Folders of compiled forms, and of distances from obstacles, that outlive a run: where they are, how many processes share them, and how
they are cleared."""

from __future__ import annotations

import atexit
import functools
import hashlib
import json
import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from .errors import InputError, check_outputs

LOG = logging.getLogger("tongue_fenicsx")
LOCK, SEAL = ".lock", "seal.json"
DISTANCES = "distances"
"""The folder beside those of forms."""


def place() -> Path:
    """Where they are kept: in ``XDG_CACHE_HOME``, or in ``~/.cache`` if that is unset, empty or relative."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(given) if os.path.isabs(given) else Path.home() / ".cache") / "tongue_fenicsx"


def open_cache(generation: str) -> Path:
    """A folder that can be written, for the forms of one generation or `DISTANCES`; a temporary one, which is said, if their place cannot.

    Raises
    ------
    InputError
        If no temporary folder can be made either.
    """
    folder = place() / generation
    try:
        check_outputs(folder)
    except InputError as error:
        return _temporary(str(error))
    return folder


@functools.cache
def _temporary(reason: str) -> Path:
    try:
        folder = tempfile.mkdtemp(prefix="tongue-cache-")
    except OSError as error:
        raise InputError(f"{reason} Nor can a temporary folder be made ({error.strerror}); set TMPDIR, too.") from error
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    LOG.warning("%s Until then forms are compiled, and distances from obstacles computed, for each run, now into %s.", reason, folder)
    return Path(folder)


def provide(entry: Path, make: Callable[[Path], object]) -> None:
    """Have an entry whole in the cache: make it unless it is there, one process at a time; others wait and say so.

    What is in the cache is whole, for it is made beside and moved, and its digests are compared. What a killed process left is removed.

    Parameters
    ----------
    entry : Path
        The folder.
    make : callable
        Fills a folder that is given to it.
    """
    if _is_whole(entry):
        return
    entry.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(entry.with_suffix(LOCK))
    try:
        lock.acquire(timeout=1.0)
    except Timeout:
        _say_waiting(entry.parent)
        lock.acquire()
    try:
        if not _is_whole(entry):
            for left in [entry, *entry.parent.glob(f"{entry.name}-*")]:
                shutil.rmtree(left, ignore_errors=True)
            with tempfile.TemporaryDirectory(prefix=f"{entry.name}-", dir=entry.parent, ignore_cleanup_errors=True) as folder:
                making = Path(folder) / entry.name
                making.mkdir()
                make(making)
                (making / SEAL).write_text(json.dumps({path.name: _digest(path) for path in making.iterdir()}))
                making.rename(entry)
    finally:
        lock.release()


@functools.cache
def _say_waiting(folder: Path) -> None:
    LOG.warning("waiting for another process, which makes the same into %s", folder)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _is_whole(entry: Path) -> bool:
    try:
        return all(_digest(entry / name) == digest for name, digest in json.loads((entry / SEAL).read_text()).items())
    except (OSError, ValueError):
        return False


def generations() -> Iterator[Path]:
    """Folders of forms, one for each DOLFINx and processor, and that of distances."""
    if place().is_dir():
        yield from sorted(path for path in place().iterdir() if path.is_dir())


def measure(generation: Path) -> tuple[int, int]:
    """How many forms or obstacles a folder has, and how many bytes."""
    sizes = [path.stat().st_size for path in generation.rglob("*") if path.is_file()]
    return sum(1 for _ in generation.glob(f"*/{SEAL}")), sum(sizes)


def clear(generation: Path) -> int:
    """Remove a folder, but not what a process makes now; return how many such there are."""
    busy = 0
    for stem in {path.name.partition(".")[0].partition("-")[0] for path in generation.iterdir()}:
        try:
            with FileLock(generation / f"{stem}{LOCK}", blocking=False):
                for path in generation.glob(f"{stem}*"):
                    shutil.rmtree(path) if path.is_dir() else path.unlink()
        except Timeout:
            busy += 1
    if not busy:
        shutil.rmtree(generation)
    return busy
