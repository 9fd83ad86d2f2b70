# SPDX-License-Identifier: MIT
"""Verification that anyone can run: each row compares the model with a closed form, a published number or another code."""

from collections.abc import Callable, Iterator

from ..testing import Row
from . import calculix, contact, gradient, heart, material, motion, muscle

CASES: dict[str, Callable[[], Iterator[Row]]] = {
    "laws": material.laws,
    "patch": material.patch,
    "manufactured": material.manufactured,
    "cook": material.cook,
    "taylor": material.taylor,
    "fibres": muscle.fibres,
    "time": motion.time_order,
    "decay": motion.decay,
    "contraction": motion.contraction,
    "ranks": motion.ranks,
    "gradient": gradient.gradient,
    "contact": contact.tangent,
    "pressed": contact.pressed,
    "hertz": contact.hertz,
    "incline": contact.incline,
    "triangles": contact.triangles,
    "land": heart.land,
    "calculix": calculix.calculix,
}
"""The cases by name; each yields rows."""

__all__ = ["CASES", "Row"]
