# SPDX-License-Identifier: MIT
"""Signed distances of obstacles against closed forms, and their derivatives against differences."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista as pv
from scipy.spatial.transform import Rotation

import tongue_fenicsx as tf
from tongue_fenicsx.geometry import obstacles
from tongue_fenicsx.geometry.obstacles import BAND, SPACING, Moved, Obstacle, Plane, Sphere, Triangulated, check_orientation
from tongue_fenicsx.geometry.surface import Surface

CENTRE, RADIUS = np.array([0.01, 0.0, 0.02]), 0.012
RNG = np.random.default_rng(3)


@pytest.fixture(scope="module")
def ball() -> Triangulated:
    """A ball of 12 mm as triangles."""
    return Triangulated(Surface.from_pyvista(pv.Sphere(radius=RADIUS, center=CENTRE, theta_resolution=120, phi_resolution=120).clean()))


def around(depth: float = 2e-3) -> np.ndarray:
    """Points within `depth` of the ball."""
    unit = RNG.standard_normal((200, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return CENTRE + (RADIUS + RNG.uniform(-depth, depth, (200, 1))) * unit


def test_distances_are_kept(ball: Triangulated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process does not compute them again, and gets the same bits; a damaged file is computed again."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    computed: list[int] = []
    kept: list[Path] = []
    compute = obstacles._compute

    def count(*arguments: Any) -> None:
        computed.append(1)
        compute(*arguments)

    monkeypatch.setattr(obstacles, "_compute", count)
    for times in (1, 1, 2):
        obstacles._sample.cache_clear()
        assert np.array_equal(Triangulated(ball.surface)._coefficients, ball._coefficients)
        assert len(computed) == times
        kept.append(next(tmp_path.rglob(obstacles.GRID)))
        if len(kept) == 2:
            kept[0].write_bytes(b"PK")


def test_plane_and_spheres() -> None:
    """Gap, normal and curvature of the shapes that have formulas."""
    points = np.array([[0.0, 0.0, 0.03], [0.01, 0.0, 0.0]])
    gap, n, H = Plane((0, 0, 0.01), (0, 0, -2)).evaluate(points)
    np.testing.assert_allclose(gap, [-0.02, 0.01])
    np.testing.assert_allclose(n, [[0, 0, -1]] * 2)
    assert not H.any()
    gap, n, H = Sphere((0, 0, 0), 0.02).evaluate(points)
    np.testing.assert_allclose(gap, [0.01, -0.01])
    np.testing.assert_allclose(n, [[0, 0, 1], [1, 0, 0]])
    np.testing.assert_allclose(H[0], np.diag([1, 1, 0]) / 0.03, atol=1e-12)
    hollow = Sphere((0, 0, 0), 0.02, inside=True).evaluate(points)
    np.testing.assert_allclose(hollow[0], -gap)
    np.testing.assert_allclose(hollow[1], -n)


def test_triangulated_ball(ball: Triangulated) -> None:
    """Distances within 0.02 mm, normals within 1.5 %, 95 of 100 within 1 %, curvature within 10 % of the sphere's, wherever the grid is."""
    points = around()
    gap, n, H = ball.evaluate(points)
    exact = Sphere(CENTRE.tolist(), RADIUS).evaluate(points)
    np.testing.assert_allclose(gap, exact[0], atol=2e-5)
    wrong = abs(n - exact[1]).max(axis=1)
    assert wrong.max() < 1.5e-2
    assert np.percentile(wrong, 95) < 1e-2
    assert abs(np.trace(H, axis1=1, axis2=2) / np.trace(exact[2], axis1=1, axis2=2) - 1).mean() < 0.1


@pytest.mark.parametrize("moved", [False, True])
def test_derivatives(ball: Triangulated, moved: bool) -> None:
    """Gradient and Hessian are those of the interpolated gap itself."""
    turn = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
    offset = np.array([0.003, 0.001, -0.002])
    obstacle: Obstacle = Moved(ball, turn, offset) if moved else ball
    points = around() @ turn.T + offset if moved else around()
    _, n, H = obstacle.evaluate(points)
    h = 1e-6
    for axis in range(3):
        step = h * np.eye(3)[axis]
        (ahead, n_ahead, _), (behind, n_behind, _) = obstacle.evaluate(points + step), obstacle.evaluate(points - step)
        np.testing.assert_allclose((ahead - behind) / (2 * h), n[:, axis], atol=1e-6)
        np.testing.assert_allclose((n_ahead - n_behind) / (2 * h), H[:, :, axis], atol=0.2)
    np.testing.assert_allclose(H, np.swapaxes(H, 1, 2), atol=1e-9)


