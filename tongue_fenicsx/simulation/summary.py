# SPDX-License-Identifier: MIT
"""The standard keys of ``summary.json``; further ones are registered the same way (`quantities.summary`)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from mpi4py import MPI

from ..anatomy.catalogue import peak_stress
from ..core.memory import peak_memory
from ..core.types import Floats
from ..core.versions import circumstances, versions
from ..mechanics.hyperelasticity import numbers
from ..mechanics.model import Model
from ..runs.history import History
from ..runs.numbering import Numbering
from .quantities import SUMMARY, Quantity, summary
from .snapshot import Snapshot
from .totals import Totals


@dataclass(frozen=True)
class Ending:
    """A run that ended.

    Attributes
    ----------
    status : str
        ``done``, ``interrupted`` or ``failed``.
    model : Model
        What was simulated.
    now : Snapshot
        The last good state.
    totals : Totals
        What was counted.
    history : History
        All steps.
    numbering : Numbering
        Of nodes and cells.
    n_unknowns : int
        Of a solve.
    reason : str
        Why it failed.
    seed : int or None
        Of the design that the run is part of.
    """

    status: str
    model: Model
    now: Snapshot
    totals: Totals
    history: History
    numbering: Numbering
    n_unknowns: int
    reason: str = ""
    seed: int | None = None


def summarise(ending: Ending) -> dict[str, Any]:
    """All registered keys, on all ranks at once."""
    found: dict[str, Any] = {}
    for quantity in SUMMARY.values():
        found |= {quantity.name: quantity.evaluate(ending)}
    return found


@summary("status", unit="1", label="done, interrupted or failed")
def _status(end: Ending) -> str:
    return end.status


@summary("reason", unit="1", label="why it failed")
def _reason(end: Ending) -> str:
    return end.reason


@summary("name", unit="1", label="name of the tongue")
def _name(end: Ending) -> str:
    return end.model.tongue.name


@summary("n_nodes", unit="1", label="nodes of the quadratic mesh")
def _n_nodes(end: Ending) -> int:
    return 0 if end.numbering.points is None else len(end.numbering.points)


@summary("n_cells", unit="1", label="tetrahedra")
def _n_cells(end: Ending) -> int:
    return 0 if end.numbering.cells is None else len(end.numbering.cells)


@summary("n_dofs", unit="1", label="unknowns")
def _n_dofs(end: Ending) -> int:
    return end.n_unknowns


@summary("ranks", unit="1", label="MPI ranks")
def _ranks(end: Ending) -> int:
    return int(end.model.tongue.comm.size)


@summary("t_end", unit="s", label="time reached")
def _t_end(end: Ending) -> float:
    return end.now.t


def _total(name: str) -> Quantity:
    return Quantity(name, "s" if name.endswith("seconds") else "1", name.replace("_", " "), lambda end: getattr(end.totals, name))


SUMMARY |= {item.name: _total(item.name) for item in fields(Totals)}


@summary("peak_memory_gib", unit="GiB", label="memory of the rank that took most")
def _peak_memory(end: Ending) -> float:
    return float(end.model.tongue.comm.allreduce(peak_memory(), op=MPI.MAX))


@summary("energy_balance_error", unit="1", label="largest imbalance over the peak work")
def _energy_balance_error(end: Ending) -> float:
    return float(end.now.balance.error)


@summary("contact_force_max_N", unit="N", label="largest force of an obstacle")
def _contact_force_max(end: Ending) -> float:
    return max((of["force_max_N"] for of in _contact(end).values()), default=0.0)


@summary("contact", unit="N, m², Pa, m", label="largest force, area, pressure and penetration of each obstacle")
def _contact(end: Ending) -> dict[str, dict[str, float]]:
    def largest(name: str, part: str) -> float:
        values: Floats = end.history.column(f"contact/{name}/{part}")
        return float((values if values.ndim == 1 else np.linalg.norm(values, axis=1)).max())

    parts = {"force_max_N": "force", "area_max_m2": "area", "pressure_max_Pa": "pressure", "penetration_max_m": "penetration"}
    return {name: {key: largest(name, part) for key, part in parts.items()} for name in end.model.contacts}


@summary("probes", unit="m", label="last displacement of the probes")
def _probes(end: Ending) -> dict[str, list[float]]:
    return {name: u.tolist() for name, u in end.now.probes.items()}


@summary("model", unit="Pa, kg/m³, 1/s, s, m", label="the law and the numbers of tissue and muscles")
def _model(end: Ending) -> dict[str, Any]:
    model, tissue = end.model, end.model.tissue
    return {
        "law": type(tissue.law).__name__.lower(),
        **numbers(tissue.law),
        "nu": tissue.law.nu,
        "volumetric": tissue.law.volumetric,
        "formulation": "mixed" if model.mixed else "displacement",
        "density": tissue.density,
        "rayleigh_alpha": tissue.damping.alpha,
        "rayleigh_beta": tissue.damping.beta,
        "force_velocity": model.contraction.force_velocity,
        "tendon_length_m": model.contraction.tendon_length,
        "sigma_max": peak_stress(end.now.levels, tissue.peak_stress),
    }


@summary("record", unit="1", label="what computed, when and how it was called")
def _record(end: Ending) -> dict[str, Any]:
    return circumstances() | {"seed": end.seed}


@summary("versions", unit="1", label="versions of what computed")
def _versions(end: Ending) -> dict[str, str]:
    return versions()
