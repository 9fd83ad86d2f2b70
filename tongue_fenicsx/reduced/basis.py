# SPDX-License-Identifier: MIT
"""Proper orthogonal decomposition: the shapes that many runs are made of."""

from __future__ import annotations

import numpy as np

from ..core.types import Floats

SNAPSHOTS = 6000
"""Of how many states shapes are made, spread over all runs."""


def modes_of(displacement: Floats, n_modes: int) -> Floats:
    """The shapes (n_modes, n_nodes, 3), each with a mean square of one over the nodes, whose span leaves the least mean square of
    displacements (n, n_nodes, 3), by the method of snapshots (Sirovich 1987).

    Raises
    ------
    ValueError
        If there are not so many independent ones.
    """
    n, n_nodes = displacement.shape[:2]
    some = displacement[:: max(1, n // SNAPSHOTS)].reshape(-1, 3 * n_nodes).astype(np.float64)
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
