# SPDX-License-Identifier: MIT
"""How well two tongues agree, muscle by muscle: overlap, volume, fibre direction and length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError
from ..core.types import Floats
from ..geometry.fibre_direction import angle_between
from ..geometry.registration import Similarity
from .anatomy import Anatomy, measure


@dataclass(frozen=True)
class Agreement:
    """One muscle of a tongue against the same muscle of a reference tongue aligned with it.

    Attributes
    ----------
    dice : float
        Overlap of the two regions, 0…1.
    angle : float
        Mean angle in degrees between the fibre field and the reference's fibres along them, without sign, inside both.
    length_ratio : float
        Mean fibre length inside the tongue over that of the reference, after alignment.
    volume_ratio : float
        Region volume over that of the reference, after alignment.
    """

    dice: float
    angle: float
    length_ratio: float
    volume_ratio: float


def align(source: Anatomy, target: Anatomy) -> Similarity:
    """The similarity in the mid-sagittal plane that lays genial spine, tip and root of one tongue on those of another."""

    def frame(anatomy: Anatomy) -> Floats:
        landmarks = measure(anatomy.surface, anatomy.genial_spine).landmarks
        return np.array([anatomy.genial_spine, landmarks["tip"], landmarks["root"]]) * (1, 0, 1)

    return Similarity.between(frame(source), frame(target))


def compare(anatomy: Anatomy, reference: Anatomy, spacing: float = 1.25e-3) -> dict[str, Agreement]:
    """Compare the muscles that two tongues have in common.

    Parameters
    ----------
    anatomy, reference : Anatomy
        The tongue to judge and the one to judge it by.
    spacing : float
        Distance in m of the points at which regions are compared.

    Raises
    ------
    InputError
        If they have no muscle in common.
    """
    common = [name for name in anatomy.muscles if name in reference.muscles]
    if not common:
        raise InputError(f"{reference.name}: has no muscle in common with {anatomy.name}.")
    alignment = align(reference, anatomy)
    axes = [np.arange(low, high, spacing) for low, high in zip(*_bounds(anatomy, reference, alignment), strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    here, there = grid[anatomy.surface.contains(grid)], alignment.backward(grid)
    there = there[reference.surface.contains(there)]
    both = alignment.forward(there)
    both_inside = anatomy.surface.contains(both)
    found = {}
    for name in common:
        mine, other = anatomy.muscles[name], reference.muscles[name]
        region, measured = mine.region(here), other.region(there)
        overlap = (mine.region(both) & both_inside & measured).sum()
        points, tangents, weights = other.fibres.segments
        inside = anatomy.surface.contains(alignment.forward(points)) & reference.surface.contains(points, 1e-3)
        ends = alignment.forward(points[inside] + 1e-4 * tangents[inside]) - alignment.forward(points[inside] - 1e-4 * tangents[inside])
        angle = angle_between(mine.fibres.direction(alignment.forward(points[inside])), ends)
        found[name] = Agreement(
            dice=float(2 * overlap / (region.sum() + measured.sum())),
            angle=float(np.average(angle, weights=weights[inside])),
            length_ratio=anatomy.fibre_length(name) / (alignment.scale * reference.fibre_length(name)),
            volume_ratio=float(region.sum() / measured.sum()),
        )
    return found


def _bounds(anatomy: Anatomy, reference: Anatomy, alignment: Similarity) -> tuple[Floats, Floats]:
    points = np.vstack([anatomy.surface.points, alignment.forward(reference.surface.points)])
    return points.min(axis=0), points.max(axis=0)
