# SPDX-License-Identifier: MIT
"""From the folders of a sweep to a reduced tongue."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from ..anatomy.catalogue import base_name
from ..core.errors import InputError
from ..meshing.tongue_mesh import TongueMesh
from ..runs.inputs import MESH, SCENARIO
from ..runs.run import Run
from .basis import coordinates_of, mirror_of, modes_of
from .judging import displacement_of, rows_of_outputs, sides_apart
from .room import Room
from .tongue import ReducedTongue, inputs_of
from .training import Sequences, train

KEPT_BACK = 10
"""One run of so many is not learned from: by it the doubt is calibrated."""
ODD = 40
"""Shapes more that are odd, where sides of muscles move apart."""


def runs_in(folders: Sequence[Path]) -> Iterator[Run]:
    """The finished runs in folders, each of a run or of a sweep.

    Raises
    ------
    InputError
        If a folder has none.
    """
    for folder in folders:
        found = [folder] if (folder / "history.h5").is_file() else sorted((folder / "runs").glob("*"))
        runs = [run for run in map(Run, found) if run.summary.get("status") == "done"]
        if not runs:
            raise InputError(f"{folder}: holds no finished run; the folder of a run or of a sweep is expected.")
        yield from runs


def learn(
    folders: Sequence[Path],
    n_modes: int,
    iterations: int,
    seed: int,
    mesh: str,
    begin: ReducedTongue | None = None,
    report: Callable[[str], object] = lambda line: None,
) -> tuple[ReducedTongue, list[Run]]:
    """A reduced tongue that learned from runs, and those that were kept back, for `calibrate`.

    Parameters
    ----------
    folders : sequence of Path
        Of runs and sweeps. Where they move sides of muscles apart the tongue does so too, with `ODD` of the shapes more, odd ones.
    n_modes, iterations, seed : int
        Shapes that are their own mirror image (on a mesh that is not, shapes), and see `train`.
    mesh : str
        Names the mesh of the runs.
    begin : ReducedTongue, optional
        Of the same mesh, in another tissue perhaps: from its memories the training begins.
    report : callable
        Is told how it goes.

    Raises
    ------
    InputError
        If there are fewer than two runs, they or `begin` are of different meshes, or they move sides apart on a mesh that is not its own
        mirror image.
    """
    runs = list(runs_in(folders))
    if len(runs) < 2:
        raise InputError(f"{folders[0]}: holds one finished run only; a sweep of tens of them is expected.")
    points, cells = runs[0].mesh
    for run in runs:
        if not np.array_equal(run.mesh[0], points):
            raise InputError(f"{run}: has another mesh than {runs[0]}; runs of one mesh are expected.")
    if begin is not None and not begin.fits(points):
        raise InputError(f"--begin: is of another mesh than {runs[0]}; a reduced tongue of the same mesh is expected.")
    muscles = list(dict.fromkeys(base_name(name) for run in runs for name in run.activation))
    found = {run: sides_apart(run) for run in runs}
    sides, mirror = [name for name in muscles if any(name in apart for apart in found.values())], mirror_of(points)
    if sides and mirror is None:
        raise InputError(
            f"{folders[0]}: moves the sides of {sides[0]} apart, and the mesh is not its own mirror image; sides together are expected."
        )
    back = runs[KEPT_BACK - 1 :: KEPT_BACK] or runs[-1:]
    learned = [run for run in runs if run not in back]
    moved = [displacement_of(run) for run in learned]
    report(f"{len(learned)} runs, {sum(map(len, moved))} states of {len(points)} nodes; {len(back)} runs kept back")
    modes = modes_of(moved, n_modes, mirror)
    if sides:
        modes = np.concatenate([modes, modes_of([u for run, u in zip(learned, moved, strict=True) if found[run]], ODD, mirror, -1)])
    odd, longest = len(modes) - n_modes, max(len(run.time) for run in learned)
    shape = len(learned), longest
    sequences = Sequences(
        np.full((len(learned), longest - 1), 5e-3),
        np.zeros((*shape, len(muscles) + len(sides))),
        np.zeros((*shape, len(modes))),
        np.zeros(shape, dtype=bool),
        len(sides),
        odd,
        modes[:, [int(np.linalg.norm(points - point, axis=1).argmin()) for point in runs[0].rest.values()]].reshape(len(modes), -1),
    )
    for i, (run, displacement) in enumerate(zip(learned, moved, strict=True)):
        n, rows = len(run.time), rows_of_outputs(run)
        sequences.h[i, : n - 1] = np.diff(run.time)
        sequences.inputs[i, :n] = inputs_of(dict.fromkeys(muscles, np.zeros(n)) | run.activation, muscles, sides)
        sequences.inputs[i, n:] = sequences.inputs[i, n - 1]
        sequences.coordinates[i, rows] = coordinates_of(displacement, modes)
        sequences.known[i, rows] = True
    weights = train(
        sequences,
        iterations=iterations,
        seed=seed,
        begin=None if begin is None else begin.weights_for(muscles, sides, modes),
        report=lambda i, error: report(f"iteration {i} of {iterations}: {error:.3f} mm"),
    )
    told = {
        "model": runs[0].summary["model"],
        "tissue": tomllib.loads(runs[0].store.read(SCENARIO).decode())["tissue"],
        "mesh": mesh,
        "contact": list(runs[0].contact),
        "runs": len(learned),
        "seeds": sorted({run.summary["record"]["seed"] for run in learned} - {None}),
        "training_seed": seed,
        "iterations": iterations,
        "rest": {name: list(point) for name, point in runs[0].rest.items()},
        "doubt": 1.0,
        "sides": sides,
        "odd": odd,
    }
    hyoid = TongueMesh.read(runs[0].folder / MESH).bones.get("hyoid")
    bones = runs[0].obstacles_at_rest | ({} if hyoid is None else {"hyoid": hyoid})
    room = Room.among([bones[name] for name in told["contact"]], points) if told["contact"] else None
    return ReducedTongue(points, cells, modes, weights, muscles, bones, told, room), back
