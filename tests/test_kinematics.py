# SPDX-License-Identifier: MIT
"""Speed and curvature of paths against closed forms, and the table that a run leaves."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tongue_fenicsx.analysis import trajectories as kinematics

T = np.sort(np.r_[np.linspace(0, 0.1, 41), np.linspace(0.02, 0.05, 20)[1:-1]])
"""Times in s with steps of different length."""


def circle(radius: float, speed: float) -> np.ndarray:
    """A circle in an inclined plane, in m, traversed at constant speed."""
    u, w = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8])
    angle = speed / radius * T[:, None]
    return np.asarray(radius * (np.cos(angle) * u + np.sin(angle) * w))


def test_circle() -> None:
    """On a circle of 8 mm at 10 cm/s the speed is that to 0.1 %, and the curvature 125 1/m to round-off at any steps."""
    path = circle(8e-3, 0.1)
    speed, curvature = kinematics.motion(T, path)
    np.testing.assert_allclose(speed, 0.1, rtol=1e-3)
    np.testing.assert_allclose(curvature[1:-1], 125.0, rtol=1e-7)
    assert np.isnan(curvature[[0, -1]]).all()


def test_straight_path_with_changing_speed() -> None:
    """Uniform acceleration along a line: the speed is exact at every time, and the path does not bend."""
    path = np.outer(0.5 * T**2 + 0.05 * T, [0.6, 0.0, 0.8])
    speed, curvature = kinematics.motion(T, path)
    np.testing.assert_allclose(speed, T + 0.05, rtol=1e-9)
    np.testing.assert_allclose(curvature[1:-1], 0.0, atol=1e-5)


def test_rest_has_no_curvature() -> None:
    """A point at rest, one slower than the threshold and a path of two places have none, and nothing warns."""
    slow = circle(8e-3, 0.9 * kinematics.SLOW)
    for path in (np.zeros((len(T), 3)), slow):
        assert np.isnan(kinematics.motion(T, path)[1]).all()
    assert np.isfinite(kinematics.motion(T, circle(8e-3, 1.1 * kinematics.SLOW))[1][1:-1]).all()
    assert np.isnan(kinematics.motion(T[:2], slow[:2])[0]).all()


def test_table(tmp_path: Path) -> None:
    """Place, speed and curvature of each probe stand under their names; what there is not is empty."""
    path = circle(8e-3, 0.1)
    run = SimpleNamespace(time=T, probes={"tip": path - path[0]}, rest={"tip": path[0]})
    kinematics.write_trajectories(run, tmp_path / "t.csv")  # type: ignore[arg-type]
    table = np.genfromtxt(tmp_path / "t.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time_s", "tip_x_m", "tip_y_m", "tip_z_m", "tip_speed_m_s", "tip_curvature_1_m")
    np.testing.assert_allclose(table["tip_z_m"], path[:, 2], atol=1e-8)
    assert table["tip_curvature_1_m"][5] == pytest.approx(125.0, rel=1e-4)
    assert np.isnan(table["tip_curvature_1_m"][0])
