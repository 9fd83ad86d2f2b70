# SPDX-License-Identifier: MIT
"""``tongue subject``: a folder for a tongue of one's own."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import typer

from ...core.errors import InputError
from ..terminal import console

subject = typer.Typer(help="A folder for a tongue of one's own.", no_args_is_help=True)
FRAME = """\
# What the numbers in this folder mean, as tongue subject init found it; look whether it is true: tongue build FOLDER --figures
unit = {unit}
axes = "{axes}"           # where x, y and z point: P or A, R or L, S or I. A tongue's shape does not tell left from right.
mid_plane = {mid_plane:.4g}       # lateral coordinate of the mid-sagittal plane
cap = {cap}            # close holes of the surface
repair = {repair:g}          # how far triangles that cross each other may be moved, in the unit above
muscles = "built-in"   # carried over from the built-in tongue; "measured" when fibres.json and attachments.json are here
"""
REPAIR = 0.5e-3
"""How far a repair may move the surface, in m."""


@subject.callback()
def _group() -> None:
    """A folder for a tongue of one's own."""


@subject.command()
def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="To be made.")],
    surface: Annotated[Path, typer.Argument(metavar="SURFACE", help="Of the tongue: STL, OBJ, PLY, VTP or VTU, in any unit and attitude.")],
) -> None:
    """Begin a subject's folder with the surface of a tongue: find its unit and axes, and say what is missing."""
    from ...anatomy.frame_guess import guess_frame
    from ...core.errors import check_outputs
    from ...core.values import UNITS
    from ...geometry.surface import SUFFIXES, read_surface

    if surface.suffix.lower() not in SUFFIXES:
        raise InputError(f"{surface}: {', '.join(SUFFIXES)} is expected.")
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder}: is not empty; the name of a new folder is expected.")
    found = read_surface(surface)
    guess = guess_frame(found, str(surface))
    check_outputs(folder, ["frame.toml"])
    shutil.copyfile(surface, folder / f"tongue_surface{surface.suffix.lower()}")
    open_edges = int((found.edge_sharing() == 1).sum())
    metre = UNITS[guess.unit] if isinstance(guess.unit, str) else guess.unit
    unit = f'"{guess.unit}"' if isinstance(guess.unit, str) else f"{guess.unit:g}"
    text = FRAME.format(
        unit=unit, axes=guess.axes, mid_plane=guess.mid_plane, cap=str(open_edges > 0).lower(), repair=float(f"{REPAIR / metre:.2g}")
    )
    (folder / "frame.toml").write_text(text, encoding="utf-8")
    console.print(f"unit {guess.unit}: the surface is {1e3 * guess.length:.0f} mm long")
    console.print(
        f"axes {guess.axes}, mid-sagittal plane at {guess.mid_plane:.3g}: the built-in tongue, turned by {guess.turned:.0f}°, lies "
        f"{1e3 * guess.distance:.1f} mm from the surface; whether left is left, you must know"
    )
    if open_edges:
        console.print(f"open: {open_edges} edges belong to one triangle only; cap = true closes that")
    console.print("missing: fibres.json, attachments.json; until then both are carried over from the built-in tongue")
    console.print("missing: palate.stl and other bones, in the same coordinates; contact needs them")
    console.print(f"wrote {folder}; look at it: tongue build {folder} -o {folder}.msh --figures")
