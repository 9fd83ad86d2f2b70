# SPDX-License-Identifier: MIT
"""From the folders of a sweep to a reduced tongue, and how far one is from full runs."""

from __future__ import annotations

import time as clock
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from ..anatomy.catalogue import base_name
from ..core.errors import InputError
from ..core.types import Floats
from ..geometry.obstacles import Triangulated
from ..geometry.tetrahedron import boundary, volumes
from ..meshing.tongue_mesh import TongueMesh
from ..runs.inputs import MESH, SCENARIO
from ..runs.run import Run
from .basis import coordinates_of, mirror_of, modes_of
from .room import Room
from .tongue import ReducedTongue, inputs_of
from .training import Sequences, train

KEPT_BACK = 10
"""One run of so many is not learned from: by it the doubt is calibrated."""
ODD = 40
"""Shapes more that are odd, where sides of muscles move apart."""
ACTIVE = 0.05
"""A muscle that is more active is at work."""
CORNERS = np.array([[0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3], [4, 5, 6, 7], [5, 6, 7, 9], [4, 5, 7, 8], [5, 7, 8, 9]])
"""Eight straight tetrahedra of a quadratic one in VTK order."""


@dataclass(frozen=True)
class Errors:
    """How far a reduced run is from the full one, over all nodes and outputs; in mm where nothing else is said.

    Attributes
    ----------
    mean, p95, largest : float
        Of the distances of nodes.
    projection : float
        Their mean with the best coordinates.
    tip : float
        Mean distance of the tip.
    volume : float
        Largest change of volume in % of that at rest.
    penetration : float
        By how much it is deeper in an obstacle than the full one.
    doubt : float
        Its own guess of `mean`.
    movement : float
        Mean displacement of the nodes.
    """

    mean: float
    p95: float
    largest: float
    projection: float
    tip: float
    volume: float
    penetration: float
    doubt: float
    movement: float

    @classmethod
    def columns(cls) -> list[str]:
        """Their names."""
        return list(cls.__dataclass_fields__)

    def cells(self) -> list[str]:
        """Them as text."""
        return [f"{value:.3g}" for value in asdict(self).values()]


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


def sides_apart(run: Run) -> list[str]:
    """The muscles of which a run moves the sides apart."""
    relaxed = np.zeros(len(run.time))
    muscles = dict.fromkeys(base_name(name) for name in run.activation if name != base_name(name))
    sides = {muscle: [run.activation.get(muscle + side, relaxed) for side in ("_L", "_R")] for muscle in muscles}
    return [muscle for muscle, (left, right) in sides.items() if not np.array_equal(left, right)]


def inputs_in(run: Run, tongue: ReducedTongue) -> Floats:
    """What a reduced tongue sees, (n_t, n_inputs), at all steps of a run.

    Raises
    ------
    InputError
        If the run moves a muscle that the tongue does not have, or sides apart that it has together.
    """
    for name in sides_apart(run):
        if name not in tongue.sides:
            raise InputError(f"{run}: {name}_L and {name}_R do not go together, as the reduced tongue has them.")
    for name in run.activation:
        tongue.check(base_name(name))
    return tongue.inputs({name: np.zeros(len(run.time)) for name in tongue.muscles} | run.activation)


def displacement_of(run: Run) -> Floats:
    """Displacement (n_outputs, n_nodes, 3) in m at all outputs, in single precision."""
    return np.stack([run.field("displacement", i).astype(np.float32) for i in range(len(run.output_times))])


def rows_of_outputs(run: Run) -> np.ndarray:
    """Which steps of a run are its outputs."""
    return np.asarray(np.abs(run.time[:, None] - run.output_times).argmin(axis=0))


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
    if begin is not None and not np.allclose(begin.points, points, atol=1e-9):
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


def calibrate(tongue: ReducedTongue, runs: Sequence[Run]) -> list[Errors]:
    """Its errors in runs that it has not learned from, by which its doubt is from now on."""
    errors = [judge(tongue, run) for run in runs]
    factor = float(np.mean([error.mean for error in errors]) / max(np.mean([error.doubt for error in errors]), 1e-9))
    tongue.told["doubt"] = factor * tongue.told["doubt"]
    return [replace(error, doubt=factor * error.doubt) for error in errors]


