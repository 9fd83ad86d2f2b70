# SPDX-License-Identifier: MIT
"""``tongue atlas``: what each muscle does alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..options import Jobs, MeshFile, MeshPreset, Muscles, Overwrite, Tissue, check_single_muscles
from ..progress import RunsBar
from ..study import conduct
from ..terminal import tabulate

if TYPE_CHECKING:
    from rich.table import Table

    from ...runs.run import Run


def atlas(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="A run folder for each muscle, the table and the plate.")],
    mesh: MeshFile = None,
    preset: MeshPreset = None,
    tissue: Tissue = "calka",
    muscle: Muscles = None,
    jobs: Jobs = 1,
    overwrite: Overwrite = False,
) -> None:
    """Move each muscle alone: a table of what it does, and a plate of pictures."""
    from ...studies import atlas as study
    from ...studies import single_muscle as solo
    from ...studies.pool import Workers

    preset = check_single_muscles(mesh, preset, tissue, muscle, study.MUSCLES)

    def run(scratch: Path, bar: RunsBar) -> dict[str, Run]:
        path = solo.mesh_of(mesh, preset, output)
        muscles = solo.muscles_in(path, study.MUSCLES, muscle)
        return study.move_each(output, path, muscles, tissue, Workers(jobs, overwrite=overwrite, report=bar))

    def show(runs: dict[str, Run]) -> Iterator[Table]:
        yield tabulate(study.table(runs), f"each muscle alone, tissue {tissue}; x backward, z upward")

    def write(runs: dict[str, Run], folder: Path) -> None:
        from ...plotting.atlas_plate import draw_plate
        from ...runs.inputs import MESH

        study.write(runs, folder)
        first = next(iter(runs.values()))
        title = f"{first.summary['name']}, tissue {tissue}: each muscle alone at full activation for 250 ms"
        draw_plate(runs, solo.regions_in(first.folder / MESH, list(runs)), folder / "atlas.png", title)

    conduct(output, study.FILES, run, show, write)
