# SPDX-License-Identifier: MIT
"""``fields.xdmf``: what ParaView reads to find its way in ``fields.h5``."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as ET

from .store import Store

FILE = "fields.xdmf"


def write_xdmf(
    store: Store, data: str, times: list[float], n_nodes: int, n_cells: int, fields: Mapping[str, tuple[str, tuple[int, ...]]]
) -> None:
    """Write the index of fields over time.

    Parameters
    ----------
    store : Store
        Where.
    data : str
        Name of the HDF5 file beside it, with ``mesh/points``, ``mesh/cells`` and each field as ``NAME/00000``, ``NAME/00001``, …
    times : list of float
        In s.
    n_nodes, n_cells : int
        Of the quadratic mesh.
    fields : mapping
        Name to ``Node`` or ``Cell`` and the shape of a value.
    """
    root = ET.Element("Xdmf", Version="3.0")
    series = ET.SubElement(ET.SubElement(root, "Domain"), "Grid", Name="tongue", GridType="Collection", CollectionType="Temporal")

    def point(parent: ET.Element, path: str, dimensions: str, kind: str, precision: str) -> None:
        item = ET.SubElement(parent, "DataItem", Dimensions=dimensions, NumberType=kind, Precision=precision, Format="HDF")
        item.text = f"{data}:/{path}"

    for index, t in enumerate(times):
        grid = ET.SubElement(series, "Grid", Name="tongue", GridType="Uniform")
        ET.SubElement(grid, "Time", Value=repr(t))
        topology = ET.SubElement(grid, "Topology", TopologyType="Tetrahedron_10", NumberOfElements=str(n_cells))
        point(topology, "mesh/cells", f"{n_cells} 10", "Int", "4")
        geometry = ET.SubElement(grid, "Geometry", GeometryType="XYZ")
        point(geometry, "mesh/points", f"{n_nodes} 3", "Float", "8")
        for name, (centre, shape) in fields.items():
            kind = {0: "Scalar", 1: "Vector", 2: "Tensor"}[len(shape)]
            attribute = ET.SubElement(grid, "Attribute", Name=name, AttributeType=kind, Center=centre)
            count = n_nodes if centre == "Node" else n_cells
            point(attribute, f"{name}/{index:05d}", " ".join(map(str, (count, *shape))), "Float", "4")
    ET.indent(root)
    store.replace(FILE, lambda target: ET.ElementTree(root).write(target, xml_declaration=True, encoding="utf-8"))
