# SPDX-License-Identifier: MIT
"""Stand-in."""

from __future__ import annotations


def figure_files() -> list[str]:
    """None."""
    return []
