# SPDX-License-Identifier: MIT
"""Which software and which machine computed a result."""

from __future__ import annotations

import platform
import shlex
import sys
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc


def versions() -> dict[str, str]:
    """Versions of what computes."""
    found = {}
    for name in ("tongue_fenicsx", "dolfinx-solver-real", "fenics-dolfinx", "petsc4py", "gmsh", "numpy"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    found["petsc"] = ".".join(map(str, PETSc.Sys.getVersion()))
    return found


def circumstances() -> dict[str, str]:
    """The command, date, host, processor, Python and MPI of this process."""
    return {
        "command": shlex.join(sys.argv),
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "host": platform.node(),
        "cpu": processor(),
        "python": platform.python_version(),
        "mpi": MPI.Get_library_version().splitlines()[0].strip("\0 "),
    }


def processor() -> str:
    """The model of the processor."""
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text(encoding="utf-8").splitlines() if facts.exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())
