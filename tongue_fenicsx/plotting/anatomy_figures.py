# SPDX-License-Identifier: MIT
"""Pictures of an anatomy: its muscles (the chapter's Figure 4.3) and the tongue among its bones (Figure 4.2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyvista as pv
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..anatomy.anatomy import Anatomy, Muscle
from ..anatomy.catalogue import CATALOGUE, base_name
from ..core.types import Floats
from ..geometry.polyline import arc_length
from .canvas import open_plotter

COLOURS = {
    "GGP": "#d62728", "GGH": "#8c1b1b", "GGM": "#ff7f0e", "GGA": "#f2c200", "SG": "#1f77b4", "HG": "#2ca02c", "IL": "#8c564b",
    "SL": "#e377c2", "VERT": "#17becf", "TRANS": "#9467bd", "GH": "#bcbd22", "MH": "#5f6f7f",
}  # fmt: skip
OTHER = "#999999"
LEFT, FRONT, OBLIQUE = (0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (-1.0, -0.9, 0.45)
SOFT = ("velum", "pharynx")
OUTSIDE = 10.0
"""In mm, how far out of the tongue fibres are drawn that come from far."""


def draw_muscles(anatomy: Anatomy, path: Path) -> Path:
    """All muscles from the left and from the front, as PNG: the fibres together, then region and fibres one by one."""
    names = list(dict.fromkeys(base_name(name) for name in anatomy.muscles))
    names.sort(key=lambda name: (list(CATALOGUE).index(name) if name in CATALOGUE else len(CATALOGUE), name))
    regions = _regions(anatomy, names)
    columns = 4
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(15, 7 + 2.3 * rows))
    grid = figure.add_gridspec(
        1 + rows, columns, height_ratios=[3.0] + [1] * rows, hspace=0.12, wspace=0.03, left=0.01, right=0.99, top=0.94, bottom=0.07
    )
    for view, place, title in ((LEFT, grid[0, :2], "from the left"), (FRONT, grid[0, 2:], "from the front")):
        axes = figure.add_subplot(place)
        axes.imshow(_together(anatomy, names, view))
        axes.set_title(title, fontsize=13)
        axes.set_axis_off()
    for index, name in enumerate(names):
        axes = figure.add_subplot(grid[1 + index // columns, index % columns])
        axes.imshow(np.hstack([_alone(anatomy, name, regions[name], view) for view in (LEFT, FRONT)]))
        axes.set_title(_label(name), fontsize=9)
        axes.set_axis_off()
    figure.legend(
        handles=[Patch(color=COLOURS.get(name, OTHER), label=_label(name)) for name in names], loc="lower center", ncols=4, frameon=False
    )
    figure.suptitle(f"{anatomy.name}: muscles", fontsize=15)
    figure.savefig(path, dpi=130)
    return path


def draw_surroundings(anatomy: Anatomy, path: Path) -> Path:
    """The tongue with palate, jaw, hyoid and pharynx: cut in the mid-sagittal plane, whole and from the front, as PNG."""
    figure = Figure(figsize=(16, 5.4), layout="constrained")
    for place, view, cut, title in zip(
        figure.subplots(1, 3),
        (LEFT, OBLIQUE, FRONT),
        (True, False, False),
        ("left half, cut in the mid-plane", "from the front left", "from the front"),
        strict=True,
    ):
        place.imshow(_scene(anatomy, view, cut))
        place.set_title(title)
        place.set_axis_off()
    figure.suptitle(f"{anatomy.name} among its bones", fontsize=14)
    figure.savefig(path, dpi=130)
    return path


def _label(name: str) -> str:
    facts = CATALOGUE.get(name)
    return f"{name}  {facts.full_name.replace('_', ' ')}" if facts else name


def _sides(anatomy: Anatomy, name: str) -> list[Muscle]:
    return [muscle for muscle in anatomy.muscles.values() if base_name(muscle.name) == name]


def _regions(anatomy: Anatomy, names: list[str], spacing: float = 1e-3) -> dict[str, pv.PolyData]:
    """The surfaces of the muscles' regions inside the tongue, both sides, in mm."""
    lower, upper = anatomy.surface.points.min(axis=0) - 2 * spacing, anatomy.surface.points.max(axis=0) + 2 * spacing
    grid = pv.ImageData(dimensions=np.ceil((upper - lower) / spacing).astype(int) + 1, spacing=(spacing,) * 3, origin=lower)
    tissue = anatomy.surface.contains(np.asarray(grid.points, dtype=float))
    points = np.asarray(grid.points, dtype=float)[tissue]
    surfaces = {}
    for name in names:
        inside = np.zeros(grid.n_points)
        inside[tissue] = np.any([muscle.region(points) for muscle in _sides(anatomy, name)], axis=0)
        grid["inside"] = inside
        surface = grid.gaussian_smooth(std_dev=0.8, scalars="inside").contour([0.5], scalars="inside")
        surfaces[name] = surface.scale(1e3, inplace=False)
    return surfaces


