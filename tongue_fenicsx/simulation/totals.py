# SPDX-License-Identifier: MIT
"""What a run counts and sums up on its way."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..solvers.newton import Outcome
from .snapshot import Snapshot


@dataclass
class Totals:
    """Counts, times in s and extremes of a run up to now; saved with every checkpoint."""

    n_steps: int = 0
    n_rejected: int = 0
    newton_iterations: int = 0
    krylov_iterations: int = 0
    fallbacks: dict[str, int] = field(default_factory=dict)
    wall_seconds: float = 0.0
    setup_seconds: float = 0.0
    cpu_seconds: float = 0.0
    volume_change_max: float = 0.0
    min_jacobian: float = 1.0
    hencky_von_mises_max: float = 0.0
    hencky_von_mises_raw_max: float = 0.0
    peak_speed_m_s: float = 0.0

    def count(self, outcome: Outcome) -> None:
        """A solve was tried."""
        self.newton_iterations += outcome.newton
        self.krylov_iterations += outcome.krylov

    def step(self, now: Snapshot, outcome: Outcome, first_choice: str) -> None:
        """A step was accepted; `first_choice` is the linear solver that should have served."""
        self.n_steps += 1
        if outcome.rung != first_choice:
            self.fallbacks[outcome.rung] = self.fallbacks.get(outcome.rung, 0) + 1
        self.volume_change_max = max(self.volume_change_max, abs(now.volume_ratio - 1))
        self.min_jacobian = min(self.min_jacobian, now.min_jacobian)
        self.peak_speed_m_s = max(self.peak_speed_m_s, now.peak_speed)

    def output(self, now: Snapshot) -> None:
        """Fields are stored."""
        percentile, largest = now.hencky_extremes
        self.hencky_von_mises_max = max(self.hencky_von_mises_max, percentile)
        self.hencky_von_mises_raw_max = max(self.hencky_von_mises_raw_max, largest)
