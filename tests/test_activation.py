# SPDX-License-Identifier: MIT
"""Piecewise-linear activation."""

import math

import pytest

from tongue_fenicsx import Activation, InputError, ramp


def test_sequence() -> None:
    """Up in 100 ms, held 200 ms, down in 100 ms; the last level stays."""
    course = Activation([(0.1, 0, 1), (0.2, 1, 1), (0.1, 1, 0)])
    assert [course(t) for t in (0, 0.05, 0.1, 0.3, 0.35, 0.4, 9)] == pytest.approx([0, 0.5, 1, 1, 0.5, 0, 0])
    assert course.kinks == pytest.approx([0.1, 0.3, 0.4])
    assert ramp(0.1, 0.25, 0.3)(1.0) == 0.3


@pytest.mark.parametrize("piece", [(0.1, 0, 1.01), (0.1, math.nan, 1), (0.1, -0.1, 0), (0, 0, 1), (math.inf, 0, 1), (0.1, 0)])
def test_bad_pieces(piece: tuple[float, ...]) -> None:
    """Levels outside 0…1, NaN, and durations that are not positive are refused."""
    with pytest.raises(InputError, match="piece 1"):
        Activation([piece])  # type: ignore[list-item]
