# SPDX-License-Identifier: MIT
"""What a movement is to do: goals for points, for the mid-sagittal outline and for the palate, each a squared distance with derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
import pyvista as pv
from dolfinx.mesh import entities_to_geometry, exterior_facet_indices
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from ..analysis.airway import feet
from ..core.errors import InputError
from ..core.types import Floats, Ints
from ..geometry.tetrahedron import QUARTERS, mid_edges
from ..meshing.tongue_mesh import TongueMesh

QUARTER = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Of a turn of vectors (n, 2) in rows, from x to z."""
Pull = Mapping[str, Floats]
"""Probe to a derivative (3,) by its displacement, in mm²/m."""


class Goal(Protocol):
    """Something that probes should do."""

    @property
    def points(self) -> Mapping[str, Floats]:
        """Probes that it needs beside those of the simulation: name to point (3,) of the rest shape in m."""
        ...

    def __call__(self, t: float, probes: Mapping[str, Floats]) -> tuple[float, Pull]:
        """Of a time in s and the displacements (3,) in m of probes: the squared distance from the goal in mm², and its derivatives."""
        ...


class _OfProbe:
    """A goal of a probe that the simulation follows."""

    @property
    def points(self) -> Mapping[str, Floats]:
        """As of `Goal`."""
        return {}


@dataclass(frozen=True)
class Track(_OfProbe):
    """Where a probe should be over time.

    Attributes
    ----------
    times : (n,) array
        In s, growing; before and after, the first and the last displacement count.
    displacement : (n, 3) array
        In m, from rest.
    probe : str
        Which probe.
    """

    times: Floats
    displacement: Floats
    probe: str

    def __post_init__(self) -> None:
        times, displacement = np.asarray(self.times, dtype=float), np.asarray(self.displacement, dtype=float)
        if times.ndim != 1 or displacement.shape != (len(times), 3):
            raise InputError(f"fit: a path of shape {displacement.shape} at {times.shape} times; (n, 3) at (n,) times are expected.")
        if len(back := np.flatnonzero(np.diff(times) <= 0)):
            raise InputError(f"fit: {times[back[0] + 1]:g} s follows {times[back[0]]:g} s; growing times are expected.")
        if not (np.isfinite(times).all() and np.isfinite(displacement).all()):
            raise InputError("fit: a path with numbers that are not finite; take them out, the path is straight between the others.")

    def at(self, t: float) -> Floats:
        """Displacement (3,) in m at a time in s."""
        return np.array([np.interp(t, self.times, along) for along in np.transpose(self.displacement)])

    def __call__(self, t: float, probes: Mapping[str, Floats]) -> tuple[float, Pull]:
        """As of `Goal`."""
        away = 1e3 * (probes[self.probe] - self.at(t))
        return float(away @ away), {self.probe: 2e3 * away}


@dataclass(frozen=True)
class Within(_OfProbe):
    """Bounds (3,) in mm for the displacement of a probe."""

    probe: str
    low: Floats
    high: Floats

    def __call__(self, t: float, probes: Mapping[str, Floats]) -> tuple[float, Pull]:
        """As of `Goal`."""
        u = 1e3 * probes[self.probe]
        beyond = u - np.clip(u, self.low, self.high)
        return float(beyond @ beyond), {self.probe: 2e3 * beyond}


def by_place(points: Floats) -> dict[str, Floats]:
    """Points (n, 3) of the rest shape in m by names that say where they are, in µm: goals of one simulation may share them."""
    return {f"at {x:.0f} {y:.0f} {z:.0f}": point for point, (x, y, z) in zip(points, 1e6 * points, strict=True)}


@dataclass(frozen=True)
class Outline:
    """The mid-sagittal outline of a tongue: points (n, 3) at rest in m, and which of them are the ends of its pieces (m, 2)."""

    points: Floats
    pieces: Ints

    @cached_property
    def probes(self) -> dict[str, Floats]:
        """Its points by the names of their probes."""
        return by_place(self.points)

    @cached_property
    def _names(self) -> list[str]:
        return list(self.probes)

    def nearest(self, places: Floats, probes: Mapping[str, Floats]) -> tuple[Floats, Ints, Floats, Floats]:
        """The distance (n,) in mm of places (n, 2), x and z in mm, from the outline as it is displaced; of each the ends (n, 2) of the
        nearest piece, where on it that is (n,), and the unit vectors (n, 2) toward there."""
        now = 1e3 * (self.points + np.array([probes[name] for name in self.probes]))[:, [0, 2]]
        distance, which, share = feet(places, now[self.pieces])
        ends = self.pieces[which]
        foot = now[ends[:, 0]] + share[:, None] * (now[ends[:, 1]] - now[ends[:, 0]])
        return distance, ends, share, (foot - places) / np.maximum(distance, 1e-9)[:, None]

    def pull(self, ends: Ints, share: float, along: Floats) -> dict[str, Floats]:
        """The derivative by its probes of what changes by `along` (2,) with a place on a piece."""
        both = np.array([along[0], 0.0, along[1]])
        return {self._names[ends[0]]: (1 - share) * both, self._names[ends[1]]: share * both}


