# SPDX-License-Identifier: MIT
"""``tongue compare``: runs over each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...core.errors import InputError, check_outputs
from ..terminal import console, tabulate

PICTURES = (".png", ".pdf", ".svg")


def compare(
    folders: Annotated[list[Path], typer.Argument(metavar="A B...", help="Run folders; the others are held against the first.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.png", help="The picture, also .pdf or .svg.")],
    time: Annotated[float | None, typer.Option("--time", metavar="S", help="When, in s; by default at the end of each run.")] = None,
) -> None:
    """Draw contours and trajectories of runs over each other, and say what differs; a table as .md and .csv lies beside the picture."""
    if output.suffix not in PICTURES:
        raise InputError(f"--output {output}: a file named {', '.join(PICTURES)} is expected.")
    check_outputs(output.parent, [output.with_suffix(suffix).name for suffix in (output.suffix, ".md", ".csv")])

    from ...analysis.comparison import open_runs
    from ...plotting.comparison_sheet import draw_comparison

    comparison = draw_comparison(open_runs(folders), output, time)
    tables = comparison.write(output)
    console.print(tabulate(comparison.rows(), "what differs"))
    console.print("wrote " + ", ".join(map(str, [output, *tables])))
