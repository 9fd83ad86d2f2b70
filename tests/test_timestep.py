# SPDX-License-Identifier: MIT
"""Generalized-alpha: order of accuracy, numerical damping, exact restart."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem, mesh
from mpi4py import MPI

from tongue_fenicsx.timestep import GeneralizedAlpha, State

DAMPING, STIFFNESS = 0.8, 9.0


def oscillate(steps: list[float], radius: float) -> np.ndarray:
    """t and u, v, ü after each step for ü + 0.8 u̇ + 9 u = 0 from u = 1, solved with the scheme's own affine rates."""
    domain = mesh.create_unit_interval(MPI.COMM_SELF, 1)
    u = fem.Function(fem.functionspace(domain, ("DG", 0)))
    u.x.array[:] = 1.0
    scheme = GeneralizedAlpha(u, radius)
    one, zero = np.ones_like(u.x.array), np.zeros_like(u.x.array)
    scheme.restore(State(0.0, 0.0, one, zero, -STIFFNESS * one, -STIFFNESS * one))
    t, path = 0.0, []
    for h in steps:
        scheme.begin(h)
        a_factor, v_factor = scheme._a_factor.value, scheme._v_factor.value
        known = scheme._a_part.x.array + DAMPING * scheme._v_part.x.array
        u.x.array[:] = -known / (a_factor + DAMPING * v_factor + STIFFNESS)
        t += h
        scheme.accept(t)
        s = scheme.state
        path.append([t, s.u[0], s.v[0], s.acceleration[0]])
    return np.array(path)


def exact(t: np.ndarray) -> np.ndarray:
    decay, omega = DAMPING / 2, np.sqrt(STIFFNESS - DAMPING**2 / 4)
    u = np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))
    v = -np.exp(-decay * t) * STIFFNESS / omega * np.sin(omega * t)
    return np.array([u, v, -DAMPING * v - STIFFNESS * u])


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("pattern", [(1.0, 1.0), (0.5, 1.5)], ids=["fixed", "alternating"])
def test_second_order(radius: float, pattern: tuple[float, float]) -> None:
    """A damped oscillator: u, v and ü converge with order 2, with equal and with alternating steps."""
    end = 2.0
    error = []
    for n in (320, 640):
        steps = [end / n * pattern[i % 2] for i in range(n)]
        t, *path = oscillate(steps, radius).T
        error.append(abs(path - exact(t)).max(axis=1))
    order = np.log2(error[0] / error[1])
    np.testing.assert_allclose(order, 2.0, atol=0.1)


def test_spectral_radius() -> None:
    """A step that is huge for the oscillator shrinks the motion by the spectral radius per step in the long run."""
    energy = np.linalg.norm(oscillate([1e4] * 40, 0.5)[:, 1:], axis=1)
    assert (energy[39] / energy[29]) ** 0.1 == pytest.approx(0.5, rel=0.15)
