# SPDX-License-Identifier: MIT
"""One HTML page of runs that opens from disk without a network: numbers, pictures, charts and the motion in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..analysis.comparison import naturally, open_runs
from ..core.errors import InputError
from .motion import Shared
from .page import Detail, page

LIMIT = 15_000_000
"""Largest size of a page in bytes."""

LEVELS = (
    *(Detail(60), Detail(60, 1000), Detail(30, 1000), Detail(15, 800)),
    *(Detail(8, 640, whole=False), Detail(4, 480, whole=False), Detail(2, 320, whole=False)),
)
"""How much of each run is shown, from the finest on."""


def write_report(folders: Sequence[str | Path], path: str | Path) -> Path:
    """Write one page of one or several runs, finished or not, and return its file; the run folders stay as they are.

    Parameters
    ----------
    folders : sequence of path
        Run folders, at least one; shown in natural order, run2 before run10.
    path : path
        The HTML file. Where it would be larger than `LIMIT`, fewer moments and smaller pictures are shown, and the page says so.

    Raises
    ------
    InputError
        If a folder holds no run or a damaged one, or even the coarsest of `LEVELS` is too large.
    """
    if not folders:
        raise InputError("report: at least one run folder is expected.")
    runs = open_runs(sorted(folders, key=lambda folder: naturally(str(folder))))
    shared = Shared()
    for detail in LEVELS:
        text = page(runs, detail, detail != LEVELS[0], LIMIT, shared)
        if text is not None:
            break
    else:
        raise InputError(f"report: {len(runs)} runs fill more than {LIMIT / 1e6:g} MB, the most of one page; give fewer of them.")
    path = Path(path)
    path.write_bytes(text)
    return path
