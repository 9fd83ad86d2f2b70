# SPDX-License-Identifier: MIT
"""Directions of fibres, which have no sense: their mean is the main axis of their dyads, as in diffusion imaging."""

from __future__ import annotations

import numpy as np

from ..core.types import Floats


def dyads(vectors: Floats) -> Floats:
    """a⊗a of each vector (…, 3), (…, 3, 3): the same for either sense."""
    return np.asarray(vectors[..., :, None] * vectors[..., None, :])


def main_axis(tensors: Floats, along: Floats) -> Floats:
    """Unit eigenvector of the largest eigenvalue of sums of dyads (…, 3, 3), in the half-space of vectors `along` (…, 3)."""
    axis = np.linalg.eigh(tensors)[1][..., -1]
    return np.where((axis * along).sum(axis=-1, keepdims=True) < 0, -axis, axis)


def common_sense(vectors: Floats) -> Floats:
    """Groups of vectors (…, k, 3) of one sense: those that run against the main axis of their group are turned round.

    The first of each group keeps its sense.
    """
    axis = main_axis(dyads(vectors).sum(axis=-3), vectors[..., 0, :])
    against = (vectors * axis[..., None, :]).sum(axis=-1, keepdims=True) < 0
    return np.where(against, -vectors, vectors)


def angle_between(a: Floats, b: Floats) -> Floats:
    """Angle in degrees, 0 to 90, between the lines along vectors a and b (…, 3)."""
    cosine = abs((a * b).sum(axis=-1)) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, 0, 1))))
