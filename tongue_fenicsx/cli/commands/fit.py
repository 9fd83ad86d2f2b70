# SPDX-License-Identifier: MIT
"""``tongue fit``: which activations make a movement."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...core.interruption import Interrupted
from ..options import Changes, Jobs
from ..progress import RunsBar
from ..terminal import console

if TYPE_CHECKING:
    from ...studies.fit_file import Task
    from ...studies.fitting import Fit
    from ...studies.openness import Openness


SAID = 12
"""Combinations that are left open are named, the least certain first."""


def fit(
    file: Annotated[Path, typer.Argument(metavar="FIT.toml", help="A scenario, muscles that may act, and what they should do.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="best.toml, fit.csv, open.csv, fit.png, and the run of the best.")
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Begin anew; what the folder holds of a fit is replaced.")] = False,
    changes: Changes = None,
    jobs: Jobs = 1,
) -> None:
    """Find activations that move points or shape the tongue as wanted, and what the data leave open; the same command goes on from the
    best that the folder holds."""
    from ...core.errors import within
    from ...studies import fit_file, fit_run

    task = fit_file.read(file, changes)

    from mpi4py import MPI

    from ...core.parallel import on_rank_zero
    from ...studies.pool import Workers

    rank, best = MPI.COMM_WORLD.rank, output / fit_run.BEST
    bar = RunsBar(console, rank == 0)
    workers = Workers(jobs, overwrite=True, report=bar)

    def say(found: Fit) -> None:
        away = ", ".join(f"{name} {d:.2f} mm" for name, d in found.distance.items())
        opened = f"; the jaw opens by {found.angle:.1f}°" if task.file.opening else ""
        console.print(f"run {found.evaluations}: {away} away (root mean square over time){opened}")

    on_rank_zero(MPI.COMM_WORLD, lambda: fit_run.begin(task, output, overwrite))
    try:
        with within(file):
            task = fit_run.glue(task, console.print)
            fitting = fit_run.FitRun(task, output, say, console.print)
        found = fitting.seek()
        with bar:
            beside = fitting.look_beside(found, workers)
        if task.file.slopes == "full":
            found = fitting.finish(beside)
        fitting.leave(found)
        known = fitting.look_around(found, beside) if task.paths else None  # bounds and constrictions are no data
    except Interrupted as signal:
        words = (
            f"the same command goes on from the best so far, {best}" if best.exists() else "before its first run was over; nothing is left"
        )
        raise Interrupted(signal.number, f"interrupted, {words}") from None
    if rank == 0:
        _print_result(task, output, found)
        if known:
            _print_openness(known, output)


def _print_result(task: Task, output: Path, found: Fit) -> None:
    """Print how the search ended."""
    from ...studies import fit_run

    drawn = f", drawn in {output / fit_run.CONTOURS}" if (output / fit_run.CONTOURS).exists() else ""
    files = f"the best is {output / fit_run.BEST}, its run {output / fit_run.RUN}{drawn}"
    console.print(f"{found.reason.lower()} after {found.evaluations} runs; {files}")
    for name, (most, t) in fit_run.farthest(task, output).items():
        console.print(f"  {name}: {found.distance[name]:.2f} mm away (root mean square), at most {most:.2f} mm, at {1e3 * t:.0f} ms")


def _print_openness(known: Openness, output: Path) -> None:
    """Print what the data leave open."""
    from ...studies import fit_run

    for line in _words(known):
        console.print(line)
    console.print(f"wrote {output / fit_run.OPEN} and {output / fit_run.SHEET}")
    run, paths, film = output / fit_run.RUN, output / fit_run.PATHS, output / "fit.mp4"
    console.print(f"the points in motion: tongue movie {run} --section midsagittal --beside {paths} -o {film}")


def _words(known: Openness) -> Iterator[str]:
    """What is sure and what is not, a line for each muscle and each combination that is open."""
    from ...studies.fitting import OPENING

    for name, levels in known.levels.items():
        scale, unit = (known.most, "°") if name == OPENING else (1.0, "")
        bounds = zip(levels, *known.interval(name), strict=True)
        yield f"  {name}: " + ", ".join(f"{scale * at:.2f}{unit} ({scale * low:.2f} to {scale * high:.2f})" for at, low, high in bounds)
        if (most := known.times[name][levels >= 1 - 1e-3]).size:
            yield f"  {name} {'is as far as' if unit else 'pulls as hard as'} it may at {', '.join(f'{1e3 * t:.0f}' for t in most)} ms"
    yield f"with {known.noise:.2g} mm of noise {known.determined} of {len(known.combinations)} combinations of levels are determined"
    left = known.open_ones()
    yield from (f"  open: {words}" for words in left[:SAID])
    if len(left) > SAID:
        yield f"  and {len(left) - SAID} more"
