# SPDX-License-Identifier: MIT
"""``tongue subject``: a folder for a tongue of one's own."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from ...core.errors import InputError
from ..terminal import console

subject = typer.Typer(help="A folder for a tongue of one's own.", no_args_is_help=True)
FRAME = """\
# What the numbers in this folder mean, as tongue subject init found it; look whether it is true: tongue build FOLDER --figures
{unit}
axes = "{axes}"  # where x, y and z point: P or A, R or L, S or I. Left and right look alike: if they are swapped, swap R and L here.
mid_plane = {mid_plane}  # where the mid-sagittal plane is, in the unit above
cap = {cap}  # whether holes of the surface are closed
repair = {repair:g}  # how far triangles that cross each other may be moved, in the unit above
muscles = "built-in"  # carried over from the built-in tongue; "measured" when fibres.json and attachments.json are here
"""
REPAIR = 0.5e-3
"""How far a repair may move the surface, in m."""


@subject.callback()
def _group() -> None:
    """A folder for a tongue of one's own."""


@subject.command()
def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="To be made.")],
    surface: Annotated[Path, typer.Argument(metavar="SURFACE", help="Of a tongue: STL, OBJ, PLY, VTP or VTU; any unit and axes.")],
) -> None:
    """Begin a subject's folder with the surface of a tongue: find its unit and axes, and say what is missing."""
    from ...anatomy.frame_guess import guess_frame
    from ...core.errors import check_outputs
    from ...core.values import UNITS
    from ...geometry.surface import SUFFIXES, read_surface

    if surface.suffix.lower() not in SUFFIXES:
        raise InputError(f"SURFACE {surface}: a file that ends in {', '.join(SUFFIXES)} is expected, after the name of the folder.")
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"FOLDER {folder}: is there already; the name of a new folder is expected.")
    found = read_surface(surface)
    guess = guess_frame(found, str(surface))
    check_outputs(folder, ["frame.toml"])
    shutil.copyfile(surface, folder / f"tongue_surface{surface.suffix.lower()}")
    n_open, known = int((found.edge_sharing() == 1).sum()), guess.unit in UNITS
    text = FRAME.format(
        unit=f'unit = "{guess.unit}"' if known else f"unit = {guess.unit}  # m; makes it as large as the built-in tongue: give yours",
        axes=guess.axes,
        mid_plane=round(guess.mid_plane, 6),
        cap=str(n_open > 0).lower(),
        repair=float(f"{REPAIR / guess.metre:.2g}"),
    )
    (folder / "frame.toml").write_text(text, encoding="utf-8")
    if known:
        console.print(f"unit: {guess.unit}; the surface is {1e3 * guess.length:.0f} mm long")
    else:
        console.print(f"unit: none of {', '.join(UNITS)}; {1e3 * guess.metre:g} mm makes it as large as the built-in tongue, give yours")
    console.print(f"axes: {guess.axes}, the mid-sagittal plane at {guess.mid_plane:.4g}; if left and right are swapped, swap R and L there")
    distance = f"{1e3 * guess.distance:.1f} mm from the surface (1 to 4 mm is usual)"
    console.print(f"so the built-in tongue, scaled and turned by {guess.turned:.0f}°, is {distance}")
    if n_open:
        console.print(f"holes: with {n_open} edges in all; they will be closed, delete cap = true if you do not want that")
    console.print("missing: fibres.json and attachments.json; until then muscles and attachments are those of the built-in tongue")
    console.print("missing: palate.stl and other bones, in the same coordinates; contact needs them")
    console.print(f"wrote {folder}; look at it: tongue build {quote(str(folder))} -o {quote(f'{folder}.msh')} --figures")
