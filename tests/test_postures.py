# SPDX-License-Identifier: MIT
"""The postures of speech are what they are called: constrictions and palatograms on the coarse tongue."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.analysis.airway import Airway, airway
from tongue_fenicsx.analysis.electropalatogram import electropalatogram

POSTURES = Path(__file__).parents[1] / "demos" / "postures"


def posture(name: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[tf.Run, Airway]:
    """Its run without pictures, of which only the end counts, and its airway there."""
    code, said = command(capsys, "run", POSTURES / f"{name}.toml", "-o", folder / name, "--no-figures", "--set", "solver.accuracy=preview")
    assert code == 0, said
    run = tf.Run(folder / name)
    return run, airway(run, (-1,))


def narrow(passage: Airway, parts: tuple[str, ...], low: float = -99.0, high: float = 99.0) -> float:
    """The least distance in mm from parts of the wall that have an x between bounds in mm."""
    x = passage.wall[:, 0]
    return float(passage.distance[-1, np.isin(passage.part, parts) & (low <= x) & (x <= high)].min())


@pytest.mark.slow
def test_i(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its narrowest place, 1 to 3 mm, is under the hard palate; the root is advanced, and the pharynx wide."""
    run, passage = posture("i", tmp_path, capsys)
    assert 1.0 <= narrow(passage, ("palate",), 0, 22) <= 3.0
    at = passage.narrowest()
    assert (passage.part[at], passage.wall[at, 0] < 22) == ("palate", True)
    assert run.probes["root"][-1, 0] < -3.5e-3
    assert narrow(passage, ("pharynx",)) > 10
    assert abs(run.probes["tip"][-1, 0]) < 5e-3


@pytest.mark.slow
def test_a(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its narrowest place, 2 to 5 mm, is the pharynx; the dorsum is low."""
    run, passage = posture("a", tmp_path, capsys)
    assert 2.0 <= narrow(passage, ("pharynx",)) <= 5.0
    assert passage.part[passage.narrowest()] == "pharynx"
    assert run.probes["dorsum"][-1, 2] < -4e-3
    assert narrow(passage, ("palate",)) > 8


@pytest.mark.slow
def test_u(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its narrowest place, 2 to 5 mm, is at the velum; the dorsum is raised."""
    run, passage = posture("u", tmp_path, capsys)
    assert 2.0 <= narrow(passage, ("velum", "palate"), 24, 52) <= 5.0
    at = passage.narrowest()
    assert (passage.part[at], passage.wall[at, 0] > 24) == ("velum", True)
    assert run.probes["dorsum"][-1, 2] > 1e-3


@pytest.mark.slow
def test_t(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It seals the ridge in the mid-line and the sides: a row that is closed from side to side, and beside it both edges, a horseshoe."""
    run, passage = posture("t", tmp_path, capsys)
    assert narrow(passage, ("palate",), -16, -8) < 0.3
    on = electropalatogram(run).grid(-1)
    assert on.sum() >= 10
    assert on[:3, 1:7].all(axis=1).any()
    behind = on[3:7]
    assert behind[:, :2].any(axis=1).all()
    assert behind[:, 6:].any(axis=1).all()
    assert not behind[1:, 2:6].any()
    assert narrow(passage, ("velum",)) > 2


@pytest.mark.slow
def test_the_demo_says_t(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A row of the palatogram is closed from side to side for a while, with both sides behind it, and in the end nothing is touched."""
    demo, mesh = POSTURES.parent / "say_t.toml", tmp_path / "coarse.msh"
    changes = ("--no-figures", "--set", "solver.accuracy=preview", "--set", f"mesh.file={mesh}")
    for line in (("build", "-o", mesh, "--preset", "coarse"), ("run", demo, "-o", tmp_path / "t", *changes)):
        code, said = command(capsys, *line)
        assert code == 0, said
    record = electropalatogram(tf.Run(tmp_path / "t"))
    grids = [record.grid(i) for i in range(len(record.time))]
    closed = [grid[:3, 1:7].all(axis=1).any() and grid[3:7, 0].any() and grid[3:7, 7].any() for grid in grids]
    assert 0.05 < np.ptp(record.time[closed]) < 0.15
    assert not grids[-1].any()


@pytest.mark.slow
def test_k(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It closes at the velum or the end of the hard palate, and not in front."""
    run, passage = posture("k", tmp_path, capsys)
    back, _, up = 1e3 * run.probes["tip"][-1]
    assert (-2 < back < 10, -10 < up < 4) == (True, True)  # the tip stays behind the lower teeth
    assert narrow(passage, ("velum", "palate"), 20, 45) < 0.3
    assert narrow(passage, ("palate",), -16, 5) > 2
