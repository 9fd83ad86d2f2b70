# SPDX-License-Identifier: MIT
"""What each muscle does alone (the chapter's Figure 4.5): the runs, and their movements as a table."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

from ..analysis.movement import single_muscle_row
from ..anatomy.catalogue import CATALOGUE
from ..core.tables import markdown
from ..mechanics.tissue import TISSUES
from ..runs.run import Run
from . import single_muscle as solo
from .pool import Workers, all_done, perform

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


def move_each(folder: Path, mesh: Path, muscles: list[str], tissue: str, workers: Workers) -> dict[str, Run]:
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
    workers : Workers
        Who does the runs.

    Raises
    ------
    InputError
        If the mesh lacks the landmarks that the table is about.
    SolveError
        If a run fails; the others are done.
    """
    walls, stress = solo.walls_in(mesh), TISSUES[tissue].peak_stress
    cases = {name: (solo.scenario(name, mesh, tissue, stress[name], walls=walls), {"muscle": name}) for name in muscles}
    return all_done(perform(folder, cases, workers))


def table(runs: Mapping[str, Run]) -> list[list[str]]:
    """What each muscle does, as printed; names of columns first."""
    rows = [single_muscle_row(name, run) for name, run in runs.items()]
    return [[key.replace("_", " ") for key in COLUMNS], *([format(row[key], form) for key, form in COLUMNS.items()] for row in rows)]


def write(runs: Mapping[str, Run], folder: Path) -> None:
    """Write ``atlas.csv``, with all digits, and ``atlas.md``, as printed."""
    with open(folder / "atlas.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(single_muscle_row(name, run) for name, run in runs.items())
    head, *lines = table(runs)
    (folder / "atlas.md").write_text(markdown(head, lines), encoding="utf-8")
