# SPDX-License-Identifier: MIT
"""The atlas: its numbers on a motion known in closed form, and the command on a small mesh."""

from __future__ import annotations

import csv
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista as pv
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.analysis.movement import single_muscle_row
from tongue_fenicsx.studies import atlas
from tongue_fenicsx.studies import single_muscle as solo


def test_row() -> None:
    """Tissue that widens by a tenth and moves 2 mm back and 1 mm down: every column says so; what lies below the root is not oral."""
    corners = [(x, y, z) for x in (0.0, 0.04) for y in (-0.02, 0.02) for z in (0.01, 0.03)]
    points = np.array([*corners, (0.02, -0.05, 0.0), (0.02, 0.05, 0.0)])
    u = np.column_stack([np.full(10, 2e-3), 0.1 * points[:, 1], np.full(10, -1e-3)])
    rest = {
        "tip": (0, 0, 0.02),
        "dorsum": (0.02, 0, 0.03),
        "root": (0.04, 0, 0.005),
        "edge_left": (0, -0.02, 0.02),
        "edge_right": (0, 0.02, 0.02),
    }
    run = SimpleNamespace(
        mesh=(points, None),
        field=lambda name: u,
        rest=rest,
        probes={name: np.array([np.zeros(3), (2e-3, 0.1 * y, -1e-3)]) for name, (_, y, _) in rest.items()},
        summary={"model": {"sigma_max": {"GGP_L": 4e3, "GGP_R": 4e3}}, "hencky_von_mises_max": 0.1, "peak_speed_m_s": 0.05},
    )
    row = single_muscle_row("GGP", run)  # type: ignore[arg-type]
    assert list(row) == list(atlas.COLUMNS)
    assert row.pop("muscle") == "GGP"
    expected = {f"{name}_{axis}_mm": value for name in ("tip", "dorsum", "root") for axis, value in (("x", 2.0), ("z", -1.0))}
    expected |= {"stress_kPa": 4.0, "edges_z_mm": -1.0, "width_mm": 4.0, "largest_mm": 30**0.5, "strain": 0.1, "speed_mm_s": 50.0}
    assert row == pytest.approx(expected)


def test_walls(tongue_file: Path) -> None:
    """Every bone but the hyoid, which the tongue surrounds."""
    assert set(solo.walls_in(tongue_file)) == {"palate", "velum", "pharynx", "upper_teeth", "lower_teeth", "mandible"}


@pytest.mark.usefixtures("_quick_protocol")
def test_command(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two muscles leave run folders, one table in two forms and one plate in two; a second call takes the runs that are there."""
    options = ["atlas", "-o", tmp_path, "--mesh", tongue_file, "--muscle", "GGP", "--muscle", "GH"]
    code, text = command(capsys, *options)
    assert code == 0, text
    with open(tmp_path / "atlas.csv", newline="") as file:
        rows = {row["muscle"]: row for row in csv.DictReader(file)}
    run = tf.Run(tmp_path / "GGP")
    assert list(rows) == ["GGP", "GH"]
    assert float(rows["GGP"]["root_x_mm"]) == pytest.approx(1e3 * run.probes["root"][-1, 0])
    assert float(rows["GGP"]["root_x_mm"]) < -5
    assert run.time[-1] == pytest.approx(0.15)
    assert (tmp_path / "atlas.md").read_text().startswith("| muscle | stress kPa | tip x mm |")
    picture = pv.read(tmp_path / "atlas.png")
    assert len(np.unique(picture.active_scalars, axis=0)) > 2000
    assert (tmp_path / "atlas.pdf").stat().st_size > 50_000
    stamp = (tmp_path / "GGP" / "history.h5").stat().st_mtime_ns
    code, text = command(capsys, *options)
    assert (code, "2 of 2 runs are already there" in text) == (0, True), text
    assert (tmp_path / "GGP" / "history.h5").stat().st_mtime_ns == stamp


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--muscle", "GPG"], "--muscle: 'GPG' is not one of GGP, GGM"),
        (["--mesh", "nowhere.msh"], "nowhere.msh: the file does not exist"),
        (["--mesh", "block.msh"], "block.msh: has none of the muscles GGP"),
    ],
)
@pytest.mark.usefixtures("block")
def test_bad_input(workspace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str) -> None:
    """Exit code 2 and one sentence, before any muscle moves: an unknown muscle, a missing mesh, one without muscles."""
    given = [str(workspace / option) if option == "block.msh" else option for option in options]
    code, text = command(capsys, "atlas", "-o", tmp_path, *given)
    assert (code, message in text) == (2, True), text
    assert not list(tmp_path.iterdir())
