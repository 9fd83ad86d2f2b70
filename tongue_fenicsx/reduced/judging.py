# SPDX-License-Identifier: MIT
"""How far a reduced tongue is from full runs."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from ..anatomy.catalogue import base_name
from ..core.errors import InputError
from ..core.types import Floats
from ..geometry.obstacles import Triangulated
from ..geometry.tetrahedron import boundary, volumes
from ..runs.run import Run
from .basis import coordinates_of
from .tongue import ReducedTongue

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
    for name, course in run.activation.items():
        if course.any():
            tongue.check(base_name(name))
    return tongue.inputs({name: np.zeros(len(run.time)) for name in tongue.muscles} | run.activation)


def displacement_of(run: Run) -> Floats:
    """Displacement (n_outputs, n_nodes, 3) in m at all outputs, in single precision."""
    return np.stack([run.field("displacement", i).astype(np.float32) for i in range(len(run.output_times))])


def rows_of_outputs(run: Run) -> np.ndarray:
    """Which steps of a run are its outputs."""
    return np.asarray(np.abs(run.time[:, None] - run.output_times).argmin(axis=0))


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
    if not tongue.fits(run.mesh[0]):
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
