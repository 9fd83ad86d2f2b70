# SPDX-License-Identifier: MIT
"""Two commits side by side: the same runs, in turn, so that a machine that drifts drifts for both."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from . import measure
from .timing import Finished, run

DEMO, CHAPTER = "demos/ggp.toml", "benchmarks/chapter.toml"


def cases(folder: Path, full: bool) -> dict[str, tuple[str, list[str], int]]:
    """Scenario, of which each commit has its own, changes to it, and ranks, of each run to compare; meshes are kept in `folder`."""
    coarse, small = measure.mesh("coarse", folder), measure.mesh(20e-3, folder)
    found = {
        "coarse demo": (DEMO, [f"mesh.file={coarse.resolve()}"], 1),
        "smallest tongue with contact, 350 ms": (CHAPTER, [f"mesh.file={small.resolve()}", "time.step=0.005"], 1),
    }
    if full:
        reference = measure.mesh("reference", folder)
        found["the chapter's case"] = (CHAPTER, [f"mesh.file={reference.resolve()}"], 2)
    return found


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """The project at a commit, in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        subprocess.run(["git", "worktree", "add", "--quiet", "--detach", str(tree), commit], check=True)
        try:
            yield tree
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(tree)], check=True)


def compare(commit: str, folder: Path, repeats: int, full: bool) -> Iterator[dict[str, Any]]:
    """A row for each run: medians of both commits in s, their ratio, and in mm how far their probes end apart."""
    with checked_out(commit) as tree, tempfile.TemporaryDirectory(dir=folder) as scratch:
        for number, (name, (scenario, changes, ranks)) in enumerate(cases(folder, full).items()):
            done: dict[str, list[Finished]] = {"old": [], "new": []}
            for turn in range(-1, repeats):  # the first, which compiles, is short and does not count
                for which, code in (("old", tree), ("new", Path.cwd()))[:: 1 if turn % 2 else -1]:
                    output = Path(scratch) / f"{number}-{which}-{turn}"
                    short = ["time.end=0.01"] if turn < 0 else []
                    done[which].append(run(code / scenario, output, *changes, *short, ranks=ranks, code=code))
            old, new = (of[1:] for of in done.values())
            yield {"run": name} | _row(old, new)


def _row(old: list[Finished], new: list[Finished]) -> dict[str, Any]:
    def both(name: str, value: Any) -> dict[str, float]:
        a, b = (median(value(one) for one in of) for of in (old, new))
        return {f"{name}, old": a, f"{name}, new": b, f"{name}, ratio": b / a if a else np.nan}

    found = both("solution (s)", lambda one: one.summary["wall_seconds"]) | both("process (s)", lambda one: one.seconds)
    found |= both("Newton iterations", lambda one: one.summary["newton_iterations"])
    for event in old[0].events:
        found |= both(f"{event} (s)", lambda one, event=event: one.events[event])
    ends = [one[-1].summary["probes"] for one in (old, new)]
    return found | {"ends apart (mm)": 1e3 * max(float(np.linalg.norm(np.subtract(u, ends[1][name]))) for name, u in ends[0].items())}
