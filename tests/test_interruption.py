# SPDX-License-Identifier: MIT
"""Ctrl-C becomes a flag in the main thread, and is left alone elsewhere."""

from __future__ import annotations

import os
import signal
from concurrent.futures import ThreadPoolExecutor

from tongue_fenicsx.core.interruption import interruptible


def test_signals_become_a_flag() -> None:
    """Raised once, seen until the end; afterwards the handlers are as before."""
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with interruptible() as interrupted:
        assert not interrupted()
        os.kill(os.getpid(), signal.SIGTERM)
        assert interrupted() == signal.SIGTERM
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_in_a_thread() -> None:
    """A simulation in a thread runs, without signals."""

    def ask() -> int:
        with interruptible() as interrupted:
            return interrupted()

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(ask).result() == 0
