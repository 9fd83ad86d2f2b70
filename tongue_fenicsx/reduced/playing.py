# SPDX-License-Identifier: MIT
"""A run of the reduced tongue, left in a run folder that everything reads as it does that of a full one."""

from __future__ import annotations

import json
import time as clock
from pathlib import Path

import h5py
import numpy as np

from ..core.types import Floats
from ..mechanics.control import OpenLoop
from ..runs import xdmf
from ..runs.claim import claim
from ..runs.figures import figure_files
from ..runs.history import History
from ..runs.inputs import KEPT, Inputs
from ..runs.run import Run
from ..runs.store import Folder
from ..runs.writer import FIELDS, LEFT_BEFORE, SUMMARY
from ..simulation.step_control import StepControl
from ..simulation.stepping import Stepping
from .judging import volume
from .tongue import STEP, ReducedTongue


def play(
    tongue: ReducedTongue, control: OpenLoop, t_end: float, output_every: float, folder: Path, inputs: Inputs, *, overwrite: bool = False
) -> Run:
    """Let the reduced tongue follow activations from rest.

    Parameters
    ----------
    tongue : ReducedTongue
        It is reset.
    control : OpenLoop
        Activations of its muscles.
    t_end, output_every : float
        End, and time between outputs, in s.
    folder : Path
        The run folder.
    inputs : Inputs
        What it keeps of what made it.
    overwrite : bool
        Replace a run that the folder holds.

    Raises
    ------
    InputError
        If the folder cannot be written, or holds a run that is not to be replaced.
    """
    steps = StepControl(Stepping(step_max=STEP, output_every=output_every), t_end, control.kinks)
    store = Folder(folder)
    with claim(folder, figure_files(), resume=False, overwrite=overwrite):
        for name in (*LEFT_BEFORE, *KEPT, *figure_files()):
            store.remove(name)
        inputs.install(folder)
        began = clock.perf_counter()
        tongue.reset()
        times, path, doubts = [0.0], [tongue.coordinates], [0.0]
        while times[-1] < t_end:
            t, _ = steps.next_time(times[-1])
            path.append(tongue.step(control.levels(t), t - times[-1]))
            times.append(t)
            doubts.append(tongue.doubt)
        u = tongue.displacement(np.array(path))
        seconds = clock.perf_counter() - began
        rest = {name: np.asarray(point) for name, point in tongue.told["rest"].items()}
        nodes = [int(np.linalg.norm(tongue.points - point, axis=1).argmin()) for point in rest.values()]
        history, still = History(store, rest), volume(tongue, np.zeros_like(tongue.points))
        for t, displacement, doubt in zip(times, u, doubts, strict=True):
            active = {f"activation/{name}": level for name, level in control.levels(t).items()}
            ratio = volume(tongue, displacement) / still
            history.append({"time": t, "probes": displacement[nodes], "volume_ratio": ratio, "reduced/doubt": doubt, **active})
        stored = [i for i, t in enumerate(times) if steps.stores(t)]
        _write_fields(store, tongue, np.array(times)[stored], u[stored])
        history.close()
        summary = {
            "status": "done",
            "reduced": True,
            "t_end": t_end,
            "n_nodes": len(tongue.points),
            "n_cells": len(tongue.cells),
            "n_steps": len(times) - 1,
            "wall_seconds": seconds,
            "volume_change_max": float(abs(history.column("volume_ratio") - 1).max()),
            "doubt_max_mm": max(doubts),
            "probes": {name: list(map(float, u[-1, node])) for name, node in zip(rest, nodes, strict=True)},
            "model": tongue.told["model"],
        }
        store.replace(SUMMARY, lambda target: target.write((json.dumps(summary, indent=2) + "\n").encode()))
    return Run(folder)


def _write_fields(store: Folder, tongue: ReducedTongue, times: Floats, displacement: Floats) -> None:
    """``fields.h5`` and ``fields.xdmf``, with the displacement."""

    def write(file: h5py.File) -> None:
        file["time"], file["mesh/points"], file["mesh/cells"] = times, tongue.points, tongue.cells.astype(np.int32)
        file.create_group("displacement").attrs["centre"] = "Node"
        for index, u in enumerate(displacement):
            file[f"displacement/{index:05d}"] = u.astype(np.float32)

    store.make(FIELDS, write, 4 * displacement.size)
    xdmf.Index(store, FIELDS, len(tongue.points), len(tongue.cells)).begin(list(times), {"displacement": ("Node", (3,))})
