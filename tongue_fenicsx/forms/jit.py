# SPDX-License-Identifier: MIT
"""How forms are compiled: fast and safe flags, and a cache that is not shared between unlike processors."""

from __future__ import annotations

import hashlib
import os
import platform
from pathlib import Path
from typing import Any

import dolfinx

FLAGS = ["-O3", "-march=native", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math"]
"""As fast as -ffast-math on these kernels, but NaN still travels from an inverted element to the line search."""


def cache_folder() -> Path:
    """Where compiled forms are kept, one folder per processor model and DOLFINx version (``-march=native`` binds them)."""
    try:
        text = Path("/proc/cpuinfo").read_text().split("\n\n")[0]
        lines = [line for line in text.splitlines() if line.startswith(("model name", "flags", "Features"))]
    except OSError:
        lines = [platform.processor()]
    key = hashlib.sha256("\n".join(lines).encode()).hexdigest()[:12]
    base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return base / "tongue_fenicsx" / f"{dolfinx.__version__}-{key}"


def options() -> dict[str, Any]:
    """JIT options of every form and expression; the long time-out lets simultaneous runs wait for one compilation."""
    return {"cffi_extra_compile_args": FLAGS, "cache_dir": str(cache_folder()), "timeout": 300}
