# SPDX-License-Identifier: MIT
"""Element sizes by name."""

PRESETS = {"coarse": 6.4e-3, "medium": 4.2e-3, "reference": 2.32e-3}
"""Element size in m away from the attachments."""
