# SPDX-License-Identifier: MIT
"""A line search by work, for contact: where points begin to touch, residuals grow before they shrink."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from .callbacks import weakly

OVERSHOT = 0.1
"""Work of the residual on a Newton step, over that at its begin, beyond which the step is shortened in contact."""
GROWTH = 5.0
"""Growth of the residual that is always too much."""
TRIALS = 4
"""Residuals that shortening a step may take."""


class WorkLineSearch:
    """Shortens Newton steps of a SNES to where the work of the residual along them is nil, if that comes first.

    Parameters
    ----------
    snes : PETSc.SNES
        Its own line search takes what is left of the step as it is.
    x, b : PETSc.Vec
        Of the layout of unknowns and residuals.
    evaluate : callable
        Takes unknowns and the vector to write their residual to.
    """

    def __init__(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec, evaluate: Callable[[PETSc.Vec, PETSc.Vec], None]) -> None:
        self._snes, self._evaluate = snes, evaluate
        self._trial, self._residual, self._tried = x.duplicate(), b.duplicate(), False
        snes.getLineSearch().setType("basic")
        snes.setLineSearchPreCheck(weakly(self._shorten))

    def forget(self) -> None:
        """Loads or time have changed: the residual of the last trial is of no use."""
        self._tried = False

    def recall(self, x: PETSc.Vec, b: PETSc.Vec) -> bool:
        """Write the residual of the last trial to `b` if `x` was it; whether that was so."""
        known = self._tried and bool(x.equal(self._trial))
        if known:
            self._residual.copy(b)
        return known

    def destroy(self) -> None:
        """Free the vectors, on all ranks at once."""
        self._trial.destroy()
        self._residual.destroy()

    def _shorten(self, x: PETSc.Vec, step: PETSc.Vec) -> None:
        """Shorten a step (x − step is next): the root of the work, by regula falsi, or halves where the residual grows too much."""
        residual = self._snes.getFunction()[0]
        first, norm = float(residual.dot(step)), float(residual.norm())
        at, b, self._tried = self._trial, self._residual, True
        low, high, share = (0.0, 1.0), (1.0, -np.inf), 1.0
        for _ in range(TRIALS if first else 0):
            at.waxpy(-1.0, step, x)
            self._evaluate(at, b)
            work = float(b.dot(step)) / (share * first) if float(b.norm()) < GROWTH * norm else -np.inf
            if work >= -OVERSHOT and (work <= OVERSHOT or share == 1.0):
                return
            if work > 0:
                low = share, work
            else:
                high = share, work
            next_share = low[0] + (high[0] - low[0]) * (low[1] / (low[1] - high[1]) if np.isfinite(high[1]) else 0.5)
            step.scale(next_share / share)
            share = next_share
