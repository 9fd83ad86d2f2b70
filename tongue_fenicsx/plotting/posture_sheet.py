# SPDX-License-Identifier: MIT
"""The sheet of postures: each with and without gravity, in section and by its airway."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..analysis.airway import Airways, Postures
from ..analysis.tongue_grid import cut, grids, mid_plane, outline
from ..core.types import Floats
from .canvas import BACKWARD, BONE, PATHS, curves, save_both
from .run_figures import name_parts


def draw_sheet(postures: Postures, passages: Airways, path: Path) -> list[Path]:
    """Draw each posture in a row, its settings in colours: the mid-sagittal section and the distance to the walls of the airway.

    Parameters
    ----------
    postures, passages : mapping
        The runs and their airways.
    path : Path
        PNG file; a PDF lies beside it.
    """
    figure = Figure(figsize=(11, 3.7 * len(postures)), layout="constrained")
    rows = figure.subplots(len(postures), 2, squeeze=False, width_ratios=[1, 1.4])
    for (name, settings), (plane, curve) in zip(postures.items(), rows, strict=True):
        first = settings["none"]
        grid = grids(first, 0)[0]
        rest = outline(grid)
        plane.add_collection(curves(rest, colors="0.6", linewidths=1.0, linestyles="--"))
        for surface in first.obstacles_at_rest.values():
            plane.add_collection(curves(cut(surface, mid_plane(grid)), colors=BONE, linewidths=1.6))
        passage = passages[name]["none"]
        curve.plot(passage.along, passage.distance[0], "--", color="0.6", label="at rest")
        contours = [rest]
        for colour, (setting, run) in zip(("0.1", *PATHS), settings.items(), strict=False):
            contours.append(outline(grids(run)[1]))
            plane.add_collection(curves(contours[-1], colors=colour, linewidths=1.3))
            curve.plot(passage.along, passages[name][setting].distance[-1], color=colour, label=f"gravity {setting}")
        name_parts(curve, passage)
        low, high = _box(contours)
        plane.set(aspect="equal", xlim=(low[0] - 10, high[0] + 10), ylim=(low[1] - 4, high[1] + 12), ylabel="z in mm")
        plane.set_title(name, loc="left", fontweight="bold")
        curve.set(ylabel="distance to the tongue in mm", ylim=(0, None))
        curve.grid(alpha=0.3)
        curve.legend(fontsize=8)
    rows[-1, 0].set_xlabel(BACKWARD)
    rows[-1, 1].set_xlabel("along the wall, front to back, in mm")
    return save_both(figure, path)


def _box(contours: list[Floats]) -> tuple[Floats, Floats]:
    points = np.concatenate(contours).reshape(-1, 2)
    return points.min(axis=0), points.max(axis=0)
