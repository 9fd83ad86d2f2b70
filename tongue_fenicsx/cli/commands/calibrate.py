# SPDX-License-Identifier: MIT
"""``tongue calibrate``: peak stresses from the strain that each muscle reaches."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...core.errors import InputError
from ..options import Jobs, MeshFile, MeshPreset, Muscles, Overwrite, Tissue, check_single_muscles
from ..progress import RunsBar
from ..study import conduct
from ..terminal import tabulate

if TYPE_CHECKING:
    from rich.table import Table

    from ...studies.calibration import Found


def calibrate(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.toml", help="The stresses, as a scenario takes them.")],
    mesh: MeshFile = None,
    preset: MeshPreset = None,
    tissue: Tissue = "calka",
    strain: Annotated[float, typer.Option(help="Von Mises Hencky strain to reach, 99th percentile by volume.")] = 0.5,
    muscle: Muscles = None,
    jobs: Jobs = 1,
    overwrite: Overwrite = False,
) -> None:
    """Find the peak stress with which each tongue muscle alone reaches a strain."""
    from ...studies import calibration
    from ...studies import single_muscle as solo
    from ...studies.pool import Workers

    if output.suffix != ".toml":
        raise InputError(f"{output}: the file must end in .toml.")
    preset = check_single_muscles(mesh, preset, tissue, muscle, calibration.TONGUE_MUSCLES)
    calibration.check_target(strain)
    name = f"parametric tongue, {preset}" if mesh is None else mesh.name

    def run(scratch: Path, bar: RunsBar) -> dict[str, Found]:
        folder = output.with_name(f"{output.stem}-runs")
        path = solo.mesh_of(mesh, preset, folder)
        muscles = solo.muscles_in(path, calibration.TONGUE_MUSCLES, muscle)
        return calibration.calibrate(folder, path, muscles, tissue, strain, bar.say, Workers(jobs, overwrite=overwrite, report=bar))

    def show(found: dict[str, Found]) -> Iterator[Table]:
        rows = [("muscle", "peak stress kPa", "strain", "runs", "")]
        for key, f in found.items():
            note = "" if f.reached else f"{strain:g} is not reached up to {1e-3 * f.limit:g} kPa"
            rows.append((key, f"{1e-3 * f.stress:g}", f"{f.strain:.3f}", str(f.runs), note))
        yield tabulate(rows, f"{name}, tissue {tissue}, strain {strain:g}")

    def write(found: dict[str, Found], folder: Path) -> None:
        calibration.write(found, folder / output.name, name, tissue, strain)

    conduct(output.parent, [output.name], run, show, write)