def _tongue(anatomy: Anatomy) -> pv.PolyData:
    return anatomy.surface.to_pyvista().scale(1e3, inplace=False).smooth_taubin(n_iter=20)


def _picture(plotter: pv.Plotter, seen: Floats, view: tuple[float, ...], margin: float) -> Floats:
    """What stands around points (n, 3) in mm, with a margin in mm."""
    plotter.enable_parallel_projection()
    plotter.view_vector(view, viewup=(0, 0, 1))
    plotter.camera.focal_point = (seen.min(axis=0) + seen.max(axis=0)) / 2 + np.array([0, 0, margin / 6])
    plotter.camera.parallel_scale = np.ptp(seen, axis=0).max() / 2 + margin
    plotter.enable_anti_aliasing("ssaa")
    return np.asarray(plotter.screenshot(return_img=True))


def _together(anatomy: Anatomy, names: list[str], view: tuple[float, ...]) -> Floats:
    with open_plotter(1100, 900) as plotter:
        plotter.add_mesh(_tongue(anatomy), color="#caa9a0", opacity=0.12, smooth_shading=True)
        for name in names:
            lines = [
                line for muscle in _sides(anatomy, name) if not muscle.name.endswith("_R") or view == FRONT for line in muscle.fibres.lines
            ]
            plotter.add_mesh(_tubes(anatomy, lines, 0.55), color=COLOURS.get(name, OTHER), smooth_shading=True)
        return _picture(plotter, _seen(anatomy), view, 2.0)


def _alone(anatomy: Anatomy, name: str, region: pv.PolyData, view: tuple[float, ...]) -> Floats:
    with open_plotter(520, 470) as plotter:
        plotter.add_mesh(_tongue(anatomy), color="#caa9a0", opacity=0.18, smooth_shading=True)
        colour = COLOURS.get(name, OTHER)
        if region.n_points:
            plotter.add_mesh(region, color=colour, opacity=0.45, smooth_shading=True)
        lines = [line for muscle in _sides(anatomy, name) for line in muscle.fibres.lines]
        plotter.add_mesh(_tubes(anatomy, lines, 0.4), color=colour)
        return _picture(plotter, _seen(anatomy), view, 1.0)


def _tubes(anatomy: Anatomy, lines: list[Floats], radius: float) -> pv.PolyData:
    """Fibres as tubes in mm."""
    pieces = [near for line in lines if len(near := _near(anatomy, line)) > 1]
    together = pv.MultiBlock([pv.lines_from_points(near) for near in pieces]).combine()
    return together.extract_surface(algorithm=None).tube(radius=radius, n_sides=8)


def _near(anatomy: Anatomy, line: Floats) -> Floats:
    """A fibre in mm, cut where it comes from far outside."""
    lower, upper = 1e3 * anatomy.surface.points.min(axis=0) - OUTSIDE, 1e3 * anatomy.surface.points.max(axis=0) + OUTSIDE
    points = 1e3 * _resample(line)
    return np.asarray(points[np.all((points > lower) & (points < upper), axis=1)])


def _seen(anatomy: Anatomy) -> Floats:
    """All that pictures of muscles show, as points (n, 3) in mm."""
    lines = [line for muscle in anatomy.muscles.values() for line in muscle.fibres.lines]
    return np.vstack([1e3 * anatomy.surface.points, *(_near(anatomy, line) for line in lines)])


def _resample(line: Floats) -> Floats:
    s = arc_length(line)
    at = np.linspace(0, s[-1], max(2, int(s[-1] / 1e-3)))
    return np.column_stack([np.interp(at, s, line[:, i]) for i in range(3)])


def _scene(anatomy: Anatomy, view: tuple[float, ...], cut: bool) -> Floats:
    with open_plotter(1000, 900) as plotter:

        def add(mesh: pv.PolyData, **options: object) -> None:
            if cut:  # solids are cut to solids, sheets to sheets
                plane = {"normal": "y", "origin": (0, 1e-3, 0)}
                mesh = mesh.clip(**plane, invert=False) if mesh.n_open_edges else mesh.clip_closed_surface(**plane)
            if mesh.n_cells:
                plotter.add_mesh(mesh, smooth_shading=True, split_sharp_edges=cut, ambient=0.3, **options)

        add(_tongue(anatomy), color="#d9827c")
        for name, bone in anatomy.bones.items():
            sheet = "palate" in name or any(word in name for word in SOFT)
            colour = "#c98d85" if any(word in name for word in SOFT) else "#f7f3e3" if "teeth" in name else "#d9c59b"
            opacity = 1.0 if cut or (view == OBLIQUE and not sheet) else 0.45
            add(bone.to_pyvista().scale(1e3, inplace=False), color=colour, opacity=opacity, culling=None if cut or sheet else "back")
        return _picture(plotter, 1e3 * anatomy.surface.points, view, 24.0)
