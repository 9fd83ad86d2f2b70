# SPDX-License-Identifier: MIT
"""Curves of straight pieces."""

from __future__ import annotations

import numpy as np

from ..core.types import Floats


def arc_length(points: Floats) -> Floats:
    """Length along a curve up to each of its points (n, d), (n,), 0 at the first."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
