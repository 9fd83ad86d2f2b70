# SPDX-License-Identifier: MIT
"""One table for many runs, which grows while they come, and one file with all their fields.

Rows are appended in the order in which runs end; from the run folders, the table is written anew, sorted, when a sweep begins and
ends. What differs from one time to the next, such as seconds and hosts, stands in a table of its own.
"""

from __future__ import annotations

import json
import os
from typing import Any

import h5py
import numpy as np

from ..analysis.tables import DONE
from ..analysis.tables import FILE as TABLE
from ..core.files import at_once
from ..core.fingerprint import fingerprint
from ..runs.run import Run
from .designs import cell, csv_text
from .plan import Case, Outcome, Plan

TIMING, FIELDS = "timing.csv", "fields.h5"
NUMBERS = (
    "t_end", "n_steps", "n_rejected", "newton_iterations", "krylov_iterations", "volume_change_max", "min_jacobian",
    "hencky_von_mises_max", "peak_speed_m_s", "energy_balance_error", "contact_force_max_N",
)  # fmt: skip
"""Keys of a run's summary that the table has."""
TIMES = ("seconds", "wall_seconds", "setup_seconds", "peak_memory_gib", "worker")


class RunTable:
    """``table.csv`` and ``timing.csv`` of a plan.

    Parameters
    ----------
    plan : Plan
        Its cases are the rows.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._index = {case.name: index for index, case in enumerate(plan.cases)}
        self._parameters = list(dict.fromkeys(key for case in plan.cases for key in case.parameters))
        probes = dict.fromkeys(name for case in plan.cases for name in case.scenario["probes"])
        self._probes = [(name, axis, f"{name}_{'xyz'[axis]}_m") for name in probes for axis in range(3)]
        columns = ["index", *self._parameters, "status", "reason", "folder", *NUMBERS, *(column for *_, column in self._probes)]
        self._columns = {TABLE: columns, TIMING: ["index", *TIMES]}

    def write(self) -> None:
        """Write both anew from the run folders."""
        rows = [self._rows(case, outcome) for case, outcome in self._plan.over()]
        for name, columns in self._columns.items():
            with at_once(self._plan.folder / name) as path:
                lines = [columns, *([row[name].get(key, "") for key in columns] for row in rows)]
                path.write_text(csv_text(lines), encoding="utf-8")

    def append(self, case: Case, outcome: Outcome) -> None:
        """Add the row of a run that has ended to both."""
        for name, row in self._rows(case, outcome).items():
            line = csv_text([[row.get(key, "") for key in self._columns[name]]]).encode()
            handle = os.open(self._plan.folder / name, os.O_WRONLY | os.O_APPEND)
            try:
                os.write(handle, line)
            finally:
                os.close(handle)

    def count(self) -> int:
        """Rows of the table now."""
        return (self._plan.folder / TABLE).read_bytes().count(b"\n") - 1

    def _rows(self, case: Case, outcome: Outcome) -> dict[str, dict[str, Any]]:
        path = self._plan.folder / case.name / "summary.json"
        summary = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        row = {"index": self._index[case.name], **{key: cell(value) for key, value in case.parameters.items()}}
        row |= {"status": outcome.status, "reason": outcome.reason, "folder": case.name}
        timing = {"index": row["index"], "seconds": round(outcome.seconds, 3), "worker": outcome.worker}
        if outcome.status == DONE:
            row |= {key: summary[key] for key in NUMBERS}
            row |= {column: summary["probes"][name][axis] for name, axis, column in self._probes if name in summary["probes"]}
        return {TABLE: row, TIMING: {key: summary[key] for key in TIMES if key in summary} | timing}


def write_fields(plan: Plan) -> str:
    """Write ``fields.h5``: the displacement of all runs that are done, if every run is over and the runs have one mesh; say what was done.

    ``displacement`` (n_runs, n_out, n_nodes, 3) in m, one chunk for each run, and ``activation`` (n_runs, n_out, n_muscles) are in single
    precision, ``time`` (n_runs, n_out) in s; runs that are not done, and outputs that a run has not, are not a number.
    """
    over = list(plan.over())
    done = [(index, case) for index, (case, outcome) in enumerate(over) if outcome.status == DONE]
    if len(over) < len(plan.cases) or not done:
        return f"{FIELDS}: not written before every run is over"
    if len({json.dumps(case.scenario["mesh"]) for _, case in done}) > 1:
        return f"{FIELDS}: not written, the runs have different meshes"
    path = plan.folder / FIELDS
    made_of = fingerprint([[case.identity, outcome.status] for case, outcome in over])
    if path.is_file():
        with h5py.File(path) as file:
            if file.attrs["made_of"] == made_of:
                return f"{FIELDS}: already there"
    runs = {index: Run(plan.folder / case.name) for index, case in done}
    points, cells = next(iter(runs.values())).mesh
    muscles = list(dict.fromkeys(name for run in runs.values() for name in run.activation))
    n_out = max(len(run.output_times) for run in runs.values())
    with at_once(path) as partial, h5py.File(partial, "w") as file:
        file.attrs["made_of"] = made_of
        file["mesh/points"], file["mesh/cells"] = points, cells.astype(np.int32)
        n = len(over)

        def empty(name: str, shape: tuple[int, ...], kind: str) -> h5py.Dataset:
            chunk = (1, *shape) if 0 not in shape else None
            return file.create_dataset(name, (n, *shape), dtype=kind, chunks=chunk, fillvalue=np.nan)

        displacement = empty("displacement", (n_out, len(points), 3), "f4")
        activation = empty("activation", (n_out, len(muscles)), "f4")
        time = empty("time", (n_out,), "f8")
        activation.attrs["muscles"] = muscles
        file["status"] = [outcome.status for _, outcome in over]
        for key in dict.fromkeys(key for case in plan.cases for key in case.parameters):
            values = [case.parameters.get(key, "") for case in plan.cases]
            numbers = all(isinstance(value, int | float) for value in values)
            file[f"parameters/{key}"] = values if numbers else [str(cell(value)) for value in values]
        for index, run in runs.items():
            times = run.output_times
            rows = np.abs(run.time[:, None] - times).argmin(axis=0)
            displacement[index, : len(times)] = [run.field("displacement", i) for i in range(len(times))]
            activation[index, : len(times)] = np.column_stack([run.activation[name][rows] for name in muscles]) if muscles else 0
            time[index, : len(times)] = times
    return f"{FIELDS}: {len(done)} of {n} runs, {path.stat().st_size / 1e6:.0f} MB"
