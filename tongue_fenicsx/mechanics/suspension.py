# SPDX-License-Identifier: MIT
"""Bones on springs: a bonded surface that moves as a rigid body, with six unknowns in place of those of its nodes.

The six are the translation and the rotation vector since the start of a solve, the latter times a lever so that all are
lengths. They stand in the vector of unknowns where the displacement of two vertices of the surface stood; the other nodes of
the surface keep their places there with the value zero. So vectors and matrices keep their layout, and the reduced tangent is
TᵀAT with the sparse T of `Transformation`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..core.values import Real, checked


@dataclass(frozen=True)
@checked("suspended")
class Suspension:
    """A bone that the rest of the body holds as springs would; its own weight is borne at rest.

    Mass, stiffness and damping are spread evenly over the bonded surface, which stays rigid, so that they also resist rotation.

    Attributes
    ----------
    mass : float
        In kg; by default a hyoid's (Stavness et al. 2011).
    stiffness : float
        Of all springs, in N/m in each direction (the same source).
    damping : float
        In N s/m.

    Raises
    ------
    InputError
        If a number is negative, or the bone has neither mass nor springs.
    """

    mass: Annotated[float, Real("kg", low=0)] = 5e-3
    stiffness: Annotated[float, Real("N/m", low=0)] = 1760.0
    damping: Annotated[float, Real("N s/m", low=0)] = 0.0
