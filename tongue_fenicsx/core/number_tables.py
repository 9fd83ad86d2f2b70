# SPDX-License-Identifier: MIT
"""Tables of numbers as people have them: columns parted by commas, or by semicolons or tabulators, and then with decimal commas."""

from __future__ import annotations

import numpy as np

from .errors import short
from .types import Floats

WORDS = {2: "two", 4: "four"}


def mark_of(text: str) -> str:
    """What parts the columns of a table."""
    return next((mark for mark in ";\t" if mark in text), ",")


def number_in(cell: str, mark: str) -> float | None:
    """The number in a cell of a table whose columns a mark parts; None where there is none."""
    try:
        plain = cell.strip(" \"'")
        return float(plain if mark == "," else plain.replace(",", "."))
    except ValueError:
        return None


def numbers_in(text: str, columns: int) -> Floats:
    """The numbers (n, columns) of a table without its line of names, if it begins with one.

    Raises
    ------
    ValueError
        If a line has others; it says which.
    """
    mark = mark_of(text)
    lines = [line for line in text.splitlines() if line.strip()]
    cells = [[number_in(cell, mark) for cell in line.split(mark)] for line in lines]
    if cells and all(number is None for number in cells[0]):
        lines, cells = lines[1:], cells[1:]
    rows = []
    for line, row in zip(lines, cells, strict=True):
        numbers = [number for number in row if number is not None]
        if len(numbers) != columns or len(row) != columns:
            raise ValueError(
                f"{short(line, 40)} is other than {WORDS[columns]} columns of numbers parted by {mark!r}; decimal commas need ';'"
            )
        rows.append(numbers)
    return np.array(rows).reshape(-1, columns)
