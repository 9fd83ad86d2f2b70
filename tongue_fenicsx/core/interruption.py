# SPDX-License-Identifier: MIT
"""Ctrl-C that lets a long computation come to a good end."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Turn Ctrl-C into a flag, so that a run ends between two steps with everything saved.

    Outside the main thread, where Python has no signals, nothing is caught.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    caught = False

    def note(number: int, frame: object) -> None:
        nonlocal caught
        if caught:
            os._exit(130)
        caught = True

    previous = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: caught
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
