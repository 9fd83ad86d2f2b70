# SPDX-License-Identifier: MIT
"""Points of the rest shape whose motion is followed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import basix.ufl
import numpy as np
from dolfinx import fem, geometry

from ..core.errors import InputError
from ..core.types import Floats
from ..core.values import check_name
from ..forms.assembly import sum_over_ranks
from ..meshing.tongue_mesh import TongueMesh


class Probes:
    """Points of the rest shape whose displacement is followed.

    Parameters
    ----------
    tongue : TongueMesh
        The mesh.
    points : mapping
        Name to landmark name or coordinates (3,) in m.

    Attributes
    ----------
    rest : dict
        Name to coordinates (3,) in m.
    """

    def __init__(self, tongue: TongueMesh, points: Mapping[str, str | Any]) -> None:
        self.names = list(points)
        self.rest: dict[str, Floats] = {}
        mesh = tongue.mesh
        owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
        trees = geometry.bb_tree(mesh, 3, entities=owned), geometry.create_midpoint_tree(mesh, 3, owned) if len(owned) else None
        self._owned: list[tuple[int, int, Floats]] = []  # of each probe in a cell of this rank: its row, the cell, its shape functions
        quadratic = basix.ufl.element("P", "tetrahedron", 2)
        for index, (name, where) in enumerate(points.items()):
            check_name("probes", name)
            if isinstance(where, str):
                if where not in tongue.landmarks:
                    known = ", ".join(tongue.landmarks) or "none"
                    raise InputError(f"probes.{name}: no landmark {where!r} in the mesh; it has {known}; or give [x, y, z].")
                where = tongue.landmarks[where]
            point = np.asarray(where, dtype=float)
            if point.shape != (3,) or not np.isfinite(point).all():
                raise InputError(f"probes.{name}: three finite coordinates or the name of a landmark are expected.")
            self.rest[name] = point
            cell, reference, distance = _nearest(mesh, *trees, point)
            nearest = mesh.comm.allgather(distance)
            if min(nearest) > 1e-3:
                raise InputError(f"probes.{name}: the point lies {1e3 * min(nearest):.1f} mm outside the tongue; at most 1 mm is accepted.")
            if int(np.argmin(nearest)) == mesh.comm.rank:
                self._owned.append((index, cell, quadratic.tabulate(0, reference[None])[0][0]))

    def values(self, u: fem.Function) -> Floats:
        """Value of a quadratic vector function at the probes, (n_probe, 3), on every rank."""
        V = u.function_space
        table = np.zeros((len(self.names), 3))
        for index, cell, shape in self._owned:
            table[index] = shape @ u.x.array.reshape(-1, 3)[V.dofmap.cell_dofs(cell)]
        total = np.zeros_like(table)
        V.mesh.comm.Allreduce(table, total)
        return total

    def transposed(self, V: fem.FunctionSpace, rows: Floats) -> Floats:
        """Derivative by the owned nodal values (flat) of a function of the values at the probes, from that by these, (n_probe, 3)."""
        nodal = fem.Function(V)
        for index, cell, shape in self._owned:
            nodal.x.array.reshape(-1, 3)[V.dofmap.cell_dofs(cell)] += shape[:, None] * rows[index]
        return sum_over_ranks(nodal.x)


def _nearest(mesh: Any, tree: Any, midpoints: Any, point: Floats) -> tuple[int, Floats, float]:
    """The owned cell nearest to a point, the reference coordinates of its nearest point, and the distance."""
    if midpoints is None:
        return -1, np.zeros(3), math.inf
    cell = int(geometry.compute_closest_entity(tree, midpoints, mesh, point.reshape(1, 3))[0])
    corners = mesh.geometry.x[mesh.geometry.dofmaps[0][cell]]
    vector = geometry.compute_distance_gjk(corners, point.reshape(1, 3))
    inside = point + vector
    reference = np.linalg.solve((corners[1:] - corners[0]).T, inside - corners[0])
    return cell, reference, float(np.linalg.norm(vector))
