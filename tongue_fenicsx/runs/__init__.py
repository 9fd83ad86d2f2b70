# SPDX-License-Identifier: MIT
"""What a run leaves, in a folder or in memory, and how it is read again."""

__all__ = ["checkpoint", "claim", "figures", "history", "inputs", "log", "numbering", "reserved", "run", "store", "writer", "xdmf"]
