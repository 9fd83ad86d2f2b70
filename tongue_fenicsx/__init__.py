# SPDX-License-Identifier: MIT
"""The biomechanics of the human tongue on an all-open solver."""

import os as _os
from importlib import import_module as _import_module
from importlib.util import find_spec as _find_spec
from typing import TYPE_CHECKING

_os.environ.setdefault("OMP_NUM_THREADS", "1")  # one thread per rank; must be set before BLAS loads
if _find_spec("dolfinx_solver") is not None:
    import dolfinx_solver as _dolfinx_solver  # noqa: F401  the wheel must come before dolfinx, petsc4py and mpi4py

__version__ = "0.1.0"

if TYPE_CHECKING:
    from .activation import Activation, Excited, ramp
    from .active import Contraction
    from .anatomy import Anatomy
    from .contact import Contact
    from .errors import InputError, SolveError
    from .model import Model, Rayleigh
    from .motion import RigidMotion
    from .obstacles import Plane, Sphere, Triangulated
    from .parametric import parametric_tongue
    from .passive import MooneyRivlin, NeoHookean, Yeoh
    from .rigid import Suspension
    from .run import Run
    from .shape import TongueShape
    from .simulation import Simulation, Stepping
    from .solver import Tolerances
    from .subject import read_subject
    from .tonguemesh import TongueMesh

_HOME = {
    "Activation": "activation",
    "Anatomy": "anatomy",
    "Contact": "contact",
    "Contraction": "active",
    "Excited": "activation",
    "InputError": "errors",
    "Model": "model",
    "MooneyRivlin": "passive",
    "NeoHookean": "passive",
    "Plane": "obstacles",
    "Rayleigh": "model",
    "RigidMotion": "motion",
    "Run": "run",
    "Simulation": "simulation",
    "Sphere": "obstacles",
    "SolveError": "errors",
    "Stepping": "simulation",
    "Suspension": "rigid",
    "Tolerances": "solver",
    "TongueMesh": "tonguemesh",
    "TongueShape": "shape",
    "Triangulated": "obstacles",
    "Yeoh": "passive",
    "parametric_tongue": "parametric",
    "ramp": "activation",
    "read_subject": "subject",
}

__all__ = [
    "Activation", "Anatomy", "Contact", "Contraction", "Excited", "InputError", "Model", "MooneyRivlin", "NeoHookean", "Plane", "Rayleigh",
    "RigidMotion", "Run", "Simulation", "SolveError", "Sphere", "Stepping", "Suspension", "Tolerances", "TongueMesh", "TongueShape",
    "Triangulated", "Yeoh", "parametric_tongue", "ramp", "read_subject",
]  # fmt: skip


def __getattr__(name: str) -> object:
    # on first use, so that `tongue doctor` can speak when a library is missing
    if name in _HOME:
        return getattr(_import_module(f".{_HOME[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
