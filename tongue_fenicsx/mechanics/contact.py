# SPDX-License-Identifier: MIT
"""Frictionless contact of the tongue's surface with rigid obstacles, by a penalty or by Nitsche's method.

Both press with P = [λ − g/γ]₊ per area at rest along the obstacle's normal n = ∇g, g the gap of the deformed point. Penalty
takes λ from its own earlier value (zero, or augmented until the penetration is small), Nitsche from the stress in the tongue,
λ = n·PN, and adds θ γ (P − λ) n·δP N (Chouly, Hild and Renard 2015; here with the obstacle's normal at the deformed point).
The factor P − λ is nil where the conditions hold, so any δP is consistent: that of linear elasticity is taken.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from ..core.types import Floats
from ..geometry.obstacles import Obstacle
from ..geometry.rigid_motion import RigidMotion

if TYPE_CHECKING:
    pass

FORMS = ("penalty", "nitsche")


@dataclass(frozen=True)
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
    tolerance : float
        Penetration in m beyond which a step is solved again, up to five times: penalty with augmented λ, Nitsche with larger 1/γ.
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
    form: str = "nitsche"
    theta: int = 0
    stiffness: float = 1.0
    tolerance: float = 0.05e-3
    touching: float = 0.2e-3
    motion: RigidMotion | None = None

    @property
    def description(self) -> list[object]:
        """What makes the contact, in plain numbers and names."""
        motion = None if self.motion is None else asdict(self.motion)
        shape = hashlib.sha256(np.ascontiguousarray(self.obstacle.surface.points).tobytes()).hexdigest()
        return [self.form, self.theta, self.stiffness, self.tolerance, self.touching, motion, shape]

    def __post_init__(self) -> None:
        if self.form not in FORMS:
            raise InputError(f"contact.form: {self.form!r}; {' or '.join(FORMS)} is expected.")
        if self.theta not in (-1, 0, 1):
            raise InputError(f"contact.theta: {self.theta}; -1, 0 or 1 is expected.")
        for name in ("stiffness", "tolerance", "touching"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(f"contact.{name}: {getattr(self, name)}; a positive number is expected.")


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
