# SPDX-License-Identifier: MIT
"""The run folder: what a simulation writes, and how it goes on from there.

Nodes and cells are numbered in the files by the vertices of the mesh file, so a run looks the same on any number of
ranks and a checkpoint continues on any other. Only rank 0 touches files; other ranks send it what they own.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import h5py
import numpy as np
from dolfinx import fem

from ..core.errors import InputError, SolveError
from ..core.parallel import on_rank_zero
from ..core.types import Floats, Ints
from ..geometry.surface import Surface
from . import checkpoint as checkpoints
from . import history as histories
from . import xdmf
from .checkpoint import Checkpoint, Identity
from .history import History, Row
from .numbering import Numbering
from .reserved import Reserved, reserve
from .store import Store

FIELDS, SUMMARY, LOG = "fields.h5", "summary.json", "log.txt"
RUN_FILES = (FIELDS, xdmf.FILE, histories.FILE, SUMMARY, LOG, checkpoints.FILE)
"""What a run folder holds beside what made it, tables and figures."""
LEFT_BEFORE = (xdmf.FILE, histories.FILE, SUMMARY, checkpoints.FILE)
"""What a new run, whose fields are in place, must not find of an earlier one."""


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
        self.store, self.history, self._identity = store, History(store, probes), identity
        self.numbering = Numbering(V)
        self._comm = V.mesh.comm
        self._fields = Reserved(store, FIELDS)
        if self._comm.rank == 0:
            self._index = xdmf.Index(store, FIELDS, len(self._points), len(self._cells))
        self._times: list[float] = []
        self._shapes: xdmf.Fields = {}

    def begin(self, times: Sequence[float], obstacles: Mapping[str, Surface], prepare: Callable[[], object]) -> None:
        """Begin a new run that is to store fields at `times` (s), with the surfaces of obstacles at rest; when its first fields are known
        and there is room for all of them, `prepare` takes out of the store what it held, on rank 0."""
        self._planned, self._obstacles, self._prepare = times, obstacles, prepare

    def go_on(self, times: Sequence[float]) -> None:
        """Go on with a run that was read, to store fields at `times` (s) in all.

        Raises
        ------
        InputError
            If there is no room for them.
        """
        self._planned = times
        on_rank_zero(self._comm, self._widen)

    def record(self, row: Row) -> None:
        """Keep one time of the history."""
        self.history.append(row)

    def write_fields(self, t: float, nodal: Mapping[str, Floats], cellwise: Mapping[str, Floats]) -> None:
        """Write fields of one time: nodal vectors (local, flat) and a number or a tensor per owned cell; and the history so far.

        Raises
        ------
        InputError
            If there is no room for the first ones.
        SolveError
            If later ones cannot be written.
        """
        gathered = {name: self.numbering.gather(values) for name, values in nodal.items()}
        gathered |= {name: self.numbering.gather_cells(values) for name, values in cellwise.items()}

        def write() -> None:
            shapes = {name: ("Node" if name in nodal else "Cell", np.asarray(values).shape[1:]) for name, values in gathered.items()}
            if not self._times:
                self._make(shapes, self._begin_file)
                self._prepare()
                self._index.begin([], shapes)
            elif shapes != self._shapes:
                raise InputError(
                    f"fields: {', '.join(shapes)} at t = {t:g} s, {', '.join(self._shapes)} before; the same ones are expected."
                )
            index = len(self._times)
            with self._writing():
                for name, values in gathered.items():
                    self._fields.fill(f"{name}/{index:05d}", np.asarray(values))
                self._fields.fill("time", t, index)
                self._index.append(index, t, shapes)
                self.history.write()

        on_rank_zero(self._comm, write)
        self._times.append(t)

    def _make(self, shapes: xdmf.Fields, first: Callable[[h5py.File], object]) -> None:
        """Make the file of fields with room for all that is planned, and what comes `first`."""
        times, self._shapes = self._planned, shapes
        count = {"Node": len(self._points), "Cell": len(self._cells)}
        room = sum(4 * count[centre] * math.prod(shape) for centre, shape in shapes.values()) * len(times)

        def write(file: h5py.File) -> None:
            file["time"] = np.full(len(times), np.nan)
            for name, (centre, shape) in shapes.items():
                file.create_group(name).attrs["centre"] = centre
                for index in range(len(times)):
                    reserve(file, f"{name}/{index:05d}", (count[centre], *shape), np.float32)
            first(file)
            self._fields.note(file)

        try:
            self.store.make(FIELDS, write, room)
        except OSError as error:
            raise InputError(
                f"{FIELDS}: {len(times)} outputs of {room / len(times) / 1e6:.1f} MB cannot be written ({error.strerror or error}); "
                "give a folder with more room, or a longer output.every."
            ) from error

    def _begin_file(self, file: h5py.File) -> None:
        file["mesh/points"], file["mesh/cells"] = self._points, self._cells.astype(np.int32)
        for name, surface in self._obstacles.items():
            surface.write(file.create_group(f"obstacles/{name}"))

    def _widen(self) -> None:
        """Make room for what is planned beyond what the file has room for; outputs after those that count become room again."""
        with self.store.open(FIELDS) as old:
            n, room = len(self._times), len(old["time"])

            def copy(file: h5py.File) -> None:
                for name in ("mesh", "obstacles"):
                    if name in old:
                        old.copy(name, file)
                for name in self._shapes:
                    for index in range(n):
                        file[f"{name}/{index:05d}"][...] = old[f"{name}/{index:05d}"][...]
                file["time"][:n] = self._times

            if room < len(self._planned):
                self._make(self._shapes, copy)
            else:
                self._fields.fill("time", np.full(room - n, np.nan), n)
        self._index.begin(self._times, self._shapes)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Say in one sentence that results cannot be written."""
        try:
            yield
        except OSError as error:
            raise SolveError(
                f"{error.filename or 'the run'}: cannot be written ({error.strerror or error}); what was stored before can be read, and "
                "--resume goes on from there when there is room."
            ) from error

    @property
    def _points(self) -> Floats:
        assert self.numbering.points is not None
        return self.numbering.points

    @property
    def _cells(self) -> Ints:
        assert self.numbering.cells is not None
        return self.numbering.cells

    def write_checkpoint(self, numbers: dict[str, Any], arrays: Mapping[str, Floats], progress: Mapping[str, Any]) -> None:
        """Save the whole state; `arrays` are local and flat (see `Checkpoint`)."""
        if self._identity is None:
            return
        identity = self._identity(numbers["t"])
        gathered = {name: self.numbering.gather(values) for name, values in arrays.items()}

        def write() -> None:
            kept = {name: values for name, values in gathered.items() if values is not None}
            with self._writing():
                self.history.write()
                Checkpoint(identity, numbers, kept, progress, self._times, self.history.n_rows).write(self.store)

        on_rank_zero(self._comm, write)

    def read_checkpoint(self) -> Checkpoint:
        """Go on from the checkpoint of this store; its arrays are local and flat.

        Raises
        ------
        InputError
            If there is none, it belongs to another problem, or a file is damaged.
        """
        found: Checkpoint
        found, self.history = on_rank_zero(self._comm, self._load)
        self._times = found.times
        return replace(found, arrays={name: self.numbering.scatter(values) for name, values in found.arrays.items()})

    def _load(self) -> tuple[Checkpoint, History]:
        assert self._identity is not None
        name = checkpoints.FILE
        try:
            found = Checkpoint.read(self.store, self._identity, len(self._points))
            name = histories.FILE
            self.history.read(found.n_rows)
            name = FIELDS
            with self.store.open(FIELDS) as file:
                if len(file["mesh/points"]) != len(self._points):
                    raise ValueError("it holds another mesh")
                if np.isfinite(file["time"][: len(found.times)]).sum() < len(found.times):
                    raise ValueError("it has fewer times than the checkpoint")
                groups = {key: group for key, group in file.items() if "centre" in group.attrs}
                self._shapes = {key: (group.attrs["centre"], group["00000"].shape[1:]) for key, group in groups.items()}
                self._fields.note(file)
        except InputError:
            raise
        except FileNotFoundError as error:
            raise InputError(f"nothing to resume, as {name} is not there; run without --resume.") from error
        except (OSError, ValueError, KeyError, TypeError) as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"{name}: cannot be read ({reason}); there is nothing to resume, so run without --resume; a whole run folder is expected."
            ) from error
        return found, self.history

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the history and ``summary.json``."""

        def write() -> None:
            with self._writing():
                self.history.close()
                self.store.replace(SUMMARY, lambda target: target.write((json.dumps(summary, indent=2) + "\n").encode()))

        on_rank_zero(self._comm, write)
