# SPDX-License-Identifier: MIT
"""Which software computed a result, and how much memory it took."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from petsc4py import PETSc

from . import __version__


def versions() -> dict[str, str]:
    """Versions of what computes."""
    found = {"tongue_fenicsx": __version__}
    for name in ("dolfinx-solver-real", "fenics-dolfinx", "petsc4py", "gmsh", "numpy"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    found["petsc"] = ".".join(map(str, PETSc.Sys.getVersion()))
    return found


def peak_memory() -> float:
    """Memory that this process took at most, in GiB."""
    found = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text(encoding="utf-8"))  # ru_maxrss has the parent's, too
    return int(found.group(1)) / 2**20 if found else float("nan")
