# SPDX-License-Identifier: MIT
"""What a run says of its steps, ``log.txt``."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path


class Log:
    """Lines that go into a file as soon as it is open; a full disk loses them, and is said when results are written.

    Parameters
    ----------
    path : Path, optional
        The file; without one nothing is kept.
    """

    def __init__(self, path: Path | None) -> None:
        self._path, self._waiting, self._open = path, "", False

    def open(self, *, anew: bool) -> None:
        """Begin to write: at the end of what is there, or `anew`."""
        if self._path is not None:
            if anew:
                self._path.unlink(missing_ok=True)
            self._open = True
            self._write("")

    def say(self, line: str) -> None:
        """Add a line."""
        if self._path is not None:
            self._write(line + "\n")

    def _write(self, text: str) -> None:
        self._waiting += text
        if self._open and self._path is not None:
            with suppress(OSError), open(self._path, "a", encoding="utf-8") as file:
                file.write(self._waiting)
            self._waiting = ""
