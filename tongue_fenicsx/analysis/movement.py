# SPDX-License-Identifier: MIT
"""What a muscle does alone, as the numbers that the anatomical criteria are about."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.types import Floats
from ..runs.run import Run
from .tongue_grid import grids

if TYPE_CHECKING:
    import pyvista as pv

OFF_PLANE = 1e-4
"""In mm: sections lie this far off y = 0, where a mirrored mesh has its faces."""

Movement = dict[str, float]
Row = dict[str, str | float]


def single_muscle_row(name: str, run: Run) -> Row:
    """The numbers of one muscle at the end of its run: displacement of the landmarks backward (x) and upward (z), the mean rise of the
    edges, how much wider the oral part is (of the tissue above the root at rest, from its leftmost to its rightmost point), the largest
    displacement, and over the whole run peak Hencky strain and speed.
    """
    points, u = run.mesh[0], run.field("displacement")
    oral = points[:, 2] > run.rest["root"][2]
    y, moved = points[oral, 1], (points + u)[oral, 1]
    landmarks = {key: 1e3 * run.probes[key][-1] for key in ("tip", "dorsum", "root")}
    return {
        "muscle": name,
        "stress_kPa": 1e-3 * max(run.summary["model"]["sigma_max"].values()),
        **{f"{key}_{axis}_mm": float(v[i]) for key, v in landmarks.items() for axis, i in (("x", 0), ("z", 2))},
        "edges_z_mm": 1e3 * float(np.mean([run.probes[f"edge_{side}"][-1, 2] for side in ("left", "right")])),
        "width_mm": 1e3 * float(np.ptp(moved) - np.ptp(y)),
        "largest_mm": 1e3 * float(np.linalg.norm(u, axis=1).max()),
        "strain": run.summary["hencky_von_mises_max"],
        "speed_mm_s": 1e3 * run.summary["peak_speed_m_s"],
    }


def movement(run: Run) -> Movement:
    """The movement at the end of a run.

    Parameters
    ----------
    run : Run
        Of one muscle alone, with the five landmarks as probes.

    Returns
    -------
    dict
        In mm, x backward and z upward: the numbers of `single_muscle_row` without unit in their names; ``tip``, ``dorsum`` and ``root``,
        lengths of their displacements; those of `sections`; the peak ``strain``, the peak ``speed`` in cm/s, and the largest
        ``volume`` change in %.
    """
    numbers = {key.removesuffix("_mm"): float(value) for key, value in single_muscle_row("", run).items() if key.endswith("_mm")}
    rest, _ = grids(run)
    rest["u"] = 1e3 * run.field("displacement")
    return (
        numbers
        | {part: float(np.hypot(numbers[f"{part}_x"], numbers[f"{part}_z"])) for part in ("tip", "dorsum", "root")}
        | sections(rest, {name: 1e3 * point for name, point in run.rest.items()})
        | {
            "strain": run.summary["hencky_von_mises_max"],
            "speed": 1e2 * run.summary["peak_speed_m_s"],
            "volume": 100 * float(abs(run.volume_ratio - 1).max()),
        }
    )


def sections(rest: pv.DataSet, landmarks: dict[str, Floats]) -> Movement:
    """What the mid-sagittal section and two coronal ones do.

    Parameters
    ----------
    rest : pyvista.DataSet
        Volume cells at rest in mm, with the displacement ``u`` (n, 3) in mm at the points.
    landmarks : dict
        ``tip``, ``dorsum`` and ``root``, (3,) in mm.

    Returns
    -------
    dict
        In mm: ``front_z``, rise of the mid-line halfway from tip to dorsum; ``front_groove`` and ``dorsum_groove``, by how much
        the mid-line rises less than the edges in the section there and through the dorsum; ``sides_z``, rise of the edges in the latter;
        ``front_bulge`` and ``dorsum_bulge``, growth of the height of those points over the chords from tip to dorsum and from tip to
        root (below zero: more concave, flatter); ``lateral``, the largest \\|u_y\\| on the mid-plane.
    """
    tip, dorsum, root = (landmarks[name] for name in ("tip", "dorsum", "root"))
    plane = rest.slice(normal="y", origin=(0.0, OFF_PLANE, 0.0))
    front, u_front, edges_front = _coronal(rest, (tip[0] + dorsum[0]) / 2, root[2])
    top, u_top, edges_top = _coronal(rest, dorsum[0], root[2])
    u_tip, u_root = (_nearest(plane, point) for point in (tip, root))

    def bulge(start: Floats, middle: Floats, end: Floats) -> float:
        chord, along = (end - start)[[0, 2]], (middle - start)[[0, 2]]
        return float((chord[0] * along[1] - chord[1] * along[0]) / np.linalg.norm(chord))

    return {
        "front_z": float(u_front[2]),
        "sides_z": edges_top,
        "front_groove": edges_front - float(u_front[2]),
        "dorsum_groove": edges_top - float(u_top[2]),
        "front_bulge": bulge(tip + u_tip, front + u_front, top + u_top) - bulge(tip, front, top),
        "dorsum_bulge": bulge(tip + u_tip, top + u_top, root + u_root) - bulge(tip, top, root),
        "lateral": float(abs(plane["u"][:, 1]).max()),
    }


def _coronal(rest: pv.DataSet, x: float, above: float) -> tuple[Floats, Floats, float]:
    """Of the coronal section at `x`: the highest mid-line point and its displacement, (3,), and the mean rise of the leftmost and the
    rightmost point higher than `above`."""
    cut = rest.slice(normal="x", origin=(x, 0.0, 0.0))
    line = cut.slice(normal="y", origin=(0.0, OFF_PLANE, 0.0))
    highest = int(np.argmax(line.points[:, 2]))
    oral = np.flatnonzero(cut.points[:, 2] > above)
    edges = oral[[np.argmin(cut.points[oral, 1]), np.argmax(cut.points[oral, 1])]]
    return np.asarray(line.points[highest], dtype=float), np.asarray(line["u"][highest]), float(cut["u"][edges, 2].mean())


def _nearest(section: pv.PolyData, point: Floats) -> Floats:
    return np.asarray(section["u"][section.find_closest_point(point)])
