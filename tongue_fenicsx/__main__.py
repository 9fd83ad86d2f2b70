# SPDX-License-Identifier: MIT
"""``python -m tongue_fenicsx`` is ``tongue``."""

from .cli.app import main

if __name__ == "__main__":
    main()
