# SPDX-License-Identifier: MIT
"""Postures with and without gravity: the runs, how they differ, and one sheet with the airway of each."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from mpi4py import MPI

from . import meshing
from .airway import WALLS, airway
from .assemble import anatomy_of, size_of
from .errors import InputError
from .fibres import Floats
from .figures import BONE, PATHS, PROBES, name_parts
from .grids import cut, grids, outline, section
from .run import Run
from .scenario import POSTURES as HEADS
from .scenario import MeshSection, Scenario
from .simulation import Report
from .solo import moved
from .tables import markdown
from .tonguemesh import on_rank_zero

SETTINGS = ("none", *HEADS)
"""Gravity: off, of the upright head, of the supine one."""
FILES = ("postures.md", "postures.png", "postures.pdf")
"""What a comparison leaves beside the run folders."""

Postures = Mapping[str, Mapping[str, Run]]
"""Name and setting to the run."""


def with_gravity(case: Scenario, setting: str) -> Scenario:
    """A scenario in one of the `SETTINGS`, whatever its own gravity is; it rises as before."""
    gravity = {"rise": case.gravity.rise} | ({} if setting == "none" else {"posture": setting})
    return Scenario.model_validate(case.model_dump(exclude={"gravity"}, exclude_none=True) | {"gravity": gravity})


def check(path: Path, case: Scenario) -> None:
    """Make sure that a scenario has an airway.

    Raises
    ------
    InputError
        If it has no contact with one of its walls.
    """
    if not case.contact.keys() & set(WALLS):
        raise InputError(f"{path}: contact: none with a wall of the airway; [contact.NAME] with one of {', '.join(WALLS)} is expected.")


def runs(cases: Mapping[str, Scenario], folder: Path, say: Callable[[str], None], report: Report | None = None) -> Postures:
    """Run every posture in every setting, in folders of their names; finished runs of the same scenario are taken as they are.

    Raises
    ------
    InputError
        If a scenario does not fit its mesh.
    SolveError
        If a run fails.
    """
    found: dict[str, dict[str, Run]] = {}
    meshes: dict[str, MeshSection] = {}
    for name, case in cases.items():
        source = case.in_metres().mesh
        mesh = meshes.setdefault(repr(source), source if source.file else _built(source, folder))
        for setting in SETTINGS:
            on_mesh = with_gravity(case.in_metres(), setting).model_copy(update={"mesh": mesh})
            run, how = moved(on_mesh, folder / name / setting, report)
            found.setdefault(name, {})[setting] = run
            say(f"{name}, gravity {setting}: {how}")
    return found


def _built(source: MeshSection, folder: Path) -> MeshSection:
    """The file that a mesh section is built to, once for all postures."""
    path = folder / f"mesh-{hashlib.sha256(repr(source).encode()).hexdigest()[:8]}.msh"
    on_rank_zero(MPI.COMM_WORLD, lambda: path.is_file() or meshing.build(anatomy_of(source), path, size_of(source)))
    return MeshSection(file=str(path))


def written(postures: Postures, folder: Path) -> list[list[str]]:
    """Write ``postures.md``; return it as a table, names of columns first: the displacement of the landmarks backward and upward at the
    end, by how much gravity moves any node at most, and how narrow the airway is where, all in mm."""
    head = ["posture", "gravity", *PROBES, "by gravity", "narrowest", "at", "x, z"]
    table = [head]
    for name, settings in postures.items():
        alone = settings["none"].field("displacement")
        for setting, run in settings.items():
            ends = (1e3 * run.probes[probe][-1] for probe in PROBES)
            by_gravity = 1e3 * float(np.linalg.norm(run.field("displacement") - alone, axis=1).max())
            passage = airway(run)
            at = passage.narrowest()
            x, z = passage.wall[at]
            place = f"{passage.distance[-1, at]:.1f}", str(passage.part[at]), f"{x:.0f}, {z:.0f}"
            table.append([name, setting, *(f"{u[0]:+.1f}, {u[2]:+.1f}" for u in ends), f"{by_gravity:.1f}", *place])
    (folder / "postures.md").write_text(markdown(table[0], table[1:]), encoding="utf-8")
    return table


def sheet(postures: Postures, path: Path) -> list[Path]:
    """Draw each posture in a row, its settings in colours: the mid-sagittal section and the distance to the walls of the airway.

    Parameters
    ----------
    postures : mapping
        Of `runs`.
    path : Path
        PNG file; a PDF lies beside it.
    """
    figure, rows = plt.subplots(
        len(postures), 2, figsize=(11, 3.7 * len(postures)), squeeze=False, layout="constrained", width_ratios=[1, 1.4]
    )
    for (name, settings), (plane, curve) in zip(postures.items(), rows, strict=True):
        first = settings["none"]
        rest = outline(section(grids(first, 0)[0]))
        plane.add_collection(LineCollection(rest, colors="0.6", linewidths=1.0, linestyles="--"))
        for surface in first.obstacles_at_rest.values():
            plane.add_collection(LineCollection(cut(surface), colors=BONE, linewidths=1.6))
        passage = airway(first)
        curve.plot(passage.along, passage.distance[0], "--", color="0.6", label="at rest")
        contours = [rest]
        for colour, (setting, run) in zip(("0.1", *PATHS), settings.items(), strict=False):
            contours.append(outline(section(grids(run)[1])))
            plane.add_collection(LineCollection(contours[-1], colors=colour, linewidths=1.3))
            curve.plot(passage.along, airway(run).distance[-1], color=colour, label=f"gravity {setting}")
        name_parts(curve, passage)
        low, high = _box(contours)
        plane.set(aspect="equal", xlim=(low[0] - 10, high[0] + 10), ylim=(low[1] - 4, high[1] + 12), ylabel="z in mm")
        plane.set_title(name, loc="left", fontweight="bold")
        curve.set(ylabel="distance to the tongue in mm", ylim=(0, None))
        curve.grid(alpha=0.3)
        curve.legend(fontsize=8)
    rows[-1, 0].set_xlabel("← front    x in mm    back →")
    rows[-1, 1].set_xlabel("along the wall, front to back, in mm")
    paths = [path, path.with_suffix(".pdf")]
    for target in paths:
        figure.savefig(target, dpi=150)
    plt.close(figure)
    return paths


def _box(contours: list[Floats]) -> tuple[Floats, Floats]:
    points = np.concatenate(contours).reshape(-1, 2)
    return points.min(axis=0), points.max(axis=0)
