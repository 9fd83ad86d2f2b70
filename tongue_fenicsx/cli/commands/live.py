# SPDX-License-Identifier: MIT
"""``tongue live``: a reduced tongue in the browser."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from ..terminal import console

PAGES = (".html", ".htm")


def live(
    model: Annotated[Path | None, typer.Argument(metavar="MODEL.npz", help="A reduced tongue; without it one that comes along.")] = None,
    tissue: Annotated[
        str | None, typer.Option("--tissue", help="Of the one that comes along: buchaillard (without this) or calka.")
    ] = None,
    save: Annotated[
        Path | None, typer.Option("--save", metavar="PAGE.html", help="Write the page, which opens from disk, and end.")
    ] = None,
    port: Annotated[int, typer.Option("--port", metavar="N", min=0, max=65535, help="Where it is served; 0: any free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open it.")] = True,
    runs: Annotated[Path, typer.Option("--runs", metavar="DIR", help="Takes the runs of the full model that the page asks for.")] = Path(
        "runs"
    ),
) -> None:
    """Play with a tongue in the browser: sliders and a timeline for its muscles; it computes in the page itself."""
    from ...core.errors import InputError, check_outputs
    from ...core.files import at_once
    from ...reduced.tongue import ReducedTongue
    from ...report.live import live_page
    from ...report.serving import serve

    if model is not None and tissue is not None:
        raise InputError(f"{model} and --tissue {tissue}: give one of them.")
    if save is not None and save.suffix.lower() not in PAGES:
        raise InputError(f"--save {save}: a page named {' or '.join(PAGES)} is expected.")
    if save is not None:
        check_outputs(save.parent, [save.name])
    page = live_page(ReducedTongue.load(model) if model is not None else ReducedTongue.shipped(tissue or "buchaillard"))
    if save is None:
        serve(page, port, browser, lambda address: console.print(f"{address}  (Ctrl-C ends it)"), lambda scenario: _check(scenario, runs))
        return
    with at_once(save) as partial:
        partial.write_bytes(page)
    console.print(f"wrote {save}, {len(page) / 1e6:.1f} MB")


def _check(scenario: str, runs: Path) -> dict[str, Any]:
    """Run a scenario with the full model; the paths of its probes in mm, or what went wrong."""
    from ...core.errors import InputError, check_outputs
    from ...runs.run import Run

    folder = next(path for path in (runs / f"live-{number}" for number in range(1, 10_000)) if not path.exists())
    try:
        check_outputs(folder)
        path = folder.with_suffix(".toml")
        path.write_text(scenario, encoding="utf-8")
        command = [sys.executable, "-m", "tongue_fenicsx", "run", str(path), "-o", str(folder)]
        console.print(f"the full model runs: tongue run {path} -o {folder}")
        done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            return {"error": done.stderr.strip() or f"exit code {done.returncode}"}
        run = Run(folder)
    except (InputError, OSError) as error:
        return {"error": str(error)}
    paths = {name: (1e3 * (run.rest[name] + u)).tolist() for name, u in run.probes.items()}
    return {"folder": str(folder), "seconds": run.summary["wall_seconds"], "time": run.time.tolist(), "paths": paths}
