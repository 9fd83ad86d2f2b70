# SPDX-License-Identifier: MIT
"""The biomechanics of the human tongue on an all-open solver.

Everything that most users need stands here; the names and where they come from are listed in ``__init__.pyi``, and each is loaded on
first use, so that ``tongue check`` and ``tongue doctor`` answer at once and without DOLFINx.
"""

import os as _os
import sys as _sys

if _os.path.basename(_sys.argv[0]) in ("-m", "tongue"):  # the command starts: signals end it quietly
    from .core.interruption import leave_at_once as _leave_at_once
    from .core.interruption import on_signals as _on_signals

    _on_signals(_leave_at_once)

from importlib import import_module as _import_module
from importlib.util import find_spec as _find_spec

import lazy_loader as _lazy

from . import plotting as _plotting  # noqa: F401  registers the standard figures and loads nothing more

_os.environ.setdefault("OMP_NUM_THREADS", "1")  # one thread per rank; must be set before BLAS loads
if _os.path.expanduser("~") == "~":  # nobody whom the system knows, as in containers; DOLFINx is imported only where there is a home
    _os.environ["HOME"] = "/proc/nonexistent"
if _find_spec("dolfinx_solver") is not None:
    from . import _wheel

    _wheel.import_on_demand()

_load, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

_ABOVE = {"Anatomy": "meshing", "parametric_tongue": "meshing", "read_subject": "meshing"}
"""Rooms above the class that give it what its method `mesh` does, when they are loaded."""


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("tongue_fenicsx")
    if name in _ABOVE:
        _import_module(f".{_ABOVE[name]}", __name__)
    return _load(name)
