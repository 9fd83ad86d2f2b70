# SPDX-License-Identifier: MIT
"""Sweeps: a scenario that is run many times, with other values of its keys each time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from ..analysis.tables import DONE
from ..analysis.tables import FILE as TABLE
from ..core.parallel import on_rank_zero
from ..scenario.files import read_toml
from ..scenario.schema import Scenario
from .cases import scenarios
from .designs import Change
from .plan import FAILED, KILLED, Plan
from .pool import Workers, perform
from .run_table import write_fields


def sweep(base: str | Path | Mapping[str, Any], design: Sequence[Change], output: str | Path, **options: Any) -> Path:
    """Run a scenario once for each entry of a design; what is there from an earlier call is not done again.

    Parameters
    ----------
    base : path or mapping
        The file of a scenario, or its tables.
    design : sequence of dict
        Keys of the scenario, such as ``tissue.c10``, to their values in each run; `designs` makes some. ``activation.MUSCLE`` may be a
        number: the course of the base with its highest level at that number, or where the base has none 100 ms of rise and hold.
    output : path
        Takes the run folders, ``table.csv`` and ``fields.h5``.
    **options
        As of `Workers`: ``jobs``, ``ranks_per_run``, ``shard``, ``figures``, ``overwrite``, ``report``.

    Returns
    -------
    Path
        The table: one line for each run, with its parameters, how it ended, and the main numbers of its summary.

    Raises
    ------
    InputError
        Before any run, if a scenario or an option is not accepted.
    Interrupted
        If interrupted; the same call goes on.
    """
    tables, folder = (base, Path()) if isinstance(base, Mapping) else (read_toml(Path(base), "a scenario in TOML"), Path(base).parent)
    run(scenarios(tables, folder, design), Path(output), Workers(**options))
    return Path(output) / TABLE


def run(cases: Sequence[tuple[Scenario, Change]], output: Path, workers: Workers, fields: bool = True) -> tuple[Plan, str]:
    """Do the runs of a sweep, in folders of their numbers, and gather their fields; also say what became of these."""
    digits = max(5, len(str(len(cases) - 1)))
    plan = perform(output, {f"runs/{index:0{digits}d}": case for index, case in enumerate(cases)}, workers)
    return plan, on_rank_zero(MPI.COMM_WORLD, lambda: write_fields(plan) if fields else "")


def describe(plan: Plan, gathered: str) -> list[str]:
    """What became of a sweep, in lines."""
    counts = Counter(outcome.status for _, outcome in plan.over())
    missing = len(plan.cases) - counts.total()
    parts = [f"{counts[status]} {status}" for status in (DONE, FAILED, KILLED) if counts[status]] + (
        [f"{missing} missing"] if missing else []
    )
    return [f"{len(plan.cases)} runs: {', '.join(parts)}", f"wrote {plan.folder / TABLE}", *([gathered] if gathered else [])]
