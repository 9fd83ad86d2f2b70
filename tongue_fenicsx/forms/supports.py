# SPDX-License-Identifier: MIT
"""Surfaces bonded to bone: what is fixed, what moves with a bone, and what a bone on springs takes along."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from numpy.typing import NDArray

from ..core.types import Expr
from ..mechanics.model import Model
from . import jit


class Supports:
    """The bonded surfaces of a model, for a displacement.

    Parameters
    ----------
    model : Model
        Which surfaces are fixed, moving and suspended.
    u : fem.Function
        The displacement.

    Attributes
    ----------
    nodes : dict
        Bonded surface to its nodes on this rank, ghosts included.
    bcs : list of dolfinx.fem.DirichletBC
        Of the fixed and moving ones; others may be added before a solver is made.
    """

    def __init__(self, model: Model, u: fem.Function) -> None:
        self._model, self._u = model, u
        V = u.function_space
        self._prescribed = fem.Function(V)
        self.nodes = {name: fem.locate_dofs_topological(V, 2, model.tongue.facets([name])) for name in model.bonded}
        self.bcs = [fem.dirichletbc(self._prescribed, self.nodes[name]) for name in (*model.fixed, *model.moving)]

    @cached_property
    def fixed_dofs(self) -> NDArray[np.int32]:
        """Unknowns of this rank that are prescribed, (n,)."""
        owned = [bc.dof_indices()[0][: bc.dof_indices()[1]] for bc in self.bcs]
        return np.unique(np.concatenate(owned)).astype(np.int32) if owned else np.empty(0, dtype=np.int32)

    def place(self, t: float) -> None:
        """Move the bones to where they are at time `t` (s)."""
        points = self._u.function_space.tabulate_dof_coordinates()
        for name, motion in self._model.moving.items():
            nodes = self.nodes[name]
            self._prescribed.x.array.reshape(-1, 3)[nodes] = motion.displacement(points[nodes], t)

    def hold(self) -> None:
        """Put the nodes where the bones are."""
        for bc in self.bcs:
            bc.set(self._u.x.array)

    @property
    def suspended_nodes(self) -> list[NDArray[np.int32]]:
        """Nodes of each surface on springs."""
        return [self.nodes[name] for name in self._model.suspended]


class Springs:
    """Inertia and springs of the bones that are suspended, spread evenly over their surfaces.

    Parameters
    ----------
    model : Model
        Its suspensions.
    measures : list of ufl.Measure
        Of their surfaces, in the same order.
    """

    def __init__(self, model: Model, measures: list[ufl.Measure]) -> None:
        mesh = model.tongue.mesh
        self._parts = []
        for suspension, ds in zip(model.suspended.values(), measures, strict=True):
            one = fem.Constant(mesh, default_scalar_type(1.0))
            area = mesh.comm.allreduce(float(fem.assemble_scalar(jit.compile_form(one * ds, mesh.comm))))
            per_area = fem.Constant(mesh, np.array([suspension.mass, suspension.damping, suspension.stiffness]) / area)
            self._parts.append((per_area, ds))

    def weight(self, a: Expr, w: Expr) -> Expr:
        """Inner product of an acceleration with a test function, weighted by the mass; 0 without any bone."""
        return sum(per[0] * ufl.inner(a, w) * ds for per, ds in self._parts)

    def work(self, u: Expr, v: Expr, a: Expr, w: Expr) -> Expr:
        """Virtual work on `w` of inertia, dampers and springs; 0 without any bone."""
        return sum((ufl.dot(per[0] * a + per[1] * v + per[2] * u, w) * ds for per, ds in self._parts))
