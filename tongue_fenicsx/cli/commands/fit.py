# SPDX-License-Identifier: MIT
"""``tongue fit``: which activations make a movement."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...core.interruption import Interrupted
from ..options import Changes
from ..terminal import console

if TYPE_CHECKING:
    from ...studies.fitting import Fit


def fit(
    file: Annotated[Path, typer.Argument(metavar="FIT.toml", help="A scenario, muscles that may act, and where probes should be.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="best.toml, fit.csv, and the run of the best.")],
    changes: Changes = None,
) -> None:
    """Find activations that take probes along given paths; the same command goes on from the best that the folder holds."""
    from ...core.errors import within
    from ...studies import fit_file

    task = fit_file.read(file, changes)

    from mpi4py import MPI

    from ...core.errors import check_outputs
    from ...core.parallel import on_rank_zero

    rank = MPI.COMM_WORLD.rank
    on_rank_zero(MPI.COMM_WORLD, lambda: check_outputs(output, [fit_file.BEST, fit_file.PROGRESS]))

    def say(found: Fit) -> None:
        away = ", ".join(f"{name} {d:.2f} mm" for name, d in found.distance.items())
        console.print(f"run {found.evaluations}: {away} away (root mean square over time)")

    try:
        with within(file):
            found = fit_file.fit(task, output, say)
    except Interrupted as signal:
        raise Interrupted(signal.number, f"interrupted; the same command goes on from the best so far, {output / fit_file.BEST}") from None
    if rank == 0:
        for name, levels in found.levels.items():
            console.print(f"  {name}: " + ", ".join(f"{level:.2f}" for level in levels))
        console.print(
            f"{found.reason.lower()} after {found.evaluations} runs; the best is {output / fit_file.BEST}, its run {output / 'run'}"
        )
