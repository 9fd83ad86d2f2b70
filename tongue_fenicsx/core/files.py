# SPDX-License-Identifier: MIT
"""Files that are whole or not there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PARTIAL = ".partial-"
"""What the names of files begin with that are not whole; a process that is killed leaves them."""


@contextmanager
def at_once(path: Path) -> Iterator[Path]:
    """A path to write to, with the same suffix; what is written there is put in place at the end, or removed if that fails, so that readers
    see the old file until the new one is whole. Each process has a path of its own."""
    partial = path.with_name(f"{PARTIAL}{os.getpid()}-{path.name}")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
