# SPDX-License-Identifier: MIT
"""The wheel of DOLFINx must be imported before the parts of its stack; it comes with the first of them that is, for it takes a while."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType

STACK = {"basix", "dolfinx", "ffcx", "petsc4py"}
"""Packages that the wheel brings; `mpi4py.MPI`, which it imports first, may also come before it."""


def import_on_demand() -> None:
    """Let the wheel be imported before its stack is."""
    sys.meta_path.insert(0, _WheelFirst())


class _WheelFirst:
    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        if name in STACK:
            sys.meta_path.remove(self)
            import dolfinx_solver  # noqa: F401
