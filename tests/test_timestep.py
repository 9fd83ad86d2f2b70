# SPDX-License-Identifier: MIT
"""Generalized-alpha: order of accuracy, numerical damping, exact restart."""

from __future__ import annotations

import numpy as np
import pytest

from tongue_fenicsx.verification.motion import oscillate, oscillation


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("pattern", [(1.0, 1.0), (0.5, 1.5)], ids=["fixed", "alternating"])
def test_second_order(radius: float, pattern: tuple[float, float]) -> None:
    """A damped oscillator: u, v and ü converge with order 2, with equal and with alternating steps."""
    end = 2.0
    error = []
    for n in (320, 640):
        steps = [end / n * pattern[i % 2] for i in range(n)]
        t, *path = oscillate(steps, radius).T
        error.append(abs(path - oscillation(t)).max(axis=1))
    order = np.log2(error[0] / error[1])
    np.testing.assert_allclose(order, 2.0, atol=0.1)


def test_spectral_radius() -> None:
    """A step that is huge for the oscillator shrinks the motion by the spectral radius per step in the long run."""
    energy = np.linalg.norm(oscillate([1e4] * 40, 0.5)[:, 1:], axis=1)
    assert (energy[39] / energy[29]) ** 0.1 == pytest.approx(0.5, rel=0.15)