def test_far_away(ball: Triangulated) -> None:
    """Outside the grid the gap is the band, deep inside minus the band."""
    gap, _, H = ball.evaluate(np.array([[0.2, 0, 0], CENTRE]))
    np.testing.assert_allclose(gap, [BAND, -BAND], rtol=1e-2)
    assert not H[0].any()


def test_much_finer_than_the_grid() -> None:
    """A surface of 60 000 triangles is simplified first, which the distance does not notice."""
    coarse, fine = (
        Triangulated(Surface.from_pyvista(pv.Sphere(radius=0.01, theta_resolution=n, phi_resolution=n).clean())) for n in (60, 180)
    )
    points = RNG.standard_normal((100, 3))
    points *= (0.01 + RNG.uniform(-2e-3, 2e-3, (100, 1))) / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(fine.evaluate(points)[0], coarse.evaluate(points)[0], atol=2e-5)
    np.testing.assert_allclose(fine.evaluate(points)[0], np.linalg.norm(points, axis=1) - 0.01, atol=2e-5)


def test_open_surface() -> None:
    """A patch repels from its front and pushes back from just behind it, but not what is beside its rim."""
    patch = Triangulated(Surface.from_pyvista(pv.Plane(i_size=0.02, j_size=0.02, i_resolution=4, j_resolution=4).triangulate()))
    points = np.array([[0, 0, 1e-3], [0.003, 0.002, -1e-3], [0.0125, 0, -0.5e-3], [0.0125, 0, 0.5e-3]])
    np.testing.assert_allclose(patch.evaluate(points)[0], [1e-3, -1e-3, 2.55e-3, 2.55e-3], atol=1e-4)


def test_sharp_edges_are_blunt_in_the_hessian() -> None:
    """Beside the edge of a cube the Hessian is that of an edge of four spacings; beside its faces it is nil."""
    cube = Triangulated(Surface.from_pyvista(pv.Cube(x_length=0.02, y_length=0.02, z_length=0.02).triangulate().clean()), spacing=1e-3)
    beside = 0.01 + 1e-3
    _, _, H = cube.evaluate(np.array([[beside, beside, 0.0], [beside, 0.0, 0.0]]))
    np.testing.assert_allclose(np.linalg.eigvalsh(H)[:, -1], [1 / 4e-3, 0.0], atol=1.0)


def test_symmetric_bones_have_symmetric_gaps(tongue: tf.TongueMesh) -> None:
    """At ±y the gap of a bone is the same, but for what the diagonals of a sheet's triangles leave."""
    for name in ("mandible", "lower_teeth", "velum", "pharynx"):
        bone = tongue.bones[name]
        points = bone.points[RNG.integers(0, len(bone.points), 300)] + RNG.normal(0, 5e-4, (300, 3))
        obstacle = Triangulated(bone, spacing=SPACING if name == "velum" else 1.25e-3)
        gaps = [obstacle.evaluate(points * (1, sign, 1))[0] for sign in (1, -1)]
        assert np.percentile(abs(gaps[0] - gaps[1]), 99) < (0.05e-3 if name == "velum" else 1e-6), name


def test_palate(tongue: tf.TongueMesh) -> None:
    """The built-in palate is 8 mm above the dorsum, and the tongue at rest is outside all bones."""
    gap, n, _ = Triangulated(tongue.bones["palate"], spacing=2e-3, band=12e-3).evaluate(tongue.landmarks["dorsum"][None])
    assert gap[0] == pytest.approx(7.5e-3, abs=1e-3)
    assert n[0, 2] < -0.7


def test_orientation(tongue: tf.TongueMesh) -> None:
    """Normals that point away from the tongue are refused."""
    palate = tongue.bones["palate"]
    check_orientation(Triangulated(palate), "palate", tongue.mesh.geometry.x)
    turned = Surface(palate.points, palate.triangles[:, ::-1].copy())
    with pytest.raises(tf.InputError, match=r"palate: .* must point to the free side"):
        check_orientation(Triangulated(turned), "palate", tongue.mesh.geometry.x)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: Plane((0, 0, 0), (0, 0, 0)), "has no direction"),
        (lambda: Plane((0, 0, float("nan")), (0, 0, 1)), "three numbers"),
        (lambda: Sphere((0, 0, 0), -1.0), "a positive length"),
        (lambda: Triangulated(Surface(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int64))), "no triangles"),
        (lambda: Triangulated(Surface.from_pyvista(pv.Cube().triangulate()), spacing=1e-3, band=2e-3), "at least 4 of it"),
    ],
)
def test_bad_obstacles(wrong: object, message: str) -> None:
    """Shapes that are none."""
    with pytest.raises(tf.InputError, match=message):
        wrong()  # type: ignore[operator]
