# SPDX-License-Identifier: MIT
"""A run folder belongs to one process while it runs, and to its run afterwards."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from ..core.errors import InputError, check_outputs, reading
from ..core.files import PARTIAL
from .checkpoint import FILE as CHECKPOINT
from .inputs import KEPT
from .writer import FIELDS, LOG, RUN_FILES, SUMMARY

LOCK = ".lock"


@contextmanager
def claim(folder: Path, figures: Iterable[str], *, resume: bool, overwrite: bool) -> Iterator[None]:
    """Hold a folder for a run; it is made if it is not there, and nothing that is there changes.

    Parameters
    ----------
    folder : Path
        The run folder.
    figures : iterable of str
        What else the run may leave there.
    resume, overwrite : bool
        Whether the run in the folder is to go on, or may be replaced.

    Raises
    ------
    InputError
        If the folder cannot be written, another process writes there, it holds a run that is neither to go on nor to be replaced, or files
        in it that no run has left have the names that a run gives.
    """
    check_claim(folder, figures, resume=resume, overwrite=overwrite)
    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(blocking=False)
    except Timeout as error:
        raise InputError(f"{folder}: another process writes a run there; wait for its end, or give another folder.") from error
    try:
        check_claim(folder, figures, resume=resume, overwrite=overwrite)  # again: another may have ended a run since
        for left in folder.glob(f"{PARTIAL}*"):  # by a process that was killed
            left.unlink()
        yield
    finally:
        lock.release()


def check_claim(folder: Path, figures: Iterable[str], *, resume: bool, overwrite: bool) -> None:
    """Raise what `claim` would raise now, for all that is in the folder."""
    check_outputs(folder / "figures")
    check_outputs(folder, [LOCK, *RUN_FILES, *KEPT, *figures])
    has_run = any((folder / name).exists() for name in (FIELDS, LOG, SUMMARY, CHECKPOINT))
    own = [name for name in KEPT if (folder / name).exists() and not has_run]
    if own:
        raise InputError(f"{folder / own[0]}: was not left by a run, which would replace it; give another folder.")
    if not (resume or overwrite) and any((folder / name).exists() for name in (SUMMARY, CHECKPOINT)):
        raise InputError(
            f"{folder}: holds a run already, {_describe(folder / SUMMARY)}; overwrite (--overwrite) replaces it, "
            "resume (--resume) goes on from its checkpoint, another folder leaves it."
        )


def _describe(summary: Path) -> str:
    if not summary.exists():
        return "stopped before its end"
    with reading(summary, "the summary of a run"):
        found = json.loads(summary.read_text(encoding="utf-8"))
        return f"{found['status']} at t = {found['t_end']:g} s"
