# SPDX-License-Identifier: MIT
"""Times from PETSc's own log, and runs of the command in a process of their own."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

Row = dict[str, float]
EVENTS = {
    "tangent": "SNESJacobianEval",
    "residual": "TongueResidual",
    "set-up": "PCSetUp",
    "total": "SNESSolve",
}
"""What a Newton iteration consists of, in events of PETSc; the tangent with that of the coarse level."""


def parts(time_of: Callable[[str], float]) -> Row:
    """s of each part, with what is left of the total, the Krylov method. (PETSc's event of that has a direct solver's set-up in it.)"""
    found = {name: time_of(event) for name, event in EVENTS.items()}
    total = found.pop("total")
    return found | {"Krylov": total - sum(found.values()), "total": total}


@dataclass
class Finished:
    """A run of the command in its own process: what its summary says, seconds of the whole process, and of PETSc's events."""

    summary: dict[str, Any]
    seconds: float
    events: dict[str, float] = field(default_factory=dict)

    @property
    def newton_per_step(self) -> float:
        """Newton iterations per accepted step."""
        return float(self.summary["newton_iterations"] / self.summary["n_steps"])

    @property
    def krylov_per_newton(self) -> float:
        """Krylov iterations per Newton iteration."""
        return float(self.summary["krylov_iterations"] / self.summary["newton_iterations"])


def run(
    scenario: Path, output: Path, *changes: str, ranks: int = 1, environment: dict[str, str] | None = None, code: Path | None = None
) -> Finished:
    """``tongue run`` in a process of its own, with PETSc's log; of the project in the folder `code`, if there is one. What an earlier one
    left in the output folder goes."""
    scenario, output = scenario.resolve(), output.resolve()
    log = output.with_name(f"{output.name}.csv")
    output.parent.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(output, ignore_errors=True)
    command = [sys.executable, "-m", "tongue_fenicsx", "run", str(scenario), "-o", str(output)]
    command += [word for change in changes for word in ("--set", change)]
    if ranks > 1:
        command = [str(Path(sys.executable).parent / "mpiexec"), "-n", str(ranks), *command]
    settings = os.environ | {"OMP_NUM_THREADS": "1", "PETSC_OPTIONS": f"-log_view :{log}:ascii_csv"} | (environment or {})
    start = time.perf_counter()
    if code is not None:  # the working directory comes first on Python's path
        settings["PYTHONPATH"] = str(code)
    subprocess.run(command, cwd=code, env=settings, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, check=True)
    seconds = time.perf_counter() - start
    rows = [row for row in csv.DictReader(log.read_text().splitlines()) if row["Rank"] == "0"]
    events = parts(lambda event: sum(float(row["Time"]) for row in rows if row["Event Name"] == event))
    return Finished(json.loads((output / "summary.json").read_text()), seconds, events)


STEADY, PATIENCE = 0.02, 20.0
"""How well a median must be known, relative to it, and the seconds after which what is known must do; three times as many for the first
three."""


def steady(work: Callable[[], Row]) -> Row:
    """The medians of a row of measurements, which is repeated until they are known."""
    rows: list[Row] = []
    start = time.perf_counter()
    while not rows or (time.perf_counter() - start < PATIENCE * (3 if len(rows) < 3 else 1) and not _known(rows)):
        rows.append(work())
    return {key: median(row[key] for row in rows) for key in rows[0]}


def _known(rows: list[Row]) -> bool:
    """Whether the standard errors of medians, by the median deviations of the values (normal ones), are small."""
    values = np.array([list(row.values()) for row in rows])
    middle = np.median(values, axis=0)
    error = 1.2533 * 1.4826 * np.median(abs(values - middle), axis=0) / np.sqrt(len(rows))
    return len(rows) >= 7 and bool((error <= STEADY * abs(middle)).all())


def seconds(work: Callable[[], object]) -> float:
    """How long it takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def machine() -> dict[str, Any]:
    """The processor and memory, without names of hosts."""
    text = Path("/proc/cpuinfo").read_text()
    model = re.search(r"model name\s*:\s*(.*)", text)
    pages = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {"processor": model.group(1) if model else "unknown", "cores": os.cpu_count(), "memory_gib": round(pages / 2**30, 1)}
