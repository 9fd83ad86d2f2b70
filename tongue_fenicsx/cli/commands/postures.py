# SPDX-License-Identifier: MIT
"""``tongue postures``: postures with and without gravity."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...core.errors import InputError
from ..options import Changes, Jobs, Overwrite
from ..progress import RunsBar
from ..study import conduct
from ..terminal import tabulate

if TYPE_CHECKING:
    from rich.table import Table

    from ...analysis.airway import Airways, Postures


def postures(
    scenarios: Annotated[list[Path], typer.Argument(metavar="SCENARIO.toml...", help="Postures, such as demos/postures/*.toml.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Run folders, the table and the sheet.")],
    changes: Changes = None,
    jobs: Jobs = 1,
    overwrite: Overwrite = False,
) -> None:
    """Run postures without gravity, upright and supine, and compare the airway over the tongue."""
    from ...scenario.files import load
    from ...studies import postures as study
    from ...studies.pool import Workers

    cases = {path.stem: load(path, changes) for path in scenarios}
    if len(cases) < len(scenarios):
        raise InputError("two scenarios have the same name; their runs would share a folder.")
    for path in scenarios:
        study.check(path, cases[path.stem])

    def run(scratch: Path, bar: RunsBar) -> tuple[Postures, Airways]:
        found = study.move_each(cases, output, Workers(jobs, overwrite=overwrite, report=bar))
        return found, study.airways(found)

    def show(found: tuple[Postures, Airways]) -> Iterator[Table]:
        yield tabulate(study.table(*found), "mm backward and upward at the end; narrowest place of the airway")

    def write(found: tuple[Postures, Airways], folder: Path) -> None:
        from ...plotting.posture_sheet import draw_sheet

        study.write(*found, folder)
        draw_sheet(*found, folder / "postures.png")

    conduct(output, study.FILES, run, show, write)
