# SPDX-License-Identifier: MIT
"""``tongue run``: one simulation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...core.errors import InputError, within
from ...core.interruption import Interrupted, Paused
from ..options import Changes, ScenarioFile
from ..progress import ProgressBar
from ..terminal import console, errors

if TYPE_CHECKING:
    from ...runs.run import Run


def run(
    scenario: ScenarioFile,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Run folder.")],
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the folder's checkpoint.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the run that the folder holds.")] = False,
    figures: Annotated[bool, typer.Option(help="Draw pictures of the finished run.")] = True,
    changes: Changes = None,
) -> None:
    """Run one simulation, also under mpiexec -n N."""
    from ...scenario.files import load

    if resume and overwrite:
        raise InputError("--resume and --overwrite: give one of them.")

    loaded = load(scenario, changes)

    from mpi4py import MPI

    from ...core.parallel import on_rank_zero
    from ...runs.claim import check_claim
    from ...runs.figures import figure_files
    from ...scenario import build as assemble
    from ...scenario.remarks import remarks

    comm = MPI.COMM_WORLD
    on_rank_zero(comm, lambda: check_claim(output, figure_files(), resume=resume, overwrite=overwrite))
    with within(scenario):
        simulation = assemble.simulation_of(loaded, output, keep_mesh=resume)
        courses = assemble.activation_of(loaded)
        inputs = assemble.inputs_of(loaded, simulation.model.tongue)
    said = remarks(simulation, courses, loaded.time.end)
    if comm.rank == 0:
        for remark in said:
            console.print(f"note: {remark}")
    try:
        with ProgressBar(console, comm.rank == 0) as bar:
            result = simulation.run(
                courses, loaded.time.end, output, resume=resume, overwrite=overwrite, report=bar, inputs=inputs, seed=loaded.seed
            )
    except Paused as paused:
        raise Interrupted(paused.number, f"{paused}, go on with --resume") from None
    shared = comm.gather(_draw(result, slice(comm.rank, None, comm.size)) if figures else ([], []))
    if shared is not None:
        for note in (note for _, notes in shared for note in notes):
            errors.print(note)
        _print_result(result)
        if pictures := [picture for drawn, _ in shared for picture in drawn]:
            console.print("pictures: " + ", ".join(map(str, pictures)))
        console.print(f"fields for ParaView: {result.folder / 'fields.xdmf'}")


def _draw(run: Run, share: slice) -> tuple[list[Path], list[str]]:
    """Draw a rank's share of the pictures of a run; what cannot be drawn is said, as the run is whole without it."""
    from ...runs.figures import FIGURES

    pictures, notes = [], []
    for name in [name for name, figure in FIGURES.items() if figure.applies(run)][share]:
        try:
            pictures += run.plot(name)
        except Exception as error:  # of any library that draws
            reason = " ".join(str(error).split())[:200]
            notes.append(
                f"note: the picture {name} could not be drawn ({type(error).__name__}: {reason}); the run is whole, see tongue plot."
            )
    return pictures, notes


def _print_result(run: Run) -> None:
    """Print the main numbers of a run."""
    from ...simulation.energy import warn

    s = run.summary
    for line in warn(s["energy_balance_error"]):
        console.print(line)
    console.print(
        f"{s['n_steps']} steps ({s['n_rejected']} rejected), "
        f"{s['newton_iterations'] / max(s['n_steps'], 1):.1f} Newton iterations a step, {s['wall_seconds']:.0f} s; "
        f"volume change {100 * s['volume_change_max']:.2f} %, Hencky strain {s['hencky_von_mises_max']:.2f}, "
        f"peak speed {100 * s['peak_speed_m_s']:.1f} cm/s"
    )
    for name, u in s["probes"].items():
        console.print(f"  {name}: {1e3 * u[0]:+.1f} mm backward, {1e3 * u[2]:+.1f} mm up")
    for name, touch in s["contact"].items():
        if touch["area_max_m2"] == 0:
            console.print(f"  contact with {name}: none")
            continue
        console.print(
            f"  contact with {name}: up to {touch['force_max_N']:.2g} N on {1e6 * touch['area_max_m2']:.0f} mm², "
            f"{1e3 * touch['penetration_max_m']:.2g} mm deep"
        )
