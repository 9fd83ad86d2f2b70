# SPDX-License-Identifier: MIT
"""Where pictures are drawn: figures that Pyplot does not know, so that a user's own figures and settings stay as they are, and plotters
off screen."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from vtkmodules.vtkCommonCore import vtkLogger

from ..anatomy.catalogue import base_name
from ..core.types import Floats

if TYPE_CHECKING:
    from ..runs.run import Run

COLOURS = "viridis"
PATHS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Of lines, which eyes that confuse red and green tell apart too (Okabe and Ito 2008)."""
BONE = "#b3926a"
BACKWARD = "← front    x in mm    back →"
"""Along an axis of the mid-sagittal plane."""


def title_of(run: Run) -> str:
    """Name of the run, the muscles that moved it, and whose tongue it is."""
    muscles = sorted({base_name(name) for name, level in run.activation.items() if level.any()})
    tongue = f" ({run.summary['name']})" if "name" in run.summary else ""
    *_, above, name = ("", *Path(str(run)).parts)
    if name == "run" and above:  # of a fit, as of every other one
        name = f"{above}/{name}"
    return f"{name}: {', '.join(muscles) or 'no active muscle'}{tongue}"


def curves(lines: Floats, **style: Any) -> LineCollection:
    """Lines (n, 2, 2) as curves, joined where they meet, so that dashes run through."""
    ends = pv.line_segments_from_points(np.insert(lines.reshape(-1, 2), 1, 0.0, axis=1))
    joined = ends.clean().strip(join=True, max_length=len(lines) + 1)
    return LineCollection([cell.points[:, [0, 2]] for cell in joined.cell], **style)


def save_both(figure: Figure, path: Path, dpi: int = 150) -> list[Path]:
    """Write a figure to a PNG file and a PDF beside it; return both. It is laid out once: Matplotlib would twice for each."""
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)
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
