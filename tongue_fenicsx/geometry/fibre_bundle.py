# SPDX-License-Identifier: MIT
"""Fibre bundles: polylines, their distance, and the smooth direction field between them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from ..core.types import Bools, Floats
from .fibre_direction import dyads, main_axis

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


class FibreBundle:
    """The fibres of one muscle as polylines, in the built-in tongue each from its origin to its insertion; nothing here asks for the sense.

    Parameters
    ----------
    lines : sequence of (n, 3) float arrays
        Polylines in m; points that repeat the one before, and lines without length, are left out.
    smoothing : float
        Standard deviation in m of the Gaussian that averages directions of neighbouring fibres.
    spacing : float
        Distance in m between the samples of a fibre that distances are measured to.

    Raises
    ------
    InputError
        If no line has a length.
    """

    def __init__(self, lines: Sequence[Floats], smoothing: float = 3e-3, spacing: float = 1e-3) -> None:
        given = [np.asarray(line, dtype=float) for line in lines]
        apart = [line[np.r_[True, np.any(np.diff(line, axis=0) != 0, axis=1)]] for line in given]
        self.lines = [line for line in apart if len(line) > 1]
        if not self.lines:
            raise InputError("fibres: they have no length; polylines of two or more different points are expected.")
        self.smoothing, self.spacing = smoothing, spacing

    @cached_property
    def segments(self) -> tuple[Floats, Floats, Floats]:
        """The fibres cut in pieces of at most `spacing`: middle (n, 3), unit tangent (n, 3), length (n,)."""
        points, tangents, lengths = [], [], []
        for line in self.lines:
            for start, step in zip(line[:-1], np.diff(line, axis=0), strict=True):
                length = np.linalg.norm(step)
                n = max(1, int(np.ceil(length / self.spacing)))
                points.append(start + (np.arange(n)[:, None] + 0.5) / n * step)
                tangents.append(np.repeat(step[None] / length, n, axis=0))
                lengths.append(np.full(n, length / n))
        return np.vstack(points), np.vstack(tangents), np.concatenate(lengths)

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self.segments[0])

    def within(self, points: Floats, radius: float) -> Bools:
        """Whether each point, (n, 3), lies within `radius` (m) of a fibre."""
        lower, upper = self.segments[0].min(axis=0) - radius, self.segments[0].max(axis=0) + radius
        near = np.all((points >= lower) & (points <= upper), axis=1)
        near[near] = np.isfinite(self._tree.query(points[near], distance_upper_bound=radius)[0])
        return near

    def distance(self, points: Floats) -> Floats:
        """Distance of each point, (n, 3), to the nearest fibre, (n,)."""
        return np.asarray(self._tree.query(points)[0])

    def direction(self, points: Floats) -> Floats:
        """Unit fibre direction at each point, (n, 3): the main axis of the dyads of the tangents nearby, in Gaussian mean.

        Its sense is that of the nearest fibre.
        """
        samples, tangents, _ = self.segments
        k = min(48, len(samples))
        distance, index = self._tree.query(points, k=np.arange(1, k + 1))
        weight = np.exp(-(distance**2 - distance[:, :1] ** 2) / (2 * self.smoothing**2))
        return main_axis(np.einsum("nk,nkij->nij", weight, dyads(tangents)[index]), tangents[index[:, 0]])
