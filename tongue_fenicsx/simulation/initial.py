# SPDX-License-Identifier: MIT
"""What a run begins with, if not at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from ..core.errors import InputError
from ..core.types import Floats
from ..runs.numbering import Numbering


@dataclass(frozen=True)
class Initial:
    """Displacement and velocity of each node at t = 0; those of nodes that bones hold do not count.

    Attributes
    ----------
    displacement : (n, 3) array, optional
        In m, in the order of the points of `Run.mesh`; nil without.
    velocity : (n, 3) array, optional
        In m/s; nil without.
    """

    displacement: Floats | None = None
    velocity: Floats | None = None

    @classmethod
    def gathered(cls, V: fem.FunctionSpace, displacement: Floats, velocity: Floats) -> Initial:
        """Of the values of owned nodes, flat, of each rank; on all of them."""
        numbering, comm = Numbering(V), V.mesh.comm
        return cls(*(comm.bcast(numbering.gather(values)) for values in (displacement, velocity)))

    def on(self, V: fem.FunctionSpace) -> tuple[Floats | None, Floats | None]:
        """Both on this rank, with ghosts, flat.

        Raises
        ------
        InputError
            If one has not a finite vector for each node.
        """
        given = {"displacement": self.displacement, "velocity": self.velocity}
        shape = V.dofmap.index_map.size_global, 3
        for name, values in given.items():
            if values is not None and (np.shape(values) != shape or not np.isfinite(values).all()):
                raise InputError(
                    f"initial.{name}: shape {np.shape(values)}; finite vectors {shape}, one for each point of Run.mesh, are expected."
                )
        if self.displacement is None and self.velocity is None:
            return None, None
        numbering = Numbering(V)
        u, v = (None if values is None else numbering.scatter(np.asarray(values, dtype=float)) for values in given.values())
        return u, v
