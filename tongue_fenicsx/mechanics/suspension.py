# SPDX-License-Identifier: MIT
"""Bones on springs: a bonded surface that moves as a rigid body, with six unknowns in place of those of its nodes.

The six are the translation and the rotation vector since the start of a solve, the latter times a lever so that all are
lengths. They stand in the vector of unknowns where the displacement of two vertices of the surface stood; the other nodes of
the surface keep their places there with the value zero. So vectors and matrices keep their layout, and the reduced tangent is
TᵀAT with the sparse T of `Transformation`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError


@dataclass(frozen=True)
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

    mass: float = 5e-3
    stiffness: float = 1760.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        for name, unit in (("mass", "kg"), ("stiffness", "N/m"), ("damping", "N s/m")):
            if not (np.isfinite(value := getattr(self, name)) and value >= 0):
                raise InputError(f"suspended.{name}: {value} {unit}; zero or a positive number is expected.")
