# SPDX-License-Identifier: MIT
"""The two ways a command can fail, and how trouble with files becomes one of them."""

from __future__ import annotations

import errno
import logging
import os
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from zipfile import BadZipFile


class InputError(ValueError):
    """Something the user gave cannot be used: one sentence naming the file, the key and what is accepted."""


class SolveError(RuntimeError):
    """The nonlinear solve gave up at the smallest step; the last good state is saved."""


def short(value: object, limit: int = 80) -> str:
    """A value as a sentence shows it: what stands in a text or file may be endless."""
    text = repr(value)
    return text if len(text) <= limit else f"{text[: limit - 1]}… ({len(text)} characters)"


@contextmanager
def within(where: object) -> Iterator[None]:
    """Say which file, or which part of one, bad input stands in, where a sentence names only the key.

    Raises
    ------
    InputError
        With the place before the sentence; also for the name of a file that is too long for any.
    """
    try:
        yield
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(str(where)) else f"{where}: {error}") from error
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        raise InputError(f"{where}: {error.filename}: {error.strerror}; a shorter one is expected.") from error


@contextmanager
def reading(path: Path, expected: str) -> Iterator[None]:
    """Say in one sentence that a file is missing, unreadable or damaged, whatever the library that reads it raises.

    Raises
    ------
    InputError
        If the file does not exist or what is inside the ``with`` block fails.
    """
    try:
        if not path.is_file():
            found = "is a folder" if path.is_dir() else "does not exist"
            raise InputError(f"{path}: the file {found}; {expected} is expected.")
        yield
    except InputError:
        raise
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError, RuntimeError, ArithmeticError, BadZipFile) as error:
        said = getattr(error, "strerror", None) or error
        reason = "it is no text in UTF-8" if isinstance(error, UnicodeDecodeError) else " ".join(str(said).split())
        raise InputError(f"{path}: cannot be read ({reason[:200] or type(error).__name__}); {expected} is expected.") from error


def check_outputs(folder: Path, names: Iterable[str] = ()) -> None:
    """Make a folder and make sure that files of these names can be written in it; nothing that is there changes.

    Raises
    ------
    InputError
        If the folder cannot be made or written, or something that is not a writable file has one of the names.
    """
    probe = folder / ".tongue-write-test"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink(missing_ok=True)  # another process may have tried the same
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); give a folder that you may write to.") from error
    for path in (folder / name for name in names):
        try:
            blocked = path.exists() and not (path.is_file() and os.access(path, os.W_OK))
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror}).") from error
        if blocked:
            raise InputError(f"{path}: is in the way; a file that may be written is expected there.")


@contextmanager
def quiet() -> Iterator[None]:
    """Keep C libraries, their logging and warnings off the terminal; what matters is checked and said afterwards."""
    kept = os.dup(2)
    sink = os.open(os.devnull, os.O_WRONLY)
    level = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    os.dup2(sink, 2)
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(sink)
        logging.disable(level)
