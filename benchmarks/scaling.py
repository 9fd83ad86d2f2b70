# SPDX-License-Identifier: MIT
"""``python -m benchmarks.scaling [TABLES.json]``: what a Newton iteration would take on more ranks than were measured; a prediction.

A part of an iteration (tangent, residuals, set-up, Krylov method) is work that ranks share, ``w N / P`` for N unknowns on P ranks, and
work that they do not, which grows with the coarse level, ``f N``; both are those of the chapter's case on 1 and 2 ranks. Ranks of one
machine share its bandwidth, too, which two ranks show. A Krylov iteration also waits for messages: two sums over all ranks, each of
log₂ P steps, and six exchanges with neighbours on the fine level and on each of log₈ N algebraic ones. What a message takes is assumed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tongue_fenicsx.core.tables import markdown

MESSAGE = 2e-6
"""s; a short one over InfiniBand or in memory."""
SUMS, EXCHANGES = 2, 6
"""Of a Krylov iteration."""
PARTS = ("tangent", "residual", "set-up", "Krylov")


def shared(one: float, two: float) -> tuple[float, float]:
    """s of work that ranks share and of work that they do not, from the times on one rank and on two."""
    alone = min(max(2 * two - one, 0.0), one)
    return one - alone, alone


def waiting(unknowns: float, ranks: int) -> float:
    """s of a Krylov iteration for messages."""
    levels = 1 + np.log(unknowns) / np.log(8)
    return 0.0 if ranks == 1 else float(MESSAGE * (SUMS * np.log2(ranks) + EXCHANGES * levels))


def prediction(one: Mapping[str, float], two: Mapping[str, float], unknowns: float, ranks: int) -> float:
    """s of a Newton iteration, from the rows of the same case on one rank and on two."""
    share = [shared(one[f"{part} (s)"], two[f"{part} (s)"]) for part in PARTS]
    work = sum(together / ranks + alone for together, alone in share) * unknowns / one["unknowns"]
    return work + one["krylov per newton"] * waiting(unknowns, ranks)


def main() -> None:
    """Print the parts and the prediction."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scaling", description=__doc__)
    parser.add_argument("tables", nargs="?", type=Path, default=Path(__file__).with_name("full.json"), help="of a benchmark")
    rows = json.loads(parser.parse_args().tables.read_text(encoding="utf-8"))["tables"]["chapter"]
    two, one = rows[:2]
    split = {part: shared(one[f"{part} (s)"], two[f"{part} (s)"]) for part in PARTS}
    print(markdown(["part", "shared (s)", "not shared (s)"], [[part, *(f"{value:.3g}" for value in of)] for part, of in split.items()]))
    ranks = (1, 2, 16, 64, 256)
    lines = []
    for unknowns in (one["unknowns"], 1e6, 1e7):
        times = [prediction(one, two, unknowns, n) for n in ranks]
        lines.append([f"{unknowns:.3g}", *(f"{t:.2g} s, {times[0] / t:.0f} ×" for t in times)])
    print(markdown(["unknowns", *(f"{n} ranks" for n in ranks)], lines))


if __name__ == "__main__":
    main()
