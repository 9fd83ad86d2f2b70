# SPDX-License-Identifier: MIT
"""Figures of a run, each registered once: what it is called, what it leaves, to which runs it applies, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .run import Run

    Draw = Callable[[Run], Path]


@dataclass(frozen=True)
class RunFigure:
    """A figure of a run.

    Attributes
    ----------
    files : tuple of str
        What it leaves in the run folder, tables too.
    caption : str
        What it shows, in reports.
    applies : callable
        Of a run: whether it has what is drawn.
    draw : callable
        Of a run: draws it and returns the picture's path. The folder ``figures/`` is there.
    """

    files: tuple[str, ...]
    caption: str
    applies: Callable[[Run], bool]
    draw: Draw


FIGURES: dict[str, RunFigure] = {}
"""All that are registered, by name; drawn in this order."""


def figure(*files: str, caption: str = "", applies: Callable[[Run], bool] = lambda run: True) -> Callable[[Draw], Draw]:
    """Register the decorated function, ``draw(run)`` to the picture's path, as the figure of its name; `Run.plot` then draws it.

    Parameters
    ----------
    *files : str
        What it leaves, relative to the run folder; by default ``figures/NAME.png``.
    caption : str
        What it shows, in reports; by default its name.
    applies : callable
        Of a run: whether it has what is drawn; by default every run has.
    """

    def register(draw: Draw) -> Draw:
        name = draw.__name__
        FIGURES[name] = RunFigure(files or (f"figures/{name}.png",), caption or name.replace("_", " "), applies, draw)
        return draw

    return register


def figure_files() -> list[str]:
    """What all registered figures may leave in a run folder."""
    return [file for figure in FIGURES.values() for file in figure.files]