def _add(total: dict[str, Floats], more: Pull) -> None:
    for name, value in more.items():
        total[name] = total.get(name, 0.0) + value


@dataclass(frozen=True)
class _OfOutline:
    """A goal of the outline of a tongue."""

    outline: Outline

    @property
    def points(self) -> Mapping[str, Floats]:
        """As of `Goal`."""
        return self.outline.probes


@dataclass(frozen=True)
class Constriction(_OfOutline):
    """How far the nearest of some places of a wall is from the outline.

    Attributes
    ----------
    outline : Outline
        Of the tongue.
    wall : (n, 2) array
        Places x, z in mm.
    degree : (float, float)
        Least and greatest distance in mm.
    """

    wall: Floats
    degree: tuple[float, float]

    def __call__(self, t: float, probes: Mapping[str, Floats]) -> tuple[float, Pull]:
        """As of `Goal`."""
        d, ends, share, toward = self.outline.nearest(self.wall, probes)
        i = int(d.argmin())
        beyond = d[i] - np.clip(d[i], *self.degree)
        return float(beyond**2), self.outline.pull(ends[i], share[i], 2e3 * beyond * toward[i])


@dataclass(frozen=True)
class Contour(_OfOutline):
    """Places (n, 2), x and z in mm, through which the outline should go: their mean square distance from it.

    Attributes
    ----------
    outline : Outline
        Of the tongue.
    places : (n, 2) array
        In mm.
    free : bool
        All places may be turned and shifted together to where they are nearest, as of a picture in which the head had moved.
    """

    places: Floats
    free: bool = False

    def laid(self, probes: Mapping[str, Floats]) -> Floats:
        """The places (n, 2) in mm, where they count; those that are `free` where their square distances are least (Levenberg–Marquardt)."""
        if not self.free:
            return self.places
        middle = self.places.mean(axis=0)

        def moved(pose: Floats) -> tuple[Floats, Floats]:  # by a shift in mm and a turn, and the arms from the middle
            c, s = np.cos(pose[2]), np.sin(pose[2])
            arm = (self.places - middle) @ np.array([[c, s], [-s, c]])
            return middle + pose[:2] + arm, arm

        def distance(pose: Floats) -> Floats:
            return self.outline.nearest(moved(pose)[0], probes)[0]

        def slopes(pose: Floats) -> Floats:
            places, arm = moved(pose)
            toward = self.outline.nearest(places, probes)[3]
            return -np.column_stack([toward, (toward * (arm @ QUARTER)).sum(axis=1)])

        return moved(least_squares(distance, np.zeros(3), slopes, method="lm", x_scale=(1.0, 1.0, 0.05)).x)[0]

    def __call__(self, t: float, probes: Mapping[str, Floats]) -> tuple[float, Pull]:
        """As of `Goal`."""
        d, ends, share, toward = self.outline.nearest(self.laid(probes), probes)
        total: dict[str, Floats] = {}
        for i in range(len(d)):
            _add(total, self.outline.pull(ends[i], share[i], 2e3 * d[i] / len(d) * toward[i]))
        return float((d**2).mean()), total


@dataclass(frozen=True)
class _OfSurface:
    """A goal of points (m, 3) of the surface at rest in m."""

    surface: Floats

    @cached_property
    def points(self) -> Mapping[str, Floats]:
        """As of `Goal`."""
        return by_place(self.surface)

    def _now(self, probes: Mapping[str, Floats]) -> Floats:
        """Where the points are, in mm."""
        return np.asarray(1e3 * (self.surface + np.array([probes[name] for name in self.points])))

    def _missed(self, away: Floats, corners: Ints, shares: Floats) -> tuple[float, Pull]:
        """The mean square of vectors (n, 3) in mm to means of points, which have (n, k) corners with shares, and its derivatives."""
        pull = np.zeros_like(self.surface)
        np.add.at(pull, corners, 2e3 / len(away) * shares[..., None] * away[:, None])
        by = {name: value for name, value in zip(self.points, pull, strict=True) if value.any()}
        return float((away**2).sum(axis=1).mean()), by


