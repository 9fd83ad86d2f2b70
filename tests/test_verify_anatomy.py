# SPDX-License-Identifier: MIT
"""What each muscle must do: every criterion on motions made up for it, and the command on a small mesh."""

from __future__ import annotations

import csv
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import pyvista as pv
from test_cli import tongue as command

from tongue_fenicsx.analysis.movement import movement
from tongue_fenicsx.core.errors import SolveError
from tongue_fenicsx.core.types import Floats
from tongue_fenicsx.studies import anatomy_check as matrix
from tongue_fenicsx.studies import anatomy_statements as anatomy

CENTRE, RADII = np.array([15.0, 0.0, 22.0]), np.array([35.0, 25.0, 17.0])
STATIONS = [-20.0, -2.5, 15.0, 50.0]
"""x of tip, front, dorsum and root of an egg, in mm."""

RIGHT: dict[str, tuple[list[tuple[float, float]], float, float]] = {
    "GGP": ([(-3, 0), (-4, 0.5), (-5, 1), (-8, 0)], 0.6, 0.0),
    "GGM": ([(-2, 0), (-2, -1), (-3, -3), (-2, 0)], 0.0, 2.0),
    "GGA": ([(0, -4), (0, -4), (0, -2), (0, 0)], 0.0, 2.0),
    "SG": ([(5, 0), (4, 1), (4, 2), (3, 0)], -1.0, 0.0),
    "HG": ([(3, 0), (3, -1), (3, -2), (3, -2)], 0.0, -1.0),
    "IL": ([(5, -3), (3, -1), (2, 0), (0, 0)], 1.0, 0.0),
    "SL": ([(3, 6), (1, -2), (0, 0), (0, 0)], 1.0, 0.0),
    "VERT": ([(-4, 0), (-2, -1), (0, -3), (0, 0)], 2.0, 0.0),
    "TRANS": ([(-4, 0), (-2, 0), (0, 3), (1, 1)], -3.0, 0.0),
    "GH": ([(0, 0), (0, 0), (0, 0), (0, 0)], 0.0, 0.0),
    "MH": ([(0, 3), (0, 3), (0, 3), (0, 3)], 0.0, 0.0),
}
"""What each muscle should do, in mm: backward and upward at the stations, growth of the width, rise of the edges over the mid-line."""


def egg() -> tuple[Floats, Any]:
    """Points in mm and quadratic tetrahedra of an ellipsoid, from a cube."""
    cube = pv.ImageData(dimensions=(13, 9, 9), spacing=(1 / 6, 1 / 4, 1 / 4), origin=(-1, -1, -1)).to_tetrahedra(5)
    corners = cube.points[cube.cells_dict[pv.CellType.TETRA]]
    edges = [corners[:, [a, b]].mean(axis=1) for a, b in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))]
    q = np.concatenate([corners, np.stack(edges, axis=1)], axis=1).reshape(-1, 3)
    s = q**2
    others = [(s[:, 1], s[:, 2]), (s[:, 2], s[:, 0]), (s[:, 0], s[:, 1])]
    ball = q * np.sqrt(np.stack([1 - a / 2 - b / 2 + a * b / 3 for a, b in others], axis=1))
    return CENTRE + RADII * ball, np.arange(len(q)).reshape(-1, 10)


