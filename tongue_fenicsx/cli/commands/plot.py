# SPDX-License-Identifier: MIT
"""``tongue plot``: figures of runs, and response curves of tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...core.errors import InputError, check_outputs
from ..terminal import console
from .compare import PICTURES


def plot(
    sources: Annotated[list[Path], typer.Argument(metavar="RUN|TABLE.csv|SWEEP...", help="Run folders, tables, or folders of sweeps.")],
    figures: Annotated[list[str] | None, typer.Option("--figure", metavar="NAME", help="Of a run: only this one; may be repeated.")] = None,
    x: Annotated[str | None, typer.Option("--x", metavar="KEY", help="Of a table: the key across.")] = None,
    y: Annotated[list[str] | None, typer.Option("--y", metavar="COLUMN", help="Of a table: what is drawn; may be repeated.")] = None,
    by: Annotated[str | None, typer.Option("--by", metavar="KEY", help="Of a table: the key whose values are lines.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.png", help="Of a table: the picture; by default responses.png beside it.")
    ] = None,
) -> None:
    """Draw the figures of runs anew, or response curves of a table of runs: columns over a key that was varied."""
    from ...analysis.tables import FILE

    tables = {source: source / FILE if (source / FILE).is_file() else source for source in sources if _is_table(source, FILE)}
    if figures and tables:
        raise InputError(f"--figure: {next(iter(tables))} is a table; it has --x, --y and --by.")
    if (x or y or by or output) and len(tables) < len(sources):
        raise InputError("--x, --y, --by and --output belong to tables; a run has --figure.")
    if output is not None and (len(sources) > 1 or output.suffix not in PICTURES):
        raise InputError(f"--output {output}: one table and a file named {', '.join(PICTURES)} are expected.")

    from ...analysis.moments import ends
    from ...analysis.tables import Table
    from ...plotting.response_curves import draw_responses
    from ...runs.run import Run

    for source in sources:
        if source in tables:
            picture = output or tables[source].with_name("responses.png")
            check_outputs(picture.parent, [picture.name])
            drawn = [draw_responses(Table.read(tables[source]), picture, x, y or (), by)]
        else:
            run = Run(source)
            ends(run)  # can its fields be read?
            drawn = run.plot(*figures or ())
        console.print("wrote " + ", ".join(map(str, drawn)))


def _is_table(source: Path, name: str) -> bool:
    return source.suffix == ".csv" or (source / name).is_file()
