# SPDX-License-Identifier: MIT
"""Laying one surface on another: a similarity (turn, scale, shift), and then a smooth map of the space around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ..core.types import Floats
from .surface import Surface

DENSE, SPARSE = 12_000, 600
"""Points of a surface that stand for it, and those that look for a partner."""
ROUNDS = 40
"""Of the iterated closest points."""
TRIM = 2.5
"""Partners farther apart than so many times the median are none."""
SMOOTHING = (100.0, 30.0, 10.0, 10.0)
"""Of the smooth map, in mm, from round to round: how little it follows a single partner."""
REACH = 10.0
"""In mm; what is farther from the other surface after the similarity has no partner there."""
TURNS = 10
"""Of the inverse."""
MM, MIRROR = 1e-3, np.array([1, -1, 1])


@dataclass(frozen=True)
class Similarity:
    """A point X is laid at ``scale`` · ``rotation`` X + ``offset``.

    Attributes
    ----------
    rotation : (3, 3) float array
        A proper one.
    scale : float
        Of lengths.
    offset : (3,) float array
        In m.
    """

    rotation: Floats
    scale: float
    offset: Floats

    @classmethod
    def between(cls, source: Floats, target: Floats, rigid: bool = False) -> Similarity:
        """The one, `rigid` or not, that leaves the least mean square distance of `target` points (n, 3) from `source` points (n, 3)."""
        start, end = source.mean(axis=0), target.mean(axis=0)
        a, b = source - start, target - end
        rotation = Rotation.align_vectors(b, a)[0].as_matrix()
        scale = 1.0 if rigid else float(np.sum((a @ rotation.T) * b) / np.sum(a**2))
        return cls(rotation, scale, end - scale * rotation @ start)

    def forward(self, points: Floats) -> Floats:
        """Points (n, 3) of the source, laid on the target."""
        return np.asarray(self.scale * points @ self.rotation.T + self.offset)

    def backward(self, points: Floats) -> Floats:
        """The inverse of `forward`."""
        return np.asarray((points - self.offset) @ self.rotation / self.scale)


def lay_on(source: Surface, target: Surface, rigid: bool = False) -> tuple[Similarity, float]:
    """The similarity in the plane y = 0, of symmetry, that lays a surface on another, by iterated closest points (Besl and McKay 1992) both
    ways, and the mean distance in m, both ways, that it leaves. It begins as the surfaces lie, centre on centre, with the same size unless
    it is to be `rigid`; open ones will do."""
    ours, theirs = scatter(source, DENSE), scatter(target, DENSE)
    a, b = ours[:: DENSE // SPARSE], theirs[:: DENSE // SPARSE]
    sizes = [float(np.sqrt(points.var(axis=0).sum())) for points in (ours, theirs)]
    scale = 1.0 if rigid else sizes[1] / sizes[0]
    found = Similarity(np.eye(3), scale, (theirs.mean(axis=0) - scale * ours.mean(axis=0)) * (1, 0, 1))
    there, here = cKDTree(theirs), cKDTree(ours)
    for _ in range(ROUNDS):
        to, at = there.query(found.forward(a))
        back, of = here.query(found.backward(b))
        near, close = to < TRIM * np.median(to), back < TRIM * np.median(back)
        starts, ends = np.vstack([a[near], ours[of[close]]]), np.vstack([theirs[at[near]], b[close]])
        found = Similarity.between(np.vstack([starts, starts * MIRROR]), np.vstack([ends, ends * MIRROR]), rigid)
    return found, float(to.mean() + found.scale * back.mean()) / 2


class SmoothMap:
    """A similarity and, upon it, radial functions of least bending that lay a surface on another.

    Parameters
    ----------
    source, target : Surface
        In about the same attitude, with y = 0 as mid-sagittal plane. Parts that the other has not, such as the floor of the
        mouth, go with what is near.

    Attributes
    ----------
    similarity : Similarity
        Where it began.
    before, distance : float
        Mean distance in m of the surfaces from each other then, and of the target from the source as laid.
    """

    def __init__(self, source: Surface, target: Surface) -> None:
        self.similarity, self.before = lay_on(source, target)
        theirs = scatter(target, DENSE) / MM
        ours = self.similarity.forward(scatter(source, DENSE)) / MM
        there, a, b = cKDTree(theirs), ours[:: DENSE // SPARSE], theirs[:: DENSE // SPARSE]
        a = a[there.query(a)[0] < REACH]
        b = b[cKDTree(ours).query(b)[0] < REACH]
        self._on = _radial(a, a, 0.0)
        for smoothing in SMOOTHING:
            partners = theirs[there.query(self._at(a))[1]]
            of = cKDTree(self._at(ours)).query(b)[1]
            self._on = _radial(np.vstack([a, ours[of]]), np.vstack([partners, b]), smoothing)
        self.distance = MM * float(cKDTree(self._at(ours)).query(b)[0].mean())

    def _at(self, points: Floats) -> Floats:
        return np.asarray(points + self._on(points))

    def forward(self, points: Floats) -> Floats:
        """Points (n, 3) around the source, in m, laid around the target."""
        return MM * self._at(self.similarity.forward(points) / MM)

    def backward(self, points: Floats) -> Floats:
        """The inverse of `forward`, by fixed-point iteration, to some hundredths of a millimetre where the map does not fold."""
        given = points / MM
        laid = given
        for _ in range(TURNS):
            laid = given - self._on(laid)
        return self.similarity.backward(MM * laid)


def scatter(surface: Surface, n: int) -> Floats:
    """Points (n, 3) all over a surface, at random with the same density everywhere; the same whenever asked for."""
    random = np.random.default_rng(0)
    a, b, c = surface.points[surface.triangles].swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = random.choice(len(area), n, p=area / area.sum())
    u, v = random.random((2, n, 1))
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    return np.asarray(a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen])


def _radial(starts: Floats, ends: Floats, smoothing: float) -> RBFInterpolator:
    """Displacements of space, in mm, that bring starts near ends: biharmonic splines (Duchon 1977), |r| in three dimensions."""
    _, unique = np.unique(starts.round(6), axis=0, return_index=True)
    return RBFInterpolator(starts[unique], (ends - starts)[unique], kernel="linear", degree=1, smoothing=smoothing)
