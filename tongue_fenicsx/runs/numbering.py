# SPDX-License-Identifier: MIT
"""Numbers of nodes and cells that do not depend on the ranks."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from ..core.types import Floats, Ints
from ..geometry.tetrahedron import volumes

VTK_ORDER = [0, 1, 2, 3, 9, 6, 8, 7, 5, 4]
"""Basix's ten nodes of a quadratic tetrahedron in the order of VTK and XDMF."""


class Numbering:
    """Rank-independent numbers of the nodes and cells of a quadratic space.

    Attributes
    ----------
    points : (n, 3) float array or None
        Node coordinates in m, on rank 0.
    cells : (m, 10) int array or None
        Node numbers in VTK order, on rank 0.
    """

    def __init__(self, V: fem.FunctionSpace) -> None:
        mesh = V.mesh
        self._comm = mesh.comm
        index_map = V.dofmap.index_map
        n_cells = mesh.topology.index_map(3).size_local
        nodes = V.dofmap.list[:n_cells]
        of_cell = index_map.local_to_global(nodes.ravel().astype(np.int32)).reshape(-1, 10)
        vertices = mesh.geometry.input_global_indices[mesh.geometry.dofmaps[0][:n_cells]]
        coordinates = V.tabulate_dof_coordinates()[: index_map.size_local]
        parts = self._comm.gather((of_cell, vertices, coordinates))
        number: Ints | None = None
        self.points: Floats | None = None
        self.cells: Ints | None = None
        if parts is not None:
            of_cell, vertices, coordinates = (np.concatenate(part) for part in zip(*parts, strict=True))
            number = _canonical(of_cell, vertices, index_map.size_global)
            self._number = number
            self.points = np.empty_like(coordinates)
            self.points[number] = coordinates
            cells = number[of_cell][:, VTK_ORDER]
            inverted = volumes(self.points[cells[:, :4]]) < 0
            cells[inverted] = cells[inverted][:, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
            self._cell_order = np.lexsort(np.sort(cells[:, :4], axis=1).T[::-1])
            self.cells = cells[self._cell_order]
        number = self._comm.bcast(number)
        owned_and_ghosts = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        self._local = number[index_map.local_to_global(owned_and_ghosts)]
        self._n_owned = index_map.size_local

    def gather(self, values: Floats) -> Floats | None:
        """Nodal vectors (local, with ghosts, flat) of all ranks as (n, 3) on rank 0, None elsewhere."""
        parts = self._comm.gather(values[: 3 * self._n_owned].reshape(-1, 3))
        if parts is None:
            return None
        stacked = np.concatenate(parts)
        ordered = np.empty_like(stacked)
        ordered[self._number] = stacked
        return ordered

    def gather_cells(self, values: Floats) -> Floats | None:
        """A value per owned cell of all ranks, (m, …) on rank 0, None elsewhere."""
        parts = self._comm.gather(values)
        return None if parts is None else np.concatenate(parts)[self._cell_order]

    def scatter(self, values: Floats | None) -> Floats:
        """The reverse of `gather`: local values with ghosts, flat."""
        return np.asarray(self._comm.bcast(values)[self._local]).ravel()


def _canonical(of_cell: Ints, vertices: Ints, n_nodes: int) -> Ints:
    """Number of each global node: vertices as in the mesh file, then edge midpoints by their end vertices."""
    number = np.full(n_nodes, -1, dtype=np.int64)
    kept, rank = np.unique(vertices, return_inverse=True)
    rank = rank.reshape(-1, 4)
    number[of_cell[:, :4]] = rank
    edges = [(2, 3), (1, 3), (1, 2), (0, 3), (0, 2), (0, 1)]  # of basix's nodes 4…9
    pairs = np.sort(np.stack([rank[:, list(edge)] for edge in edges], axis=1), axis=2).reshape(-1, 2)
    _, order = np.unique(pairs, axis=0, return_inverse=True)
    number[of_cell[:, 4:].ravel()] = len(kept) + order.reshape(-1)
    return number
