# SPDX-License-Identifier: MIT
"""The muscles and attachments of the built-in tongue, carried over to a surface that came without any."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ..core.errors import InputError
from ..core.types import Bools, Floats
from ..geometry.fibre_bundle import FibreBundle
from ..geometry.registration import SmoothMap
from ..geometry.surface import LABEL, Surface
from .anatomy import Muscle
from .catalogue import base_name
from .frame_guess import UNLIKE
from .parametric.tongue import parametric_tongue

BONDED = 1e-3
"""Triangles within so much of the built-in tongue's attachment to a bone, in m, are bonded to it."""
CAP = 2.5e-4
"""Triangles farther than that, in m, from an open surface that was measured close a hole of it."""
BONES = ("mandible", "hyoid")
INSIDE = 0.3
"""Least share of its fibres' length that must lie in the tongue for a muscle to come along."""


class CarriedOver:
    """The built-in tongue, laid on another's surface.

    Parameters
    ----------
    seen : Surface
        What was measured, in our frame; it may be open.
    surface : Surface
        The same, closed: the tongue that muscles and attachments are for.
    bonded : bool
        Whether attachments are wanted.

    Attributes
    ----------
    muscles : dict
        Name with side to `Muscle`.
    surface : Surface
        With what is bonded to which bone.
    genial_spine : (3,) float array
        In m.
    notes : list of str
        How well it lies, what was left out.

    Raises
    ------
    InputError
        If the surface does not resemble a tongue in our frame.
    """

    def __init__(self, seen: Surface, surface: Surface, bonded: bool = True) -> None:
        built_in = parametric_tongue()
        self._map = laid = SmoothMap(built_in.surface, seen)
        if laid.before > (most := UNLIKE * float(np.ptp(seen.points, axis=0).max())):
            raise InputError(
                f"the built-in tongue, laid on it, is {1e3 * laid.before:.1f} mm from it, at most {1e3 * most:.1f} mm is accepted; "
                "a tongue in the frame that axes and mid_plane in frame.toml state is expected."
            )
        self._points: Floats | None = None
        self._drawn = np.empty((0, 3))
        self.genial_spine = laid.forward(built_in.genial_spine[None])[0]
        self.surface = surface
        capped = (abs(seen.signed_distance(surface.centroids)) > CAP) & np.any(seen.edge_sharing() == 1)
        if bonded:
            self.surface = Surface(surface.points, surface.triangles, self._bonded(surface.centroids, capped, built_in.surface))
        bundles = {
            name: FibreBundle([laid.forward(line) for line in muscle.fibres.lines], laid.similarity.scale * muscle.fibres.smoothing)
            for name, muscle in built_in.muscles.items()
        }
        inside = {name: _share_inside(bundle, surface) for name, bundle in bundles.items()}
        absent = sorted({base_name(name) for name in inside if min(inside[name], inside[_other_side(name)]) < INSIDE})
        self.muscles = {
            name: replace(
                muscle,
                fibres=bundles[name],
                region=partial(self._region, muscle),
                pcsa=None if muscle.pcsa is None else laid.similarity.scale**2 * muscle.pcsa,
                anchor=None if muscle.anchor is None else laid.similarity.forward(muscle.anchor[None])[0],
            )
            for name, muscle in built_in.muscles.items()
            if base_name(name) not in absent
        }
        self.notes = [
            f"muscles and attachments were carried over from the built-in tongue, which lies {1e3 * laid.distance:.1f} mm from the surface "
            f"in the mean and was scaled by {laid.similarity.scale:.2f}; nobody has measured them."
        ]
        if bonded and capped.any():
            self.notes.append("the cap of its hole is bonded, in front to the mandible and behind to the hyoid, whichever is nearer.")
        if absent:
            self.notes.append(f"{', '.join(absent)}: outside of this surface, so left out.")

    def _region(self, muscle: Muscle, points: Floats) -> Bools:
        if self._points is not points:  # the same for one muscle after the other
            self._points, self._drawn = points, self._map.backward(points)
        return muscle.region(self._drawn)

    def _bonded(self, centroids: Floats, capped: Bools, built_in: Surface) -> np.ndarray:
        """What each triangle is bonded to: as the built-in tongue is there, and a cap to the nearest bone."""
        labels = np.full(len(centroids), "free", dtype=LABEL)
        points, least = self._map.backward(centroids), np.full(len(centroids), np.inf)
        for bone in BONES:
            _, nearest = Surface(built_in.points, built_in.triangles[built_in.labels == bone]).nearest_triangle(points)
            distance = np.linalg.norm(nearest - points, axis=1)
            labels[(distance < BONDED) | (capped & (distance < least))] = bone
            least = distance
        return labels


def _share_inside(bundle: FibreBundle, surface: Surface) -> float:
    points, _, lengths = bundle.segments
    return float(lengths[surface.contains(points, 1e-3)].sum() / lengths.sum())


def _other_side(name: str) -> str:
    """The muscle of the other side, or itself."""
    base, _, side = name.partition("_")
    return f"{base}_{'R' if side == 'L' else 'L'}" if side else name
