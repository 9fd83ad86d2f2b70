# SPDX-License-Identifier: MIT
"""``tongue sweep``: one scenario with many values of its keys."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from ...core.errors import InputError
from ...core.interruption import Interrupted
from ..options import Changes, Jobs, Overwrite
from ..progress import RunsBar
from ..terminal import console


def sweep(
    file: Annotated[Path, typer.Argument(metavar="SWEEP.toml", help="A base and what is varied; with --vary a scenario.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="DIR", help="Run folders, table.csv, fields.h5.")] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="KEY=VALUES", help="Of the scenario: value,value,… or first:last:number; may be repeated."),
    ] = None,
    changes: Changes = None,
    jobs: Jobs = 1,
    ranks_per_run: Annotated[int, typer.Option("--ranks-per-run", metavar="N", help="Under mpiexec: ranks that share a run.")] = 1,
    shard: Annotated[str, typer.Option("--shard", metavar="I/N", help="Only the I-th of N shares, as in an array job.")] = "1/1",
    fields: Annotated[bool, typer.Option("--fields/--no-fields", help="Gather the displacement of all runs in fields.h5.")] = True,
    figures: Annotated[bool, typer.Option("--figures", help="Draw the pictures of each run.")] = False,
    overwrite: Overwrite = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the design as CSV and end.")] = False,
) -> None:
    """Run a scenario with many values of its keys: one table, one file of fields; the same command goes on where it was left."""
    from ...studies import sweep_file
    from ...studies.cases import scenarios
    from ...studies.designs import as_csv

    base, folder, design = sweep_file.from_options(file, vary, changes) if vary else sweep_file.load(file, changes)
    cases = scenarios(base, folder, design)
    if dry_run:
        console.out(as_csv(design), end="", highlight=False)
        return
    if output is None:
        raise InputError("--output is missing; a folder for the runs is expected, or --dry-run.")
    share = re.fullmatch(r"(\d+)/(\d+)", shard)
    if share is None:
        raise InputError(f"--shard {shard}: the number of a share and how many there are, such as 1/8, are expected.")

    from mpi4py import MPI

    from ...studies import sweep as study
    from ...studies.pool import Workers

    rank = MPI.COMM_WORLD.rank
    try:
        with RunsBar(console, rank == 0) as bar:
            workers = Workers(jobs, ranks_per_run, (int(share[1]), int(share[2])), figures, overwrite, bar)
            plan, gathered = study.run(cases, output, workers, fields)
    except Interrupted as signal:
        raise Interrupted(signal.number, f"interrupted; the same command goes on with what is in {output}") from None
    if rank == 0:
        for line in study.describe(plan, gathered):
            console.print(line)
