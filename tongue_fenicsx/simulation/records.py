# SPDX-License-Identifier: MIT
"""The standard history of a run; further quantities are registered the same way (`quantities.history`)."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from .energy import ENERGIES
from .quantities import history

if TYPE_CHECKING:
    from ..core.types import Floats
    from .snapshot import Snapshot


@history("time", unit="s", label="time")
def _time(now: Snapshot) -> float:
    return now.t


@history("probes", unit="m", label="displacement of the probes")
def _probes(now: Snapshot) -> Floats:
    return np.array(list(now.probes.values())).reshape(-1, 3)


@history("volume_ratio", unit="1", label="present volume over rest volume")
def _volume_ratio(now: Snapshot) -> float:
    return now.volume_ratio


@history("energy", unit="J", label="energies, and works since the start")
def _energy(now: Snapshot) -> dict[str, float]:
    found = asdict(now.balance)
    return {name: found[name] for name in ENERGIES}


@history("activation", unit="1", label="activation of the muscles")
def _activation(now: Snapshot) -> dict[str, float]:
    return dict(now.levels)


@history("support", unit="N", label="force of each bone on the tongue")
def _support(now: Snapshot) -> dict[str, Floats]:
    return now.support_forces


@history("contact", unit="N, m², Pa, m", label="what each obstacle does, and where it is")
def _contact(now: Snapshot) -> dict[str, Floats | float]:
    return {f"{name}/{part}": value for name, touch in now.touches.items() for part, value in touch.parts.items()}
