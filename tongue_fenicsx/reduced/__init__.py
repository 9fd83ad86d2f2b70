# SPDX-License-Identifier: MIT
"""A tongue of some tens of coordinates that moves in real time, learned from many runs of the full one."""

__all__ = ["basis", "judging", "learning", "network", "playing", "room", "tongue", "training"]
