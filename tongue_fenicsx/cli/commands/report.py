# SPDX-License-Identifier: MIT
"""``tongue report``: runs on one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...core.errors import InputError, check_outputs
from ..terminal import console


def report(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Run folders, finished or stopped.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.html", help="The page.")] = Path("report.html"),
) -> None:
    """Put runs on one HTML page that opens anywhere: numbers, pictures, charts and the motion in 3D."""
    if output.suffix not in (".html", ".htm"):
        raise InputError(f"--output {output}: a file named .html is expected.")
    check_outputs(output.parent, [output.name])

    from ...report import write_report

    write_report(folders, output)
    console.print(f"wrote {output} ({output.stat().st_size / 1e6:.1f} MB)")
