# SPDX-License-Identifier: MIT
"""What differs between runs: keys of their scenarios, numbers, and the displacement of their meshes."""

from __future__ import annotations

import csv
import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.tables import markdown
from ..runs.run import Run
from .moments import field_at

Quantities = dict[str, tuple[str, float, str]]
"""Key in ``summary.json`` to label, factor and unit."""

OUTCOME: Quantities = {
    "t_end": ("time reached", 1e3, "ms"),
    "peak_speed_m_s": ("peak speed", 1e2, "cm/s"),
    "hencky_von_mises_max": ("von Mises Hencky strain, 99th percentile", 1.0, ""),
    "volume_change_max": ("largest change of volume", 1e2, "%"),
    "min_jacobian": ("smallest J", 1.0, ""),
    "contact_force_max_N": ("largest contact force", 1.0, "N"),
    "wall_seconds": ("wall time", 1.0, "s"),
}
MISSING = "–"


def naturally(name: str) -> list[tuple[bool, int, str]]:
    """A key that sorts names as people count: run2 before run10."""
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in re.split(r"(\d+)", name)]


def open_runs(folders: Sequence[str | Path]) -> dict[str, Run]:
    """Runs by the names of their folders, or by their paths where names repeat, or by numbered paths.

    Raises
    ------
    InputError
        If a folder holds no run or a damaged one.
    """
    names = [Path(folder).resolve().name for folder in folders]
    paths = [str(folder) for folder in folders]
    numbered = [f"{number}: {path}" for number, path in enumerate(paths, start=1)]
    labels = next(labels for labels in (names, paths, numbered) if len(set(labels)) == len(labels))
    return dict(zip(labels, map(Run, folders), strict=True))


def differing_keys(runs: Mapping[str, Run]) -> dict[str, list[str]]:
    """Keys of the scenarios that are not the same in all runs, such as ``tissue.c10``, to their value in each, as text.

    A table of several keys that some runs have and others not, such as ``contact.palate``, is one key, and what differs between those
    that have it.
    """
    scenarios = [dict(_flat(_scenario(run))) for run in runs.values()]
    tables = [Counter(key.rpartition(".")[0] for key in scenario) for scenario in scenarios]
    found: dict[str, list[str]] = {}
    for key in dict.fromkeys(key for scenario in scenarios for key in scenario):
        table = key.rpartition(".")[0]
        values = [scenario.get(key, MISSING) for scenario in scenarios]
        having = [value for value, of in zip(values, tables, strict=True) if of[table]]
        if len(having) < len(values) and max(of[table] for of in tables) > 1:
            found[table] = ["given" if of[table] else MISSING for of in tables]
            values = values if len(set(having)) > 1 else []
        if len(set(values)) > 1:
            found[key] = values
    return found


def _scenario(run: Run) -> dict[str, Any]:
    if not run.store.has("scenario.toml"):
        return {}
    with run.reading("scenario.toml"):
        return tomllib.loads(run.store.read("scenario.toml").decode())


def _flat(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, str]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def same_mesh(a: Run, b: Run) -> bool:
    """Whether the nodes and cells of two runs are the same."""
    return all(map(np.array_equal, a.mesh, b.mesh))


@dataclass(frozen=True)
class Comparison:
    """Runs side by side.

    Attributes
    ----------
    runs : mapping
        Name to run; the others are held against the first.
    times : list of float
        The time in s at which each is looked at.
    """

    runs: Mapping[str, Run]
    times: list[float]

    def __post_init__(self) -> None:
        names = {label: run.summary["name"] for label, run in self.runs.items() if "name" in run.summary}
        if len(set(names.values())) > 1:
            of = ", ".join(f"{label} of {name!r}" for label, name in names.items())
            raise InputError(f"compare: the runs are on different anatomies ({of}); runs on one are expected.")

    def rows(self) -> list[list[str]]:
        """The table: names of the runs, keys that differ, and numbers, each a row with a cell for each run."""
        runs = list(self.runs.values())
        table = [["", *self.runs], *([key, *values] for key, values in differing_keys(self.runs).items())]
        table.append(["seen at, in ms", *(f"{1e3 * t:.4g}" for t in self.times)])
        for name in dict.fromkeys(name for run in runs for name in run.probes):
            for axis, toward in ((0, "backward"), (2, "upward")):
                row = [_displacement(run, name, axis, t) for run, t in zip(runs, self.times, strict=True)]
                table.append([f"{name.replace('_', ' ')} {toward} in mm", *row])
        moved = [field_at(run, "displacement", t) for run, t in zip(runs, self.times, strict=True)]
        table.append(["largest displacement in mm", *(f"{1e3 * np.linalg.norm(u, axis=1).max():.4g}" for u in moved)])
        apart = [
            f"{1e3 * np.linalg.norm(u - moved[0], axis=1).max():.4g}" if same_mesh(runs[0], run) else MISSING
            for run, u in zip(runs, moved, strict=True)
        ]
        table.append(["largest difference from the first in mm", *apart])
        for key, (label, factor, unit) in OUTCOME.items():
            if any(key in run.summary for run in runs):
                values = [f"{factor * run.summary[key]:.4g}" if key in run.summary else MISSING for run in runs]
                table.append([f"{label} in {unit}" if unit else label, *values])
        return table

    def write(self, path: Path) -> list[Path]:
        """Write the table in Markdown and as CSV beside a picture; return both files."""
        head, *rows = self.rows()
        files = [path.with_suffix(".md"), path.with_suffix(".csv")]
        files[0].write_text(markdown(head, rows), encoding="utf-8")
        with files[1].open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *rows])
        return files


def _displacement(run: Run, probe: str, axis: int, t: float) -> str:
    return f"{1e3 * np.interp(t, run.time, run.probes[probe][:, axis]):+.4g}" if probe in run.probes else MISSING
