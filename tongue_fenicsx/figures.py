# SPDX-License-Identifier: MIT
"""Pictures of a run, drawn from its folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pyvista as pv
from matplotlib.collections import LineCollection
from vtkmodules.vtkCommonCore import vtkLogger

from .fibres import Floats

if TYPE_CHECKING:
    from .results import Run

vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # without a screen VTK warns, and then draws all the same

COLOURS = "viridis"
PROBES = ("tip", "dorsum", "root")
"""Drawn by default, where the run has them: the tip, the palatal and the pharyngeal point."""


def _grid(run: Run, index: int = -1) -> tuple[pv.UnstructuredGrid, pv.UnstructuredGrid]:
    """The tongue at rest and deformed at an output, with ``displacement`` in mm as point data; lengths in mm."""
    points, cells = run.mesh
    u = 1e3 * run.field("displacement", index)
    rest = pv.UnstructuredGrid({pv.CellType.QUADRATIC_TETRA: cells}, 1e3 * points)
    rest["displacement"] = np.linalg.norm(u, axis=1)
    deformed = rest.copy()
    deformed.points = rest.points + u
    return rest, deformed


def _section(grid: pv.UnstructuredGrid) -> pv.PolyData:
    """Where the mid-sagittal plane cuts a grid, as triangles."""
    return grid.tessellate(max_n_subdivide=1).slice(normal="y", origin=(0.0, 1e-4, 0.0)).triangulate()


def _outline(section: pv.PolyData) -> list[Floats]:
    edges = section.extract_feature_edges(boundary_edges=True, feature_edges=False, manifold_edges=False, non_manifold_edges=False)
    lines = edges.lines.reshape(-1, 3)[:, 1:]
    return [np.asarray(edges.points)[line][:, [0, 2]] for line in lines]


def midsagittal(run: Run, index: int = -1) -> Path:
    """The mid-sagittal section at rest and deformed, coloured by displacement, as PNG and PDF."""
    rest, deformed = _grid(run, index)
    before, after = _section(rest), _section(deformed)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.8), sharex=True, sharey=True, layout="constrained")
    left.add_collection(LineCollection(_outline(before), colors="0.2", linewidths=1.4))
    left.triplot(before.points[:, 0], before.points[:, 2], before.regular_faces, color="0.85", linewidth=0.3)
    left.set_title("at rest")
    image = right.tripcolor(
        after.points[:, 0], after.points[:, 2], after.regular_faces, after["displacement"], shading="gouraud", cmap=COLOURS, vmin=0
    )
    right.add_collection(LineCollection(_outline(before), colors="0.5", linewidths=1.0, linestyles="--"))
    right.set_title(f"at {1e3 * _time(run, index):.0f} ms (dashed: rest)")
    for axes in (left, right):
        axes.set_aspect("equal")
        axes.set_xlabel("← front    x in mm    back →")
    left.set_ylabel("z in mm")
    left.autoscale_view()
    figure.colorbar(image, ax=[left, right], label="displacement in mm", shrink=0.8)
    figure.suptitle(_title(run))
    return _save(figure, run, "midsagittal")


def view3d(run: Run, index: int = -1) -> Path:
    """The deformed tongue from the front left, coloured by displacement, in its transparent rest shape."""
    rest, deformed = _grid(run, index)
    path = run.folder / "figures" / "view3d.png"
    path.parent.mkdir(exist_ok=True)
    plotter = pv.Plotter(off_screen=True, window_size=(1200, 900))
    try:
        plotter.set_background("white")
        plotter.add_mesh(
            _skin(deformed),
            scalars="displacement",
            cmap=COLOURS,
            smooth_shading=True,
            clim=(0.0, max(float(deformed["displacement"].max()), 1e-6)),
            scalar_bar_args={"title": "displacement in mm\n", "color": "black", "fmt": "%.1f", "n_labels": 5},
        )
        plotter.add_mesh(_skin(rest), color="gray", opacity=0.18, smooth_shading=True)
        plotter.add_text(f"{_title(run)}, {1e3 * _time(run, index):.0f} ms", font_size=11, color="black")
        plotter.view_vector((-1.2, -1.0, 0.55), viewup=(0, 0, 1))
        plotter.camera.zoom(1.35)
        plotter.screenshot(path)
    finally:
        plotter.close()
    return path


def _skin(grid: pv.UnstructuredGrid) -> pv.PolyData:
    return grid.extract_surface(algorithm="dataset_surface", nonlinear_subdivision=1)


def trajectories(run: Run) -> Path:
    """Paths of tip, dorsum and root in the mid-sagittal plane, and their displacement over time, as PNG and PDF."""
    names = [name for name in PROBES if name in run.probes] or list(run.probes)
    figure, (plane, over_time) = plt.subplots(1, 2, figsize=(10, 4.4), layout="constrained")
    for colour, name in zip(plt.rcParams["axes.prop_cycle"].by_key()["color"], names, strict=False):
        x, _, z = 1e3 * run.probes[name].T
        plane.plot(x, z, color=colour, label=name)
        plane.plot(x[-1], z[-1], "o", color=colour, markersize=5)
        over_time.plot(1e3 * run.time, x, color=colour, label=f"{name}, backward")
        over_time.plot(1e3 * run.time, z, "--", color=colour, label=f"{name}, upward")
    plane.plot(0, 0, "k+")
    plane.set(xlabel="← forward    displacement in mm    backward →", ylabel="upward in mm", title="paths from rest (+) to the end (•)")
    plane.set_aspect("equal", adjustable="datalim")
    over_time.set(xlabel="time in ms", ylabel="displacement in mm", title="over time")
    for axes in (plane, over_time):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    figure.suptitle(_title(run))
    return _save(figure, run, "trajectories")


def _time(run: Run, index: int) -> float:
    """Time in s of an output."""
    return float(run.output_times[index])


def _title(run: Run) -> str:
    muscles = sorted({name.split("_")[0] for name in run.summary.get("model", {}).get("sigma_max", {})})
    return f"{run.summary.get('name', run.folder.name)}: {', '.join(muscles) or 'no active muscle'}"


def _save(figure: plt.Figure, run: Run, name: str) -> Path:
    folder = run.folder / "figures"
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.png"
    figure.savefig(path, dpi=150)
    figure.savefig(path.with_suffix(".pdf"))
    plt.close(figure)
    return path
