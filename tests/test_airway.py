# SPDX-License-Identifier: MIT
"""The airway over the tongue, against circles; and postures with and without gravity."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import LIVING
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.analysis import airway
from tongue_fenicsx.analysis.tongue_grid import grids, mid_plane, outline, outlines, section


def arc(radius: float, start: float, end: float, n: int = 400) -> np.ndarray:
    """Lines (n, 2, 2) along a part of a circle about (3, 4)."""
    angle = np.radians(np.linspace(start, end, n + 1))
    points = np.array([3.0, 4.0]) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.stack([points[:-1], points[1:]], axis=1)


def test_circles() -> None:
    """Of two walls the nearer counts where they overlap; from a tongue of 20 mm radius they are 10 and 15 mm away."""
    walls = {"palate": arc(30, 180, 60), "pharynx": arc(35, 100, -30)}
    wall, part = airway.wall_of(walls, np.array([3.0, 4.0]))
    radius = np.linalg.norm(wall - [3.0, 4.0], axis=1)
    np.testing.assert_allclose(radius, np.where(part == "palate", 30.0, 35.0), rtol=1e-4)
    assert list(dict.fromkeys(part)) == ["palate", "pharynx"]
    angle = np.degrees(np.unwrap(np.arctan2(*(wall - [3.0, 4.0])[:, ::-1].T)))
    assert (np.diff(angle) < 0).all()
    assert angle[part == "palate"].min() == pytest.approx(60.0, abs=0.5)
    assert angle[-1] == pytest.approx(-30.0, abs=0.5)
    tongue = np.concatenate([arc(20, 0, 360), arc(20, 0, 0, 1)])  # with a line of no length
    np.testing.assert_allclose(airway.feet(wall, tongue)[0], radius - 20, rtol=1e-4)


def test_section_is_that_of_all_cells(tongue_file: Path) -> None:
    """Only cells, and sides, near the plane are cut, which leaves none out."""
    tongue = tf.TongueMesh.read(tongue_file)
    run = tf.Simulation(tf.Model(tongue), probes={}).run({"GGP": tf.ramp(0.01, 0.1, 0.5)}, t_end=0.01)
    grid = grids(run)[1]
    whole = grid.tessellate(max_n_subdivide=1).slice(normal="y", origin=(0.0, mid_plane(grid) + 1e-4, 0.0))
    assert section(grid).area == pytest.approx(whole.area, rel=1e-6)
    (quick,), of_all = outlines(run, [1]), outline(grid, 1)
    np.testing.assert_allclose(np.sort(quick, axis=0), np.sort(of_all, axis=0), atol=1e-6)


def test_postures(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Three runs; gravity of the upright head lowers the tip, that of the supine one draws it back and widens the airway in front; one
    sheet, one table; the wall is the palate's mid-line, and each run keeps the curve."""
    path = tongue_file.parent / "posture.toml"
    path.write_text(LIVING)
    code, text = command(capsys, "postures", path, "-o", tmp_path, "--set", "time.end=0.06", "--set", "output.every=0.03")
    assert code == 0, text
    runs = {setting: tf.Run(tmp_path / "posture" / setting) for setting in ("none", "upright", "supine")}
    assert runs["upright"].probes["tip"][-1, 2] < runs["none"].probes["tip"][-1, 2] - 1e-4
    assert runs["supine"].probes["tip"][-1, 0] > runs["none"].probes["tip"][-1, 0] + 1e-4
    assert (tmp_path / "postures.md").read_text().count("\n") == 5
    assert (tmp_path / "postures.png").stat().st_size > 20_000
    fronts = {setting: airway.airway(run, [-1]).distance[0, 0] for setting, run in runs.items()}
    assert fronts["supine"] > fronts["none"]
    run = runs["upright"]
    passage = airway.airway(run)
    assert passage.distance.shape == (3, len(passage.wall))
    assert passage.distance[0].min() > 2.0
    palate = run.obstacles_at_rest["palate"]
    assert abs(palate.signed_distance(np.insert(1e-3 * passage.wall, 1, 0.0, axis=1))).max() < 1e-4
    run.plot("airway")
    lines = (run.folder / "airway.csv").read_text().splitlines()
    assert lines[0] == "part,along_mm,x_mm,z_mm,distance_mm_0ms,distance_mm_30ms,distance_mm_60ms"
    last = np.array([float(line.split(",")[-1]) for line in lines[1:]])
    np.testing.assert_allclose(last, passage.distance[-1], rtol=1e-3)
    assert (run.folder / "figures" / "airway.png").is_file()


def test_no_airway(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A posture without a wall, and two of one name, are refused before anything runs."""
    path = tongue_file.parent / "free.toml"
    path.write_text(LIVING.partition("[contact.palate]")[0])
    code, text = command(capsys, "postures", path, "-o", tmp_path)
    assert code == 2
    assert "none with a wall of the airway" in text
    code, text = command(capsys, "postures", path, path, "-o", tmp_path)
    assert code == 2
    assert "two scenarios have the same name" in text
    assert not list(tmp_path.iterdir())
