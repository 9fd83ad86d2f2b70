# SPDX-License-Identifier: MIT
"""How accurate a run is: one name for the time step and for when a solve is done."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

from ..core.errors import InputError
from ..core.values import Below1, Length, OneOf, Real, Seconds, checked


@dataclass(frozen=True)
@checked("solver")
class Tolerances:
    """When a solve is done, and the step and penetration that go with it; by default those of ``Tolerances.of("trajectory")``.

    Attributes
    ----------
    rtol : float
        Residual over the forces on the supports, or over a tenth of the residual of the first guess where that is more; in an equilibrium,
        which no inertia holds and nothing after it forgets, three tenths of that.
    atol : float
        Residual in N that is always small enough.
    linear : float
        Relative residual of each linear solve.
    max_newton : int
        Newton iterations before the step is cut.
    step : float
        Largest time step in s, where a `Stepping` names none.
    penetration : float
        Depth in m that is accepted in an obstacle, where a `Contact` names none.
    """

    rtol: Below1 = 1e-2
    atol: Annotated[float, Real("N", low=0, above=True)] = 1e-9
    linear: Below1 = 1e-2
    max_newton: Annotated[int, Real(low=1, high=1000, whole=True)] = 15
    step: Seconds = 5e-3
    penetration: Length = 1e-4

    @classmethod
    def of(cls, accuracy: str = "trajectory", **given: Any) -> Tolerances:
        """Those of an accuracy, with `given` ones in their place.

        Parameters
        ----------
        accuracy : str
            ``"trajectory"``: within 1 % of a quarter of the step with tight tolerances, but where soft tissue slips on bone
            (docs/performance.md); ``"tight"``; ``"preview"``: coarser.
        **given
            Attributes.

        Raises
        ------
        InputError
            If there is no such accuracy, or a number is not accepted.
        """
        if accuracy not in ACCURACIES:
            raise InputError(f"accuracy: {accuracy!r}; one of {', '.join(ACCURACIES)} is expected.")
        return replace(ACCURACIES[accuracy], **given)

    def no_looser_than(self, accuracy: str) -> Tolerances:
        """The same, with `rtol` and `linear` at most those of an accuracy."""
        limit = ACCURACIES[accuracy]
        return replace(self, rtol=min(self.rtol, limit.rtol), linear=min(self.linear, limit.linear))


ACCURACIES = {
    "trajectory": Tolerances(),
    "tight": Tolerances(rtol=1e-5, linear=1e-3, penetration=0.05e-3),
    "preview": Tolerances(rtol=1e-2, linear=3e-2, step=10e-3, penetration=2e-4),
}
Accuracy = Annotated[str, OneOf(names=ACCURACIES)]
