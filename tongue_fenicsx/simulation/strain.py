# SPDX-License-Identifier: MIT
"""Strain measures from deformation gradients, in numbers."""

from __future__ import annotations

import numpy as np

from ..core.types import Floats


def hencky_von_mises(F: Floats) -> Floats:
    """Von Mises measure √(⅔ dev h : dev h) of the Hencky strain h = ½ ln FᵀF, for F of shape (…, 3, 3)."""
    h = 0.5 * np.log(np.linalg.eigvalsh(np.swapaxes(F, -1, -2) @ F))
    deviator = h - h.mean(axis=-1, keepdims=True)
    return np.asarray(np.sqrt(2 / 3 * (deviator**2).sum(axis=-1)))


def hencky(F: Floats) -> Floats:
    """The Hencky strain h = ½ ln FᵀF, (…, 3, 3)."""
    stretches, axes = np.linalg.eigh(np.swapaxes(F, -1, -2) @ F)
    return np.asarray((axes * (0.5 * np.log(stretches))[..., None, :]) @ np.swapaxes(axes, -1, -2))


def determinant(F: Floats) -> Floats:
    """Determinants (…) of matrices (…, 3, 3), by hand, which is ten times as fast as by factors."""
    return np.asarray(np.einsum("...i,...i->...", F[..., 0, :], np.cross(F[..., 1, :], F[..., 2, :])))


def largest_stretch(F: Floats) -> Floats:
    """Largest principal stretch (…)."""
    return np.asarray(np.sqrt(np.linalg.eigvalsh(np.swapaxes(F, -1, -2) @ F)[..., -1]))


def weighted_percentile(values: Floats, weights: Floats, percent: float) -> float:
    """The value below which `percent` of the total weight lies."""
    return float(np.percentile(values, percent, weights=weights, method="inverted_cdf"))
