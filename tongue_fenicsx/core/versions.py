# SPDX-License-Identifier: MIT
"""Which software computed a result."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

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
