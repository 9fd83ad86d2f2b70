# SPDX-License-Identifier: MIT
"""What each muscle does alone (the chapter's Figure 4.5): the runs, and their movements as a table."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from . import solo
from .muscles import CATALOGUE, PEAK_STRESS
from .run import Run
from .simulation import Report
from .tables import markdown

MUSCLES = tuple(name for name in CATALOGUE if name != "GGH")
"""All eleven."""
FILES = ("atlas.csv", "atlas.md", "atlas.png", "atlas.pdf")
"""What an atlas leaves beside the run folders."""
COLUMNS = {
    "muscle": "", "stress_kPa": ".3g", "tip_x_mm": "+.1f", "tip_z_mm": "+.1f", "dorsum_x_mm": "+.1f", "dorsum_z_mm": "+.1f",
    "root_x_mm": "+.1f", "root_z_mm": "+.1f", "edges_z_mm": "+.1f", "width_mm": "+.1f", "largest_mm": ".1f", "strain": ".2f",
    "speed_mm_s": ".0f",
}  # fmt: skip
"""Of the table, and how its numbers are printed."""

Row = dict[str, str | float]


def movements(
    folder: Path, mesh: Path, muscles: list[str], tissue: str, say: Callable[[str], None], report: Report | None = None
) -> dict[str, Run]:
    """Run each muscle alone among the bones, each in a folder of its name; one that is already there from the same scenario is taken.

    Parameters
    ----------
    folder : Path
        Where the run folders go.
    mesh : Path
        Mesh file.
    muscles : list of str
        Without sides, of the catalogue.
    tissue : str
        Preset of the tissue and its peak stresses.
    say : callable
        Is told of each muscle.
    report : callable, optional
        Called after each step of a run, on rank 0.

    Raises
    ------
    InputError
        If the mesh lacks the landmarks that the table is about.
    SolveError
        If a run fails.
    """
    runs = {}
    walls = solo.walls_in(mesh)
    for name in muscles:
        case = solo.scenario(name, mesh, tissue, PEAK_STRESS[tissue][name], walls=walls)
        runs[name], how = solo.moved(case, folder / name, report)
        say(f"{name}: {how}")
    return runs


def row(name: str, run: Run) -> Row:
    """The numbers of one muscle at the end of its run: displacement of the landmarks backward (x) and upward (z), the mean rise of the
    edges, how much wider the oral part is (of the tissue above the root at rest, from its leftmost to its rightmost point), the largest
    displacement, and over the whole run peak Hencky strain and speed.
    """
    points, u = run.mesh[0], run.field("displacement")
    oral = points[:, 2] > run.rest["root"][2]
    y, moved = points[oral, 1], (points + u)[oral, 1]
    landmarks = {key: 1e3 * run.probes[key][-1] for key in ("tip", "dorsum", "root")}
    return {
        "muscle": name,
        "stress_kPa": 1e-3 * max(run.summary["model"]["sigma_max"].values()),
        **{f"{key}_{axis}_mm": float(v[i]) for key, v in landmarks.items() for axis, i in (("x", 0), ("z", 2))},
        "edges_z_mm": 1e3 * float(np.mean([run.probes[f"edge_{side}"][-1, 2] for side in ("left", "right")])),
        "width_mm": 1e3 * float(np.ptp(moved) - np.ptp(y)),
        "largest_mm": 1e3 * float(np.linalg.norm(u, axis=1).max()),
        "strain": run.summary["hencky_von_mises_max"],
        "speed_mm_s": 1e3 * run.summary["peak_speed_m_s"],
    }


def written(runs: Mapping[str, Run], folder: Path) -> list[list[str]]:
    """Write ``atlas.csv`` and ``atlas.md``; return the table as it is printed, names of columns first."""
    rows = [row(name, run) for name, run in runs.items()]
    table = [[key.replace("_", " ") for key in COLUMNS], *([format(r[key], form) for key, form in COLUMNS.items()] for r in rows)]
    with open(folder / "atlas.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    (folder / "atlas.md").write_text(markdown(table[0], table[1:]), encoding="utf-8")
    return table
