# SPDX-License-Identifier: MIT
"""What `make bench` times can be timed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from petsc4py import PETSc

from benchmarks import measure, stress, timing


def test_assembly(tongue_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A residual costs less than a tangent."""
    monkeypatch.setattr(timing, "PATIENCE", 0.0)
    for times in measure.assembly(tongue_file).values():
        assert 0 < times["residual"] < times["tangent"]


@pytest.mark.parametrize("preset", measure.PRESETS.values(), ids=list(measure.PRESETS))
def test_a_step(preset: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    """Every part of a Newton iteration on a small block takes time."""
    monkeypatch.setattr(timing, "PATIENCE", 0.0)
    PETSc.Log.begin()
    assert all(value > 0 for value in measure.solver(2, preset).values())


def test_steady(monkeypatch: pytest.MonkeyPatch) -> None:
    """A row is repeated until its medians are known, outliers or not, or until patience ends."""
    noise = np.random.default_rng(1).lognormal(0.0, 0.1, 10_000)
    calls = iter(noise)
    done = []

    def work() -> timing.Row:
        done.append(1)
        return {"even": 2.0, "uneven": float(next(calls))}

    row = timing.steady(work)
    assert row["even"] == 2.0
    assert 20 < len(done) < 200
    assert row["uneven"] == pytest.approx(1.0, rel=3 * timing.STEADY)
    monkeypatch.setattr(timing, "PATIENCE", 0.0)
    done.clear()
    timing.steady(work)
    assert len(done) == 3


def test_profiles() -> None:
    """The quicker solver of each case counts at 1, one that does not finish at none."""
    at, shares = stress.profiles({"ours": {"a": 1.0, "b": 4.0}, "plain": {"a": 3.0, "b": 2.0, "c": 5.0}})
    np.testing.assert_allclose(at, [1, 2, 3])
    np.testing.assert_allclose(shares["ours"], [1 / 3, 2 / 3, 2 / 3])
    np.testing.assert_allclose(shares["plain"], [2 / 3, 2 / 3, 1])
