# SPDX-License-Identifier: MIT
"""Names of types that every room uses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Expr = Any
"""A UFL expression."""
