# SPDX-License-Identifier: MIT
"""What a fit found: levels with what the data leave open, probes beside their paths, and contours upon the outline."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..analysis.tongue_grid import cut, grids, mid_plane, outline
from ..core.types import Floats
from ..runs.run import Run
from .canvas import BACKWARD, BONE, PATHS, curves, save_both, title_of

COLUMNS = 4


def draw_fit(
    run: Run,
    knots: Floats,
    levels: Mapping[str, tuple[Floats, Floats, Floats]],
    paths: Mapping[str, tuple[Floats, Floats]],
    away: Mapping[str, float],
    path: Path,
) -> Path:
    """Draw the levels of each muscle over time in their intervals; below them each probe and its path.

    Parameters
    ----------
    run : Run
        Of the levels.
    knots : (n,) array
        Times in s of the levels.
    levels : mapping
        Muscle to its levels (n,), and the lowest and highest that the data do not tell apart from them.
    paths : mapping
        Probe to times (m,) in s, and the displacement (m, 3) in m where it should be.
    away : mapping
        Probe to its distance in mm.
    path : Path
        PNG file; a PDF lies beside it.
    """
    rows = -(-len(levels) // COLUMNS), -(-len(paths) // COLUMNS)
    figure = Figure(figsize=(13, 0.7 + 2.4 * rows[0] + 3.0 * rows[1]), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[2.4 * rows[0], 3.0 * rows[1]])
    t = 1e3 * knots
    for axes, name in _panels(above, rows[0], list(levels)):
        at, low, high = levels[name]
        axes.fill_between(t, low, high, color="#56b4e9", alpha=0.45, linewidth=0)
        axes.plot(t, at, ".-", color="#0072b2")
        axes.set(title=name, xlim=(0, t[-1]), ylim=(0, 1), xlabel="time in ms", ylabel="activation")
        axes.grid(alpha=0.3)
    above.suptitle("activations; shaded: what the data cannot tell apart (two standard deviations)")
    for axes, name in _panels(below, rows[1], list(paths)):
        (times, wanted), moved = paths[name], 1e3 * run.probes[name]
        inside = 1e3 * times <= t[-1] + 1e-6
        times, wanted = times[inside], wanted[inside]
        for colour, axis, toward in zip(cycle(PATHS), (0, 2), ("backward", "upward"), strict=False):
            axes.plot(
                1e3 * times, 1e3 * wanted[:, axis], "o", color=colour, markersize=3.5, alpha=0.6, clip_on=False, label=f"{toward}, wanted"
            )
            axes.plot(1e3 * run.time, moved[:, axis], color=colour, label=toward)
        axes.set(title=f"{name}: {away[name]:.2f} mm away", xlim=(0, t[-1]), xlabel="time in ms", ylabel="displacement in mm")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    below.suptitle("points, and where they should be (dots)")
    return save_both(figure, path)[0]


def draw_contours(run: Run, wanted: Mapping[str, tuple[Floats, float]], path: Path) -> Path:
    """Draw the mid-sagittal outline at the end of a run, and at rest, with contours through which it should go.

    Parameters
    ----------
    run : Run
        At whose end they count.
    wanted : mapping
        Contour to its places (n, 2), x and z in mm, and its root mean square distance in mm.
    path : Path
        PNG file; a PDF lies beside it.
    """
    rest, moved = grids(run)
    figure = Figure(figsize=(7, 6), layout="constrained")
    axes = figure.subplots()
    axes.add_collection(curves(outline(rest), colors="0.5", linewidths=1.0, linestyles="--", label="at rest"))
    axes.add_collection(curves(outline(moved), colors="0.2", linewidths=1.6, label=f"at {1e3 * run.time[-1]:.0f} ms"))
    for colour, (name, (places, away)) in zip(cycle(PATHS), wanted.items(), strict=False):
        axes.plot(*places.T, "o", color=colour, markersize=2.5, label=f"{name}: {away:.2f} mm away", zorder=0)
    axes.autoscale_view()
    axes.set(aspect="equal", xlabel=BACKWARD, ylabel="z in mm", autoscale_on=False)
    for surface in run.obstacles(-1).values():
        axes.add_collection(curves(cut(surface, mid_plane(rest)), colors=BONE, linewidths=1.6), autolim=False)
    axes.legend(fontsize=8)
    figure.suptitle(title_of(run))
    return save_both(figure, path)[0]


def _panels(figure: Figure, rows: int, names: list[str]) -> list[tuple[Axes, str]]:
    """As many axes as names; those left over are gone."""
    columns = min(COLUMNS, len(names))
    panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for left in panels[len(names) :]:
        left.remove()
    for axes in panels[: len(names)]:
        axes.yaxis.set_major_locator(MaxNLocator(5))
    return list(zip(panels, names, strict=False))
