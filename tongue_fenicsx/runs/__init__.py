# SPDX-License-Identifier: MIT
"""What a run leaves, in a folder or in memory, and how it is read again."""

__all__ = ["checkpoint", "figures", "history", "numbering", "run", "store", "writer", "xdmf"]
