# SPDX-License-Identifier: MIT
"""Where pictures are drawn: figures that Pyplot does not know, so that a user's own figures and settings stay as they are, and plotters
off screen."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pyvista as pv
from matplotlib.figure import Figure
from vtkmodules.vtkCommonCore import vtkLogger

from ..anatomy.catalogue import base_name

if TYPE_CHECKING:
    from ..runs.run import Run

COLOURS = "viridis"
BONE = "#b3926a"
BACKWARD = "← front    x in mm    back →"
"""Along an axis of the mid-sagittal plane."""


def title_of(run: Run) -> str:
    """Name of the tongue and the muscles that moved it."""
    muscles = sorted({base_name(name) for name, level in run.activation.items() if level.any()})
    return f"{run.summary.get('name', Path(str(run)).name)}: {', '.join(muscles) or 'no active muscle'}"


def save_both(figure: Figure, path: Path, dpi: int = 150) -> list[Path]:
    """Write a figure to a PNG file and a PDF beside it; return both."""
    paths = [path, path.with_suffix(".pdf")]
    for target in paths:
        figure.savefig(target, dpi=dpi)
    return paths


@contextmanager
def open_plotter(width: int, height: int) -> Iterator[pv.Plotter]:
    """A white plotter off screen of so many pixels, closed at the end."""
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # without a screen VTK warns, and then draws all the same
    plotter = pv.Plotter(off_screen=True, window_size=(width, height))
    try:
        plotter.set_background("white")
        yield plotter
    finally:
        plotter.close()
