# SPDX-License-Identifier: MIT
"""Surfaces, fibres, obstacles and rigid motions, in numbers."""

__all__ = ["fibre_bundle", "fibre_direction", "obstacles", "polyline", "registration", "rigid_motion", "surface", "tetrahedron"]
