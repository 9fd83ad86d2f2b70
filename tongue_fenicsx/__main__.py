# SPDX-License-Identifier: MIT
"""``python -m tongue_fenicsx`` is ``tongue``."""

from .cli import process
from .core.interruption import Interrupted, leave_at_once, on_signals


def main() -> None:
    """Run the command line in a process of its own."""
    try:
        process.prepare()
        from .cli.app import main as run

        run()
    except Interrupted as early:
        leave_at_once(early.number, None)
    finally:
        on_signals(leave_at_once)


if __name__ == "__main__":
    main()
