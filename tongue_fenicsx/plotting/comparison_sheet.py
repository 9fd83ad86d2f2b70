# SPDX-License-Identifier: MIT
"""The sheet of a comparison: contours and trajectories of several runs over each other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ..analysis.comparison import Comparison
from ..analysis.moments import check_moment, ends, obstacles_at
from ..analysis.tongue_grid import cut, grids_at, mid_plane, outline
from ..core.errors import InputError
from ..runs.run import Run
from .canvas import BACKWARD, BONE, PATHS, curves
from .run_figures import DASHES, PROBES

REST = "0.6"

Style = tuple[str, str]
"""Dash and colour of a line."""


def draw_comparison(runs: dict[str, Run], path: str | Path, time: float | None = None) -> Comparison:
    """Draw runs over each other, and write what differs between them in Markdown and as CSV beside the picture.

    Parameters
    ----------
    runs : dict
        Name to run, at least two on one anatomy; the others are held against the first.
    path : path
        The picture: PNG, PDF or SVG.
    time : float, optional
        When the contours and the numbers are taken, in s; by default at the end of each run.

    Returns
    -------
    Comparison
        With the table in its ``rows()``.

    Raises
    ------
    InputError
        If there are fewer than two runs or more than can be told apart, on different anatomies, or one has no fields at that time.
    """
    most = len(PATHS) * len(DASHES)
    if not 2 <= len(runs) <= most:
        raise InputError(f"compare: {len(runs)} runs are given; two to {most} are expected, the most that lines can tell apart.")
    comparison = Comparison(runs, [ends(run)[1] if time is None else check_moment(run, time, "compare: time") for run in runs.values()])
    styles = [(dash, colour) for dash, colour in product(DASHES, PATHS)][: len(runs)]
    names = [name for name in PROBES if any(name in run.probes for run in runs.values())]
    figure = Figure(figsize=(12, 11 if names else 5.5), layout="constrained")
    above, *below = figure.subfigures(2 if names else 1, 1, squeeze=False)[:, 0]
    _draw_contours(above.subplots(), comparison, styles)
    lines = [
        Line2D([], [], color=colour, linestyle=dash, linewidth=1.6, label=label) for label, (dash, colour) in zip(runs, styles, strict=True)
    ]
    above.legend(handles=[*lines, Line2D([], [], color=REST, linewidth=1, label="at rest")], loc="outside right center", frameon=False)
    for part in below:
        for (path_axes, course), name in zip(part.subplots(2, len(names), squeeze=False).T, names, strict=True):
            _draw_probe(path_axes, course, name, comparison, styles)
    figure.savefig(path, dpi=150)
    return comparison


def _draw_contours(axes: Axes, comparison: Comparison, styles: Sequence[Style]) -> None:
    """The mid-sagittal contours, the rest shape behind them, and the bones."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for run, t, (dash, colour) in zip(comparison.runs.values(), comparison.times, styles, strict=True):
        grids = grids_at(run, t)
        rest, moved = (outline(grid) for grid in grids)
        axes.add_collection(curves(rest, colors=REST, linewidths=1, zorder=1))
        axes.add_collection(curves(moved, colors=colour, linestyles=dash, linewidths=1.5, zorder=2))
        for surface in obstacles_at(run, t).values():
            axes.add_collection(curves(cut(surface, mid_plane(grids[0])), colors=BONE, linestyles=dash, linewidths=1.3, zorder=0))
        points = np.concatenate([rest, moved]).reshape(-1, 2)
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    axes.set(aspect="equal", xlim=(low[0] - 12, high[0] + 12), ylim=(low[1] - 6, high[1] + 12), xlabel=BACKWARD, ylabel="z in mm")
    moments = dict.fromkeys(f"{1e3 * t:.4g} ms" for t in comparison.times)
    axes.set_title(f"mid-sagittal contours at {', '.join(moments)}")


def _draw_probe(path: Axes, course: Axes, name: str, comparison: Comparison, styles: Sequence[Style]) -> None:
    """The way of a probe in the mid-sagittal plane, with a dot where it ends, and how far it is from rest over time."""
    for run, (dash, colour) in zip(comparison.runs.values(), styles, strict=True):
        if name in run.probes:
            x, _, z = 1e3 * (run.rest[name] + run.probes[name]).T
            path.plot(x, z, color=colour, linestyle=dash, linewidth=1.3)
            path.plot(x[-1], z[-1], "o", color=colour, markersize=4)
            course.plot(1e3 * run.time, 1e3 * np.linalg.norm(run.probes[name], axis=1), color=colour, linestyle=dash, linewidth=1.3)
    path.set_title(f"{name}: path, to the end (•)")
    path.set(xlabel=BACKWARD, ylabel="z in mm")
    path.set_aspect("equal", adjustable="datalim")
    for axis in (path.xaxis, path.yaxis):
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    course.set(title=f"{name}: displacement", xlabel="time in ms", ylabel="mm", ylim=(0, None))
    course.margins(x=0)
    for axes in (path, course):
        axes.grid(alpha=0.3)
