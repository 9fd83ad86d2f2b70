# SPDX-License-Identifier: MIT
"""What a command's process needs before anything else: streams that may break, and signals that end it quietly."""

from __future__ import annotations

import atexit
import io
import os
import signal
import sys
from typing import Any

from ..core.interruption import Interrupted, leave_at_once, on_signals

received = 0
"""Number of the signal that ends the command; 0 as long as there is none."""


def prepare() -> None:
    """Go on where the terminal does not; let the first SIGINT or SIGTERM end the command as `Interrupted`, a second one at once."""
    # called last; then Python lets go of handlers, and a signal would end the command by itself
    atexit.register(on_signals, signal.SIG_IGN)
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:  # closed; a file of results would become it
            os.open(os.devnull, os.O_RDWR)
    sys.stdout, sys.stderr = _bearing(sys.stdout, 1, "replace"), _bearing(sys.stderr, 2, "backslashreplace")
    os.environ["PETSC_OPTIONS"] = f"{os.environ.get('PETSC_OPTIONS', '')} -no_signal_handler"
    on_signals(_interrupt)


def _interrupt(number: int, frame: object) -> None:
    global received
    received = number
    on_signals(leave_at_once)
    raise Interrupted(number)


class _Bearing(io.FileIO):
    """A stream that nobody need read and that may be full: what cannot be written is lost."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError:
            return memoryview(data).nbytes


def _bearing(stream: Any, descriptor: int, errors: str) -> io.TextIOWrapper:
    encoding = "utf-8" if stream is None else stream.encoding
    raw = _Bearing(descriptor, "w", closefd=False)
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding=encoding, errors=errors, line_buffering=True)
