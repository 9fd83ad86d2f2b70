# SPDX-License-Identifier: MIT
"""How forms are compiled: fast and safe flags, and a cache that is not shared between unlike processors."""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import platform
import sysconfig
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cffi
import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from ffcx.naming import compute_signature
from ffcx.options import get_options
from mpi4py import MPI
from ufl.corealg.dag_traverser import DAGTraverser

from ..core import cache
from ..core.errors import InputError, quiet
from ..core.parallel import on_rank_zero
from ..core.types import Expr, Floats

FLAGS = ["-O3", "-g0", "-march=native", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math", "-fno-math-errno"]
"""As fast as -ffast-math on these kernels, but NaN still travels from an inverted element to the line search. ``-g0``:
Python's own ``-g`` would cost a third of the time of a compilation and nineteen twentieths of what it leaves."""
WAIT = 300
"""Seconds in which ranks without a common file system wait for one another's compiler."""


def _let_expressions_go() -> None:
    """Python 3.13.0 and 3.13.1 never free an object whose `singledispatchmethod` was called (CPython's issue 127750): UFL's derivatives,
    and with them the mesh, the spaces and the MPI communicators of each form, until MPI has none left."""
    kinds = [DAGTraverser]
    for kind in kinds:
        kinds += kind.__subclasses__()
        for method in vars(kind).values():
            if isinstance(method, functools.singledispatchmethod) and hasattr(method, "_method_cache"):
                method._method_cache = None


_let_expressions_go()


def compile_form(form: Any, comm: MPI.Intracomm, **settings: Any) -> Any:
    """A form, or nested lists of forms, ready to assemble; `settings` go to `dolfinx.fem.form`.

    Raises
    ------
    InputError
        If it must be compiled and cannot be.
    """
    if isinstance(form, list | tuple):
        return [compile_form(part, comm, **settings) for part in form]
    options = _provide(form, comm) if isinstance(form, ufl.Form) else None
    return fem.form(form, jit_options=options, **settings)


def compile_without_data(form: ufl.Form, comm: MPI.Intracomm) -> fem.CompiledForm:
    """A form to which functions and integration domains are still to be given.

    Raises
    ------
    InputError
        If it must be compiled and cannot be.
    """
    return fem.compile_form(comm, form, jit_options=_provide(form, comm))


def compile_expression(value: Expr, points: Floats, comm: MPI.Intracomm) -> fem.Expression:
    """A value ready to be evaluated at reference points (q, d) of cells.

    Raises
    ------
    InputError
        If it must be compiled and cannot be.
    """
    return fem.Expression(value, points, comm=comm, jit_options=_provide((value, np.asarray(points)), comm))


def compile_kernels(item: ufl.Form, layout: str, source: Callable[[], str], declarations: str, comm: MPI.Intracomm) -> Any:
    """A cffi module with what is declared, made of a form and a `layout`; the `source` in C is asked for if need be.

    Raises
    ------
    InputError
        If it must be compiled and cannot be.
    """
    entry = on_rank_zero(comm, lambda: _find(item, lambda folder: _build(source(), declarations, folder), layout + declarations))
    name = f"{entry.name}.kernels"  # modules of one name are one module: the last that is loaded
    spec = importlib.util.spec_from_file_location(name, next(entry.glob("kernels*")))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _build(source: str, declarations: str, folder: Path) -> None:
    """Compile kernels into a folder, and leave there what is needed to load them."""
    ffi = cffi.FFI()
    ffi.cdef(declarations)
    ffi.set_source("kernels", source, extra_compile_args=FLAGS)
    with quiet():
        ffi.compile(tmpdir=str(folder))
    for path in folder.glob("*.[co]"):
        path.unlink()


def generation() -> str:
    """Name of what compiled forms are bound to: the DOLFINx version and, by ``-march=native``, the model of the processor."""
    try:
        text = Path("/proc/cpuinfo").read_text().split("\n\n")[0]
        lines = [line for line in text.splitlines() if line.startswith(("model name", "flags", "Features"))]
    except OSError:
        lines = [platform.processor()]
    return f"{dolfinx.__version__}-{hashlib.sha256('\n'.join(lines).encode()).hexdigest()[:12]}"


def _provide(item: Any, comm: MPI.Intracomm) -> dict[str, Any]:
    """Options with which DOLFINx finds, on all ranks, a form or expression compiled."""
    return _options(on_rank_zero(comm, lambda: _find(item, lambda making: _compile(item, making))))


def _find(item: Any, make: Callable[[Path], None], layout: str = "") -> Path:
    """Where a form or expression is compiled, once it is."""
    settings = (FLAGS, sysconfig.get_config_var("EXT_SUFFIX"), sorted(get_options().items()), layout)
    folder = cache.open_cache(generation())
    entry: Path = folder / compute_signature([item], str(settings))
    try:
        cache.provide(entry, make)
    except (cffi.VerificationError, OSError) as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"a form cannot be compiled ({reason}); a C compiler, Python's headers and room in {folder} are needed, "
            "tongue doctor says what is missing."
        ) from error
    return entry


def _compile(item: Any, folder: Path) -> None:
    """Compile into a folder, and leave there what is needed to load it."""
    with quiet():
        dolfinx.jit.ffcx_jit(MPI.COMM_SELF, item, {"scalar_type": dolfinx.default_scalar_type}, _options(folder))
    for path in folder.glob("*.[co]"):
        path.write_bytes(b"")  # FFCx asks only whether they exist


def _options(folder: Path) -> dict[str, Any]:
    return {"cffi_extra_compile_args": FLAGS, "cache_dir": str(folder), "timeout": WAIT}
