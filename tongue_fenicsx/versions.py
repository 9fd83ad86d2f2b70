# SPDX-License-Identifier: MIT
"""Which software computed a result."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

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
