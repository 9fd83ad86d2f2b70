# SPDX-License-Identifier: MIT
"""When a solve is done."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerances:
    """When a solve is done.

    Attributes
    ----------
    rtol : float
        Residual over the residual of the first guess.
    atol : float
        Residual in N.
    linear : float
        Relative residual of each linear solve.
    max_newton : int
        Newton iterations before the step is cut.
    """

    rtol: float = 1e-4
    atol: float = 1e-9
    linear: float = 1e-3
    max_newton: int = 15
