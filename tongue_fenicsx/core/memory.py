# SPDX-License-Identifier: MIT
"""How much memory a computation took."""

from __future__ import annotations

import re
from pathlib import Path


def peak_memory() -> float:
    """Memory that this process took at most, in GiB."""
    found = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text(encoding="utf-8"))  # ru_maxrss has the parent's, too
    return int(found.group(1)) / 2**20 if found else float("nan")
