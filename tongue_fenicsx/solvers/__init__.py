# SPDX-License-Identifier: MIT
"""Time integration, Newton's method and linear solvers."""

__all__ = [
    "adjoint",
    "callbacks",
    "equations",
    "initial_acceleration",
    "line_search",
    "linear",
    "newton",
    "options",
    "placement",
    "rigid_bodies",
    "tangent",
    "time_integration",
    "tolerances",
]
