# SPDX-License-Identifier: MIT
"""Postures with and without gravity: the runs, their airways, and how they differ."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..analysis.airway import WALLS, Airways, Postures, airway
from ..core.errors import InputError
from ..core.parallel import on_rank_zero
from ..core.tables import markdown
from ..plotting.run_figures import PROBES
from ..scenario.schema import POSTURES as HEADS
from ..scenario.schema import Scenario
from . import single_muscle as solo
from .pool import Workers, all_done, perform

SETTINGS = ("none", *HEADS)
"""Gravity: off, of the upright head, of the supine one."""
FILES = ("postures.md", "postures.png", "postures.pdf")
"""What a comparison leaves beside the run folders."""


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


def move_each(cases: Mapping[str, Scenario], folder: Path, workers: Workers) -> Postures:
    """Run every posture in every setting, in folders of their names; finished runs of the same scenario are taken as they are.

    Raises
    ------
    InputError
        If a scenario does not fit its mesh.
    SolveError
        If a run fails; the others are done.
    """
    probes = {name: name for name in solo.LANDMARKS}
    runs = {}
    for name, case in cases.items():
        probed = case.model_copy(update={"probes": probes | (case.probes or {})})
        for setting in SETTINGS:
            runs[f"{name}/{setting}"] = with_gravity(probed, setting), {"posture": name, "gravity": setting}
    done = all_done(perform(folder, runs, workers))
    return {name: {setting: done[f"{name}/{setting}"] for setting in SETTINGS} for name in cases}


def airways(postures: Postures) -> Airways:
    """The airway of each run at rest and at the end, on every rank."""

    def measure() -> Airways:
        return {name: {setting: airway(run, (0, -1)) for setting, run in settings.items()} for name, settings in postures.items()}

    found: Airways = on_rank_zero(MPI.COMM_WORLD, measure)
    return found


def table(postures: Postures, passages: Airways) -> list[list[str]]:
    """The postures as printed, names of columns first: the displacement of the landmarks backward and upward at the
    end, by how much gravity moves any node at most, and how narrow the airway is where, all in mm."""
    head = ["posture", "gravity", *PROBES, "by gravity", "narrowest", "at", "x, z"]
    rows = [head]
    for name, settings in postures.items():
        alone = settings["none"].field("displacement")
        for setting, run in settings.items():
            ends = (1e3 * run.probes[probe][-1] for probe in PROBES)
            by_gravity = 1e3 * float(np.linalg.norm(run.field("displacement") - alone, axis=1).max())
            passage = passages[name][setting]
            at = passage.narrowest()
            x, z = passage.wall[at]
            place = f"{passage.distance[-1, at]:.1f}", str(passage.part[at]), f"{x:.0f}, {z:.0f}"
            rows.append([name, setting, *(f"{u[0]:+.1f}, {u[2]:+.1f}" for u in ends), f"{by_gravity:.1f}", *place])
    return rows


def write(postures: Postures, passages: Airways, folder: Path) -> None:
    """Write ``postures.md``."""
    head, *lines = table(postures, passages)
    (folder / "postures.md").write_text(markdown(head, lines), encoding="utf-8")
