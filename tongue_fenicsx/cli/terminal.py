# SPDX-License-Identifier: MIT
"""Where commands print; text is printed as it is, without markup, because names and paths may hold brackets."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

console = Console(soft_wrap=True, width=None if sys.stdout.isatty() else 120, markup=False, emoji=False)
errors = Console(stderr=True, soft_wrap=True, highlight=False, markup=False, emoji=False)


def tabulate(rows: Sequence[Sequence[str | Text]], title: str) -> Table:
    """A table of rows, the names of the columns first."""
    head, *body = rows
    table = Table(*(Column(str(name), overflow="fold") for name in head), title=title)
    for row in body:
        table.add_row(*row)
    return table


def fail(text: str) -> Text:
    """Text that says what does not hold."""
    return Text(text, style="red")
