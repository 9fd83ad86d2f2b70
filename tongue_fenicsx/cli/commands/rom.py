# SPDX-License-Identifier: MIT
"""``tongue rom``: a reduced tongue, which learns from many runs and then moves in real time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..options import Changes, ScenarioFile
from ..terminal import console

rom = typer.Typer(help="A reduced tongue, which learns from many runs and then moves in real time.", no_args_is_help=True)
Model = Annotated[Path, typer.Argument(metavar="MODEL.npz", help="A reduced tongue.")]


@rom.command()
def train(
    sweeps: Annotated[list[Path], typer.Argument(metavar="SWEEP_DIR…", help="Folders of sweeps to learn from.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="MODEL.npz", help="The reduced tongue.")],
    modes: Annotated[int, typer.Option("--modes", metavar="N", min=1, help="Shapes that it is made of.")] = 60,
    iterations: Annotated[int, typer.Option("--iterations", metavar="N", min=1, help="Of the training.")] = 4000,
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Of the training.")] = 0,
    begin: Annotated[
        Path | None,
        typer.Option("--begin", metavar="MODEL.npz", help="A reduced tongue of the same mesh, in another tissue perhaps, to begin with."),
    ] = None,
    mesh: Annotated[str, typer.Option("--mesh", metavar="PRESET", help="Of the runs, for scenarios that tongue live exports.")] = "coarse",
) -> None:
    """Let a reduced tongue learn from the runs of sweeps; one in ten is kept back, and tells the errors."""
    from ...core.errors import check_outputs
    from ...core.tables import markdown
    from ...reduced.judging import Errors, calibrate
    from ...reduced.learning import learn
    from ...reduced.tongue import ReducedTongue

    check_outputs(output.parent, [output.name])
    first = None if begin is None else ReducedTongue.load(begin)
    tongue, back = learn(sweeps, modes, iterations, seed, mesh, first, lambda line: console.print(line))
    tongue.save(output)  # whatever comes
    errors = calibrate(tongue, back)
    tongue.save(output)
    console.print(markdown(Errors.columns(), [error.cells() for error in errors]))
    console.print(f"wrote {output}, {output.stat().st_size / 1e6:.1f} MB")


@rom.command()
def run(
    model: Model,
    scenario: ScenarioFile,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Run folder.")],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the run that the folder holds.")] = False,
    changes: Changes = None,
) -> None:
    """Let a reduced tongue follow the activations of a scenario; the folder is that of a run."""
    from ...core.errors import within
    from ...mechanics.control import OpenLoop
    from ...reduced.playing import play
    from ...reduced.tongue import ReducedTongue
    from ...runs.inputs import Inputs
    from ...scenario.build import activation_of
    from ...scenario.files import dump, load
    from ...scenario.remarks import not_followed

    tongue, loaded = ReducedTongue.load(model), load(scenario, changes)
    with within(scenario):
        for name in (courses := activation_of(loaded)):
            tongue.check(name)
        beyond = not_followed(loaded, tongue)
    if beyond:
        console.print(f"note: it knows the bones and the tissue of the runs it learned from; not followed: {', '.join(beyond)}")
    result = play(tongue, OpenLoop(courses), loaded.time.end, loaded.output.every, output, Inputs(dump(loaded)), overwrite=overwrite)
    s = result.summary
    console.print(f"{s['n_steps']} steps, {s['wall_seconds']:.2f} s; wrong by {s['doubt_max_mm']:.2g} mm at most, by its own guess")
    for name, u in s["probes"].items():
        console.print(f"  {name}: {1e3 * u[0]:+.1f} mm backward, {1e3 * u[2]:+.1f} mm up")
    console.print(f"fields for ParaView: {result.folder / 'fields.xdmf'}")


@rom.command()
def test(
    model: Model,
    folders: Annotated[list[Path], typer.Argument(metavar="DIR…", help="Runs or sweeps that the model has not learned from.")],
) -> None:
    """Hold a reduced tongue against full runs."""
    import numpy as np

    from ...core.tables import markdown
    from ...reduced.judging import Errors, by_activity, judge, times
    from ...reduced.learning import runs_in
    from ...reduced.tongue import ReducedTongue

    tongue = ReducedTongue.load(model)
    runs = list(runs_in(folders))
    rows = [(str(run), judge(tongue, run)) for run in runs]
    whole = Errors(*np.mean([list(vars(errors).values()) for _, errors in rows], axis=0))
    lines = [[name, *errors.cells()] for name, errors in [*rows, ("mean", whole)]]
    console.print(markdown(["run", *Errors.columns()], lines))
    head, *by_count = by_activity(tongue, runs)
    console.print(markdown(head, by_count))
    reduced, full = np.sum([times(tongue, run) for run in runs], axis=0)
    console.print(f"{reduced:.2g} s where the full model took {full:.0f} s: 1 / {full / reduced:.0f}")
