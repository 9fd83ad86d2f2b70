# SPDX-License-Identifier: MIT
"""Activation over time: pieces, tables, functions, first-order dynamics."""

import math
from pathlib import Path

import numpy as np
import pytest

from tongue_fenicsx import Activation, Excited, InputError, ramp
from tongue_fenicsx.mechanics.activation import FunctionOfTime


def test_sequence() -> None:
    """Up in 100 ms, held 200 ms, down in 100 ms; the last level stays."""
    course = Activation([(0.1, 0, 1), (0.2, 1, 1), (0.1, 1, 0)])
    assert [course(t) for t in (0, 0.05, 0.1, 0.3, 0.35, 0.4, 9)] == pytest.approx([0, 0.5, 1, 1, 0.5, 0, 0])
    assert course.kinks == pytest.approx([0.1, 0.3, 0.4])
    assert ramp(0.1, 0.25, 0.3)(1.0) == 0.3


def test_levels_stay_within_their_pieces() -> None:
    """To the last bit: a muscle that lets go never pushes by rounding."""
    random = np.random.default_rng(1)
    for up, down, top in random.uniform(0.05, 0.2, (2000, 3)):
        course = Activation([(up, 0.0, top), (down, top, 0.0), (up, 0.0, 1.0)])
        levels = [course(t) for end in course.kinks for t in (end, np.nextafter(end, 0))]
        assert 0.0 <= min(levels) <= max(levels) <= 1.0


@pytest.mark.parametrize("piece", [(0.1, 0, 1.01), (0.1, math.nan, 1), (0.1, -0.1, 0), (0, 0, 1), (math.inf, 0, 1), (0.1, 0)])
def test_bad_pieces(piece: tuple[float, ...]) -> None:
    """Levels outside 0…1, NaN, and durations that are not positive are refused."""
    with pytest.raises(InputError, match=r"activation\.pieces\.0.*expected"):
        Activation([piece])  # type: ignore[list-item]


@pytest.mark.parametrize("head", ["", "time,level\n"])
@pytest.mark.parametrize("separator", [",", ";"])
def test_table(tmp_path: Path, head: str, separator: str) -> None:
    """A CSV file of times and levels is a course of straight lines."""
    path = tmp_path / "table.csv"
    path.write_text(head + "\n".join(f"{t}{separator} {a}" for t, a in ((0.0, 0.0), (0.1, 0.8), (0.4, 0.2))) + "\n")
    course = Activation.from_table(path)
    assert [course(t) for t in (0, 0.05, 0.1, 0.25, 1)] == pytest.approx([0, 0.4, 0.8, 0.5, 0.2])
    assert course.kinks == pytest.approx([0.1, 0.4])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0,0\n0.1,2\n", "2.0; a number from 0 to 1 is expected"),
        ("0,0\n0,1\n", "the times do not grow"),
        ("0,0\n", "less than two rows"),
        ("0,0\n0.1,nan\n", "nan; a number from 0 to 1"),
        ("0,0,0\n1,1,1\n", "other than two columns"),
        ("0,a\n1,1\n", "cannot be read"),
    ],
)
def test_bad_tables(tmp_path: Path, text: str, expected: str) -> None:
    """Each fault of a table is one sentence that names the file."""
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=expected) as raised:
        Activation.from_table(path)
    assert str(path) in str(raised.value)


def test_function_of_time() -> None:
    """Any function serves as long as it stays in 0…1."""
    course = FunctionOfTime(lambda t: math.sin(10 * t) ** 2)
    assert course(0.1) == pytest.approx(math.sin(1.0) ** 2)
    for wrong in (math.nan, -0.1, 1.1):
        with pytest.raises(InputError, match="a number from 0 to 1 is expected"):
            FunctionOfTime(lambda t, wrong=wrong: wrong)(0.0)  # type: ignore[misc]


def test_excitation_dynamics() -> None:
    """A step up follows 1 − exp(−t/τ_rise), a step down exp(−t/τ_fall), a slow ramp lags by τ."""
    step = Excited(Activation([(1e-9, 0.0, 1.0), (0.1, 1.0, 1.0), (1e-9, 1.0, 0.0)]), rise=0.02, fall=0.05)
    t = np.linspace(0.001, 0.099, 30)
    np.testing.assert_allclose([step(s) for s in t], 1 - np.exp(-t / 0.02), atol=2e-5)
    peak = 1 - np.exp(-0.1 / 0.02)
    np.testing.assert_allclose([step(0.1 + s) for s in t], peak * np.exp(-t / 0.05), atol=2e-3)
    assert step(5.0) < 1e-6
    slow = Excited(Activation([(10.0, 0.0, 1.0)]), rise=0.02, fall=0.05)
    assert slow(5.0) == pytest.approx((5.0 - 0.02) / 10.0, abs=1e-5)
    for wrong in (0.0, 2.0, math.nan):
        with pytest.raises(InputError, match=r"excitation\.rise"):
            Excited(ramp(0.1, 0.1), rise=wrong)
