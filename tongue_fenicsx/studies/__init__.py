# SPDX-License-Identifier: MIT
"""Many runs with one question: sweep, atlas, postures, calibration, anatomy; and who does them."""

__all__ = [
    "anatomy_check",
    "anatomy_statements",
    "articulography",
    "atlas",
    "beside",
    "calibration",
    "cases",
    "designs",
    "fit_file",
    "fit_run",
    "fitting",
    "goals",
    "openness",
    "plan",
    "pool",
    "postures",
    "run_table",
    "shapes",
    "single_muscle",
    "stress",
    "sweep",
    "sweep_file",
    "worker",
]
