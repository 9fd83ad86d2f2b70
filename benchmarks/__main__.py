# SPDX-License-Identifier: MIT
"""``python -m benchmarks [--full] [--update]``: measure, print tables, compare with the committed numbers by ratios; with ``--against
COMMIT`` the same runs of that commit and of this one in turn.

Ratios are to a Newton iteration of plain DOLFINx with MUMPS on a small block, measured in the same run, so that they mean the same
on another machine.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from petsc4py import PETSc

from tongue_fenicsx.core.tables import markdown as table
from tongue_fenicsx.core.versions import versions

from . import measure, pairs, peers
from .timing import Finished, machine, run, steady

HERE = Path(__file__).parent
FOLDER = Path("runs/bench")
SLOWER = 1.2
"""How much slower than the committed ratio is worth saying."""
CHAPTER_SECONDS = 5 * 3600
"""What the chapter needed on ten cores, from its section on the simulations."""

Table = list[dict[str, Any]]


def row_of(name: str, done: Finished) -> dict[str, Any]:
    """A run as a row: Newton iterations times what each is made of, and s of the solution and of the whole process."""
    s = done.summary
    newton = s["newton_iterations"]
    parts = {f"{key} (s)": value / newton for key, value in done.events.items()}
    return {
        "case": name, "unknowns": s["n_dofs"], "ranks": s["ranks"], "steps": s["n_steps"], "rejected": s["n_rejected"], "newton": newton,
        "newton per step": done.newton_per_step, "krylov per newton": done.krylov_per_newton, **parts,
        "solution (s)": s["wall_seconds"], "seconds": done.seconds, "GiB per rank": s["peak_memory_gib"],
    }  # fmt: skip


def measurements(full: bool, found: dict[str, Table]) -> None:
    """Fill in all tables, one after the other."""
    preset = "reference" if full else "coarse"
    step = 6.25e-3
    say("peers")
    found["peers"] = [vars(peer) | {"per newton (s)": peer.per_newton} for peer in peers.peers(*((8, 10) if full else (4, 10)))]
    if full:
        say("peers at the chapter's size")
        found["peers at the chapter's size"] = [vars(peer) | {"per newton (s)": peer.per_newton} for peer in peers.large(15, 5)]
    baseline = steady(lambda: {"seconds": peers.plain(4, 5).per_newton})
    found["baseline"] = [{"what": "Newton iteration of plain DOLFINx, MUMPS LU, 768 tetrahedra"} | baseline]
    say("assembly")
    file = measure.mesh(preset, FOLDER)
    times = measure.assembly(file)
    found["assembly"] = [{"muscles": name, **{f"{key} (µs per cell)": value for key, value in of.items()}} for name, of in times.items()]
    say("solver")
    found["solver"] = []
    for name, of in measure.PRESETS.items():
        rows = [measure.solver(n, of) for n in ((6, 9, 13) if of["mixed"] else (6, 9, 13, 18, 27) if full else (6, 9, 13, 18))]
        fit = measure.exponent(rows)
        found["solver"] += [{"preset": name} | row | {"exponent": fit} for row in rows]
    say("the chapter's case")
    runs = {ranks: measure.chapter(file, FOLDER, step, ranks) for ranks in (2, 1)}
    quarter = measure.chapter(file, FOLDER, step / 4, 2)
    found["chapter"] = [row_of(f"{preset}, {1e3 * step:g} ms", done) for done in runs.values()]
    found["chapter"].append(row_of(f"{preset}, {1e3 * step / 4:g} ms", quarter))
    where = [FOLDER / f"{file.stem}-{1e3 * h:g}ms-2" for h in (step, step / 4)]
    found["chapter's result"] = [
        {
            "error of the trajectories": measure.trajectory_error(*where),
            "2 ranks are faster by": runs[1].summary["wall_seconds"] / runs[2].summary["wall_seconds"],
            "the chapter's time over ours": CHAPTER_SECONDS / runs[2].seconds,
        }
    ]
    coarse = measure.mesh("coarse", FOLDER)
    if full:
        say("time steps")
        found["time steps"] = list(measure.time_steps(coarse, FOLDER, [12.5e-3, 10e-3, 5e-3, 2.5e-3, 1.25e-3]))
    say("small and first runs")
    small = measure.mesh(20e-3, FOLDER)
    found["quick"] = [row_of("smallest tongue, 350 ms", measure.chapter(small, FOLDER, 5e-3))]
    found["sweep"] = [measure.sweep(small, 50)]
    demo = [f"mesh.file={coarse.resolve()}"]
    with tempfile.TemporaryDirectory() as cache:
        first = run(Path("demos/ggp.toml"), FOLDER / "first", *demo, environment={"XDG_CACHE_HOME": cache})
    found["quick"] += [
        row_of("demo, first run with compilation", first),
        row_of("demo", run(Path("demos/ggp.toml"), FOLDER / "demo", *demo)),
    ]


def timings(tables: dict[str, Table]) -> dict[str, float]:
    """Every time as a ratio to the baseline, by the name of its table, row and column."""
    baseline = tables["baseline"][0]["seconds"]
    keys = ("case", "preset", "name", "muscles", "ranks", "unknowns", "step_ms")
    return {
        "; ".join([name, *(f"{row[key]}" for key in keys if key in row), column]): value / baseline
        for name, rows in tables.items()
        if name != "baseline"
        for row in rows
        for column, value in row.items()
        if column in ("seconds", "solution (s)", "total", "per newton (s)") or "per cell" in column
    }


def page(tables: dict[str, Table], about: dict[str, Any]) -> str:
    """All tables, each with what it was measured on above."""

    def cell(value: object) -> str:
        return f"{value:.3g}" if isinstance(value, float) else str(value)

    lines = [f"{about['processor']}, {about['cores']} cores, {about['memory_gib']} GiB; one thread a rank.", ""]
    for name, rows in tables.items():
        head = list(rows[0])
        lines += [f"### {name.capitalize()}", "", table(head, ([cell(row[key]) for key in head] for row in rows))]
    return "\n".join(lines)


def say(what: str) -> None:
    """Where the benchmark is."""
    print(f"-- {what}", file=sys.stderr, flush=True)


def main() -> int:
    """Measure, write, compare; 1 if something got slower."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--full", action="store_true", help="at the chapter's size; an hour or so")
    parser.add_argument("--update", action="store_true", help="make the result the committed one")
    parser.add_argument("--against", metavar="COMMIT", help="compare runs with those of a commit, in turn, and nothing else")
    parser.add_argument("--repeats", type=int, default=5, help="how often each of those runs, of which the median counts")
    chosen = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    if chosen.against:
        for row in pairs.compare(chosen.against, FOLDER, chosen.repeats, chosen.full):
            print(table(["", row.pop("run")], ([key, f"{value:.3g}"] for key, value in row.items())), flush=True)
        return 0
    PETSc.Log.begin()
    about = machine() | {"versions": versions()}
    tables: dict[str, Table] = {}
    stem = "full" if chosen.full else "quick"
    try:
        measurements(chosen.full, tables)
    finally:  # an hour's work is not lost with its last row
        (FOLDER / f"{stem}.part.md").write_text(page(tables, about), encoding="utf-8")
    committed = HERE / f"{stem}.json"
    folder = HERE if chosen.update else FOLDER
    result = {"machine": about, "tables": tables, "ratios": timings(tables)}
    (folder / f"{stem}.json").write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    (folder / f"{stem}.md").write_text(page(tables, about), encoding="utf-8")
    print(page(tables, about))
    if chosen.update or not committed.exists():
        return 0
    before = json.loads(committed.read_text(encoding="utf-8"))["ratios"]
    slower = {name: value / before[name] for name, value in result["ratios"].items() if value > SLOWER * before.get(name, float("inf"))}
    for name, factor in slower.items():
        print(f"slower by {100 * (factor - 1):.0f} %: {name}")
    return int(bool(slower))


if __name__ == "__main__":
    sys.exit(main())