def made_up(muscle: str, sign: float, shift: tuple[float, float, float], well: bool) -> Any:
    """A run in which an egg moves as it should, or the opposite way, and is shifted; its strain, speed and volume are right or not."""
    points, cells = egg()
    path, wider, edges = RIGHT[muscle]
    x, z = (np.interp(points[:, 0], STATIONS, [step[i] for step in path]) for i in (0, 1))
    side = (points[:, 1] - CENTRE[1]) / RADII[1]
    u = sign * np.stack([x, wider / 2 * side, z + edges * side**2], axis=1) + shift
    rest = {
        "tip": (-20, 0, 22), "dorsum": (15, 0, 39), "root": (50, 0, 22),
        "edge_left": (-2.5, -21.65, 22), "edge_right": (-2.5, 21.65, 22),
    }  # fmt: skip
    at = {name: int(np.argmin(((points - point) ** 2).sum(axis=1))) for name, point in rest.items()}
    return SimpleNamespace(
        mesh=(1e-3 * points, cells),
        output_times=np.array([0.35]),
        field=lambda name, index=-1: 1e-3 * u,
        rest={name: 1e-3 * np.array(point) for name, point in rest.items()},
        probes={name: 1e-3 * u[[node]] for name, node in at.items()},
        summary={
            "model": {"sigma_max": {"GGP_L": 1.0}},
            "hencky_von_mises_max": 0.5 if well else 0.1,
            "peak_speed_m_s": 0.15 if well else 0.5,
        },
        volume_ratio=np.array([1.0, 1.001 if well else 0.97]),
    )


@pytest.mark.parametrize("muscle", RIGHT)
def test_criteria(muscle: str) -> None:
    """A right motion meets every criterion; the opposite one fails those about a direction, a shifted one those about rest."""
    right = movement(made_up(muscle, 1.0, (0.0, 0.0, 0.0), well=True))
    opposite = movement(made_up(muscle, -1.0, (0.0, 1.0, 0.0), well=False))
    shifted = movement(made_up(muscle, 1.0, (5.0, 0.0, 0.0), well=True))
    for criterion in anatomy.criteria(muscle, 1.0):
        assert criterion.holds(right), criterion
        wrong = shifted if criterion.slight and criterion.low == -inf else opposite
        assert not criterion.holds(wrong), criterion


def test_sections() -> None:
    """Numbers of a motion known in closed form: a groove, sides, and a front that sinks below its chord."""
    found = movement(made_up("GGM", 1.0, (0.0, 0.0, 0.0), well=True))
    assert found["dorsum_groove"] == pytest.approx(2.0, abs=0.05)
    assert found["sides_z"] == pytest.approx(-1.0, abs=0.05)
    assert found["front_z"] == pytest.approx(-1.0, abs=0.05)
    assert found["lateral"] == pytest.approx(0.0, abs=1e-3)
    assert movement(made_up("VERT", 1.0, (0.0, 0.0, 0.0), well=True))["dorsum_bulge"] == pytest.approx(-3.0, abs=0.05)


def test_bounds_of_full_activation() -> None:
    """Strain, speed and the 5 to 12 mm of the root are asked at full activation only; GH and MH need not strain the tongue."""
    parts = {level: [c.says for c in anatomy.criteria("GGP", level)] for level in (0.3, 1.0)}
    assert set(parts[1.0]) - set(parts[0.3]) == {"5 to 12 mm forward", "of the order of 0.5", "as in speech"}
    assert "peak strain" not in [c.part for c in anatomy.criteria("GH", 1.0)]


def test_columns() -> None:
    """The subject is checked with living tissue only; a robust check triples the settings."""
    labels = [column.label for column in matrix.columns(Path("coarse.msh"), Path("pb.msh"))]
    assert labels == ["coarse calka 1", "coarse buchaillard 0.1", "coarse buchaillard 0.3", "pb buchaillard 0.1", "pb buchaillard 0.3"]
    assert [column.label for column in matrix.columns(Path("coarse.msh"), robust=True)[:3]] == [
        "coarse calka 1",
        "coarse calka 1 × 0.8",
        "coarse calka 1 × 1.2",
    ]


