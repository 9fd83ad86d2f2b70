# SPDX-License-Identifier: MIT
"""The stage of movies and of the picture in 3D: a field on the moving tongue among its bones, in space or in the mid-sagittal plane."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import pyvista as pv
from matplotlib.artist import Artist
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..analysis.moments import field_at, obstacles_at, pose_at
from ..analysis.tongue_grid import cut, grids, mid_plane, outline, section, skin
from ..core.types import Floats
from ..geometry.surface import Surface
from ..runs.run import Run
from ..simulation import fields  # noqa: F401  registers units and labels
from ..simulation.quantities import FIELDS
from .canvas import BACKWARD, BONE, COLOURS, PATHS, curves, open_plotter, title_of

INCHES, DPI = (8.0, 4.5), 160
"""Of a picture of 1280 × 720 pixels."""
WIDTH, HEIGHT = 1110, 720
"""Of the view in space, at its left."""
VIEWS = {
    "side": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "front": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "top": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    "oblique": ((-1.2, -1.0, 0.55), (0.0, 0.0, 1.0)),
}
"""Where the eye is, and what points up."""
APART = 0.6
"""How far off the tongue bones are drawn in space, in mm."""
IN_UNITS = {"1": (1.0, ""), "m": (1e3, "mm"), "m/s": (1e2, "cm/s"), "Pa": (1e-3, "kPa")}
"""Unit of a field to factor and unit in pictures."""

Places = Mapping[str, tuple[Floats, Floats]]
"""Points by name: times in s and places in m."""
TRAIL = 0.15
"""In s: the way of a point so long ago is drawn."""
Show = Callable[[float], None]
"""Puts a picture to a time in s."""


def values_at(run: Run, field: str, t: float) -> Floats:
    """A stored field at a time in s as colours show it: of vectors the length, of tensors the von Mises measure √(3/2 s : s)."""
    values = _in_units(field)[0] * field_at(run, field, t)
    if values.ndim == 3:
        deviator = values - np.trace(values, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 3
        return np.asarray(np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))))
    return np.linalg.norm(values, axis=1) if values.ndim == 2 else values


def _registered(field: str) -> str | None:
    """The registered field that one is, or a part of."""
    return next((name for name in sorted(FIELDS, key=len, reverse=True) if f"{field}_".startswith(f"{name}_")), None)


def _in_units(field: str) -> tuple[float, str]:
    known = _registered(field)
    return (1.0, "") if known is None else IN_UNITS.get(FIELDS[known].unit, (1.0, FIELDS[known].unit))


def _label(field: str) -> str:
    known, unit = _registered(field), _in_units(field)[1]
    part = "" if known is None else field.removeprefix(known).strip("_")
    label = field if known is None else f"{FIELDS[known].label} {part}".strip()
    return f"{label} in {unit}" if unit else label


def _colours(field: str, values: Floats) -> ScalarMappable:
    """The colours of all values: from zero, or around 1 for the ratio of volumes."""
    low, high = np.percentile(values, [1, 99])
    if field == "jacobian":
        reach = max(high - 1, 1 - low, 1e-6)
        return ScalarMappable(Normalize(1 - reach, 1 + reach), "RdBu_r")
    if field == "displacement":
        high = values.max()
    return ScalarMappable(Normalize(0 if 0 <= low < high / 2 or low == high else low, max(high, low + 1e-6)), COLOURS)


def _apart(bone: Surface) -> pv.PolyData:
    """A bone in mm, drawn off the tongue: where it touches, the tongue is a little in it, and would come through it in blotches."""
    mesh = bone.to_pyvista().scale(1e3, inplace=False)
    normals = mesh.compute_normals(cell_normals=False, auto_orient_normals=False, consistent_normals=False, split_vertices=False)
    mesh.points -= APART * normals.point_data["Normals"]  # which point to where tissue may be
    return mesh


@dataclass(frozen=True)
class Scene:
    """What all pictures of a run share: the rest shape, colours, and the room that the tongue needs, in mm."""

    run: Run
    field: str
    rest: pv.UnstructuredGrid
    colours: ScalarMappable
    low: Floats
    high: Floats

    def at(self, t: float) -> pv.UnstructuredGrid:
        """The tongue at a time in s with ``value`` in its nodes or cells."""
        moved = self.rest.copy()
        moved.points = self.rest.points + 1e3 * field_at(self.run, "displacement", t)
        values = values_at(self.run, self.field, t)
        (moved.point_data if len(values) == moved.n_points else moved.cell_data)["value"] = values
        return moved

    @contextmanager
    def in_space(self, figure: Figure, view: str) -> Iterator[Show]:
        """The tongue in its transparent rest shape and among the obstacles, seen from one of `VIEWS`."""
        with open_plotter(WIDTH, HEIGHT) as plotter:
            smooth = {"smooth_shading": True, "show_scalar_bar": False, "reset_camera": False}
            plotter.add_mesh(skin(self.rest), color="gray", opacity=0.3, culling="front", **smooth)
            bones = {}
            for name, surface in self.run.obstacles_at_rest.items():
                bone = _apart(surface)
                bones[name] = plotter.add_mesh(bone, color=BONE, opacity=0.35, culling="front" if bone.n_open_edges else "back", **smooth)
            self._look(plotter, view)
            image = figure.figimage(np.full((HEIGHT, WIDTH, 3), 255, dtype=np.uint8))

            def show(t: float) -> None:
                mapped = {"cmap": self.colours.cmap, "clim": self.colours.get_clim()}
                plotter.add_mesh(skin(self.at(t)), scalars="value", name="tongue", ambient=0.25, render=False, **mapped, **smooth)
                for name, bone in bones.items():
                    rotation, offset = pose_at(self.run, name, t)
                    bone.user_matrix = np.block([[rotation, 1e3 * offset[:, None]], [np.zeros(3), 1.0]])
                plotter.reset_camera_clipping_range()
                plotter.render()
                image.set_data(plotter.screenshot(return_img=True))

            yield show

    def _look(self, plotter: pv.Plotter, view: str) -> None:
        """Turn the eye to the room of the tongue, in parallel projection, and up or down to the bones as far as there is room."""
        eye, up = map(np.array, VIEWS[view])
        toward = eye / np.linalg.norm(eye)
        across = np.cross(up, toward) / np.linalg.norm(np.cross(up, toward))
        corners = np.stack(np.meshgrid(*zip(self.low, self.high, strict=True)), axis=-1).reshape(-1, 3)
        upward = np.cross(toward, across)
        wide, tall = (np.ptp(corners @ axis) for axis in (across, upward))
        centre, away = (self.low + self.high) / 2, 10 * float(np.linalg.norm(self.high - self.low))
        half = 0.66 * max(tall, wide * HEIGHT / WIDTH)
        if bones := [1e3 * surface.points @ upward for surface in self.run.obstacles_at_rest.values()]:
            seen = np.concatenate(bones)
            aside, room = (seen.min() + seen.max()) / 2 - centre @ upward, half - tall / 2
            centre = centre + np.clip(aside, -room, room) * upward
        plotter.enable_parallel_projection()
        plotter.camera_position = (centre + away * toward, centre, up)
        plotter.camera.parallel_scale = half
        plotter.enable_anti_aliasing("msaa")

    @contextmanager
    def in_section(self, figure: Figure, beside: Places) -> Iterator[Show]:
        """The mid-sagittal section among the obstacles, the rest shape dashed; places that lie beside it are rings, with a line to the
        probe of the same name, a dot, and their way in the last `TRAIL`."""
        axes = figure.add_axes((0.08, 0.12, 0.77, 0.79))
        axes.add_collection(curves(outline(self.rest), colors="0.5", linewidths=1.0, linestyles="--"))
        (x, _, z), (x_end, _, z_end) = self.low, self.high
        axes.set(aspect="equal", xlim=(x - 12, x_end + 12), ylim=(z - 6, z_end + 12), xlabel=BACKWARD, ylabel="z in mm")
        drawn: list[Artist] = []

        def show(t: float) -> None:
            for artist in drawn:
                artist.remove()
            grid = self.at(t)
            now = section(grid)
            smooth = {"shading": "gouraud"} if "value" in now.point_data else {}
            places = now.points[:, 0], now.points[:, 2], now.regular_faces
            colours = axes.tripcolor(*places, now["value"], cmap=self.colours.cmap, norm=self.colours.norm, **smooth)
            lines = [curves(outline(grid), colors="0.2", linewidths=1.2)]
            lines += [curves(cut(bone, mid_plane(self.rest)), colors=BONE, linewidths=1.6) for bone in obstacles_at(self.run, t).values()]
            drawn[:] = [colours, *map(axes.add_collection, lines)]
            for colour, (name, (times, way)) in zip(cycle(PATHS), beside.items(), strict=False):
                behind = np.append(times[(times > t - TRAIL) & (times < t)], t)
                x, _, z = (1e3 * np.interp(behind, times, along) for along in way.T)
                drawn.extend(axes.plot(x, z, color=colour, linewidth=1))
                if name in self.run.probes:
                    u = [np.interp(t, self.run.time, along) for along in self.run.probes[name].T]
                    mine = 1e3 * (self.run.rest[name] + u)
                    drawn.extend(axes.plot([mine[0], x[-1]], [mine[2], z[-1]], color=colour, linewidth=2))
                    drawn.extend(axes.plot(mine[0], mine[2], "o", color=colour, markersize=5))
                drawn.extend(axes.plot(x[-1], z[-1], "o", color=colour, markersize=9, markerfacecolor="none", markeredgewidth=1.6))
                drawn.append(axes.annotate(name, (x[-1], z[-1]), xytext=(7, 7), textcoords="offset points", color=colour, fontsize=9))

        yield show


@contextmanager
def stage(run: Run, field: str, times: Floats, view: str | None, beside: Places | None = None) -> Iterator[tuple[Figure, Show]]:
    """A picture of a run with title, clock and colours, and what puts it to a time in s.

    Parameters
    ----------
    run : Run
        The run.
    field : str
        A stored field.
    times : (n,) array
        Times in s for which colours and room are enough.
    view : str or None
        One of `VIEWS`; None is the mid-sagittal section.
    beside : mapping, optional
        In the section: name to times (n,) in s and places (n, 3) in m of points that are drawn beside the tongue.
    """
    rest = grids(run, 0)[0]
    places = np.concatenate([rest.points, *(rest.points + 1e3 * field_at(run, "displacement", t) for t in times)])
    values = np.concatenate([values_at(run, field, t) for t in times])
    scene = Scene(run, field, rest, _colours(field, values), places.min(axis=0), places.max(axis=0))
    figure = Figure(figsize=INCHES, dpi=DPI)
    low, high = scene.colours.get_clim()
    beyond = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}
    extend = beyond[bool(values.min() < low), bool(values.max() > high)]
    bar = figure.colorbar(scene.colours, cax=figure.add_axes((0.885, 0.16, 0.018, 0.66)), extend=extend)
    bar.set_label(_label(field), fontsize=9)
    bar.ax.tick_params(labelsize=8)
    figure.text(0.02, 0.945, title_of(run), fontsize=11, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 2})
    clock = figure.text(0.885, 0.945, "", fontsize=11)
    with scene.in_space(figure, view) if view else scene.in_section(figure, beside or {}) as show:

        def show_all(t: float) -> None:
            show(t)
            clock.set_text(f"{1e3 * t:.0f} ms")

        yield figure, show_all
