# SPDX-License-Identifier: MIT
"""The standard fields of a run; further ones are registered the same way (`quantities.field`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import strain
from .quantities import field

if TYPE_CHECKING:
    from ..core.types import Floats
    from .snapshot import Snapshot


@field("displacement", unit="m", label="displacement", centre="Node", default=True)
def _displacement(now: Snapshot) -> Floats:
    return now.u


@field("velocity", unit="m/s", label="velocity", centre="Node", default=True)
def _velocity(now: Snapshot) -> Floats:
    return now.v


@field("hencky_von_mises", unit="1", label="von Mises measure of the Hencky strain", default=True)
def _hencky_von_mises(now: Snapshot) -> Floats:
    return now.mean(now.hencky_von_mises)


@field("jacobian", unit="1", label="present volume over rest volume J", default=True)
def _jacobian(now: Snapshot) -> Floats:
    return now.mean(now.J)


@field("contact_pressure", unit="Pa", label="pressure of contact", default=True)
def _contact_pressure(now: Snapshot) -> Floats | None:
    return now.contact.pressure if now.touches else None


@field("hencky", unit="1", label="Hencky strain")
def _hencky(now: Snapshot) -> Floats:
    return now.mean(strain.hencky(now.F))


@field("cauchy", unit="Pa", label="Cauchy stress of tissue, muscles and damping")
def _cauchy(now: Snapshot) -> Floats:
    return now.mean(now.evaluate("cauchy", lambda weak, u, v: weak.cauchy_stress(u, v))).reshape(-1, 3, 3)


@field("fibre_stretch", unit="1", label="fibre stretch λ̄ of a muscle, 1 outside it")
def _fibre_stretch(now: Snapshot) -> dict[str, Floats]:
    return now.per_muscle(0, elsewhere=1.0)


@field("fibre_rate", unit="1/s", label="rate of the fibre stretch of a muscle")
def _fibre_rate(now: Snapshot) -> dict[str, Floats]:
    return now.per_muscle(1, elsewhere=0.0)


@field("active_stress", unit="Pa", label="active Cauchy stress along the fibres of a muscle")
def _active_stress(now: Snapshot) -> dict[str, Floats]:
    return now.per_muscle(2, elsewhere=0.0)
