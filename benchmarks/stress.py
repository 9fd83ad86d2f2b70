# SPDX-License-Identifier: MIT
"""``python -m benchmarks.stress -o DIR [--mesh FILE] [--sample N]``: the stress set with our linear solvers and with MUMPS alone.

Leaves ``ours/`` and ``plain/`` as `tongue verify --stress` does, and ``profile.png``: the share of the runs that each finishes within so
many times the time of the quicker one (Dolan and Moré 2002). Finished runs are not done again.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tongue_fenicsx.analysis.tables import FILE as TABLE
from tongue_fenicsx.core.tables import markdown
from tongue_fenicsx.solvers import newton
from tongue_fenicsx.solvers.linear import LinearSolvers
from tongue_fenicsx.studies import stress, sweep
from tongue_fenicsx.studies.pool import Workers
from tongue_fenicsx.studies.run_table import TIMING
from tongue_fenicsx.studies.single_muscle import mesh_of, walls_in


class Plain(LinearSolvers):
    """A direct solver in every Newton iteration."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.ladder = ("mumps",)


def profiles(seconds: Mapping[str, Mapping[str, float]]) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Ratios τ, and of each solver the share of the cases that it finishes within τ times the least time; `seconds` has case to time of
    each solver, without those that it did not finish."""
    cases = sorted(set().union(*seconds.values()))
    times = np.array([[of.get(case, np.inf) for case in cases] for of in seconds.values()])
    ratios = times / times.min(axis=0)
    at = np.unique(np.r_[1.0, ratios[np.isfinite(ratios)]])
    return at, {name: (row[:, None] <= at).mean(axis=0) for name, row in zip(seconds, ratios, strict=True)}


def finished(folder: Path) -> dict[str, float]:
    """Case to s of the time steps, of the runs that reached the end."""
    with open(folder / TIMING, newline="", encoding="utf-8") as file:
        seconds = {row["index"]: float(row["wall_seconds"] or "nan") for row in csv.DictReader(file)}
    return {row["case"]: seconds[row["index"]] for row in stress.read(folder / TABLE) if row["status"] == "done"}


def main() -> None:
    """Run both, print both tables, draw the profile."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stress", description=__doc__)
    parser.add_argument("--output", "-o", type=Path, required=True)
    parser.add_argument("--mesh", type=Path)
    parser.add_argument("--sample", type=int)
    chosen = parser.parse_args()
    mesh = mesh_of(chosen.mesh, "coarse", chosen.output)
    runs = stress.runs(stress.select(None, chosen.sample), mesh, walls_in(mesh))
    for name in ("ours", "plain"):
        with patch.object(newton, "LinearSolvers", Plain) if name == "plain" else nullcontext():
            sweep.run(runs, chosen.output / name, Workers(), fields=False)
        head, *lines = stress.by_kind(stress.read(chosen.output / name / TABLE))
        print(f"{name}\n\n{markdown(head, lines)}")
    at, shares = profiles({name: finished(chosen.output / name) for name in ("ours", "plain")})
    figure = Figure()
    ax = figure.subplots()
    for name, share in shares.items():
        ax.step(at, share, where="post", label=name)
    ax.set(xscale="log", xlabel="time over that of the quicker", ylabel="share of the runs", ylim=(0, 1.02))
    ax.legend()
    figure.savefig(chosen.output / "profile.png", dpi=150)


if __name__ == "__main__":
    main()
