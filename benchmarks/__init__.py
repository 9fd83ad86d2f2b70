# SPDX-License-Identifier: MIT
"""What the solver costs: ``make bench`` in minutes, ``make bench-full`` at the chapter's size."""

import tongue_fenicsx  # noqa: F401  (before DOLFINx)
