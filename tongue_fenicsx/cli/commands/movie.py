# SPDX-License-Identifier: MIT
"""``tongue movie``: the motion of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...core.errors import InputError, check_outputs
from ..terminal import console


def movie(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder, finished or stopped.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.mp4|.gif", help="The movie.")],
    quantity: Annotated[str, typer.Option("--quantity", help="Stored field, hencky or J.")] = "displacement",
    view: Annotated[str | None, typer.Option("--view", help="side, front, top or oblique (default).")] = None,
    section: Annotated[str | None, typer.Option("--section", help="midsagittal: the section instead of a view in 3D.")] = None,
    beside: Annotated[
        Path | None,
        typer.Option(
            "--beside", metavar="TABLE.csv", help="With --section: points of a trajectories.csv, or of a fit's paths.csv, beside it."
        ),
    ] = None,
    start: Annotated[float | None, typer.Option("--from", metavar="S", help="First time of the run in s.")] = None,
    end: Annotated[float | None, typer.Option("--to", metavar="S", help="Last time of the run in s.")] = None,
    seconds: Annotated[float, typer.Option("--seconds", min=0.1, max=600, help="How long the movie takes.")] = 4.0,
    fps: Annotated[int, typer.Option("--fps", min=1, max=50, help="Frames per second.")] = 25,
) -> None:
    """Draw the motion of a run as a movie: a field on the tongue among its bones, in 3D or in the mid-sagittal plane."""
    if section not in (None, "midsagittal"):
        raise InputError(f"--section: {section!r} is not midsagittal, the only one.")
    if section and view not in (None, "side"):
        raise InputError(f"--view {view}: a section is seen from the side; leave out --view or --section.")
    if beside and not section:
        raise InputError("--beside: points are drawn in the section; --section midsagittal is expected with it.")
    check_outputs(output.parent, [output.name])

    from rich.progress import Progress

    from ...analysis.trajectories import read_places
    from ...plotting.movie import draw_movie
    from ...runs.run import Run

    with Progress(console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(output.name, total=None)
        draw_movie(
            Run(folder),
            output,
            quantity=quantity,
            view=None if section else view or "oblique",
            start=start,
            end=end,
            seconds=seconds,
            fps=fps,
            beside=read_places(beside) if beside else None,
            report=lambda frame, frames: bar.update(task, completed=frame, total=frames),
        )
    console.print(f"wrote {output} ({output.stat().st_size / 1e6:.1f} MB)")
