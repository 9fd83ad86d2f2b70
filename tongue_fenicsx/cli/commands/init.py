# SPDX-License-Identifier: MIT
"""``tongue init``: a commented file to begin with."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from ...core.errors import InputError, check_outputs
from ..options import check_name
from ..terminal import console

KINDS = {
    "muscle": "tongue run",
    "vowel": "tongue run",
    "contact": "tongue run",
    "subject": "tongue run",
    "block": "tongue run",
    "sweep": "tongue sweep",
    "fit": "tongue fit",
}
"""What there is, and which command takes it."""


def init(
    kind: Annotated[str, typer.Argument(metavar="KIND", help=f"{', '.join(KINDS)}.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="FILE.toml", help="By default KIND.toml.")] = None,
) -> None:
    """Write a commented scenario, sweep or fit to begin with."""
    check_name("KIND", kind, KINDS)
    path = output or Path(f"{kind}.toml")
    if path.suffix != ".toml":
        raise InputError(f"--output {path}: the file must end in .toml.")
    if path.exists():
        raise InputError(f"--output {path}: is there already; another name is expected.")
    check_outputs(path.parent, [path.name])
    path.write_text((files("tongue_fenicsx.scenario") / "examples" / f"{kind}.toml").read_text(encoding="utf-8"), encoding="utf-8")
    console.print(f"wrote {path}; change what you like, then: {KINDS[kind]} {path} -o runs/{path.stem}")
