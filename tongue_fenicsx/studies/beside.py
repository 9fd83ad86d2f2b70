# SPDX-License-Identifier: MIT
"""Runs beside that of a fit: how what the full tongue does changes with each of the numbers that were found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..core.errors import SolveError
from ..core.types import Floats
from ..runs.run import Run
from .fitting import Fit, Search

MOVED = 0.05
"""By how much a number is moved, toward the middle of what it may be."""
BASE = "base"
"""The run that the others are beside."""


def nearby(found: Fit, search: Search) -> dict[str, tuple[Fit, float]]:
    """For each number of a search by its name, a fit with that one moved, and by how much."""
    x = search.begin(found.levels, found.angle)
    steps = np.where(x <= 0.5, MOVED, -MOVED)
    return {name: (search.moved(found, x + step * one), step) for name, step, one in zip(search.names, steps, np.eye(len(x)), strict=True)}


@dataclass(frozen=True)
class Beside:
    """The runs of `nearby`, or of some of it.

    Attributes
    ----------
    found : Fit
        What they are beside.
    search : Search
        Whose numbers were moved.
    runs : mapping
        Name to run or why it failed, with that of the fit itself as `BASE`.
    """

    found: Fit
    search: Search
    runs: Mapping[str, Run | SolveError]

    def slopes(self, read: Callable[[Run], Floats]) -> dict[str, Floats]:
        """Name of each number that was moved to the derivatives by it of what is read from a run.

        Raises
        ------
        SolveError
            If one of them failed.
        """
        read_from = {}
        for name, run in self.runs.items():
            if isinstance(run, SolveError):
                raise run
            read_from[name] = read(run)
        steps = nearby(self.found, self.search)
        return {name: (values - read_from[BASE]) / steps[name][1] for name, values in read_from.items() if name != BASE}
