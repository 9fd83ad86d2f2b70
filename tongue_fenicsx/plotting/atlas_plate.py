# SPDX-License-Identifier: MIT
"""The plate of the atlas: every muscle alone, from above, from the front and obliquely, on one sheet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyvista as pv
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from numpy.typing import NDArray

from ..analysis.tongue_grid import cut, grids, mid_plane, outline, skin
from ..anatomy.catalogue import CATALOGUE
from ..core.types import Floats
from ..runs.run import Run
from .canvas import BONE, COLOURS, curves, open_plotter, save_both

VIEWS = {
    "from above": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    "from the front": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "from the front left": ((-1.0, -0.9, 0.5), (0.0, 0.0, 1.0)),
}
"""Where the eye is, and what points up."""
COLUMNS = len(VIEWS) + 2
PIXELS = 800
MUSCLE = "#f3c6c0"
Image = NDArray[np.uint8]


def draw_plate(runs: Mapping[str, Run], regions: Mapping[str, Floats], path: Path, title: str) -> list[Path]:
    """Draw the ends of the runs, coloured by displacement, each on a scale of its own, with the rest shape transparent; and from the side
    their mid-sagittal outlines among the bones, over the muscle.

    Parameters
    ----------
    runs : mapping
        Muscle to its run.
    regions : mapping
        Muscle to its tetrahedra (n, 4, 3) at rest in m.
    path : Path
        PNG file; a PDF lies beside it.
    title : str
        Over the sheet.
    """
    shapes = {name: grids(run) for name, run in runs.items()}
    everything = np.vstack([np.asarray(moved.points) for _, moved in shapes.values()])
    low, high = everything.min(axis=0), everything.max(axis=0)
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    images = {
        view: _crop([_picture(rest, moved, camera, centre, radius) for rest, moved in shapes.values()]) for view, camera in VIEWS.items()
    }
    blocks = 2 if len(runs) > 6 else 1
    rows = -(-len(runs) // blocks)
    widths = [stack[0].shape[1] for stack in images.values()]
    height = max(stack[0].shape[0] for stack in images.values())
    ratios = [*widths, 1.3 * max(widths), 0.3 * max(widths)] * blocks  # the last two for the side and the scale
    inch = 2.0 / max(widths)
    wide, tall = 0.3 + inch * sum(ratios), 1.2 + inch * rows * 1.13 * height
    figure = Figure(figsize=(wide, tall))
    borders = {"left": 0.01, "right": 0.995, "top": 1 - 1.05 / tall, "bottom": 0.01}
    grid = figure.add_gridspec(rows, len(ratios), width_ratios=ratios, wspace=0.02, hspace=0.13, **borders)
    for place, (name, (_, moved)) in enumerate(shapes.items()):
        block, line = divmod(place, rows)
        for column, stack in enumerate(images.values()):
            axes = figure.add_subplot(grid[line, COLUMNS * block + column])
            axes.imshow(stack[place], interpolation="antialiased")
            axes.set_axis_off()
            if column == 0:
                axes.set_title(_label(name), loc="left", fontsize=11, fontweight="bold")
        axes = figure.add_subplot(grid[line, COLUMNS * block + len(VIEWS)])
        _side(axes, runs[name], 1e3 * regions[name], *shapes[name])
        axes.set(xlim=(low[0] - 6, high[0] + 6), ylim=(low[2] - 4, high[2] + 10))
        _scale(figure, grid[line, COLUMNS * block + len(VIEWS) + 1], _most(moved))
        for column, view in enumerate([*VIEWS, "from the left, cut"] if line == 0 else []):
            spot = grid[0, COLUMNS * block + column].get_position(figure)
            figure.text((spot.x0 + spot.x1) / 2, 1 - 0.75 / tall, view, ha="center", fontsize=10, color="0.35")
    figure.suptitle(title, fontsize=14, y=1 - 0.1 / tall, va="top")
    note = "colour: total displacement in mm, each muscle on a scale of its own; transparent and dashed: at rest; red: the muscle"
    figure.text(0.5, 1 - 0.4 / tall, note, ha="center", va="top", fontsize=10)
    return save_both(figure, path, dpi=220)


def _side(axes: Axes, run: Run, region: Floats, rest: pv.UnstructuredGrid, moved: pv.UnstructuredGrid) -> None:
    """The outlines at rest and moved among the bones, over the tetrahedra (n, 4, 3) of a muscle at rest, lengths in mm."""
    sides = region[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]][..., [0, 2]].reshape(-1, 3, 2)
    axes.add_collection(PolyCollection(list(sides), facecolors=MUSCLE, edgecolors=MUSCLE, linewidths=0.3, rasterized=True))
    for surface in run.obstacles().values():
        axes.add_collection(curves(cut(surface, mid_plane(rest)), colors=BONE, linewidths=1.0))
    axes.add_collection(curves(outline(rest), colors="0.5", linewidths=0.8, linestyles="--"))
    axes.add_collection(curves(outline(moved), colors="0.15", linewidths=1.1))
    axes.set_aspect("equal")
    axes.set_axis_off()


def _most(moved: pv.UnstructuredGrid) -> float:
    """The largest displacement in mm, not quite zero."""
    return max(float(moved["displacement"].max()), 1e-6)


def _label(name: str) -> str:
    return f"{name}  {CATALOGUE[name].full_name.replace('_', ' ')}"


def _scale(figure: Figure, place: SubplotSpec, most: float) -> None:
    axes = figure.add_subplot(place)
    axes.set_axis_off()
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, most), COLOURS), cax=axes.inset_axes((0.05, 0.15, 0.22, 0.7)), ticks=[0, most / 2, most]
    )
    bar.ax.set_yticklabels(["0", f"{most / 2:.1f}", f"{most:.1f}"], fontsize=8)


def _picture(
    rest: pv.UnstructuredGrid,
    moved: pv.UnstructuredGrid,
    camera: tuple[tuple[float, ...], tuple[float, ...]],
    centre: Floats,
    radius: float,
) -> Image:
    """One view, in parallel projection on white."""
    with open_plotter(PIXELS, PIXELS) as plotter:
        smooth = {"smooth_shading": True, "show_scalar_bar": False}
        plotter.enable_parallel_projection()
        plotter.add_mesh(skin(moved), scalars="displacement", cmap=COLOURS, clim=(0.0, _most(moved)), ambient=0.25, **smooth)
        plotter.add_mesh(skin(rest), color="gray", opacity=0.3, culling="front", **smooth)
        plotter.view_vector(camera[0], viewup=camera[1])
        plotter.camera.focal_point = centre
        plotter.camera.position = centre + 10 * radius * np.array(camera[0])
        plotter.camera.parallel_scale = radius
        plotter.reset_camera_clipping_range()
        plotter.enable_anti_aliasing("ssaa")
        return np.asarray(plotter.screenshot(return_img=True))


def _crop(images: list[Image], margin: int = 6) -> list[Image]:
    """Images cut to what is not white in any of them."""
    drawn = np.any([(image < 250).any(axis=2) for image in images], axis=0)
    (top, bottom), (left, right) = (np.flatnonzero(drawn.any(axis=axis))[[0, -1]] for axis in (1, 0))
    return [image[max(top - margin, 0) : bottom + margin, max(left - margin, 0) : right + margin] for image in images]
