# SPDX-License-Identifier: MIT
"""Pictures of a run, drawn from its folder."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import NullFormatter

from ..analysis.electropalatogram import ELECTRODES
from ..analysis.tongue_grid import cut, grids, mid_plane, outline, section
from ..analysis.trajectories import SLOW, motion
from .canvas import BACKWARD, BONE, COLOURS, PATHS, curves, save_both, title_of
from .scene import stage

if TYPE_CHECKING:
    from ..analysis.airway import Airway
    from ..analysis.electropalatogram import Electropalatogram
    from ..runs.run import Run

NEAR = "magma"
FRAMES = 24
"""How many electropalatograms are drawn at most."""
DASHES = ("-", "--", ":")
"""Of more lines than there are colours."""
PROBES = ("tip", "dorsum", "root")
"""Drawn by default, where the run has them: the tip, the palatal and the pharyngeal point; else the first probes."""


def draw_midsagittal(run: Run, index: int | None = None) -> Path:
    """The mid-sagittal section at rest and deformed, coloured by displacement, with the obstacles, as PNG and PDF.

    By default at the output at which the tongue is farthest from rest.
    """
    index = run.farthest if index is None else index
    rest, deformed = grids(run, index)
    before, after = section(rest), section(deformed)
    figure = Figure(figsize=(10, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    left.add_collection(curves(outline(rest), colors="0.2", linewidths=1.4))
    left.triplot(before.points[:, 0], before.points[:, 2], before.regular_faces, color="0.85", linewidth=0.3)
    left.set_title("at rest")
    image = right.tripcolor(
        after.points[:, 0], after.points[:, 2], after.regular_faces, after["displacement"], shading="gouraud", cmap=COLOURS, vmin=0
    )
    right.add_collection(curves(outline(rest), colors="0.5", linewidths=1.0, linestyles="--"))
    right.add_collection(curves(outline(deformed), colors="0.2", linewidths=1.4))
    right.set_title(f"at {1e3 * _time(run, index):.0f} ms (dashed: rest)")
    for axes, moment in ((left, 0), (right, index)):
        axes.set_aspect("equal")
        axes.set_xlabel(BACKWARD)
        for surface in run.obstacles(moment).values():
            axes.add_collection(curves(cut(surface, mid_plane(rest)), colors=BONE, linewidths=1.6))
    left.set_ylabel("z in mm")
    left.autoscale_view()
    if run.contact:  # bones reach far
        (x, _, z), (x_end, _, z_end) = (f(np.vstack([rest.points, deformed.points]), axis=0) for f in (np.min, np.max))
        left.set(xlim=(x - 13, x_end + 13), ylim=(z - 8, z_end + 12))
    figure.colorbar(image, ax=[left, right], label="displacement in mm", shrink=0.8)
    figure.suptitle(title_of(run))
    figure.get_layout_engine().set(h_pad=0.1)
    return _save(figure, run, "midsagittal")


def draw_view3d(run: Run, index: int | None = None) -> Path:
    """The deformed tongue from the front left, coloured by displacement, in its transparent rest shape and among the obstacles, as PNG.

    By default at the output at which the tongue is farthest from rest.
    """
    t = _time(run, run.farthest if index is None else index)
    path = run.folder / "figures" / "view3d.png"
    with stage(run, "displacement", np.array([t]), "oblique") as (figure, show):
        show(t)
        figure.savefig(path)
    return path


def draw_trajectories(run: Run) -> Path:
    """Paths of tip, dorsum and root in the mid-sagittal plane (the chapter's Figure 4.6), and over time their displacement (Figure 4.7),
    tangential speed and curvature, as PNG and PDF."""
    names = [name for name in PROBES if name in run.probes] or list(run.probes)[: len(PATHS)]
    figure = Figure(figsize=(12, 8.5), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1, 1.1])
    over_time, speeds, bends = below.subplots(1, 3)
    t = 1e3 * run.time
    reach = 0.55e3 * max(float(np.ptp(run.probes[name][:, [0, 2]], axis=0).max()) for name in names) + 0.1
    handles = []
    for colour, name, plane in zip(cycle(PATHS), names, above.subplots(1, len(names), squeeze=False)[0], strict=False):
        place = run.rest[name] + run.probes[name]
        speed, curvature = motion(run.time, place)
        x, _, z = 1e3 * place.T
        plane.plot(x, z, ".-", color=colour, markersize=2.5, linewidth=1)
        plane.plot(x[0], z[0], "k+", x[-1], z[-1], "ko", markersize=5)
        plane.set(title=f"{name}: from rest (+) to the end (•)", xlabel=BACKWARD, ylabel="z in mm")
        (across, up) = ((c.min() + c.max()) / 2 for c in (x, z))
        plane.set(aspect="equal", xlim=(across - reach, across + reach), ylim=(up - reach, up + reach))
        plane.grid(alpha=0.3)
        handles += over_time.plot(t, x - x[0], color=colour, label=name)
        over_time.plot(t, z - z[0], "--", color=colour)
        speeds.plot(t, 1e2 * speed, color=colour)
        bends.semilogy(t, curvature, ".", color=colour, markersize=3)
    ways = [Line2D([], [], color="0.3", linestyle=style, label=way) for style, way in (("-", "backward"), ("--", "upward"))]
    below.legend(handles=handles + ways, loc="outside lower center", ncols=len(handles) + 2, frameon=False)
    over_time.set(title="displacement, backward and upward", ylabel="mm")
    speeds.set(title="tangential speed", ylabel="cm/s", ylim=(0, None))
    bends.set(title=f"curvature, where faster than {1e2 * SLOW:g} cm/s", ylabel="1/m")
    bends.yaxis.set_major_formatter("{x:g}")
    bends.yaxis.set_minor_formatter(NullFormatter())
    for axes in (over_time, speeds, bends):
        axes.set(xlabel="time in ms", xlim=(0, t[-1]))
        axes.grid(alpha=0.3)
    figure.suptitle(title_of(run))
    return _save(figure, run, "trajectories")


def draw_contact(run: Run) -> Path:
    """Force and area of contact with each obstacle over time, as PNG and PDF."""
    figure = Figure(figsize=(10, 3.8), layout="constrained")
    force, area = figure.subplots(1, 2)
    for name, touch in run.contact.items():
        force.plot(1e3 * run.time, np.linalg.norm(touch["force"], axis=1), label=name)
        area.plot(1e3 * run.time, 1e6 * touch["area"], label=name)
    force.set(xlabel="time in ms", ylabel="force in N", title="force of contact")
    area.set(xlabel="time in ms", ylabel="area in mm²", title="area of contact")
    for axes in (force, area):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    figure.suptitle(title_of(run))
    return _save(figure, run, "contact")


def draw_electropalatogram(run: Run, record: Electropalatogram) -> Path:
    """The electropalatograms from first to last contact, front at the top; where the electrodes lie; how many are on over time."""
    touched = np.flatnonzero(record.on.any(axis=1))
    first, last = (touched[0], touched[-1]) if len(touched) else (0, len(record.time) - 1)
    first, last = max(first - 1, 0), min(last + 1, len(record.time) - 1)
    moments = np.arange(first, last + 1, -(-(last + 1 - first) // FRAMES))
    columns = FRAMES // 2
    rows = -(-len(moments) // columns)
    figure = Figure(figsize=(13, 3.6 + 1.3 * rows), layout="constrained")
    frames, below = figure.subfigures(2, 1, height_ratios=[1.3 * rows, 3.2])
    corner = np.array([row > 0 or 0 < column < 7 for row in range(8) for column in range(8)]).reshape(8, 8)
    y, x = np.nonzero(corner)
    sheet = frames.subplots()  # one for all: two dozen of axes take most of a second
    for place, moment in enumerate(moments):
        down, across = np.array(divmod(place, columns)) * (10.5, 9.5)
        on = record.grid(int(moment))[corner]
        sheet.scatter(across + x[~on], down + y[~on], s=3, color="0.7")
        sheet.scatter(across + x[on], down + y[on], s=22, color="black", marker="s")
        sheet.add_patch(Rectangle((across - 0.9, down - 0.9), 8.8, 8.8, fill=False, color="0.3", linewidth=0.8))
        sheet.text(across + 3.5, down - 1.2, f"{1e3 * record.time[moment]:.0f} ms", fontsize=8, ha="center")
    sheet.set(xlim=(-1, 9.5 * columns - 1.5), ylim=(10.5 * rows - 2.4, -2.6), aspect="equal")
    sheet.set_axis_off()
    palate, count = below.subplots(1, 2, width_ratios=[1, 2])
    lateral, frontal = 1e3 * record.places[:, 1], 1e3 * record.places[:, 0]
    share = palate.scatter(lateral, frontal, c=100 * record.on.mean(axis=0), cmap="magma_r", vmin=0, vmax=100, edgecolor="0.4")
    palate.set(aspect="equal", xlabel="← left    y in mm    right →", ylabel="← back    x in mm    front →")
    palate.invert_yaxis()
    below.colorbar(share, ax=palate, label="% of the time on")
    count.step(1e3 * record.time, record.on.sum(axis=1), where="mid", color="black")
    count.set(xlabel="time in ms", ylabel=f"electrodes on, of {len(ELECTRODES)}", ylim=(0, len(ELECTRODES)))
    count.grid(alpha=0.3)
    if not len(touched):
        count.text(0.5, 0.5, "no electrode is touched", transform=count.transAxes, ha="center", va="center", color="0.4")
    figure.suptitle(f"{title_of(run)}: virtual electropalatogram")
    return _save(figure, run, "epg")


def draw_airway(run: Run, record: Airway) -> Path:
    """The distance from the walls of the airway to the tongue: in the mid-sagittal plane, along the walls at rest and at the output where
    the tongue is farthest from rest, and along them over time, as PNG and PDF."""
    index = run.farthest
    rest, moved = grids(run, index)
    figure = Figure(figsize=(14, 4.6), layout="constrained")
    plane, curve, time = figure.subplots(1, 3)
    plane.add_collection(curves(outline(rest), colors="0.5", linewidths=1.0, linestyles="--"))
    plane.add_collection(curves(outline(moved), colors="0.1", linewidths=1.4))
    dots = plane.scatter(*record.wall.T, c=record.distance[index], s=9, cmap=NEAR, vmin=0, rasterized=True)
    figure.colorbar(dots, ax=plane, label="distance in mm", shrink=0.8)
    plane.set(aspect="equal", xlabel=BACKWARD, ylabel="z in mm", title=f"at {1e3 * _time(run, index):.0f} ms")
    curve.plot(record.along, record.distance[0], "--", color="0.5", label="at rest")
    curve.plot(record.along, record.distance[index], color="0.1", label=f"at {1e3 * _time(run, index):.0f} ms")
    name_parts(curve, record)
    curve.set(xlabel="along the wall, front to back, in mm", ylabel="distance to the tongue in mm", ylim=(0, None))
    curve.legend(fontsize=8)
    curve.grid(alpha=0.3)
    image = time.pcolormesh(1e3 * record.time, record.along, record.distance.T, cmap=NEAR, vmin=0, rasterized=True)
    figure.colorbar(image, ax=time, label="distance in mm")
    time.set(xlabel="time in ms", ylabel="along the wall in mm")
    figure.suptitle(f"{title_of(run)}: airway")
    return _save(figure, run, "airway")


def name_parts(axes: Axes, record: Airway) -> None:
    """Say along a curve over the wall where each part of it begins."""
    for name in dict.fromkeys(record.part):
        begin = record.along[np.argmax(record.part == name)]
        axes.axvline(begin, color="0.8", linewidth=0.8, zorder=0)
        axes.annotate(name, (begin, 1.0), (3, -3), xycoords=("data", "axes fraction"), textcoords="offset points", va="top", fontsize=8)


def _time(run: Run, index: int) -> float:
    """Time in s of an output."""
    return float(run.output_times[index])


def _save(figure: Figure, run: Run, name: str) -> Path:
    return save_both(figure, run.folder / "figures" / f"{name}.png")[0]
