# SPDX-License-Identifier: MIT
"""Frictionless contact of the tongue's surface with rigid obstacles, by a penalty or by Nitsche's method.

Both press with P = [λ − g/γ]₊ per area at rest along the obstacle's normal n = ∇g, g the gap of the deformed point. Penalty
takes λ from its own earlier value (zero, or augmented until the penetration is small), Nitsche from the stress in the tongue,
λ = n·PN, and adds θ γ (P − λ) n·δP N (Chouly, Hild and Renard 2015; here with the obstacle's normal at the deformed point).
The factor P − λ is nil where the conditions hold, so any δP is consistent: that of linear elasticity is taken.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np

from ..core.types import Floats
from ..core.values import Length, OneOf, Positive, checked
from ..geometry.obstacles import Obstacle
from ..geometry.rigid_motion import RigidMotion

FORMS = ("penalty", "nitsche")


@dataclass(frozen=True)
@checked("contact")
class Contact:
    """How the tongue meets one obstacle.

    Attributes
    ----------
    obstacle : Obstacle
        Its signed distance.
    form : str
        ``"penalty"`` or ``"nitsche"``.
    theta : int
        Variant of Nitsche's method: 0, 1 (of a potential) or −1 (stable for any parameter).
    stiffness : float
        Factor on the default of 1/γ (`PENALTY` or `NITSCHE`).
    tolerance : float, optional
        Penetration in m beyond which a step is solved again, up to five times: penalty with augmented λ, Nitsche with larger 1/γ. By
        default that of the accuracy of the solver.
    touching : float
        Penetration in m at rest that counts as zero gap: surfaces of real subjects overlap a little.
    motion : RigidMotion, optional
        Of the bone that it moves with.

    Raises
    ------
    InputError
        If a name or number is not accepted.
    """

    obstacle: Obstacle
    form: Annotated[str, OneOf(names=FORMS)] = "nitsche"
    theta: Annotated[int, OneOf(names=(-1, 0, 1))] = 0
    stiffness: Positive = 1.0
    tolerance: Length | None = None
    touching: Length = 0.2e-3
    motion: RigidMotion | None = None


@dataclass(frozen=True)
class Touch:
    """What an obstacle does to the tongue, and where it is: what was at X is at `rotation` X + `offset`.

    Force (3,) in N, area in m², largest pressure in Pa, penetration in m, rotation (3, 3), offset (3,) in m.
    """

    force: Floats
    area: float
    pressure: float
    penetration: float
    rotation: Floats
    offset: Floats

    @property
    def parts(self) -> dict[str, Floats | float]:
        """All by name, as a run keeps them; the rotation as (9,)."""
        return {item.name: np.ravel(value) if np.ndim(value := getattr(self, item.name)) else value for item in fields(self)}
