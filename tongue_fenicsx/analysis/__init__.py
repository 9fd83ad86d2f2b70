# SPDX-License-Identifier: MIT
"""Numbers from runs; never from a live solver."""

__all__ = ["airway", "comparison", "electropalatogram", "moments", "movement", "tables", "tongue_grid", "trajectories"]
