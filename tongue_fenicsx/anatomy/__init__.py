# SPDX-License-Identifier: MIT
"""Muscles and bones as plain data: the built-in tongue, and a subject's folder."""

__all__ = ["anatomy", "carry_over", "catalogue", "comparison", "frame_guess", "parametric", "subject"]
