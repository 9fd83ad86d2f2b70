# SPDX-License-Identifier: MIT
"""When a solve is done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..core.values import Below1, Real, checked


@dataclass(frozen=True)
@checked("solver")
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

    rtol: Below1 = 1e-4
    atol: Annotated[float, Real("N", low=0, above=True)] = 1e-9
    linear: Below1 = 1e-3
    max_newton: Annotated[int, Real(low=1, high=1000, whole=True)] = 15
