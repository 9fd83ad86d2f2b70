# SPDX-License-Identifier: MIT
"""Which steps to take: on to the next milestone, shorter where a solve fails or the error in time is too large."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from ..core.types import Floats
from ..solvers.equations import Equations
from ..solvers.newton import Outcome
from ..solvers.time_integration import State
from .stepping import Stepping

SMALL = 1e-4
"""Displacement in m below which the error of a step is not judged more sharply: motion from rest would need endless steps."""
EASY = 6
"""Newton iterations up to which the next step may be longer."""


AT_ONCE = 1e-5
"""Time in s within which a kink is no milestone of its own: a step that short would turn a jump into a blow."""


ROUND_OFF = 1e-6
"""Time in s before the end within which an output is that of the end, as steps are not shorter."""


class StepControl:
    """Chooses the steps of a run.

    Parameters
    ----------
    stepping : Stepping
        Its bounds and tolerance.
    t_end : float
        End of the run in s.
    kinks : iterable of float
        Further times in s that a step must end on.
    step, largest : float
        The step in s to try first, and the largest displacement so far in m (root mean square).
    """

    def __init__(self, stepping: Stepping, t_end: float, kinks: Iterable[float], step: float | None = None, largest: float = SMALL) -> None:
        self._stepping, self._t_end = stepping, t_end
        self.step, self.largest = step or stepping.longest, largest
        self._excess = 0.0
        every = stepping.output_every
        outputs = (round(every * i, 12) for i in range(1, int(t_end / every) + 1))
        self._milestones = [0.0, *(time for time in outputs if time < t_end - ROUND_OFF), round(t_end, 12)]
        for kink in sorted(kinks):
            if 0 < kink < t_end and min(abs(kink - time) for time in self._milestones) > AT_ONCE:
                self._milestones.append(round(kink, 12))
        self._milestones = sorted(set(self._milestones))

    def next_time(self, t: float) -> tuple[float, float]:
        """The end of the step from `t`, and the milestone that it leads to, in s."""
        target = next(m for m in self._milestones if m > t + 1e-9)
        h = (target - t) / math.ceil((target - t) / self.step * (1 - 1e-9))
        return (t + h if t + 1.5 * h < target else target), target

    def stores(self, t: float) -> bool:
        """Whether fields are stored at a milestone."""
        every = self._stepping.output_every
        return abs(t / every - round(t / every)) < 1e-6 or t >= self._t_end * (1 - 1e-12)

    @property
    def outputs(self) -> list[float]:
        """Times in s at which fields are stored."""
        return [time for time in self._milestones if self.stores(time)]

    def find_fault(self, equations: Equations, before: State) -> str | None:
        """What is wrong with the error of the step that led from `before`; None if it may stand, as steps of the least length always do."""
        tolerance = self._stepping.tolerance
        if tolerance is None:
            return None
        largest = max(self.largest, _root_mean_square(equations, equations.state.u))
        error = _root_mean_square(equations, equations.scheme.error(before)) / largest
        self._excess = error / tolerance
        if self._excess > 2 and equations.state.h > 2 * self._stepping.step_min:
            return f"time error {error:.1e} of the displacement"
        self.largest = largest
        return None

    def grow(self, h: float, outcome: Outcome) -> None:
        """A step of `h` (s) was accepted."""
        if self._stepping.tolerance is not None:
            self._follow_error(h)
        else:
            self.step = min(self.step * (1.5 if outcome.newton <= EASY else 1.0), self._stepping.longest)

    def cut(self, h: float, converged: bool) -> bool:
        """A step of `h` (s) was given up, though its solve may have converged; whether a shorter one is allowed."""
        if converged:
            self._follow_error(h)
        else:
            self.step = h / 2
        return self.step >= self._stepping.step_min

    def _follow_error(self, h: float) -> None:
        step = h * float(np.clip(0.8 * max(self._excess, 1e-9) ** (-1 / 3), 0.2, 1.5))
        self.step = min(max(step, self._stepping.step_min), self._stepping.longest)


def _root_mean_square(equations: Equations, values: Floats) -> float:
    """Over all nodes, of local nodal vectors."""
    V = equations.weak.V
    owned = 3 * V.dofmap.index_map.size_local
    n, squares = V.mesh.comm.allreduce(np.array([owned / 3, float((values[:owned] ** 2).sum())]))
    return math.sqrt(squares / n)
