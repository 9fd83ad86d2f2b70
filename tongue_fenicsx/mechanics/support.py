# SPDX-License-Identifier: MIT
"""Whether something holds a tongue: in an equilibrium each rigid motion must meet a bone or an obstacle."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from ..core.errors import InputError
from .model import Model

NEAR = 5e-3
"""Gap in m within which an obstacle may come to hold the tongue."""
FREE = 1e-6
"""Share of the strongest support below which a motion is free."""


def check_held(model: Model) -> None:
    """Make sure that no rigid motion is free; to be called by all ranks at once.

    Raises
    ------
    InputError
        With the directions in which nothing holds the tongue.
    """
    tongue = model.tongue
    if tongue.comm.allreduce(len(tongue.facets(model.bonded))) > 0:
        return
    x, (low, high) = tongue.mesh.geometry.x, tongue.box
    centre, size = (low + high) / 2, (high - low).max()
    rows = []
    for contact in model.contacts.values():
        gap, normal, _ = contact.obstacle.evaluate(x)
        near = gap < min(NEAR, tongue.comm.allreduce(gap.min(initial=np.inf), op=MPI.MIN) + NEAR)
        rows.append(np.hstack([normal, np.cross((x - centre) / size, normal)])[near])
    supports = np.concatenate([part for parts in tongue.comm.allgather(rows) for part in parts])
    stiffness, motions = np.linalg.eigh(supports.T @ supports)
    free = motions[:, stiffness <= FREE * max(stiffness[-1], 1.0)].T
    if len(free) == 0:
        return
    along = [axis for i, axis in enumerate("xyz") if np.linalg.norm(free[:, i]) > 0.7]
    about = [axis for i, axis in enumerate("xyz") if np.linalg.norm(free[:, 3 + i]) > 0.7]
    ways = [f"{what} {' and '.join(axes)}" for what, axes in (("along", along), ("about", about)) if axes]
    raise InputError(
        f"time.quasi_static: nothing holds the tongue sideways, {len(free)} rigid motions are free ({', '.join(ways) or 'oblique ones'}); "
        "an equilibrium needs a surface that is fixed or on springs (boundary.fixed, boundary.suspended), or compute in time."
    )
