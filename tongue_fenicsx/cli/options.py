# SPDX-License-Identifier: MIT
"""Options that several commands have."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError

ScenarioFile = Annotated[Path, typer.Argument(metavar="SCENARIO.toml")]
Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the scenario, e.g. tissue.nu=0.499.")
]
MeshFile = Annotated[Path | None, typer.Option("--mesh", metavar="FILE.msh", help="A mesh; without it the parametric tongue.")]
MeshPreset = Annotated[str | None, typer.Option("--preset", help="Of the parametric tongue: coarse, medium or reference.")]
Tissue = Annotated[str, typer.Option("--tissue", help="calka, buchaillard or kappert.")]
Muscles = Annotated[list[str] | None, typer.Option("--muscle", metavar="NAME", help="Only this muscle; may be repeated.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace runs of other scenarios in the folder.")]
Jobs = Annotated[int, typer.Option("--jobs", "-j", metavar="N", help="Processes that share the runs.")]


def check_name(option: str, value: str, accepted: Collection[str]) -> None:
    """Refuse a value that is not one of those that an option accepts.

    Raises
    ------
    InputError
        If it is not.
    """
    if value not in accepted:
        raise InputError(f"{option}: {value!r} is not one of {', '.join(accepted)}.")


def check_single_muscles(mesh: Path | None, preset: str | None, tissue: str, some: list[str] | None, known: Collection[str]) -> str:
    """Check the options of a study of single muscles; return the preset of the mesh.

    Raises
    ------
    InputError
        If a mesh and a preset are given, or a name is not known.
    """
    from ..anatomy.parametric.size import PRESETS
    from ..mechanics.tissue import TISSUES

    if mesh is not None and preset is not None:
        raise InputError("--mesh and --preset: give one of them.")
    preset = preset or "coarse"
    check_name("--preset", preset, PRESETS)
    check_name("--tissue", tissue, TISSUES)
    for name in some or ():
        check_name("--muscle", name, known)
    return preset
