# SPDX-License-Identifier: MIT
"""The stress set: hard cases for the solver, each 120 ms of the tongue among its bones, and a table of how they ended.

The cases are a fixed list of changes to one scenario. Any part of the set has about the share of each kind that the whole has.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis.tables import DONE
from ..core.errors import InputError
from ..core.tables import markdown
from ..scenario.schema import Scenario
from . import designs
from .atlas import MUSCLES
from .cases import scenarios
from .designs import Change
from .single_muscle import CONTACT

FILES = ("stress.md",)
TISSUES, RATIOS = ("calka", "buchaillard"), (0.49, 0.499)
ANTAGONISTS = (("GGP", "HG"), ("GGP", "SG"), ("GGA", "SL"), ("SL", "IL"), ("TRANS", "VERT"), ("SG", "HG"), ("MH", "HG"), ("GGM", "SG"))
RISING = (("MH", "GGP"), ("MH", "GGP", "SL"), ("MH", "SG"), ("MH", "GGP", "GGM", "SG"))
END, RISE, JUMP = 0.12, 0.06, 1e-6
"""In s: of each run, of a ramp, and of a jump on its way."""
SEED = 15
REACH = 0.998
"""Share of the runs that must reach the end."""

Case = tuple[str, str, Change]
"""Kind, name, and what changes in the scenario."""


def cases() -> list[Case]:
    """The whole set, in an order of which every beginning is spread over the kinds."""
    kinds = {
        "level": _levels(),
        "pair": _pairs(),
        "random": _random(),
        "jump": _jumps(),
        "antagonists": _antagonists(),
        "palate": _palate(),
    }
    random, placed = np.random.default_rng(SEED), []
    for kind, those in kinds.items():
        for place, index in enumerate(random.permutation(len(those))):
            name, change = those[index]
            placed.append(((place + 0.5) / len(those), (kind, name, change)))
    return [case for _, case in sorted(placed, key=lambda entry: entry[0])]


def select(only: str | None, sample: int | None) -> list[Case]:
    """The cases of a kind, and so many of them; one tissue after the other, for each has forms of its own.

    Raises
    ------
    InputError
        If there is no such kind, or not one case is wanted.
    """
    every = cases()
    kinds = sorted({kind for kind, *_ in every})
    if only is not None and only not in kinds:
        raise InputError(f"--only {only}: one of {', '.join(kinds)} is expected.")
    if sample is not None and sample < 1:
        raise InputError(f"--sample {sample}: a positive number is expected.")
    return sorted([case for case in every if only in (None, case[0])][:sample], key=lambda case: str(case[2]["tissue.preset"]))


def runs(chosen: Sequence[Case], mesh: Path, walls: Sequence[str]) -> list[tuple[Scenario, Change]]:
    """The scenario of each case on a mesh, among these of its bones, and what the table says of it."""
    base = {
        "mesh": {"file": str(mesh)},
        "time": {"end": END},
        "output": {"every": END / 2},
        "contact": dict.fromkeys(walls, CONTACT),
        "activation": {muscle: {"pieces": [(END, 0.0, 0.0)]} for muscle in MUSCLES},
    }
    found = scenarios(base, Path(), [change for *_, change in chosen])
    return [(scenario, {"kind": kind, "case": name}) for (scenario, _), (kind, name, _) in zip(found, chosen, strict=True)]


def read(table: Path) -> list[dict[str, str]]:
    """The rows of the set's ``table.csv``."""
    with open(table, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def by_kind(rows: Sequence[Mapping[str, str]]) -> list[list[str]]:
    """A line for each kind, under the names of its columns, and one for all."""
    lines = [
        ["kind", "runs", "reach the end", "steps", "rejected", "Newton a step", "worst run", "Krylov a Newton", "least J", "imbalance"]
    ]
    kinds = sorted({row["kind"] for row in rows})
    for kind in [*kinds, "all"]:
        those = [row for row in rows if kind in ("all", row["kind"])]
        ended = [row for row in those if row["status"] == DONE]
        line = [kind, str(len(those)), f"{100 * len(ended) / len(those):.1f} %"]
        if ended:
            steps, rejected, newton, krylov, least, imbalance = (
                np.array([float(row[key]) for row in ended])
                for key in ("n_steps", "n_rejected", "newton_iterations", "krylov_iterations", "min_jacobian", "energy_balance_error")
            )
            line += [f"{steps.sum():.0f}", f"{rejected.sum():.0f}", f"{newton.sum() / steps.sum():.2f}", f"{(newton / steps).max():.2f}"]
            line += [f"{krylov.sum() / newton.sum():.1f}", f"{least.min():.2f}", f"{100 * imbalance.max():.2f} %"]
        lines.append(line + [""] * (len(lines[0]) - len(line)))
    return lines


def write(rows: Sequence[Mapping[str, str]], folder: Path) -> None:
    """The table by kind and what failed, as Markdown."""
    head, *lines = by_kind(rows)
    text = [markdown(head, lines), *(f"- {line}\n" for line in failures(rows))]
    (folder / FILES[0]).write_text("\n".join(text), encoding="utf-8")


def failures(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Each run that did not reach the end, with its reason."""
    return [f"{row['case']}: {row['reason']}" for row in rows if row["status"] != DONE]


def holds(rows: Sequence[Mapping[str, str]]) -> bool:
    """Whether enough of them reach the end."""
    return len(rows) - len(failures(rows)) >= REACH * len(rows)


def _of(tissue: str, nu: float, courses: Mapping[str, Any]) -> tuple[str, Change]:
    what = " ".join(f"{muscle} {course[-1][-1]:g}" for muscle, course in courses.items())
    activation = {f"activation.{muscle}": course for muscle, course in courses.items()}
    return f"{what} {tissue} {nu:g}", {"tissue.preset": tissue, "tissue.nu": nu, **activation}


def _ramp(level: float) -> list[tuple[float, float, float]]:
    return [(RISE, 0.0, level)]


def _levels() -> list[tuple[str, Change]]:
    settings = product(MUSCLES, (0.1, 0.3, 0.5, 1.0), TISSUES, RATIOS)
    return [_of(tissue, nu, {muscle: _ramp(level)}) for muscle, level, tissue, nu in settings]


def _pairs() -> list[tuple[str, Change]]:
    return [_of(tissue, 0.49, dict.fromkeys(pair, _ramp(0.5))) for pair, tissue in product(combinations(MUSCLES, 2), TISSUES)]


def _random() -> list[tuple[str, Change]]:
    settings = list(product(TISSUES, RATIOS))
    drawn = designs.random_activations(MUSCLES, 120, SEED, END, spacing=(0.03, 0.08))
    return [
        (f"random {i} {tissue} {nu:g}", {"tissue.preset": tissue, "tissue.nu": nu, **activation})
        for i, activation in enumerate(drawn)
        for tissue, nu in [settings[i % len(settings)]]
    ]


def _jumps() -> list[tuple[str, Change]]:
    at_once, later = [(END, 1.0, 1.0)], [(END / 3, 0.0, 0.0), (JUMP, 0.0, 1.0)]
    found = []
    for when, course, groups in (
        ("at once", at_once, [(muscle,) for muscle in MUSCLES] + [MUSCLES]),
        ("later", later, [(muscle,) for muscle in MUSCLES]),
    ):
        for group, tissue in product(groups, TISSUES):
            name, change = _of(tissue, 0.49, dict.fromkeys(group, course))
            found.append((f"{when} {name}", change))
    return found


def _antagonists() -> list[tuple[str, Change]]:
    return [_of(tissue, nu, dict.fromkeys(pair, _ramp(1.0))) for pair, tissue, nu in product(ANTAGONISTS, TISSUES, RATIOS)]


def _palate() -> list[tuple[str, Change]]:
    settings = product(RISING, (0.3, 0.6, 1.0), TISSUES, RATIOS)
    return [_of(tissue, nu, dict.fromkeys(group, _ramp(level))) for group, level, tissue, nu in settings]
