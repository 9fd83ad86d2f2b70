# SPDX-License-Identifier: MIT
"""``tongue build``: mesh the parametric tongue or a real subject."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ...core.errors import InputError
from .. import mesh_table
from ..options import check_name
from ..terminal import console

if TYPE_CHECKING:
    from ...anatomy.parametric.size import TongueShape


def build(
    subject: Annotated[
        Path | None, typer.Argument(metavar="[SUBJECT_FOLDER]", help="A real subject; without it the parametric tongue.")
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE.msh", help="Mesh file; FILE.h5 and FILE.json lie beside it.")
    ] = Path("tongue.msh"),
    preset: Annotated[str | None, typer.Option(help="coarse, medium or reference.")] = None,
    size: Annotated[float | None, typer.Option(metavar="MM", help="Element size in mm instead of a preset.")] = None,
    shape: Annotated[
        list[str] | None,
        typer.Option("--shape", metavar="KEY=MM", help="length, width, height, root, tip in mm, or scale, of the parametric tongue."),
    ] = None,
    sex: Annotated[str | None, typer.Option(help="male or female: the mean size of the parametric tongue.")] = None,
    age: Annotated[float | None, typer.Option(metavar="YEARS", help="With --sex; growth until 18.")] = None,
    split: Annotated[
        list[str] | None, typer.Option("--split", metavar="MUSCLE", help="GGP into GGP and GGH, or SL into a left and a right half.")
    ] = None,
    compare_with: Annotated[
        Path | None, typer.Option("--compare", metavar="SUBJECT_FOLDER", help="Judge every muscle by a subject's.")
    ] = None,
    figures: Annotated[bool, typer.Option("--figures", help="Draw the muscles and the bones: FILE-muscles.png, FILE-bones.png.")] = False,
) -> None:
    """Mesh the parametric tongue or a real subject."""
    from mpi4py import MPI

    from ...anatomy.parametric.size import PRESETS
    from ...core.parallel import on_rank_zero
    from ...meshing import build as meshing
    from ...scenario import build as assemble
    from ...scenario.schema import MeshSection

    if preset is not None and size is not None:
        raise InputError("--preset and --size: give one of them.")
    if subject is not None and (shape or sex or split or age is not None):
        raise InputError("--shape, --sex, --age and --split belong to the parametric tongue, not to a subject.")
    preset = "coarse" if preset is None else preset
    check_name("--preset", preset, PRESETS)
    element = PRESETS[preset] if size is None else 1e-3 * size
    pictures = [output.with_name(f"{output.stem}-{name}.png") for name in ("muscles", "bones")]

    def work() -> dict[str, Any]:
        meshing.check_request(output, element)
        from ...anatomy.comparison import compare
        from ...anatomy.parametric.tongue import parametric_tongue

        if subject is not None:
            anatomy = assemble.anatomy_of(MeshSection(subject=str(subject)))
        else:
            anatomy = parametric_tongue(_shape(shape or [], sex, age), split or [])
        reference = None if compare_with is None else assemble.anatomy_of(MeshSection(subject=str(compare_with)))
        numbers = meshing.build(anatomy, output, element)
        if reference is not None:
            mesh_table.print_agreement(console, compare(anatomy, reference), reference.name)
        if figures:
            from ...plotting import anatomy_figures

            anatomy_figures.draw_muscles(anatomy, pictures[0])
            anatomy_figures.draw_surroundings(anatomy, pictures[1])
        return numbers

    comm = MPI.COMM_WORLD
    numbers = on_rank_zero(comm, work)
    if comm.rank == 0:
        mesh_table.print_mesh(console, numbers, output)
        if figures:
            console.print("pictures: " + ", ".join(map(str, pictures)))


def _shape(changes: list[str], sex: str | None, age: float | None) -> TongueShape:
    """The shape that the options describe."""
    from ...anatomy.parametric.size import TongueShape
    from ...core.values import keys

    if age is not None and sex is None:
        raise InputError("--age: needs --sex male or female.")
    values = {} if sex is None else {"scale": TongueShape.of_person(sex, 30.0 if age is None else age).scale}
    for change in changes:
        key, _, text = change.partition("=")
        check_name(f"--shape {change}", key, keys(TongueShape))
        try:
            number = float(text)
        except ValueError:
            raise InputError(f"--shape {change}: KEY=NUMBER is expected, in mm (scale without unit).") from None
        values[key] = number if key == "scale" else 1e-3 * number
    return TongueShape(**values)
