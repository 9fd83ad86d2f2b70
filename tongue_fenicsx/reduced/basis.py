# SPDX-License-Identifier: MIT
"""Proper orthogonal decomposition: the shapes that many runs are made of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ..core.types import Floats, Ints

SNAPSHOTS = 6000
"""Of how many states shapes are made, spread over all runs."""


def mirror_of(points: Floats) -> Ints | None:
    """The mirror image of each node (n_nodes, 3) across the mid-plane, (n_nodes,); None if a node has none."""
    distance, image = cKDTree(points).query(points * (1, -1, 1))
    return image if distance.max() < 1e-9 else None


def modes_of(displacements: Sequence[Floats], n_modes: int, mirror: Ints | None = None, sign: int = 1) -> Floats:
    """The shapes (n_modes, n_nodes, 3), each with a mean square of one over the nodes, whose span leaves the least mean square of
    displacements, each (n, n_nodes, 3), by the method of snapshots (Sirovich 1987); with the `mirror` of the nodes of the part of them that
    is its own mirror image, or for a `sign` of -1 the opposite of it.

    Raises
    ------
    ValueError
        If there are not so many independent ones.
    """
    every = max(1, sum(map(len, displacements)) // SNAPSHOTS)
    some = np.concatenate([displacement[::every] for displacement in displacements]).astype(np.float64)
    if mirror is not None:
        some = (some + sign * some[:, mirror] * (1, -1, 1)) / 2
    n_nodes = some.shape[1]
    some = some.reshape(len(some), -1)
    if n_modes > min(some.shape):
        raise ValueError(f"{n_modes} modes of {len(some)} states")
    energies, vectors = np.linalg.eigh(some @ some.T)
    energies, vectors = energies[::-1][:n_modes], vectors[:, ::-1][:, :n_modes]
    if energies[-1] < 1e-12 * energies[0]:
        raise ValueError(f"no {n_modes} independent shapes")
    orthonormal = (vectors / np.sqrt(energies)).T @ some
    return np.asarray(np.sqrt(n_nodes) * orthonormal).reshape(n_modes, n_nodes, 3)


def coordinates_of(displacement: Floats, modes: Floats) -> Floats:
    """Coordinates (…, n_modes) in mm of displacements (…, n_nodes, 3) in m."""
    flat = modes.reshape(len(modes), -1)
    return np.asarray(1e3 * (displacement.reshape(*displacement.shape[:-2], -1) @ flat.T.astype(displacement.dtype)) / modes.shape[1])