@pytest.mark.usefixtures("_quick_protocol")
def test_command(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """One muscle in one setting: the matrix on the terminal and in two files, exit 0; exit 3 with the value where a criterion fails."""
    monkeypatch.setattr(matrix, "LEVELS", {"calka": (1.0,)})
    options = ["verify", "--anatomy", "-o", tmp_path, "--mesh", tongue_file, "--muscle", "MH"]
    code, text = command(capsys, *options)
    assert (code, "tongue calka 1: 5 of 5 hold" in text) == (0, True), text
    with open(tmp_path / "anatomy.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["part"] for row in rows] == ["tip", "dorsum", "root", "mid-plane", "volume"]
    assert all(row["holds"] == "yes" for row in rows)
    monkeypatch.setitem(anatomy.STATEMENTS, "MH", [anatomy.Criterion("tip", "down", "tip_z", high=0.0)])
    code, text = command(capsys, *options)
    assert (code, "1 of 1 runs are already there" in text, "NO +" in text) == (3, True, True), text
    assert "**NO +" in (tmp_path / "anatomy.md").read_text()


def test_failed_solve(tmp_path: Path) -> None:
    """A run that cannot be solved fails every criterion of its muscle."""
    settings = matrix.columns(tmp_path / "coarse.msh")
    found = matrix.judge({column: ["GH", "MH"] for column in settings}, lambda column, name: SolveError("the solve gave up."))
    assert not any(cell.holds for cells in found.values() for cell in cells.values())
    assert {str(cell) for cells in found.values() for cell in cells.values()} == {"no solution"}
    assert matrix.counts(found, settings[0]) == "coarse calka 1: 0 of 10 hold"


def test_open_statements() -> None:
    """Seven are stated by textbooks and met by no published fibres: they are counted apart, and the rest must hold."""
    found = [
        (muscle, criterion.part, criterion.says) for muscle, those in anatomy.STATEMENTS.items() for criterion in those if criterion.open
    ]
    assert found == [
        ("GGP", "width", "slightly wider"),
        ("GGA", "root", "hardly moves"),
        ("HG", "edges", "down"),
        ("IL", "root", "moves slightly"),
        ("SL", "root", "hardly moves"),
        ("VERT", "dorsum", "flat"),
        ("VERT", "root", "hardly moves"),
    ]
    (column, *_) = matrix.columns(Path("coarse.msh"))
    must, may = (next(c for c in anatomy.criteria("GGA", 1.0) if c.open is is_open) for is_open in (False, True))
    wrong = {("GGA", must): {column: matrix.Cell(1.0, True)}, ("GGA", may): {column: matrix.Cell(2.0, False)}}
    assert matrix.holds(wrong)
    assert matrix.counts(wrong, column) == "coarse calka 1: 1 of 1 hold; of those left open, 0 of 1"
    assert [matrix.verdict(criterion, cells[column]) for (_, criterion), cells in wrong.items()] == ["+1.00", "open +2.00"]
    wrong["GGA", must] = {column: matrix.Cell(1.0, False)}
    assert not matrix.holds(wrong)
    assert matrix.verdict(must, wrong["GGA", must][column]) == "NO +1.00"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--anatomy", "--subject", "nowhere"], "nowhere: the subject folder does not exist"),
        (["--anatomy", "--muscle", "GPG"], "--muscle: 'GPG' is not one of GGP, GGM"),
        (["--anatomy", "--mesh", "nowhere.msh"], "nowhere.msh: the file does not exist"),
        (["--anatomy", "--only", "patch"], "--only and --anatomy: give one of them"),
        (["--robust"], "--jobs and --overwrite belong to --anatomy"),
        (["--stress", "--only", "patch"], "--only patch: one of antagonists, jump, level"),
        (["--stress", "--anatomy"], "--stress: not with --anatomy"),
        (["--sample", "3"], "--sample belongs to --stress"),
        (["--anatomy", "--strict"], "No such option: --strict"),
    ],
)
def test_bad_input(capsys: pytest.CaptureFixture[str], options: list[str], message: str) -> None:
    """Exit code 2 and one sentence, before any muscle moves."""
    code, text = command(capsys, "verify", *options)
    assert (code, message in text) == (2, True), text
    assert "hold" not in text
