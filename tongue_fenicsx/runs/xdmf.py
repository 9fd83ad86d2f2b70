# SPDX-License-Identifier: MIT
"""``fields.xdmf``: what ParaView reads to find its way in ``fields.h5``."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as ET

from .store import Store

FILE = "fields.xdmf"
HEAD = b"""<?xml version="1.0" encoding="utf-8"?>
<Xdmf Version="3.0">
<Domain>
<Grid Name="tongue" GridType="Collection" CollectionType="Temporal">
"""
TAIL = b"""
</Grid>
</Domain>
</Xdmf>
"""

Fields = Mapping[str, tuple[str, tuple[int, ...]]]
"""Name of each field to ``Node`` or ``Cell`` and the shape of a value."""


class Index:
    """The index of fields over time, to which times are appended.

    Parameters
    ----------
    store : Store
        Where.
    data : str
        Name of the HDF5 file beside it, with ``mesh/points``, ``mesh/cells`` and each field as ``NAME/00000``, ``NAME/00001``, …
    n_nodes, n_cells : int
        Of the quadratic mesh.
    """

    def __init__(self, store: Store, data: str, n_nodes: int, n_cells: int) -> None:
        self._store, self._data, self._n_nodes, self._n_cells = store, data, n_nodes, n_cells
        self._end = len(HEAD)

    def begin(self, times: list[float], fields: Fields) -> None:
        """Begin with the first outputs, at these times in s."""
        grids = b"".join(self._grid(index, t, fields) for index, t in enumerate(times))
        self._store.replace(FILE, lambda target: target.write(HEAD + grids + TAIL))
        self._end = len(HEAD + grids)

    def append(self, index: int, t: float, fields: Fields) -> None:
        """Add the output of number `index`, at `t` (s)."""
        grid = self._grid(index, t, fields)
        self._store.write_at(FILE, self._end, grid + TAIL)
        self._end += len(grid)

    def _grid(self, index: int, t: float, fields: Fields) -> bytes:
        grid = ET.Element("Grid", Name="tongue", GridType="Uniform")
        ET.SubElement(grid, "Time", Value=repr(t))

        def point(parent: ET.Element, path: str, dimensions: str, kind: str, precision: str) -> None:
            item = ET.SubElement(parent, "DataItem", Dimensions=dimensions, NumberType=kind, Precision=precision, Format="HDF")
            item.text = f"{self._data}:/{path}"

        topology = ET.SubElement(grid, "Topology", TopologyType="Tetrahedron_10", NumberOfElements=str(self._n_cells))
        point(topology, "mesh/cells", f"{self._n_cells} 10", "Int", "4")
        geometry = ET.SubElement(grid, "Geometry", GeometryType="XYZ")
        point(geometry, "mesh/points", f"{self._n_nodes} 3", "Float", "8")
        for name, (centre, shape) in fields.items():
            kind = {0: "Scalar", 1: "Vector", 2: "Tensor"}[len(shape)]
            attribute = ET.SubElement(grid, "Attribute", Name=name, AttributeType=kind, Center=centre)
            count = self._n_nodes if centre == "Node" else self._n_cells
            point(attribute, f"{name}/{index:05d}", " ".join(map(str, (count, *shape))), "Float", "4")
        ET.indent(grid)
        return ET.tostring(grid)
