# SPDX-License-Identifier: MIT
"""Where the entries of cells' matrices lie in a PETSc matrix, so that they are added there without a search for each."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy import sparse

from ..core.types import Floats


class Placement:
    """The entries of a matrix that has all of them, for cells of which this rank owns all nodes.

    Parameters
    ----------
    matrix : PETSc.Mat
        AIJ, or BAIJ in blocks of three.
    V : fem.FunctionSpace
        Of its rows and columns: vectors at nodes.

    Attributes
    ----------
    inner, border : (n,) int32 array
        Cells of this rank all of whose nodes it owns, and the others.
    places : (n_inner, nodes, nodes, rows) int32 array
        Where the three by three numbers of two nodes begin among the values: in blocks of three at one place, column by column,
        otherwise at one for each row.
    """

    def __init__(self, matrix: PETSc.Mat, V: fem.FunctionSpace) -> None:
        self._own = matrix.getDiagonalBlock()
        self._kind, rows = ("SeqBAIJ", 1) if "baij" in matrix.getType() else ("SeqAIJ", 3)
        begins, columns = self._own.getRowIJ(compressed=rows == 1)
        size = (3 // rows) ** 2
        self._length = size * len(columns)
        entries = sparse.csr_array((np.arange(1, len(columns) + 1, dtype=np.int32), columns, begins))  # 0 where there is none
        dofs = V.dofmap.list[: V.mesh.topology.index_map(3).size_local]
        whole = (dofs < V.dofmap.index_map.size_local).all(axis=1)
        self.inner, self.border = (np.flatnonzero(of).astype(np.int32) for of in (whole, ~whole))
        a, b = np.broadcast_arrays(rows * dofs[self.inner, :, None], rows * dofs[self.inner, None, :])
        places = [entries[a.ravel() + i, b.ravel()].reshape(a.shape) for i in range(rows)]
        self.places: NDArray[np.int32] = size * (np.ascontiguousarray(np.stack(places, axis=-1)) - 1)
        assert self.places.min(initial=0) == 0

    @contextmanager
    def values(self) -> Iterator[Floats]:
        """The values, to be changed in place; the matrix has to be assembled before and after."""
        own, address = ctypes.c_void_p(self._own.handle), ctypes.POINTER(ctypes.c_double)()
        library = ctypes.CDLL(str(fem_petsc.get_petsc_lib()))
        getattr(library, f"Mat{self._kind}GetArray")(own, ctypes.byref(address))
        yield np.ctypeslib.as_array(address, (self._length,))
        getattr(library, f"Mat{self._kind}RestoreArray")(own, ctypes.byref(address))
