# SPDX-License-Identifier: MIT
"""Numbers from runs; never from a live solver."""

__all__ = ["airway", "electropalatogram", "movement", "tongue_grid", "trajectories"]
