# SPDX-License-Identifier: MIT
"""The anatomical criteria over tissues, subjects, activations and stresses: the runs, and their matrix."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import isnan, nan
from pathlib import Path

from mpi4py import MPI

from ..analysis.movement import Movement, movement
from ..core.errors import SolveError
from ..core.parallel import on_rank_zero
from ..core.tables import markdown
from ..mechanics.tissue import TISSUES
from ..runs.run import Run
from . import single_muscle as solo
from .anatomy_statements import Criterion, criteria
from .pool import Workers, perform, results

LEVELS = {"calka": (1.0,), "buchaillard": (0.1, 0.3)}
"""Activations by tissue: the stresses of the one are calibrated for full activation, those of the other are greatest forces, of which
postures of speech take some 0.05 to 0.6 (Stavness 2012)."""
SUBJECT_TISSUE = "buchaillard"
"""Living subjects are not checked with the tissue of a cadaver."""
FACTORS = (1.0, 0.8, 1.2)
"""Of the peak stress, the first alone unless the check is to be robust."""
FILES = ("anatomy.md", "anatomy.csv")
"""What a check leaves beside the run folders."""


@dataclass(frozen=True)
class Column:
    """One setting in which every muscle moves alone.

    Attributes
    ----------
    tongue : str
        Name of the mesh.
    mesh : Path
        Its file.
    tissue : str
        Preset of the tissue and its peak stresses.
    level : float
        Activation.
    factor : float
        Of the peak stress.
    """

    tongue: str
    mesh: Path
    tissue: str
    level: float
    factor: float

    @property
    def label(self) -> str:
        """How it is called."""
        return f"{self.tongue} {self.tissue} {self.level:g}" + ("" if self.factor == 1 else f" × {self.factor:g}")

    @property
    def folder(self) -> str:
        """Where its runs go."""
        return self.label.replace(" × ", "-x").replace(" ", "-")


@dataclass(frozen=True)
class Cell:
    """A measured value, not a number where the solve failed, and whether the criterion holds."""

    value: float
    holds: bool

    def __str__(self) -> str:
        return "no solution" if isnan(self.value) else f"{self.value:+.2f}"


Matrix = dict[tuple[str, Criterion], dict[Column, Cell]]
"""Muscle and criterion to its cells; one about full activation has none elsewhere."""


def columns(mesh: Path, subject: Path | None = None, robust: bool = False) -> list[Column]:
    """The settings for a tongue, and for a subject if there is one; each again at ± 20 % of the stress if wanted."""
    places = [(mesh, tissue) for tissue in LEVELS] + ([(subject, SUBJECT_TISSUE)] if subject is not None else [])
    return [
        Column(place.stem, place, tissue, level, factor)
        for place, tissue in places
        for level in LEVELS[tissue]
        for factor in (FACTORS if robust else FACTORS[:1])
    ]


def check(folder: Path, muscles: Mapping[Column, Sequence[str]], workers: Workers) -> Matrix:
    """Move every muscle alone among the bones in every setting and judge the ends; finished runs of the same scenario are taken.

    Parameters
    ----------
    folder : Path
        Where the run folders go.
    muscles : mapping
        Setting to its muscles, without sides.
    workers : Workers
        Who does the runs.

    Raises
    ------
    InputError
        If a mesh lacks the landmarks.
    """
    cases = {}
    for column, names in muscles.items():
        walls = solo.walls_in(column.mesh)
        for name in names:
            stress = column.factor * TISSUES[column.tissue].peak_stress[name]
            case = solo.scenario(name, column.mesh, column.tissue, stress, column.level, walls)
            cases[f"{column.folder}/{name}"] = case, {"setting": column.label, "muscle": name}
    found = results(perform(folder, cases, workers))
    return judge(muscles, lambda column, name: found[f"{column.folder}/{name}"])


def judge(muscles: Mapping[Column, Sequence[str]], ended: Callable[[Column, str], Run | SolveError]) -> Matrix:
    """Hold the end of each run against the statements about its muscle; one that failed meets none.

    Parameters
    ----------
    muscles : mapping
        Setting to its muscles, without sides.
    ended : callable
        Of a setting and a muscle: the run, or why it failed.
    """
    matrix: Matrix = {}
    for column, names in muscles.items():
        for name in names:
            run = ended(column, name)
            measured = None if isinstance(run, SolveError) else _measure(run)
            for criterion in criteria(name, column.level):
                cell = Cell(nan, False) if measured is None else Cell(measured[criterion.quantity], criterion.holds(measured))
                matrix.setdefault((name, criterion), {})[column] = cell
    return matrix


def _measure(run: Run) -> Movement:
    measured: Movement = on_rank_zero(MPI.COMM_WORLD, partial(movement, run))
    return measured


def counts(matrix: Matrix, column: Column) -> str:
    """How many statements hold in a setting, and apart how many of the open ones."""
    cells = [(criterion.open, cells[column].holds) for (_, criterion), cells in matrix.items() if column in cells]
    must, may = ([holds for is_open, holds in cells if is_open is wanted] for wanted in (False, True))
    return f"{column.label}: {sum(must)} of {len(must)} hold" + (f"; of those left open, {sum(may)} of {len(may)}" if may else "")


def holds(matrix: Matrix) -> bool:
    """Whether all statements hold that are not open."""
    return all(cell.holds for (_, criterion), cells in matrix.items() for cell in cells.values() if not criterion.open)


def verdict(criterion: Criterion, cell: Cell | None) -> str:
    """A cell in words: nothing where the statement does not apply, NO before a value that should be another one."""
    if cell is None:
        return ""
    return str(cell) if cell.holds else f"{'open' if criterion.open else 'NO'} {cell}"


def rows(matrix: Matrix) -> list[tuple[str, Criterion]]:
    """The rows, muscle by muscle in the order of their first appearance."""
    muscles = list(dict.fromkeys(muscle for muscle, _ in matrix))
    return sorted(matrix, key=lambda row: muscles.index(row[0]))


def write(matrix: Matrix, settings: Sequence[Column], folder: Path) -> None:
    """Write ``anatomy.md``, a table with what fails in bold, and ``anatomy.csv``, one line a cell."""
    head = ["muscle", "part", "statement", "bounds", *(column.label for column in settings)]
    lines = []
    with open(folder / "anatomy.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["muscle", "part", "statement", "bounds", "tongue", "tissue", "activation", "stress_factor", "value", "holds", "open"]
        )
        for muscle, criterion in rows(matrix):
            cells = matrix[muscle, criterion]
            start = [muscle, criterion.part, criterion.says, criterion.bounds]
            for column, cell in cells.items():
                setting = [column.tongue, column.tissue, column.level, column.factor]
                writer.writerow([*start, *setting, cell.value, *("yes" if is_so else "no" for is_so in (cell.holds, criterion.open))])
            lines.append([*start, *(_mark(criterion, cells.get(column)) for column in settings)])
    (folder / "anatomy.md").write_text(markdown(head, lines), encoding="utf-8")


def _mark(criterion: Criterion, cell: Cell | None) -> str:
    """A cell in Markdown, bold where a statement that is not open does not hold."""
    text = verdict(criterion, cell)
    return f"**{text}**" if text.startswith("NO") else text
