# SPDX-License-Identifier: MIT
"""What `make bench` times can be timed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from petsc4py import PETSc

from benchmarks import measure, stress


def test_assembly(tongue_file: Path) -> None:
    """A residual costs less than a tangent."""
    for times in measure.assembly(tongue_file, 1).values():
        assert 0 < times["residual"] < times["tangent"]


@pytest.mark.parametrize("preset", measure.PRESETS.values(), ids=list(measure.PRESETS))
def test_a_step(preset: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    """Every part of a Newton iteration on a small block takes time."""
    monkeypatch.setattr(measure, "REPEATS", 1)
    PETSc.Log.begin()
    assert all(value > 0 for value in measure.solver(2, preset).values())


def test_profiles() -> None:
    """The quicker solver of each case counts at 1, one that does not finish at none."""
    at, shares = stress.profiles({"ours": {"a": 1.0, "b": 4.0}, "plain": {"a": 3.0, "b": 2.0, "c": 5.0}})
    np.testing.assert_allclose(at, [1, 2, 3])
    np.testing.assert_allclose(shares["ours"], [1 / 3, 2 / 3, 2 / 3])
    np.testing.assert_allclose(shares["plain"], [2 / 3, 2 / 3, 1])
