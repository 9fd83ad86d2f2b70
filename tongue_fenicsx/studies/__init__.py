# SPDX-License-Identifier: MIT
"""Many runs with one question: atlas, postures, calibration, anatomy."""

__all__ = ["anatomy_check", "anatomy_statements", "atlas", "calibration", "postures", "single_muscle"]
