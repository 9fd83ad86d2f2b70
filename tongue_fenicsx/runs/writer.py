# SPDX-License-Identifier: MIT
"""The run folder: what a simulation writes, and how it goes on from there.

Nodes and cells are numbered in the files by the vertices of the mesh file, so a run looks the same on any number of
ranks and a checkpoint continues on any other. Only rank 0 touches files; other ranks send it what they own.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import h5py
import numpy as np
from dolfinx import fem

from ..core.errors import InputError, reading
from ..core.parallel import on_rank_zero
from ..core.types import Floats
from ..geometry.surface import Surface
from ..mechanics.contact import TOUCH_COLUMNS
from ..simulation.energy import ENERGIES, Balance
from ..solvers.time_integration import State
from .numbering import Numbering

STATE = ("u", "v", "acceleration", "auxiliary", "average", "pressure")
"""Arrays of a `State`."""

RUN_FILES = ("scenario.toml", "fields.xdmf", "fields.h5", "history.h5", "summary.json", "log.txt", "checkpoint.h5")
"""What every run folder holds; figures leave more."""


class RunWriter:
    """Writes a run folder, from rank 0, so that at any time what is on disk can be read.

    Parameters
    ----------
    folder : Path
        The run folder; it exists and is writable.
    V : fem.FunctionSpace
        Space of the displacement.
    probes : mapping
        Names of the probes to their points (3,) in m of the rest shape.
    """

    def __init__(self, folder: Path, V: fem.FunctionSpace, probes: Mapping[str, Floats]) -> None:
        self.folder, self._probes = folder, probes
        self.numbering = Numbering(V)
        self._root = V.mesh.comm.rank == 0
        self.rows: list[dict[str, Any]] = []
        self._times: list[float] = []

    def start(self, obstacles: Mapping[str, Surface]) -> None:
        """Begin a new run, with the surfaces of obstacles at rest: forget what the folder held."""
        if not self._root:
            return
        for name in ("checkpoint.h5", "history.h5", "summary.json"):
            (self.folder / name).unlink(missing_ok=True)
        with h5py.File(self.folder / "fields.h5", "w") as file:
            file["mesh/points"] = self.numbering.points
            file["mesh/cells"] = self.numbering.cells.astype(np.int32)  # type: ignore[union-attr]
            for name, surface in obstacles.items():
                surface.write(file.create_group(f"obstacles/{name}"))

    def record(self, row: dict[str, Any]) -> None:
        """Keep one time of the history: ``t``, ``probes`` (n_probe, 3), ``volume_ratio``, the energies, and by name the numbers
        of ``support`` and ``contact``."""
        self.rows.append(row)

    def write_fields(self, t: float, nodal: Mapping[str, Floats], cellwise: Mapping[str, Floats]) -> None:
        """Write fields of one time: nodal vectors (local, flat) and a number or a tensor per owned cell."""
        everything = {name: self.numbering.gather(values) for name, values in nodal.items()}
        everything |= {name: self.numbering.gather_cells(values) for name, values in cellwise.items()}
        index = len(self._times)
        self._times.append(t)
        if not self._root:
            return
        with h5py.File(self.folder / "fields.h5", "a") as file:
            for name, values in everything.items():
                file.create_dataset(f"{name}/{index:05d}", data=np.asarray(values, dtype=np.float32))
            file.attrs["time"] = self._times
        self._write_xdmf(list(nodal), {name: values.shape[1:] for name, values in cellwise.items()})
        self._write_history()

    def _write_xdmf(self, nodal: list[str], cellwise: dict[str, tuple[int, ...]]) -> None:
        assert self.numbering.points is not None
        assert self.numbering.cells is not None
        n_nodes, n_cells = len(self.numbering.points), len(self.numbering.cells)
        root = ET.Element("Xdmf", Version="3.0")
        series = ET.SubElement(ET.SubElement(root, "Domain"), "Grid", Name="tongue", GridType="Collection", CollectionType="Temporal")

        def item(parent: ET.Element, path: str, dimensions: str, kind: str, precision: str) -> None:
            data = ET.SubElement(parent, "DataItem", Dimensions=dimensions, NumberType=kind, Precision=precision, Format="HDF")
            data.text = f"fields.h5:/{path}"

        for index, t in enumerate(self._times):
            grid = ET.SubElement(series, "Grid", Name="tongue", GridType="Uniform")
            ET.SubElement(grid, "Time", Value=repr(t))
            topology = ET.SubElement(grid, "Topology", TopologyType="Tetrahedron_10", NumberOfElements=str(n_cells))
            item(topology, "mesh/cells", f"{n_cells} 10", "Int", "4")
            geometry = ET.SubElement(grid, "Geometry", GeometryType="XYZ")
            item(geometry, "mesh/points", f"{n_nodes} 3", "Float", "8")
            for name in nodal:
                attribute = ET.SubElement(grid, "Attribute", Name=name, AttributeType="Vector", Center="Node")
                item(attribute, f"{name}/{index:05d}", f"{n_nodes} 3", "Float", "4")
            for name, shape in cellwise.items():
                attribute = ET.SubElement(grid, "Attribute", Name=name, AttributeType="Tensor" if shape else "Scalar", Center="Cell")
                item(attribute, f"{name}/{index:05d}", " ".join(map(str, (n_cells, *shape))), "Float", "4")
        ET.indent(root)
        _replace(self.folder / "fields.xdmf", lambda path: ET.ElementTree(root).write(path, xml_declaration=True, encoding="utf-8"))

    def _write_history(self) -> None:
        def write(path: Path) -> None:
            with h5py.File(path, "w") as file:
                file["time"] = [row["t"] for row in self.rows]
                file["probes"] = np.array([row["probes"] for row in self.rows]).reshape(len(self.rows), -1, 3).transpose(1, 0, 2)
                file["probes"].attrs.update({"names": list(self._probes), "rest": np.reshape(list(self._probes.values()), (-1, 3))})
                file["volume_ratio"] = [row["volume_ratio"] for row in self.rows]
                for name in ENERGIES:
                    file[f"energy/{name}"] = [row[name] for row in self.rows]
                for name in self.rows[0]["support"]:
                    file[f"support/{name}"] = np.array([row["support"][name] for row in self.rows])
                for name in self.rows[0]["contact"]:
                    table = np.array([row["contact"][name] for row in self.rows])
                    for column, place in TOUCH_COLUMNS.items():
                        file[f"contact/{name}/{column}"] = table[:, place]

        _replace(self.folder / "history.h5", write)

    def write_checkpoint(self, state: State, balance: Balance, counters: Mapping[str, Any], identity: str) -> None:
        """Save the whole state; `identity` says of what problem, so that no other one continues from it."""
        fields = {name: self.numbering.gather(getattr(state, name)) for name in STATE}
        if not self._root:
            return

        def write(path: Path) -> None:
            with h5py.File(path, "w") as file:
                file.attrs.update({"t": state.t, "h": state.h, "identity": identity, "times": self._times})
                file.attrs["balance"] = json.dumps(asdict(balance))
                file.attrs["counters"] = json.dumps(counters)
                file.attrs["rows"] = len(self.rows)
                for name, values in fields.items():
                    file[name] = values

        self._write_history()
        _replace(self.folder / "checkpoint.h5", write)

    def read_checkpoint(self, identity: str) -> tuple[State, Balance, dict[str, Any]]:
        """Continue from the checkpoint of this folder.

        Raises
        ------
        InputError
            If there is none or it belongs to another problem.
        """
        stored = on_rank_zero(self.numbering._comm, lambda: self._load_checkpoint(identity))
        arrays = {name: self.numbering.scatter(values) for name, values in stored["fields"].items()}
        self._times, self.rows = stored["times"], stored["rows"]
        return State(stored["t"], stored["h"], **arrays), Balance(**stored["balance"]), stored["counters"]

    def _load_checkpoint(self, identity: str) -> dict[str, Any]:
        expected = "there is nothing to resume, so run without --resume; a whole run folder"
        path = self.folder / "checkpoint.h5"
        with reading(path, expected), h5py.File(path, "r") as file:
            if file.attrs["identity"] != identity:
                raise InputError(f"{path}: was saved by another scenario or mesh; run without --resume or in another folder.")
            stored = {
                "t": float(file.attrs["t"]),
                "h": float(file.attrs["h"]),
                "times": list(map(float, file.attrs["times"])),
                "balance": json.loads(file.attrs["balance"]),
                "counters": json.loads(file.attrs["counters"]),
                "fields": {name: file[name][:] for name in STATE},
            }
            n_rows = int(file.attrs["rows"])
            assert self.numbering.points is not None
            for name, values in stored["fields"].items():
                if values.shape != self.numbering.points.shape or not np.isfinite(values).all():
                    raise ValueError(f"{name} is damaged")
            if not np.isfinite([stored["t"], stored["h"]]).all() or not stored["balance"] or not stored["counters"]:
                raise ValueError("it is not complete")
        path = self.folder / "history.h5"
        with reading(path, expected), h5py.File(path, "r") as file:
            columns = {name: file[f"energy/{name}"][:n_rows] for name in ENERGIES}
            columns |= {"t": file["time"][:n_rows], "volume_ratio": file["volume_ratio"][:n_rows]}
            probes = file["probes"][:, :n_rows].transpose(1, 0, 2)
            support = {name: data[:n_rows] for name, data in file.get("support", {}).items()}
            contact = {
                name: np.column_stack([group[column][:n_rows] for column in TOUCH_COLUMNS])
                for name, group in file.get("contact", {}).items()
            }
        stored["rows"] = [
            {name: float(column[i]) for name, column in columns.items()}
            | {"probes": probes[i]}
            | {key: {name: rows[i] for name, rows in of.items()} for key, of in (("support", support), ("contact", contact))}
            for i in range(n_rows)
        ]
        path = self.folder / "fields.h5"
        with reading(path, expected), h5py.File(path, "r+") as file:
            if len(file["mesh/points"]) != len(self.numbering.points):
                raise ValueError("it holds another mesh")
            for key, group in file.items():
                for name in [n for n in group if key != "obstacles" and n.isdigit() and int(n) >= len(stored["times"])]:
                    del group[name]
        return stored

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the history and ``summary.json``."""
        if self._root:
            self._write_history()
            _replace(self.folder / "summary.json", lambda path: path.write_text(json.dumps(summary, indent=2) + "\n"))


def _replace(path: Path, write: Any) -> None:
    """Write a file beside its place and move it there whole."""
    partial = path.with_name(f"{path.name}.partial")
    write(partial)
    os.replace(partial, path)
