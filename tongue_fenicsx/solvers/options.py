# SPDX-License-Identifier: MIT
"""PETSc options that belong to one solver only."""

from __future__ import annotations

import re
import weakref
from collections.abc import Mapping
from itertools import count

from petsc4py import PETSc

REPEATABLE = ("vec_mdot_use_gemv", "vec_maxpy_use_gemv")
"""Set to 0 for all vectors: BLAS sums in an order that depends on where they lie in memory, and no run with GMRES would repeat."""
_numbers = count()


class SolverOptions:
    """Options under a prefix of this solver's own, so that solvers alive at once do not see each other.

    What the user has set for all solvers, ``-tongue_KEY``, is copied to this one and is not overruled.

    Attributes
    ----------
    prefix : str
        Of all PETSc objects of the solver.
    """

    def __init__(self) -> None:
        options = PETSc.Options()
        for key in REPEATABLE:
            if not options.hasName(key):
                options[key] = "0"
        self.prefix = f"tongue_{next(_numbers)}_"
        self._keys: list[str] = []
        self._clear = weakref.finalize(self, _delete, self._keys)
        for key, value in options.getAll().items():
            if key.startswith("tongue_") and not re.match(r"tongue_\d+_", key):
                self.put(self.prefix, {key.removeprefix("tongue_"): value})

    def put(self, prefix: str, settings: Mapping[str, str | int]) -> None:
        """Set what is not set yet, until `clear` (parts of a solver read their options late)."""
        options = PETSc.Options()
        for key, value in settings.items():
            if not options.hasName(prefix + key):
                options[prefix + key] = value
                self._keys.append(prefix + key)

    def clear(self) -> None:
        """Take the options out again; so does the end of the solver or of the process."""
        self._clear()


def _delete(keys: list[str]) -> None:
    for key in keys:
        PETSc.Options().delValue(key)