@dataclass(frozen=True)
class Touch(_OfSurface):
    """Places (n, 3) in mm that the surface should reach: the mean square distance from the nearest of its points."""

    places: Floats

    def __call__(self, t: float, probes: Mapping[str, Floats]) -> tuple[float, Pull]:
        """As of `Goal`."""
        now = self._now(probes)
        nearest = cKDTree(now).query(self.places)[1][:, None]
        return self._missed(now[nearest[:, 0]] - self.places, nearest, np.ones_like(nearest))


@dataclass(frozen=True)
class Cover(_OfSurface):
    """Places (n, 3) in mm, of another surface, that the surface, of triangles (k, 3), should go through: their mean square distance."""

    triangles: Ints
    places: Floats

    def __call__(self, t: float, probes: Mapping[str, Floats]) -> tuple[float, Pull]:
        """As of `Goal`."""
        now = self._now(probes)
        which, nearest = pv.PolyData.from_regular_faces(now, self.triangles).find_closest_cell(self.places, return_closest_point=True)
        corners = self.triangles[which]
        first, sides = now[corners[:, 0]], np.swapaxes(now[corners[:, 1:]] - now[corners[:, :1]], 1, 2)
        along = (np.linalg.pinv(sides) @ (nearest - first)[..., None])[..., 0]
        return self._missed(nearest - self.places, corners, np.column_stack([1 - along.sum(axis=1), along]))


@dataclass
class Goals:
    """Several goals from a time on until the end, an `Objective`: the mean over them, with their weights, and over time, in mm².

    Attributes
    ----------
    each : mapping
        Name to goal.
    since, end : float
        In s.
    weights : mapping
        Name to how much a goal counts, 1 without.
    square : dict
        Name to the mean square distance in mm² so far.
    """

    each: Mapping[str, Goal]
    since: float
    end: float
    weights: Mapping[str, float] = field(default_factory=dict)
    square: dict[str, float] = field(default_factory=dict)

    def __call__(self, t: float, h: float, probes: Mapping[str, Floats]) -> tuple[float, Pull]:
        """What a step that ends at `t` adds."""
        share, added, by = min(h, max(t - self.since, 0.0)) / (self.end - self.since), 0.0, dict[str, Floats]()
        if share > 0:
            weights = {name: self.weights.get(name, 1.0) for name in self.each}
            for name, goal in self.each.items():
                square, pull = goal(t, probes)
                self.square[name] = self.square.get(name, 0.0) + share * square
                part = share * weights[name] / sum(weights.values())
                added += part * square
                _add(by, {probe: part * value for probe, value in pull.items()})
        return added, by

    @property
    def distance(self) -> dict[str, float]:
        """Name to the root mean square over time, in mm."""
        return {name: float(np.sqrt(square)) for name, square in self.square.items()}


def skin_of(tongue: TongueMesh) -> tuple[Floats, Ints]:
    """The points of a tongue's surface, corners and middles of edges (n, 3) in m, and its triangles (m, 3), four to a side of a
    tetrahedron, on all ranks."""
    mesh = tongue.mesh
    mesh.topology.create_connectivity(2, 3)
    facets = exterior_facet_indices(mesh.topology)
    corners = np.concatenate(mesh.comm.allgather(mesh.geometry.x[entities_to_geometry(mesh, 2, facets)])).round(9)
    middles = corners[:, [[0, 1], [1, 2], [2, 0]]].mean(axis=2).round(9)
    points, places = np.unique(np.concatenate([corners, middles], axis=1).reshape(-1, 3), axis=0, return_inverse=True)
    return points, places.reshape(-1, 6)[:, QUARTERS].reshape(-1, 3)


def outline_of(tongue: TongueMesh) -> Outline:
    """The mid-sagittal outline of a tongue.

    Raises
    ------
    InputError
        If the mesh has no faces on the mid-plane, as one has that is a mirrored half.
    """
    points, triangles = skin_of(tongue)
    pairs = mid_edges(points, triangles)
    if len(pairs) == 0:
        raise InputError("fit: the mesh has no faces on the mid-plane y = 0; constrictions and contours need those of the built-in tongue.")
    ends, pairs = np.unique(pairs, return_inverse=True)
    return Outline(points[ends], pairs.reshape(-1, 2))
