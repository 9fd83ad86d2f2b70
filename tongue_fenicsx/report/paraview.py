# SPDX-License-Identifier: MIT
"""A run for ParaView: the moving tongue with fields, muscles and fibres at its nodes, its bones, and a script that opens them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyvista as pv
from mpi4py import MPI
from scipy.spatial import cKDTree

from ..analysis.tongue_grid import grids_at
from ..anatomy.catalogue import base_name
from ..core.types import Floats
from ..meshing.tongue_mesh import TongueMesh
from ..runs.inputs import MESH
from ..runs.run import Run

SCRIPT = "open_in_paraview.py"
TONGUE, BONES = "tongue.pvd", "bones.pvd"

_TEXT = """# paraview --script={script}: the tongue of {run}, coloured by displacement, and its bones; lengths in mm
import os
from paraview.simple import *

here = os.path.dirname(os.path.abspath(__file__))
view = GetActiveViewOrCreate("RenderView")
tongue = PVDReader(FileName=os.path.join(here, "{tongue}"))
shown = Show(tongue, view)
ColorBy(shown, ("POINTS", "displacement", "Magnitude"))
shown.RescaleTransferFunctionToDataRange(True, False)
shown.SetScalarBarVisibility(view, True)
if os.path.exists(os.path.join(here, "{bones}")):
    bones = Show(PVDReader(FileName=os.path.join(here, "{bones}")), view)
    bones.Opacity = 0.3
    bones.DiffuseColor = [0.7, 0.57, 0.42]
    ColorBy(bones, None)
GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
view.ResetCamera()
Render()
"""


def write_paraview(run: Run, folder: Path, report: Callable[[int, int], object] = lambda done, total: None) -> Path:
    """Write a file of the tongue and one of its bones for every output, their collections, and a script; return the script.

    The tongue is where it is at the time, in mm; at its nodes are every stored field (of cells their mean), and of each
    muscle its weight, 0 to 1, and its fibre direction times that.

    Parameters
    ----------
    run : Run
        With its folder.
    folder : Path
        Where the files go.
    report : callable
        Is told how many outputs are written, of how many.

    Raises
    ------
    InputError
        If the run's files are missing or damaged.
    """
    folder.mkdir(parents=True, exist_ok=True)
    times = run.output_times
    muscles = _muscles(run)
    parts: dict[str, list[str]] = {TONGUE: [], BONES: []}
    for index, t in enumerate(times):
        _, grid = grids_at(run, float(t))
        del grid.point_data["displacement"]
        for name in run.fields:
            values = run.field(name, index) * (1e3 if name == "displacement" else 1.0)
            of_nodes = len(values) == grid.n_points
            (grid.point_data if of_nodes else grid.cell_data)[name] = values.reshape(len(values), -1)
        grid = grid.cell_data_to_point_data()
        for name, values in muscles.items():
            grid.point_data[name] = values
        parts[TONGUE].append(f"tongue_{index:04d}.vtu")
        grid.save(folder / parts[TONGUE][-1])
        if bones := [surface.to_pyvista().scale(1e3, inplace=False) for surface in run.obstacles(index).values()]:
            parts[BONES].append(f"bones_{index:04d}.vtp")
            pv.merge(bones).extract_surface(algorithm="dataset_surface").save(folder / parts[BONES][-1])
        report(index + 1, len(times))
    for name, files in parts.items():
        if files:
            _collect(folder / name, times, files)
    script = folder / SCRIPT
    script.write_text(_TEXT.format(script=SCRIPT, run=run, tongue=TONGUE, bones=BONES), encoding="utf-8")
    return script


def _muscles(run: Run) -> dict[str, Floats]:
    """Weight (n_nodes,) and weighted fibre direction (n_nodes, 3) of each muscle, both sides in one; nil between the vertices of elements,
    where the mean of their ends is taken."""
    points, cells = run.mesh
    tongue = TongueMesh.read(run.folder / MESH, MPI.COMM_SELF)
    _, at = cKDTree(points).query(tongue.mesh.geometry.x)
    middles = [(4, 0, 1), (5, 1, 2), (6, 0, 2), (7, 0, 3), (8, 1, 3), (9, 2, 3)]  # of a quadratic tetrahedron in VTK order
    found: dict[str, Floats] = {}
    sides: dict[str, list[Floats]] = {}
    for name, muscle in tongue.muscles.items():
        both = np.zeros((len(points), 4))
        corners = tongue.mesh.geometry.dofmaps[0][muscle.cells]
        both[at[corners], 0] = muscle.weight
        both[at[corners], 1:] = muscle.weight[..., None] * muscle.direction
        for middle, a, b in middles:
            both[cells[:, middle]] = (both[cells[:, a]] + both[cells[:, b]]) / 2
        sides.setdefault(base_name(name), []).append(both)
    for name, parts in sides.items():
        more = parts[0] if len(parts) == 1 else np.where(parts[0][:, :1] >= parts[1][:, :1], *parts)  # they meet on the mid-plane
        found |= {f"{name}_weight": more[:, 0], f"{name}_fibres": more[:, 1:]}
    return found


def _collect(path: Path, times: Floats, files: list[str]) -> None:
    """A collection of ParaView's: files with their times in s."""
    lines = [f'<DataSet timestep="{t:.9g}" file="{name}"/>' for t, name in zip(times, files, strict=True)]
    path.write_text(f'<VTKFile type="Collection" version="0.1"><Collection>{"".join(lines)}</Collection></VTKFile>\n', encoding="utf-8")
