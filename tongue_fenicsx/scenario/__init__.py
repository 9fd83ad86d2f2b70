# SPDX-License-Identifier: MIT
"""Scenario files: what there may be in one, and the simulation that it describes."""

__all__ = ["build", "effort", "files", "remarks", "schema"]
