# SPDX-License-Identifier: MIT
"""``tongue doctor``: what a machine needs to run this package, and how to mend what is missing."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from rich.text import Text

from ...core.cache import place
from ...core.errors import InputError, check_outputs
from ..terminal import console

Finding = tuple[str, bool, str]


def doctor() -> None:
    """Say what is installed, what is wrong and how to mend it."""
    wrong = False
    for name, fine, text in findings():
        console.print(Text.assemble(("ok ", "green") if fine else ("bad ", "red"), f"{name}: {text}"))
        wrong = wrong or not fine
    if wrong:
        raise SystemExit(2)


def findings() -> Iterator[Finding]:
    """Check after check: name, whether it is fine, and what was found or how to mend it."""
    fine = sys.version_info >= (3, 12)
    yield "Python", fine, platform.python_version() if fine else f"{platform.python_version()} is too old; install Python 3.12 or newer"
    yield _compiler()
    for name, mend in (
        ("dolfinx", "pip install 'tongue_fenicsx[wheel]' (Linux x86-64), or DOLFINx 0.11 or newer from conda-forge, Debian or a container"),
        ("petsc4py.PETSc", "it comes with DOLFINx"),
        ("mpi4py.MPI", "it comes with DOLFINx"),
        ("gmsh", "pip install gmsh; on Debian also apt install libglu1-mesa libxft2 libxcursor1 libxinerama1"),
        ("h5py", "pip install h5py"),
        ("pyvista", "pip install pyvista; on Debian also apt install libgl1"),
        ("pymeshfix", "pip install pymeshfix"),
    ):
        yield _module(name, mend)
    yield _drawing()
    yield _petsc()
    yield _cache()
    threads = os.environ.get("OMP_NUM_THREADS", "")
    yield "OMP_NUM_THREADS", threads == "1", threads if threads == "1" else f"{threads or 'unset'}; set it to 1, ranks do the parallel work"


def _module(name: str, mend: str) -> Finding:
    try:
        module = import_module(name)
    except Exception as error:  # a library that cannot be loaded raises anything
        return name, False, f"cannot be imported ({error}); {mend}"
    root = sys.modules[name.split(".")[0]]
    return name, True, str(getattr(module, "__version__", getattr(root, "__version__", "present")))


def _compiler() -> Finding:
    compiler = os.environ.get("CC", "cc").split()[0]
    if shutil.which(compiler) is None:
        return "C compiler", False, f"{compiler} is not on the PATH; FFCx needs one, on Debian: apt install gcc libc6-dev"
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "probe.c"
        source.write_text("#include <math.h>\n#include <Python.h>\ndouble f(double x) { return sqrt(x); }\n")
        options = ["-O3", "-march=native", "-shared", "-fPIC", f"-I{sysconfig.get_path('include')}"]
        result = subprocess.run([compiler, *options, "-o", f"{folder}/probe.so", str(source)], capture_output=True, text=True)
    if "Python.h" in result.stderr:
        return "C compiler", False, f"{compiler} does not find Python's headers (Python.h); on Debian: apt install python3-dev"
    if result.returncode:
        return (
            "C compiler",
            False,
            f"{compiler} cannot compile: {result.stderr.strip().splitlines()[-1]}; on Debian: apt install gcc libc6-dev",
        )
    return "C compiler", True, compiler


def _petsc() -> Finding:
    try:
        from petsc4py import PETSc
    except ImportError as error:
        return "PETSc", False, f"cannot be imported ({error})"
    if not PETSc.Sys.hasExternalPackage("mumps"):
        return "PETSc", False, "was built without MUMPS, which the direct solves need; use a build that has it"
    if PETSc.ScalarType is not float and "complex" in str(PETSc.ScalarType):
        return "PETSc", False, "uses complex numbers; a real build is needed"
    return "PETSc", True, ".".join(map(str, PETSc.Sys.getVersion())) + ", real, with MUMPS"


def _drawing() -> Finding:
    """Draw off screen in another process: where no driver is found, VTK may end the process."""
    code = "import pyvista; p = pyvista.Plotter(off_screen=True); p.add_mesh(pyvista.Sphere()); p.screenshot(None, return_img=True)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if result.returncode:
        return "pictures", False, "VTK cannot draw off screen; on Debian: apt install libgl1 libegl1 libosmesa6"
    return "pictures", True, "drawn off screen"


def _cache() -> Finding:
    try:
        check_outputs(place())
    except InputError as error:
        return "form cache", False, f"{error} Until then each run compiles its forms again"
    return "form cache", True, str(place())
