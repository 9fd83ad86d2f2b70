# SPDX-License-Identifier: MIT
"""Ctrl-C and SIGTERM that let a long computation come to a good end."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM.

    Parameters
    ----------
    number : int
        The signal.
    text : str
        What to say.
    """

    def __init__(self, number: int, text: str = "interrupted") -> None:
        super().__init__(number, text)
        self.number, self.text = number, text

    def __str__(self) -> str:
        return self.text


class Paused(Interrupted):
    """A run was interrupted between two steps, with everything saved."""


def launched() -> bool:
    """Whether mpiexec began this process, so that others may wait for it; told without MPI."""
    return any(name in os.environ for name in ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK"))


def leave_at_once(number: int, frame: object) -> None:
    """End the process without a word; under mpiexec as SIGTERM does, for that also ends ranks that would wait for this one for ever."""
    if launched():
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTERM)
    os._exit(128 + number)


def on_signals(handler: Callable[[int, object], object] | signal.Handlers) -> None:
    """Let Ctrl-C and SIGTERM call a handler; under mpiexec, where a rank that waits in MPI never comes to it, let them end the process."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL if launched() else handler)


@contextmanager
def interruptible() -> Iterator[Callable[[], int]]:
    """Turn Ctrl-C or SIGTERM into its number, 0 before, so that a run ends between two steps with everything saved; a second one ends it
    at once.

    Outside the main thread, where Python has no signals, nothing is caught.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: 0
        return
    caught = 0

    def note(number: int, frame: object) -> None:
        nonlocal caught
        if caught:
            leave_at_once(number, frame)
        caught = number

    previous = {number: signal.signal(number, note) for number in SIGNALS}
    try:
        yield lambda: caught
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
