# SPDX-License-Identifier: MIT
"""What contact does: its forces, areas and pressures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from ..core.types import Expr, Floats
from ..mechanics.contact import Touch
from .assembly import assemble
from .weak_form import WeakForm


@dataclass(frozen=True)
class ContactState:
    """What contact does in one state: `touches` by obstacle, `forces` (owned nodes, 3) in N, `pressure` (owned cells,) in Pa."""

    touches: dict[str, Touch]
    forces: Floats
    pressure: Floats


class ContactMeasures:
    """Force, area and pressure of contact at the state of a weak form.

    Parameters
    ----------
    weak : WeakForm
        The weak form.
    v : Expr
        Velocity.
    """

    def __init__(self, weak: WeakForm, v: Expr) -> None:
        self._weak = weak
        mesh = weak.V.mesh
        self._comm = mesh.comm
        F = ufl.Identity(3) + ufl.grad(weak.u)
        N, ds = ufl.FacetNormal(mesh), weak.ds_contact
        cofactor = ufl.det(F) * ufl.inv(F).T * N
        stretch = ufl.sqrt(ufl.dot(cofactor, cofactor))
        w, q = ufl.TestFunction(weak.V), ufl.TestFunction(fem.functionspace(mesh, ("DG", 0)))

        def pressure(name: str) -> Expr:
            term = weak.contacts.terms[name]
            stress = weak.surface_stress(weak.u, v) if term.contact.form == "nitsche" else None
            return term.pressure(term.traction(stress, N))

        self._forces = weak.compile_contacts(lambda name: pressure(name) * ufl.dot(weak.contacts.terms[name].normal, w) * ds)
        self._loads = weak.compile_contacts(lambda name: pressure(name) * q * ds)
        self._areas = weak.compile_contacts(lambda name: ufl.conditional(ufl.gt(pressure(name), 0.0), stretch, 0.0) * q * ds)

    def evaluate(self) -> ContactState:
        """The present state."""
        V = self._weak.V
        total = np.zeros((V.dofmap.index_map.size_local, 3))
        pressures = np.zeros(V.mesh.topology.index_map(3).size_local)
        touches: dict[str, Touch] = {}
        for name, term in self._weak.contacts.terms.items():
            forces = assemble(self._forces[name]).reshape(-1, 3)
            load, area = assemble(self._loads[name]), assemble(self._areas[name])
            pressure = np.divide(load, area, out=np.zeros_like(load), where=area > 0)
            total += forces
            pressures += pressure
            touches[name] = Touch(
                np.asarray(self._comm.allreduce(forces.sum(axis=0))),
                float(self._comm.allreduce(float(area.sum()))),
                float(self._comm.allreduce(float(pressure.max(initial=0.0)), op=MPI.MAX)),
                self._weak.contacts.penetration(term),
                term.placed.rotation,
                term.placed.offset,
            )
        return ContactState(touches, total, pressures)