def follow(tongue: ReducedTongue, run: Run) -> tuple[Floats, Floats]:
    """Coordinates (n_outputs, n_modes) and doubt (n_outputs,) in mm at the outputs of a run.

    Raises
    ------
    InputError
        If the run has another mesh, or moves the sides of a muscle apart.
    """
    if not np.allclose(run.mesh[0], tongue.points, atol=1e-9):
        raise InputError(f"{run}: has another mesh than the reduced tongue.")
    coordinates, doubt = tongue.sequence(run.time, inputs_in(run, tongue))
    rows = rows_of_outputs(run)
    return coordinates[rows], doubt[rows]


def judge(tongue: ReducedTongue, run: Run) -> Errors:
    """The errors of the reduced tongue against a full run."""
    coordinates, doubt = follow(tongue, run)
    full, reduced = displacement_of(run), tongue.displacement(coordinates)
    best = tongue.displacement(coordinates_of(full, tongue.modes))
    distance = 1e3 * np.linalg.norm(reduced - full, axis=2)
    tip = int(np.linalg.norm(tongue.points - run.rest["tip"], axis=1).argmin())
    rest = volume(tongue, np.zeros_like(tongue.points))
    return Errors(
        mean=float(distance.mean()),
        p95=float(np.percentile(distance, 95)),
        largest=float(distance.max()),
        projection=float(1e3 * np.linalg.norm(best - full, axis=2).mean()),
        tip=float(distance[:, tip].mean()),
        volume=float(100 * max(abs(volume(tongue, u) / rest - 1) for u in reduced)),
        penetration=float(1e3 * max(0.0, depth(tongue, run, reduced) - depth(tongue, run, full))),
        doubt=float(doubt.mean()),
        movement=float(1e3 * np.linalg.norm(full, axis=2).mean()),
    )


def by_activity(tongue: ReducedTongue, runs: Sequence[Run]) -> list[list[str]]:
    """Errors by how many muscles are at work, beyond `ACTIVE` in the mean of both sides: a table of the share of the outputs in %, and of
    the distances of nodes in mm their mean, 95th percentile and largest; names of columns first."""
    counts, distances = [], []
    for run in runs:
        means = inputs_in(run, tongue)[rows_of_outputs(run), : len(tongue.muscles)]
        counts.append((means > ACTIVE).sum(axis=1))
        distances.append(1e3 * np.linalg.norm(tongue.displacement(follow(tongue, run)[0]) - displacement_of(run), axis=2))
    count, distance = np.concatenate(counts), np.concatenate(distances)
    rows = [["muscles", "of the time", "mean", "p95", "largest"]]
    for n in np.unique(count):
        of = distance[count == n]
        numbers = [100 * len(of) / len(distance), of.mean(), np.percentile(of, 95), of.max()]
        rows.append([str(n), *(f"{number:.3g}" for number in numbers)])
    return rows


def times(tongue: ReducedTongue, run: Run) -> tuple[float, float]:
    """Seconds that the reduced tongue takes for a run, all nodes at its steps included, and that the full one took."""
    begin = clock.perf_counter()
    tongue.displacement(tongue.sequence(run.time, inputs_in(run, tongue))[0])
    return clock.perf_counter() - begin, float(run.summary["wall_seconds"])


def volume(tongue: ReducedTongue, displacement: Floats) -> float:
    """Volume in m³ of the tongue with a displacement (n_nodes, 3) in m, by eight straight tetrahedra for each cell."""
    return float(abs(volumes((tongue.points + displacement)[tongue.cells[:, CORNERS]].reshape(-1, 4, 3)).sum()))


def depth(tongue: ReducedTongue, run: Run, displacement: Floats) -> float:
    """How deep in m a node of the surface is in an obstacle of the run at most, of those that are not within it at rest."""
    deepest, (skin, _) = 0.0, boundary(tongue.cells)
    for name, surface in run.obstacles_at_rest.items():
        obstacle = Triangulated(surface)
        outside = skin[obstacle.evaluate(tongue.points[skin])[0] > 0]
        for i, u in enumerate(displacement):
            rotation, offset = run.pose(name, i)
            local = (tongue.points[outside] + u[outside] - offset) @ rotation
            deepest = max(deepest, -float(obstacle.evaluate(local)[0].min(initial=0.0)))
    return deepest
