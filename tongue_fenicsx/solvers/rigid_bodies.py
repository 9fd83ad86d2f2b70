# SPDX-License-Identifier: MIT
"""x"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.spatial.transform import Rotation

from ..core.errors import InputError
from ..core.types import Floats, Ints

LEVER = 0.01
"""In m: what a rotation of one radian counts as."""


class RigidBodies:
    """All surfaces of a displacement space that stay rigid, as unknowns of a solve.

    Parameters
    ----------
    V, coarse : fem.FunctionSpace
        Quadratic and linear displacement on the same mesh.
    surfaces : list of int array
        Local nodes of `V` on each surface, with ghosts.
    x : PETSc.Vec
        Unknowns of a solve; on each rank the displacement comes first.

    Raises
    ------
    InputError
        If a surface has too few vertices to be a bone.
    """

    def __init__(self, V: fem.FunctionSpace, coarse: fem.FunctionSpace, surfaces: list[NDArray[np.int32]], x: PETSc.Vec) -> None:
        self._comm = V.mesh.comm
        self._surfaces = [_RigidSurface(V, coarse, nodes) for nodes in surfaces]
        parts = [surface.fine for surface in self._surfaces]
        self._transformation = _Transformation(x, parts)
        self._forces = x.duplicate()

    def destroy(self) -> None:
        """Free the PETSc objects, on all ranks at once."""
        for item in (self._transformation.matrix, self._forces):
            item.destroy()

    def reduce(self, A: PETSc.Mat) -> PETSc.Mat:
        """A matrix for the reduced tangent, from the assembled tangent of all nodes."""
        reduced = A.ptap(self._transformation.matrix)
        reduced.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        return reduced

    def begin(self, u: Floats, x: PETSc.Vec) -> None:
        """Start a solve from displacements `u` (local nodes, 3) in m: the rigid places nearest to them have the unknowns zero."""
        for surface in self._surfaces:
            surface.begin(u)
            x.array[surface.fine.dofs] = 0.0

    def place(self, x: PETSc.Vec, u: Floats) -> None:
        """Write the displacements of the surfaces into `u` (local nodes, 3), ghosts too."""
        for surface in self._surfaces:
            six = np.where(surface.fine.masters >= 0, x.array_r[surface.fine.masters], 0.0)
            u[surface.nodes] = surface.place(self._comm.allreduce(six))

    def residual(self, b: PETSc.Vec) -> None:
        """Turn a residual of all nodes, in N, into that of the reduced unknowns."""
        b.copy(self._forces)
        self._transformation.set([surface.derivative() for surface in self._surfaces])
        self._transformation.matrix.multTranspose(self._forces, b)
        b.array[self._transformation.slaves] = 0.0

    def tangent(self, A: PETSc.Mat, reduced: PETSc.Mat) -> None:
        """Write the reduced tangent, of that of all nodes and the residual that was last reduced."""
        t = self._transformation
        A.ptap(t.matrix, result=reduced)
        for surface, columns in zip(self._surfaces, t.columns, strict=True):
            added = surface.bending(self._forces.array_r[surface.fine.dofs].reshape(-1, 3))
            if self._comm.rank == 0:
                reduced.setValues(columns, columns, added, addv=True)
        reduced.assemble()
        reduced.zeroRowsColumns(t.slaves + t.first)

    def nodal(self, x: PETSc.Vec) -> PETSc.Vec:
        """T x, with the T of the residual that was last reduced."""
        full = x.duplicate()
        self._transformation.matrix.mult(x, full)
        return full

    def coarse(self, like: PETSc.Vec) -> tuple[PETSc.Mat, Ints]:
        """T at rest for the linear space, whose vectors are like `like`, and the global columns of the six of all surfaces."""
        parts = [surface.coarse for surface in self._surfaces]
        transformation = _Transformation(like, parts)
        transformation.set([_rigid_modes(part.arms, np.eye(3)) for part in parts])
        return transformation.matrix, np.concatenate(transformation.columns)

    @property
    def dofs(self) -> Ints:
        """Owned unknowns of all surfaces."""
        return np.concatenate([surface.fine.dofs for surface in self._surfaces])


@dataclass(frozen=True)
class _Part:
    """A rigid surface in one space, on this rank: its owned nodes, their arms (n, 3) from its middle at rest in m, and the six
    unknowns that hold its place, -1 where another rank has them."""

    nodes: Ints
    arms: Floats
    masters: Ints

    @property
    def dofs(self) -> Ints:
        return np.asarray((3 * self.nodes[:, None] + np.arange(3)).ravel())


class _RigidSurface:
    """Where one surface is; `fine` and `coarse` are its nodes in both spaces."""

    def __init__(self, V: fem.FunctionSpace, coarse: fem.FunctionSpace, nodes: NDArray[np.int32]) -> None:
        self._comm = V.mesh.comm
        index_map = V.dofmap.index_map
        self.nodes = nodes
        points = V.tabulate_dof_coordinates()
        vertex = np.full(index_map.size_local + index_map.num_ghosts, -1, dtype=np.int64)  # the same node of the linear space
        vertex[V.dofmap.list[:, :4]] = coarse.dofmap.list
        self._owned = nodes < index_map.size_local
        owned = nodes[self._owned].astype(np.int64)
        vertices = owned[vertex[owned] >= 0]
        everyone = self._comm.allgather(points[vertices])
        found = np.vstack(everyone)
        if len(found) < 3:
            raise InputError("boundary.suspended: the surface has fewer than three vertices; one that can turn as a bone does is expected.")
        middle = found.mean(axis=0)
        self._rest, self._arms = points[nodes], points[nodes] - middle
        mine = np.arange(len(found)) - sum(map(len, everyone[: self._comm.rank]))
        masters = [vertices[i] if 0 <= i < len(vertices) else -1 for i in mine[[0, -1]]]
        self.fine = _Part(owned, points[owned] - middle, _components(masters))
        self.coarse = _Part(vertex[vertices], points[vertices] - middle, _components([vertex[m] if m >= 0 else -1 for m in masters]))

    def begin(self, u: Floats) -> None:
        """Start from the rigid place nearest to displacements `u` (Kabsch 1976)."""
        arms = self.fine.arms
        now = self._rest[self._owned] + u[self.fine.nodes]
        n, before, after = (self._comm.allreduce(part) for part in (len(arms), arms.sum(axis=0), now.sum(axis=0)))
        spread = self._comm.allreduce((arms - before / n).T @ (now - after / n))
        left, _, right = np.linalg.svd(spread)
        self._turn = (left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right).T
        self._middle = after / n - self._turn @ before / n

    def place(self, six: Floats) -> Floats:
        """Displacement (n, 3) in m of the local nodes for the six unknowns; remembers where they are."""
        self._spin = Rotation.from_rotvec(six[3:] / LEVER)
        self._present = self._spin.apply(self._arms @ self._turn.T)
        return np.asarray(self._middle + six[:3] + self._present - self._rest)

    def derivative(self) -> Floats:
        """Derivative (n, 3, 6) of the owned nodes' displacements by the six unknowns."""
        w = self._spin.as_rotvec()
        W, angle = _cross(w), np.linalg.norm(w)
        a, b = ((1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3) if angle > 1e-4 else (0.5, 1 / 6)
        return _rigid_modes(self._present[self._owned], np.eye(3) + a * W + b * W @ W)

    def bending(self, forces: Floats) -> Floats:
        """What forces (n, 3) in N on the owned nodes add to the tangent, (6, 6) in N/m, as they turn about the middle."""
        moment = self._comm.allreduce(self._present[self._owned].T @ forces)
        added = np.zeros((6, 6))
        added[3:, 3:] = ((moment + moment.T) / 2 - np.trace(moment) * np.eye(3)) / LEVER**2
        return added


class _Transformation:
    """The sparse `matrix` T from reduced to nodal unknowns, u = T x to first order.

    `first` is the first row of this rank, `slaves` its unknowns that are left without meaning, `columns` where the six of each
    surface stand.
    """

    def __init__(self, like: PETSc.Vec, parts: list[_Part]) -> None:
        comm = like.getComm().tompi4py()
        self.first, last = like.getOwnershipRange()
        self._parts = parts
        held = [comm.allgather(np.where(p.masters >= 0, p.masters + self.first, -1)) for p in parts]
        self.columns = [np.max(ranks, axis=0).astype(PETSc.IntType) for ranks in held]
        n = last - self.first
        surface, own = np.full(n, -1), np.ones(n, dtype=bool)
        for i, part in enumerate(parts):
            surface[part.dofs] = i
            own[part.masters[part.masters >= 0]] = False
        self.slaves = np.flatnonzero((surface >= 0) & own).astype(PETSc.IntType)
        ends = np.cumsum(own + 6 * (surface >= 0))
        indices = np.zeros(ends[-1] if n else 0, dtype=PETSc.IntType)
        begins = ends - own - 6 * (surface >= 0)
        indices[begins[own]] = np.flatnonzero(own) + self.first
        for i, columns in enumerate(self.columns):
            indices[(begins + own)[surface == i][:, None] + np.arange(6)] = columns
        size = (n, like.getSize())
        csr = (np.r_[0, ends].astype(PETSc.IntType), indices, np.ones(len(indices)))
        self.matrix = PETSc.Mat().createAIJ((size, size), csr=csr, comm=like.getComm())

    def set(self, derivatives: list[Floats]) -> None:
        """Give it the derivatives (n, 3, 6) of the nodes of each surface by its six unknowns."""
        for part, columns, derivative in zip(self._parts, self.columns, derivatives, strict=True):
            for row, values in zip((part.dofs + self.first).astype(PETSc.IntType), derivative.reshape(-1, 6), strict=True):
                self.matrix.setValues(row, columns, values)
        self.matrix.assemble()


def _components(nodes: list[int]) -> Ints:
    """The three unknowns of each node, -1 for a node that is not here."""
    return np.array([3 * node + c if node >= 0 else -1 for node in nodes for c in range(3)])


def _cross(w: Floats) -> Floats:
    """The matrix of the cross product with (…, 3)."""
    return np.cross(w[..., None, :], np.eye(3)).swapaxes(-1, -2)


def _rigid_modes(arms: Floats, left: Floats) -> Floats:
    """Derivative (n, 3, 6) of rigidly moved arms (n, 3); `left` is the left Jacobian of the rotation vector."""
    translation = np.broadcast_to(np.eye(3), (len(arms), 3, 3))
    return np.concatenate([translation, -_cross(arms) @ left / LEVER], axis=2)
