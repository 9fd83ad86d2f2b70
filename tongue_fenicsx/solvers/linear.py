# SPDX-License-Identifier: MIT
"""Linear solvers of a tangent."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from petsc4py import PETSc

from .rigid_bodies import RigidBodies

DIRECT_COARSE_MAX = 12_000
"""Coarse unknowns up to which the coarse level is factorised; beyond it is smoothed by algebraic multigrid."""
SMOOTHED = "0.7,7.0"
"""Eigenvalues of the tangent over its diagonal that the smoother damps; up to 7.7 it does not amplify. On tongues and blocks, at rest
and deformed, the largest is 3.3 to 4.0 at ν = 0.3 and 4.9 to 5.9 from 0.49 to 0.4999. (An estimate would depend on the run's past.)"""


class _Galerkin:
    """The `coarse` matrix PᵀAP of a tangent in blocks, which PETSc multiplies only without blocks."""

    def __init__(self, A: PETSc.Mat, interpolation: PETSc.Mat) -> None:
        self.interpolation, self._scalar = interpolation, PETSc.Mat()
        A.convert("aij", self._scalar)
        self.coarse = self._scalar.ptap(interpolation)

    def update(self, A: PETSc.Mat) -> None:
        """Follow a change of A."""
        A.convert("aij", self._scalar)
        self._scalar.ptap(self.interpolation, result=self.coarse)

    def destroy(self) -> None:
        """Free the matrices, on all ranks at once."""
        for item in (self.interpolation, self._scalar, self.coarse):
            item.destroy()


def _constrained_interpolation(
    coarse: fem.FunctionSpace, fine: fem.FunctionSpace, fixed: NDArray[np.int32], bodies: RigidBodies | None
) -> PETSc.Mat:
    """Interpolation that leaves fixed unknowns out, with a unit pair kept at each fixed vertex so that the coarse matrix is regular.

    Unknowns of rigid bodies are left out, too; what lies around them follows the six coarse unknowns of each.
    """
    P = fem_petsc.interpolation_matrix(coarse, fine)
    P.assemble()
    first, _ = P.getOwnershipRange()
    rows = (fixed if bodies is None else np.concatenate([fixed, bodies.dofs])).astype(PETSc.IntType) + first
    pairs = []
    for row in rows:
        columns, values = P.getRow(row)
        at = np.flatnonzero(values > 0.99)
        if len(at):
            pairs.append((row, columns[at[0]]))
    moving: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    if bodies is not None:
        follow, moving = bodies.coarse(P.createVecRight())
        P = P.matMult(follow)
    keep = P.createVecRight()
    keep.set(1.0)
    for _, column in pairs:
        if column not in moving:
            keep.setValue(column, 0.0)
    keep.assemble()
    P.diagonalScale(None, keep)
    P.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    P.zeroRows(rows, diag=0.0)
    for row, column in pairs:
        P.setValue(row, column, 1.0)
    P.assemble()
    return P
