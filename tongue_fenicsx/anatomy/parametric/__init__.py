# SPDX-License-Identifier: MIT
"""The built-in tongue."""

__all__ = ["bones", "profile", "size", "tongue"]
