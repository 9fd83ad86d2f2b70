# SPDX-License-Identifier: MIT
"""The quadrature rule of the stress terms: Xiao and Gimbutas' (2010), all of whose weights are positive.

The usual rule of degree 3 has five points, one with the weight −4/5. Where the law is not smooth, as at the clip of the
force–velocity factor, that point does not balance the others, the tangent of a stable state becomes indefinite and
Newton's method cycles.
"""

from __future__ import annotations

from typing import Any

import basix
import numpy as np

from ..core.types import Floats

RULE = "Xiao-Gimbutas"


def metadata(degree: int) -> dict[str, Any]:
    """Metadata of a measure."""
    return {"quadrature_degree": degree, "quadrature_rule": RULE}


def points_and_weights(degree: int) -> tuple[Floats, Floats]:
    """Points (q, 3) and weights (q,) on the reference tetrahedron."""
    points, weights = basix.make_quadrature(basix.CellType.tetrahedron, degree, rule=basix.quadrature.string_to_type(RULE))
    return np.asarray(points), np.asarray(weights)
