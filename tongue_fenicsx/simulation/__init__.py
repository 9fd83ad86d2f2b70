# SPDX-License-Identifier: MIT
"""The time loop: engine, steps, energies, and the quantities that a run leaves."""

__all__ = [
    "as_scenario",
    "diagnosis",
    "energy",
    "engine",
    "fields",
    "gradient",
    "initial",
    "loop",
    "probes",
    "quadrature_points",
    "quantities",
    "records",
    "simulation",
    "snapshot",
    "step_control",
    "stepping",
    "strain",
    "summary",
    "totals",
]
