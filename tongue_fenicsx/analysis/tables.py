# SPDX-License-Identifier: MIT
"""Tables of many runs, one line a run, by the names of their columns; those of a sweep and any other CSV."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from ..core.errors import InputError, reading
from ..core.types import Floats

FILE = "table.csv"
"""In the folder of a sweep."""
DONE = "done"


@dataclass(frozen=True)
class Table:
    """A table of runs.

    Attributes
    ----------
    path : Path
        Its file.
    columns : dict
        Name to the cells of the runs that are done, as text.
    n_runs : int
        Lines of the file, also of runs that are not done.
    """

    path: Path
    columns: dict[str, list[str]]
    n_runs: int

    @classmethod
    def read(cls, path: Path) -> Table:
        """Read a CSV file with names in its first line; where it has a column ``status``, only lines with ``done`` there count.

        Raises
        ------
        InputError
            If it cannot be read, names repeat, a line has other than a cell for each name, or no run is done.
        """
        with reading(path, "a table with names in its first line"):
            rows_read = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines(), strict=True))
            if len(rows_read) < 2:
                raise ValueError("it has no line under its names" if rows_read else "it is empty")
            head, *lines = rows_read
            if len(set(head)) < len(head):
                raise ValueError("two columns have one name")
            for number, line in enumerate(lines, start=2):
                if len(line) != len(head):
                    raise ValueError(f"line {number} has {len(line)} cells under {len(head)} names")
        rows = [dict(zip(head, line, strict=True)) for line in lines]
        done = [row for row in rows if row.get("status", DONE) == DONE]
        if not done:
            raise InputError(f"{path}: none of its {len(rows)} runs is done; at least one is expected.")
        return cls(path, {name: [row[name] for row in done] for name in head}, len(rows))

    @property
    def varied(self) -> list[str]:
        """The keys that differ between runs: of the columns before ``status``, or without that of those with a dot in their names."""
        names = list(self.columns)
        keys = names[: names.index("status")] if "status" in names else [name for name in names if "." in name]
        return [name for name in keys if name != "index" and len(set(self.columns[name])) > 1]

    def cells(self, name: str) -> list[str]:
        """The cells of a column.

        Raises
        ------
        InputError
            If there is none of this name; the nearest is named.
        """
        if name not in self.columns:
            near = get_close_matches(name, self.columns, n=1, cutoff=0.4)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise InputError(f"{self.path}: no column {name!r}; {hint}It has {', '.join(self.columns)}.")
        return self.columns[name]

    def is_number(self, name: str) -> bool:
        """Whether a column holds numbers, at least one, and empty cells."""
        try:
            return bool(np.isfinite(self.numbers(name)).any())
        except InputError:
            return False

    def numbers(self, name: str) -> Floats:
        """A column as numbers, not a number where a cell is empty.

        Raises
        ------
        InputError
            If there is no such column, or it holds other than numbers.
        """
        cells = self.cells(name)
        try:
            return np.array([float(cell) if cell.strip() else np.nan for cell in cells])
        except ValueError as error:
            raise InputError(f"{self.path}: the column {name!r} holds other than numbers ({str(error)[:80]}).") from error
