# SPDX-License-Identifier: MIT
"""``tongue paraview``: a run as files that ParaView opens."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...core.errors import check_outputs
from ..terminal import console


def paraview(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder, finished or stopped.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="DIR", help="By default RUN-paraview.")] = None,
) -> None:
    """Write the moving tongue with muscles and fibres, its bones, and a script that opens them in ParaView."""
    from rich.progress import Progress

    from ...report.paraview import SCRIPT, write_paraview
    from ...runs.run import Run

    run, target = Run(folder), output or folder.with_name(f"{folder.resolve().name}-paraview")
    check_outputs(target, [SCRIPT])
    with Progress(console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(str(target), total=None)
        script = write_paraview(run, target, lambda done, total: bar.update(task, completed=done, total=total))
    console.print(f"wrote {target}; open it with: paraview --script={script}")
