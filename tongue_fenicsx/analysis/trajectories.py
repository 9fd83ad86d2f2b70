# SPDX-License-Identifier: MIT
"""How points move: the speed along their paths and how the paths bend (the chapter's section 4.5.4)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from ..core.types import Floats
from .tables import Table

if TYPE_CHECKING:
    from ..runs.run import Run

SLOW = 1e-2
"""Speed in m/s below which a path is not said to bend: a point that rests or turns back has no direction."""


def speed(time: Floats, path: Floats) -> Floats:
    """Tangential speed in m/s, (n,), of a point at `path` (n, 3) in m: of the parabola through three successive times (n,) in s."""
    if len(time) < 3:
        return np.full(len(time), np.nan)
    return np.asarray(np.linalg.norm(np.gradient(path, time, axis=0, edge_order=2), axis=1))


def curvature(path: Floats) -> Floats:
    """Curvature in 1/m, (n,), of a `path` (n, 3) in m: of the circle through three successive places (Menger 1930); NaN at the ends and
    where two of the three coincide."""
    before, here, after = path[:-2], path[1:-1], path[2:]
    area = np.linalg.norm(np.cross(here - before, after - here), axis=1)
    sides = np.prod([np.linalg.norm(b - a, axis=1) for a, b in ((before, here), (here, after), (before, after))], axis=0)
    bend = np.full(len(path), np.nan)
    np.divide(2 * area, sides, out=bend[1:-1], where=sides > 0)
    return bend


def motion(time: Floats, path: Floats) -> tuple[Floats, Floats]:
    """Speed in m/s and curvature in 1/m, (n,), of a point at `path` (n, 3) in m; the curvature is NaN where it is slower than `SLOW`."""
    fast = speed(time, path)
    return fast, np.where(fast > SLOW, curvature(path), np.nan)


def read_places(path: Path) -> dict[str, tuple[Floats, Floats]]:
    """Places of points over time in a table as `write_trajectories` writes one: name to times (n,) in s and places (n, 3) in m.

    Raises
    ------
    InputError
        If the file has no times or no point, or a place that is no number.
    """
    table = Table.read(path)
    names = [column.removesuffix("_x_m") for column in table.columns if column.endswith("_x_m")]
    points = {name: (table.numbers("time_s"), np.column_stack([table.numbers(f"{name}_{axis}_m") for axis in "xyz"])) for name in names}
    if not points or not all(np.isfinite(numbers).all() for point in points.values() for numbers in point):
        raise InputError(
            f"{path}: time_s and NAME_x_m, NAME_y_m, NAME_z_m with a number in each line are expected, as trajectories.csv has."
        )
    return points


def write_trajectories(run: Run, path: Path) -> None:
    """Write a CSV table: time in s, then of each probe place in m, speed in m/s and curvature in 1/m (empty where there is none)."""
    columns = {"time_s": run.time}
    for name, displacement in run.probes.items():
        place = run.rest[name] + displacement
        fast, bend = motion(run.time, place)
        columns |= _columns(name, place) | {f"{name}_speed_m_s": fast, f"{name}_curvature_1_m": bend}
    _write(columns, path)


def write_places(points: Mapping[str, tuple[Floats, Floats]], path: Path) -> None:
    """Write a CSV table of places (n, 3) in m of points, each at its times (n,) in s; between these they go straight."""
    times = np.unique(np.concatenate([times for times, _ in points.values()]))
    columns = {"time_s": times}
    for name, (known, places) in points.items():
        columns |= _columns(name, np.column_stack([np.interp(times, known, along) for along in places.T]))
    _write(columns, path)


def _columns(name: str, places: Floats) -> dict[str, Floats]:
    return {f"{name}_{axis}_m": x for axis, x in zip("xyz", places.T, strict=True)}


def _write(columns: Mapping[str, Floats], path: Path) -> None:
    rows = ([f"{number:.6g}" if np.isfinite(number) else "" for number in row] for row in np.column_stack(list(columns.values())))
    path.write_text("\n".join(map(",".join, [list(columns), *rows])) + "\n", encoding="utf-8")
