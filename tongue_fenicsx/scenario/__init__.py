# SPDX-License-Identifier: MIT
"""Scenario files: what there may be in one, and the simulation that it describes."""

__all__ = ["build", "changes", "effort", "files", "remarks", "schema"]
