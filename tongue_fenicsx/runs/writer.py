# SPDX-License-Identifier: MIT
"""The run folder: what a simulation writes, and how it goes on from there.

Nodes and cells are numbered in the files by the vertices of the mesh file, so a run looks the same on any number of
ranks and a checkpoint continues on any other. Only rank 0 touches files; other ranks send it what they own.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import h5py
import numpy as np
from dolfinx import fem

from ..core.errors import InputError
from ..core.parallel import on_rank_zero
from ..core.types import Floats
from ..geometry.surface import Surface
from . import checkpoint as checkpoints
from . import history as histories
from . import xdmf
from .checkpoint import Checkpoint, Identity
from .history import History, Row, read_rows
from .numbering import Numbering
from .store import Store

FIELDS, SUMMARY, SCENARIO, LOG = "fields.h5", "summary.json", "scenario.toml", "log.txt"
RUN_FILES = (SCENARIO, FIELDS, xdmf.FILE, histories.FILE, SUMMARY, LOG, checkpoints.FILE)
"""What a run folder holds beside tables and figures."""


class RunWriter:
    """Writes a run, from rank 0, so that at any time what is stored can be read.

    Parameters
    ----------
    store : Store
        Where.
    V : fem.FunctionSpace
        Space of the displacement.
    probes : mapping
        Names of the probes to their points (3,) in m of the rest shape.
    identity : callable or None
        Of a time in s: fingerprint of each part of the problem up to there; without one no checkpoint is kept.

    Attributes
    ----------
    history : History
        Of all steps, on every rank.
    """

    def __init__(self, store: Store, V: fem.FunctionSpace, probes: Mapping[str, Floats], identity: Identity | None) -> None:
        self.store, self.history, self._identity = store, History(probes), identity
        self.numbering = Numbering(V)
        self._comm = V.mesh.comm
        self._times: list[float] = []

    def start(self, obstacles: Mapping[str, Surface]) -> None:
        """Begin a new run, with the surfaces of obstacles at rest: forget what the store held."""

        def begin() -> None:
            assert self.numbering.cells is not None
            for name in (checkpoints.FILE, histories.FILE, SUMMARY):
                self.store.remove(name)
            with self.store.open(FIELDS, "w") as file:
                file["mesh/points"] = self.numbering.points
                file["mesh/cells"] = self.numbering.cells.astype(np.int32)
                for name, surface in obstacles.items():
                    surface.write(file.create_group(f"obstacles/{name}"))

        on_rank_zero(self._comm, begin)

    def record(self, row: Row) -> None:
        """Keep one time of the history."""
        self.history.append(row)

    def write_fields(self, t: float, nodal: Mapping[str, Floats], cellwise: Mapping[str, Floats]) -> None:
        """Write fields of one time: nodal vectors (local, flat) and a number or a tensor per owned cell; and the history so far."""
        gathered = {name: self.numbering.gather(values) for name, values in nodal.items()}
        gathered |= {name: self.numbering.gather_cells(values) for name, values in cellwise.items()}
        index = len(self._times)
        self._times.append(t)

        def write() -> None:
            fields: dict[str, tuple[str, tuple[int, ...]]] = {}
            with self.store.open(FIELDS, "a") as file:
                for name, values in gathered.items():
                    assert values is not None
                    file.create_dataset(f"{name}/{index:05d}", data=np.asarray(values, dtype=np.float32))
                    fields[name] = "Node" if name in nodal else "Cell", values.shape[1:]
                file.attrs["time"] = self._times
            assert self.numbering.points is not None
            assert self.numbering.cells is not None
            xdmf.write_xdmf(self.store, FIELDS, self._times, len(self.numbering.points), len(self.numbering.cells), fields)
            self.history.write(self.store)

        on_rank_zero(self._comm, write)

    def write_checkpoint(self, numbers: dict[str, Any], arrays: Mapping[str, Floats], progress: Mapping[str, Any]) -> None:
        """Save the whole state; `arrays` are local and flat (see `Checkpoint`)."""
        if self._identity is None:
            return
        identity = self._identity(numbers["t"])
        gathered = {name: self.numbering.gather(values) for name, values in arrays.items()}

        def write() -> None:
            self.history.write(self.store)
            kept = {name: values for name, values in gathered.items() if values is not None}
            Checkpoint(identity, numbers, kept, progress, self._times, len(self.history.rows)).write(self.store)

        on_rank_zero(self._comm, write)

    def read_checkpoint(self) -> Checkpoint:
        """Go on from the checkpoint of this store; its arrays are local and flat.

        Raises
        ------
        InputError
            If there is none, it belongs to another problem, or a file is damaged.
        """
        found: Checkpoint
        found, self.history.rows = on_rank_zero(self._comm, self._load)
        self._times = found.times
        return replace(found, arrays={name: self.numbering.scatter(values) for name, values in found.arrays.items()})

    def _load(self) -> tuple[Checkpoint, list[Row]]:
        assert self._identity is not None
        assert self.numbering.points is not None
        n_nodes, name = len(self.numbering.points), checkpoints.FILE
        try:
            found = Checkpoint.read(self.store, self._identity, n_nodes)
            name = histories.FILE
            rows = read_rows(self.store, found.n_rows)
            name = FIELDS
            with self.store.open(FIELDS, "r+") as file:
                if len(file["mesh/points"]) != n_nodes:
                    raise ValueError("it holds another mesh")
                _forget_outputs(file, len(found.times))
        except InputError:
            raise
        except (OSError, ValueError, KeyError, TypeError) as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"{name}: cannot be read ({reason}); there is nothing to resume, so run without --resume; a whole run folder is expected."
            ) from error
        return found, rows

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the history and ``summary.json``."""

        def write() -> None:
            self.history.write(self.store)
            self.store.replace(SUMMARY, lambda target: _write_text(target, json.dumps(summary, indent=2) + "\n"))

        on_rank_zero(self._comm, write)


def _forget_outputs(file: h5py.File, n_outputs: int) -> None:
    """Remove fields that were written after the checkpoint."""
    for key, group in file.items():
        for name in [n for n in group if key != "obstacles" and n.isdigit() and int(n) >= n_outputs]:
            del group[name]


def _write_text(target: Any, text: str) -> None:
    if hasattr(target, "write"):
        target.write(text.encode())
    else:
        target.write_text(text, encoding="utf-8")
