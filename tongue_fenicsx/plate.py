# SPDX-License-Identifier: MIT
"""The plate of the atlas: every muscle alone, from above, from the front and obliquely, on one sheet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pyvista as pv
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from .fibres import Floats
from .figures import COLOURS
from .grids import grids, skin
from .muscles import CATALOGUE
from .results import Run

VIEWS = {
    "from above": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    "from the front": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "from the front left": ((-1.0, -0.9, 0.5), (0.0, 0.0, 1.0)),
}
"""Where the eye is, and what points up."""
PIXELS = 800
Image = NDArray[np.uint8]


def plate(runs: Mapping[str, Run], path: Path, title: str) -> list[Path]:
    """Draw the ends of the runs, coloured by displacement on one scale, with the rest shape transparent.

    Parameters
    ----------
    runs : mapping
        Muscle to its run.
    path : Path
        PNG file; a PDF lies beside it.
    title : str
        Over the sheet.
    """
    shapes = {name: grids(run) for name, run in runs.items()}
    most = max(max(float(moved["displacement"].max()) for _, moved in shapes.values()), 1e-6)
    everything = np.vstack([np.asarray(moved.points) for _, moved in shapes.values()])
    low, high = everything.min(axis=0), everything.max(axis=0)
    images = {
        view: _cropped(
            [
                _picture(rest, moved, camera, (low + high) / 2, float(np.linalg.norm(high - low)) / 2, most)
                for rest, moved in shapes.values()
            ]
        )
        for view, camera in VIEWS.items()
    }
    blocks = 2 if len(runs) > 6 else 1
    rows = -(-(len(runs) + 1) // blocks)  # one place for the scale
    widths = [stack[0].shape[1] for stack in images.values()]
    height = max(stack[0].shape[0] for stack in images.values())
    gap = 0.12 * max(widths)
    inch = 2.0 / max(widths)
    wide, tall = 0.3 + inch * blocks * (sum(widths) + gap), 1.0 + inch * rows * 1.13 * height
    figure = plt.figure(figsize=(wide, tall))
    ratios = ([*widths, gap] * blocks)[:-1]
    borders = {"left": 0.01, "right": 0.99, "top": 1 - 0.85 / tall, "bottom": 0.01}
    grid = figure.add_gridspec(rows, len(ratios), width_ratios=ratios, wspace=0.02, hspace=0.13, **borders)
    for place, (name, (_, moved)) in enumerate(shapes.items()):
        block, line = divmod(place, rows)
        for column, (view, stack) in enumerate(images.items()):
            axes = figure.add_subplot(grid[line, 4 * block + column])
            axes.imshow(stack[place], interpolation="antialiased")
            axes.set_axis_off()
            if line == 0:
                spot = grid[0, 4 * block + column].get_position(figure)
                figure.text((spot.x0 + spot.x1) / 2, 1 - 0.5 / tall, view, ha="center", fontsize=10, color="0.35")
            if column == 0:
                axes.set_title(_label(name), loc="left", fontsize=11, fontweight="bold")
            if column == 2:
                axes.set_title(f"up to {moved['displacement'].max():.1f} mm", loc="right", fontsize=10)
    _scale(figure, figure.add_subplot(grid[-1, 4 * blocks - 4 :]), most)
    figure.suptitle(title, fontsize=14, y=1 - 0.12 / tall, va="top")
    paths = [path, path.with_suffix(".pdf")]
    for target in paths:
        figure.savefig(target, dpi=220)
    plt.close(figure)
    return paths


def _label(name: str) -> str:
    return f"{name}  {CATALOGUE[name].full_name.replace('_', ' ')}"


def _scale(figure: plt.Figure, axes: plt.Axes, most: float) -> None:
    axes.set_axis_off()
    inner = axes.inset_axes((0.06, 0.5, 0.88, 0.12))
    figure.colorbar(ScalarMappable(Normalize(0, most), COLOURS), cax=inner, orientation="horizontal").set_label(
        "total displacement in mm, one scale for all muscles; transparent: at rest", fontsize=10
    )


def _picture(
    rest: pv.UnstructuredGrid,
    moved: pv.UnstructuredGrid,
    camera: tuple[tuple[float, ...], tuple[float, ...]],
    centre: Floats,
    radius: float,
    most: float,
) -> Image:
    """One view, in parallel projection on white."""
    plotter = pv.Plotter(off_screen=True, window_size=(PIXELS, PIXELS))
    try:
        smooth = {"smooth_shading": True, "show_scalar_bar": False}
        plotter.set_background("white")
        plotter.enable_parallel_projection()
        plotter.add_mesh(skin(moved), scalars="displacement", cmap=COLOURS, clim=(0.0, most), ambient=0.25, **smooth)
        plotter.add_mesh(skin(rest), color="gray", opacity=0.3, culling="front", **smooth)
        plotter.view_vector(camera[0], viewup=camera[1])
        plotter.camera.focal_point = centre
        plotter.camera.position = centre + 10 * radius * np.array(camera[0])
        plotter.camera.parallel_scale = radius
        plotter.reset_camera_clipping_range()
        plotter.enable_anti_aliasing("ssaa")
        return np.asarray(plotter.screenshot(return_img=True))
    finally:
        plotter.close()


def _cropped(images: list[Image], margin: int = 6) -> list[Image]:
    """Images cut to what is not white in any of them."""
    drawn = np.any([(image < 250).any(axis=2) for image in images], axis=0)
    (top, bottom), (left, right) = (np.flatnonzero(drawn.any(axis=axis))[[0, -1]] for axis in (1, 0))
    return [image[max(top - margin, 0) : bottom + margin, max(left - margin, 0) : right + margin] for image in images]
