# SPDX-License-Identifier: MIT
"""``tongue verify``: the model against closed forms, published numbers and another code; muscles against anatomy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...core.errors import InputError
from ..options import Jobs, MeshFile, Muscles, Overwrite, check_name, check_single_muscles
from ..progress import RunsBar
from ..study import conduct
from ..terminal import console, fail, tabulate

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from ...studies.anatomy_check import Column, Matrix


def verify(
    only: Annotated[
        str | None, typer.Option("--only", metavar="NAME", help="One case, such as patch, fibres or calculix; of --stress one kind.")
    ] = None,
    anatomy: Annotated[bool, typer.Option("--anatomy", help="Instead: does each muscle alone do what anatomy says?")] = False,
    subject: Annotated[
        Path | None, typer.Option("--subject", metavar="SUBJECT_FOLDER", help="With --anatomy: a real subject as well.")
    ] = None,
    stress: Annotated[bool, typer.Option("--stress", help="Instead: do hard cases reach their end, and with how much work?")] = False,
    sample: Annotated[int | None, typer.Option("--sample", metavar="N", help="With --stress: only N runs, spread over the kinds.")] = None,
    robust: Annotated[bool, typer.Option("--robust", help="With --anatomy: also at 0.8 and 1.2 of the peak stresses.")] = False,
    mesh: MeshFile = None,
    muscle: Muscles = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="With --anatomy or --stress: keep the runs and the table here.")
    ] = None,
    jobs: Jobs = 1,
    overwrite: Overwrite = False,
) -> None:
    """Compare the model with closed forms and with CalculiX, or muscles with anatomy; exit 0 only if everything holds that is not open."""
    if sample is not None and not stress:
        raise InputError("--sample belongs to --stress.")
    if stress:
        if anatomy or subject or robust or muscle:
            raise InputError("--stress: not with --anatomy, --subject, --robust or --muscle.")
        holds = _verify_stress(only, sample, mesh, output, jobs, overwrite)
    elif anatomy:
        if only is not None:
            raise InputError("--only and --anatomy: give one of them.")
        holds = _verify_anatomy(subject, robust, mesh, muscle, output, jobs, overwrite)
    else:
        if subject or robust or mesh or muscle or output or jobs != 1 or overwrite:
            raise InputError("--subject, --robust, --mesh, --muscle, --output, --jobs and --overwrite belong to --anatomy or --stress.")
        holds = _verify_cases(only)
    if not holds:
        raise SystemExit(3)


def _verify_cases(only: str | None) -> bool:
    """Print the table of the cases; say whether every row holds."""
    from mpi4py import MPI

    from ...verification import CASES

    if only is not None:
        check_name("--only", only, CASES)
    rows: list[tuple[str | Text, ...]] = [("case", "reference", "error", "limit", "", "holds")]
    holds = True
    for name in CASES if only is None else [only]:
        if MPI.COMM_WORLD.rank == 0 and console.is_terminal:
            console.print(f"running {name} …")
        for row in CASES[name]():
            verdict = "skipped" if row.skipped else "yes" if row.holds else fail("NO")
            rows.append((row.case, row.reference, f"{row.error:.2g}", f"{row.limit:g}", row.note, verdict))
            holds = holds and row.holds
    if MPI.COMM_WORLD.rank == 0:
        console.print(tabulate(rows, "verification"))
    return holds


def _verify_stress(only: str | None, sample: int | None, mesh: Path | None, output: Path | None, jobs: int, overwrite: bool) -> bool:
    """Print the stress set by kind, and what failed; say whether enough of it reaches the end."""
    from ...analysis.tables import FILE as TABLE
    from ...studies import single_muscle as solo
    from ...studies import stress as study
    from ...studies import sweep
    from ...studies.pool import Workers

    chosen = study.select(only, sample)

    def run(scratch: Path, bar: RunsBar) -> Sequence[Mapping[str, str]]:
        folder = output or scratch
        path = solo.mesh_of(mesh, "coarse", folder)
        plan, _ = sweep.run(
            study.runs(chosen, path, solo.walls_in(path)), folder, Workers(jobs, overwrite=overwrite, report=bar), fields=False
        )
        return study.read(plan.folder / TABLE)

    def show(rows: Sequence[Mapping[str, str]]) -> Iterator[Table | str]:
        yield tabulate(study.by_kind(rows), f"{len(rows)} of {len(study.cases())} runs of the stress set")
        yield from study.failures(rows)

    return study.holds(conduct(output, study.FILES, run, show, study.write))


def _verify_anatomy(
    subject: Path | None, robust: bool, mesh: Path | None, some: list[str] | None, output: Path | None, jobs: int, overwrite: bool
) -> bool:
    """Print the matrix of the anatomical criteria; say whether all of them hold that are not open."""
    from ...studies import anatomy_check as study
    from ...studies import atlas
    from ...studies import single_muscle as solo
    from ...studies.pool import Workers

    preset = check_single_muscles(mesh, None, "calka", some, atlas.MUSCLES)

    def run(scratch: Path, bar: RunsBar) -> tuple[Matrix, list[Column]]:
        folder = output or scratch
        person = None if subject is None else solo.subject_mesh(subject, folder)
        settings = study.columns(solo.mesh_of(mesh, preset, folder), person, robust)
        muscles = {path: solo.muscles_in(path, atlas.MUSCLES, some) for path in {column.mesh: None for column in settings}}
        workers = Workers(jobs, overwrite=overwrite, report=bar)
        return study.check(folder, {column: muscles[column.mesh] for column in settings}, workers), settings

    def show(found: tuple[Matrix, list[Column]]) -> Iterator[Table | str]:
        matrix, settings = found
        rows: list[list[str | Text]] = [["muscle", "part", "statement", "bounds", *(column.label for column in settings)]]
        for name, criterion in study.rows(matrix):
            words = [study.verdict(criterion, matrix[name, criterion].get(column)) for column in settings]
            verdicts = (fail(word) if word.startswith("NO") else word for word in words)
            rows.append([name, criterion.part, criterion.says, criterion.bounds, *verdicts])
        yield tabulate(rows, "what each muscle must do alone")
        yield from (study.counts(matrix, column) for column in settings)

    matrix, _ = conduct(output, study.FILES, run, show, lambda found, folder: study.write(*found, folder))
    return study.holds(matrix)
