# SPDX-License-Identifier: MIT
"""Why a solve gave up, in a sentence: what stands out in its last iterate, and in the last good state."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from .snapshot import Sensors, Snapshot
from .strain import determinant, largest_stretch

ADVICE = "Less activation, a slower rise, a longer tendon or another element size may help"


def describe_iterate(sensors: Sensors) -> str:
    """Where and in which muscles J is smallest and the stretch largest at the present displacement, and which obstacles it is in; on all
    ranks at once."""
    weak = sensors.equations.weak
    comm, F = weak.V.mesh.comm, sensors.points.deformation_gradient()
    found = []
    for values, pick, name in ((determinant(F), np.argmin, "smallest J"), (largest_stretch(F), np.argmax, "largest stretch")):
        at = np.unravel_index(pick(values), values.shape) if values.size else None
        mine = (float(values[at]), _place(sensors, at)) if at is not None else None
        everyone = [part for part in comm.allgather(mine) if part is not None]
        value, place = (min if pick is np.argmin else max)(everyone)
        found.append(f"{name} {value:.3g} {place}")
    depths = {name: weak.contacts.penetration(term) for name, term in weak.contacts.terms.items()}
    inside = [f"{1e3 * depth:.2g} mm inside {name}" for name, depth in depths.items() if depth > 0]
    return ", ".join(found) + f" of the rest shape{''.join(f', {part}' for part in inside)}"


def _place(sensors: Sensors, at: tuple[np.intp, ...]) -> str:
    slots = sensors.equations.weak.slots
    muscles = [slots.names[owner] for owner in slots.owners[:, at[0]] if owner >= 0]
    x, y, z = 1e3 * sensors.points.places[at]
    return f"in {' and '.join(muscles) or 'tissue that no muscle pulls'} at ({x:.1f}, {y:.1f}, {z:.1f}) mm"


def advise(sensors: Sensors, now: Snapshot, levels: Mapping[str, float], quasi_static: bool) -> str:
    """What may help where the step after the last good state `now`, to other levels of the muscles, failed: in statics, muscles whose force
    falls as their fibres lengthen are named."""
    if not quasi_static:
        return ADVICE
    weak, past = sensors.equations.weak, []
    for muscle, stretch in now.per_muscle(0, 0.0).items():
        longest = weak.V.mesh.comm.allreduce(float(stretch.max(initial=0.0)), op=MPI.MAX)
        if levels[muscle] > 0 and longest > weak.model.contraction.optimal_stretch:
            past.append(f"{muscle} (stretch up to {longest:.2f})")
    if not past:
        return ADVICE
    return (
        f"Fibres of {', '.join(past)} are on the descending limb of force–length, where equilibria need not be stable or exist nearby; "
        "motion, without time.quasi_static, goes through"
    )
