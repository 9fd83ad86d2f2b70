# SPDX-License-Identifier: MIT
"""Processes that are killed at a chosen touch of a file."""

from __future__ import annotations

import itertools
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tongue_fenicsx.runs.store import Folder


def in_child(action: Callable[[], object]) -> int:
    """Wait status of a copy of this process that does something."""
    child = os.fork()
    if child == 0:
        try:
            action()
            os._exit(0)
        except BaseException:
            os._exit(1)
    return os.waitpid(child, 0)[1]


def killed_at(folder: Path, n: int, action: Callable[[], object]) -> bool:
    """Do something in a copy of this process that is killed at its n-th touch of a file in the folder: before a file is opened, renamed or
    removed, or in the middle of what is written; whether it came to that."""
    count = itertools.count()

    def touch() -> None:
        if next(count) == n:
            os.kill(os.getpid(), signal.SIGKILL)

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event in ("open", "os.rename", "os.remove") and str(arguments[0]).startswith(str(folder)):
            touch()

    def write_half(self: Folder, name: str, at: int, data: bytes) -> None:
        plain(self, name, at, data[: len(data) // 2])
        touch()
        plain(self, name, at, data)

    plain = Folder.write_at

    def act() -> None:
        Folder.write_at = write_half  # type: ignore[method-assign]
        sys.addaudithook(hook)
        action()

    return os.WIFSIGNALED(in_child(act))
