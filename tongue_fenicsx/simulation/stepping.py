# SPDX-License-Identifier: MIT
"""How time advances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

from ..core.errors import InputError
from ..core.values import Below1, Flag, Real, Seconds, Share, checked
from ..solvers.tolerances import Tolerances

Interval = Annotated[float, Real("s", low=1e-4, high=100)]
Report = Callable[["Progress"], None]


@dataclass(frozen=True)
@checked("time")
class Stepping:
    """How time advances.

    Attributes
    ----------
    step_max : float, optional
        Largest step in s; by default that of the accuracy of the solver.
    step_min : float
        The step in s below which the run gives up.
    spectral_radius : float
        Of generalized-alpha, 0…1.
    output_every : float
        Time in s between stored fields.
    tolerance : float, optional
        Accepted error of a step over the largest displacement so far (at least 0.1 mm), both as root mean squares over the
        nodes; steps grow and shrink between `step_min` and `step_max` to meet it. By default steps are the largest, shorter only
        where a solve fails.
    quasi_static : bool
        Whether inertia and rates are left out, so that every output is an equilibrium.
    fields : sequence of str
        Fields to store beside displacement, velocity, strain and J: names of `quantities.FIELDS`.
    """

    step_max: Seconds | None = None
    step_min: Seconds = 1e-5
    spectral_radius: Share = 0.8
    output_every: Interval = 0.01
    quasi_static: Flag = False
    fields: Sequence[str] = ()
    tolerance: Below1 | None = None

    def __post_init__(self) -> None:
        if self.step_min > self.longest:
            raise InputError(f"step_min: {self.step_min} s is larger than step_max, {self.longest} s.")

    @property
    def longest(self) -> float:
        """The largest step in s."""
        return Tolerances.step if self.step_max is None else self.step_max

    def within(self, tolerances: Tolerances) -> Stepping:
        """The same, with the step of the tolerances if it names none."""
        return replace(self, step_max=self.step_max or tolerances.step)


@dataclass(frozen=True)
class Progress:
    """Where a run is: what the progress bar and the log say after each step."""

    t: float
    t_end: float
    step: int
    h: float
    newton: int
    krylov: int
    rung: str
