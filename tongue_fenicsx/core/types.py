# SPDX-License-Identifier: MIT
"""Names of types that every room uses; they cost no import until somebody asks what they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

type Floats = NDArray[np.float64]
type Ints = NDArray[np.int64]
type Bools = NDArray[np.bool_]
type Expr = Any
"""A UFL expression."""
