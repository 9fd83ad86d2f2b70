# SPDX-License-Identifier: MIT
"""``python -m tongue_fenicsx`` is ``tongue``."""

from .cli import main

if __name__ == "__main__":
    main()
