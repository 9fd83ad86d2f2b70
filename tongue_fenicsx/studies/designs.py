# SPDX-License-Identifier: MIT
"""Designs: which keys of a scenario take which values in each of many runs.

A design is a list with one dictionary for each run, of keys such as ``tissue.c10`` to values. All of them are functions of what they
are given: the same seed gives the same design everywhere.
"""

from __future__ import annotations

import csv
import io
import json
import zlib
from collections.abc import Mapping, Sequence
from itertools import product as combinations
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError, reading
from ..scenario.changes import toml_value

Change = dict[str, Any]
"""Keys of a scenario to their values in one run. ``activation.MUSCLE`` is one key: see `sweep.changed`."""

SAMPLERS = ("latin_hypercube", "sobol")
SIDES = ("together", "apart")
UNPAIRED = ("SL",)
"""Muscles that have no sides unless their mesh splits them."""


def factorial(levels: Mapping[str, Sequence[Any]]) -> list[Change]:
    """Every combination of the values of each key; the last key changes fastest."""
    return [dict(zip(levels, values, strict=True)) for values in combinations(*levels.values())]


def product(*designs: Sequence[Change]) -> list[Change]:
    """Every run of each design with every one of the others; the last design changes fastest.

    Raises
    ------
    InputError
        If two designs have a key in common.
    """
    for i, design in enumerate(designs):
        for key in {key for change in design for key in change}:
            if any(key in change for other in designs[:i] for change in other):
                raise InputError(f"{key}: is varied in two ways; once is expected.")
    return [{key: value for change in runs for key, value in change.items()} for runs in combinations(*designs)]


def from_table(path: Path) -> list[Change]:
    """One run for each line of a CSV file whose first line names the keys; an empty cell leaves the key as it is.

    Raises
    ------
    InputError
        If the file cannot be read, or a line has other cells than the first.
    """
    with reading(path, "a CSV file with keys of the scenario in its first line and a run in each of the others"):
        with open(path, newline="", encoding="utf-8-sig") as file:
            head, *lines = [[cell.strip() for cell in line] for line in csv.reader(file) if any(line)]
        if not lines or not all(head) or len(set(head)) < len(head):
            raise ValueError("it has no runs, or not one name for each column")
        for number, line in enumerate(lines, 2):
            if len(line) != len(head):
                raise ValueError(f"line {number} has {len(line)} cells, the first one {len(head)}")
        return [{key: toml_value(cell) for key, cell in zip(head, line, strict=True) if cell} for line in lines]


def sampled(between: Mapping[str, tuple[float, float]], n: int, seed: int, method: str = "latin_hypercube") -> list[Change]:
    """Points that fill the box between the bounds of each key evenly.

    Parameters
    ----------
    between : mapping
        Key to its least and greatest value.
    n : int
        How many points. A Sobol sequence is balanced for powers of 2 only; a longer one begins with the shorter.
    seed : int
        Of the generator.
    method : str
        ``latin_hypercube`` or ``sobol`` (scrambled).
    """
    from scipy.stats import qmc

    kind = {"latin_hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}[method]
    sampler = kind(len(between), rng=np.random.default_rng(seed))
    exponent = max(n - 1, 0).bit_length()
    unit = sampler.random_base2(exponent)[:n] if method == "sobol" else sampler.random(n)
    low, high = np.transpose(list(between.values()))
    return [dict(zip(between, map(float, point), strict=True)) for point in low + unit * (high - low)]


def random_activations(
    muscles: Sequence[str],
    n: int,
    seed: int,
    end: float,
    level: tuple[float, float] = (0.0, 1.0),
    spacing: tuple[float, float] = (0.05, 0.15),
    rest: float = 0.3,
    sides: str = "together",
    hold: float = 0.0,
    grid: float = 1e-5,
) -> list[Change]:
    """Random piecewise linear activations, from rest.

    The knots of a muscle follow each other at intervals from the uniform distribution between the bounds of `spacing`, until `end` is
    passed. At each of them the muscle is where it was with the probability `hold`, else at rest with the probability `rest`, else at a
    level from the uniform distribution between the bounds of `level`. Run, muscle and side are independent of each other: neither more
    runs nor more muscles change the others.

    Parameters
    ----------
    muscles : sequence of str
        With or without sides.
    n : int
        How many runs.
    seed : int
        Of the generators.
    end : float
        Of the runs, in s.
    level : (float, float)
        Least and greatest activation.
    spacing : (float, float)
        Shortest and longest time between knots in s.
    rest : float
        Probability of rest at a knot.
    hold : float
        Probability that a muscle stays where it is at a knot.
    grid : float
        Knots are at multiples of so many s. A run takes a step to the knots of every muscle: where eleven of them have theirs anywhere,
        these are most of its steps.
    sides : str
        ``together``, or ``apart``: then each side of a muscle has its own.
    """
    if sides == "apart":
        muscles = [
            name
            for muscle in muscles
            for name in ([muscle] if muscle in UNPAIRED or muscle.endswith(("_L", "_R")) else [f"{muscle}_L", f"{muscle}_R"])
        ]

    def course(run: int, muscle: str) -> list[list[float]]:
        random = np.random.default_rng([seed, run, zlib.crc32(muscle.encode())])
        pieces: list[list[float]] = []
        t = before = 0.0
        while t < end:
            duration = round(max(round(float(random.uniform(*spacing)) / grid), 1) * grid, 5)
            drawn = round(float(random.uniform(*level)), 4)
            target = 0.0 if random.random() < rest else drawn
            if hold and random.random() < hold:
                target = before
            pieces.append([duration, before, target])
            t, before = t + duration, target
        return pieces

    return [{f"activation.{muscle}": course(run, muscle) for muscle in muscles} for run in range(n)]


def as_csv(design: Sequence[Change]) -> str:
    """A design as a table of CSV; the first column is the number of the run."""
    keys = list(dict.fromkeys(key for change in design for key in change))
    rows = [[index, *(cell(change[key]) if key in change else "" for key in keys)] for index, change in enumerate(design)]
    return csv_text([["run", *keys], *rows])


def cell(value: Any) -> str | float:
    """A value as a cell of a table."""
    return value if isinstance(value, str | int | float) else json.dumps(value)


def csv_text(rows: Sequence[Sequence[Any]]) -> str:
    """Rows as CSV."""
    file = io.StringIO()
    csv.writer(file, lineterminator="\n").writerows(rows)
    return file.getvalue()
