# SPDX-License-Identifier: MIT
"""The command ``tongue``."""

from __future__ import annotations

import sys
import tempfile
import traceback
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from ..core.errors import InputError, SolveError, check_outputs
from ..forms.weak_form import WeakForm
from .progress import ProgressBar

if TYPE_CHECKING:
    from ..anatomy.parametric.size import TongueShape

app = typer.Typer(
    help="Biomechanics of the human tongue: build a mesh, run a scenario, look at the pictures.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
console = Console(soft_wrap=True, width=None if sys.stdout.isatty() else 120)
errors = Console(stderr=True, soft_wrap=True, highlight=False)

Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the scenario, e.g. tissue.nu=0.499.")
]
MeshFile = Annotated[Path | None, typer.Option("--mesh", metavar="FILE.msh", help="A mesh; without it the parametric tongue.")]
MeshPreset = Annotated[str | None, typer.Option("--preset", help="Of the parametric tongue: coarse, medium or reference.")]
Tissue = Annotated[str, typer.Option("--tissue", help="calka, buchaillard or kappert.")]
Muscles = Annotated[list[str] | None, typer.Option("--muscle", metavar="NAME", help="Only this muscle; may be repeated.")]
Folder = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Run folder.")]


@app.command()
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

    from ..core.parallel import on_rank_zero
    from ..meshing import build as meshing
    from ..meshing.presets import PRESETS
    from ..scenario import build as assemble
    from ..scenario.schema import MeshSection
    from . import mesh_table as shown

    if preset is not None and size is not None:
        raise InputError("--preset and --size: give one of them.")
    if subject is not None and (shape or sex or split or age is not None):
        raise InputError("--shape, --sex, --age and --split belong to the parametric tongue, not to a subject.")
    preset = "coarse" if preset is None else preset
    if preset not in PRESETS:
        raise InputError(f"--preset: {preset!r} is not one of {', '.join(PRESETS)}.")
    element = PRESETS[preset] if size is None else 1e-3 * size

    def work() -> dict[str, Any]:
        from ..anatomy.comparison import compare
        from ..anatomy.parametric.tongue import parametric_tongue

        if subject is not None:
            anatomy = assemble.anatomy_of(MeshSection(subject=str(subject)))
        else:
            anatomy = parametric_tongue(_shape(shape or [], sex, age), split or [])
        reference = None if compare_with is None else assemble.anatomy_of(MeshSection(subject=str(compare_with)))
        built = meshing.build(anatomy, output, element)
        if reference is not None:
            shown.agreement(console, compare(anatomy, reference), reference.name)
        if figures:
            from ..plotting import anatomy_figures as portraits

            portraits.muscles(anatomy, output.with_name(f"{output.stem}-muscles.png"))
            portraits.surroundings(anatomy, output.with_name(f"{output.stem}-bones.png"))
        return built

    comm = MPI.COMM_WORLD
    built = on_rank_zero(comm, work)
    if comm.rank == 0:
        shown.mesh(console, built, output)
        if figures:
            console.print(f"pictures: {output.with_name(f'{output.stem}-muscles.png')}, {output.with_name(f'{output.stem}-bones.png')}")


def _shape(changes: list[str], sex: str | None, age: float | None) -> TongueShape:
    """The shape that the options of ``build`` describe."""
    from ..anatomy.parametric.size import RANGES, TongueShape

    if age is not None and sex is None:
        raise InputError("--age: needs --sex male or female.")
    values = {} if sex is None else {"scale": TongueShape.of_person(sex, 30.0 if age is None else age).scale}
    for change in changes:
        key, _, text = change.partition("=")
        if key not in RANGES:
            raise InputError(f"--shape {change}: {key!r} is not one of {', '.join(RANGES)}.")
        try:
            number = float(text)
        except ValueError:
            raise InputError(f"--shape {change}: KEY=NUMBER is expected, in mm (scale without unit).") from None
        values[key] = number if key == "scale" else 1e-3 * number
    return TongueShape(**values)


@app.command()
def run(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO.toml")],
    output: Folder,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the folder's checkpoint.")] = False,
    changes: Changes = None,
) -> None:
    """Run one simulation, also under mpiexec -n N."""
    from mpi4py import MPI

    from ..core.parallel import on_rank_zero
    from ..scenario import build as assemble
    from ..scenario.files import dump, load

    comm = MPI.COMM_WORLD
    loaded = load(scenario, changes)
    on_rank_zero(comm, lambda: check_outputs(output, assemble.MESH_FILES))
    simulation = assemble.simulation_of(loaded, output, keep_mesh=resume)
    try:
        with ProgressBar(console, comm.rank == 0) as bar:
            result = simulation.run(loaded.time.end, output, resume, bar, dump(loaded.in_metres()))
    except KeyboardInterrupt:
        if comm.rank == 0:
            errors.print(f"interrupted; everything so far is in {output}, go on with --resume")
        raise SystemExit(130) from None
    if comm.rank == 0:
        pictures = result.plot()
        s = result.summary
        console.print(
            f"{s['n_steps']} steps ({s['n_rejected']} rejected), "
            f"{s['newton_iterations'] / max(s['n_steps'], 1):.1f} Newton iterations a step, {s['wall_seconds']:.0f} s; "
            f"volume change {100 * s['volume_change_max']:.2f} %, Hencky strain {s['hencky_von_mises_max']:.2f}, "
            f"peak speed {100 * s['peak_speed_m_s']:.1f} cm/s"
        )
        for name, u in s["probes"].items():
            console.print(f"  {name}: {1e3 * -u[0]:+.1f} mm forward, {1e3 * u[2]:+.1f} mm up")
        for name, touch in s["contact"].items():
            console.print(
                f"  contact with {name}: up to {touch['force_max_N']:.2g} N on {1e6 * touch['area_max_m2']:.0f} mm², "
                f"{1e3 * touch['penetration_max_m']:.2g} mm deep"
            )
        console.print("pictures: " + ", ".join(map(str, pictures)))
        console.print(f"fields for ParaView: {output / 'fields.xdmf'}")


@app.command()
def report(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Run folders, finished or stopped.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.html", help="The page.")] = Path("report.html"),
) -> None:
    """Put runs on one HTML page that opens anywhere: numbers, pictures, charts and the motion in 3D."""
    from ..report import write_report

    if output.suffix not in (".html", ".htm"):
        raise InputError(f"--output {output}: a file named .html is expected.")
    check_outputs(output.parent, [output.name])
    write_report(folders, output)
    console.print(f"wrote {output} ({output.stat().st_size / 1e6:.1f} MB)")


@app.command()
def check(scenario: Annotated[Path, typer.Argument(metavar="SCENARIO.toml")], changes: Changes = None) -> None:
    """Validate a scenario and say what would run, without running."""
    from ..anatomy.catalogue import base_name
    from ..scenario import build as assemble
    from ..scenario.files import load

    loaded = load(scenario, changes)
    with tempfile.TemporaryDirectory() as folder:
        simulation = assemble.simulation_of(loaded, Path(folder))
    model, tongue = simulation.model, simulation.model.tongue
    n_cells = tongue.mesh.topology.index_map(3).size_global
    console.print(f"{scenario} is fine: {tongue.name}, {n_cells} tetrahedra, surfaces {', '.join(sorted(tongue.surfaces))}")
    for name, muscle in tongue.muscles.items():
        if muscle.direction_error is not None:
            console.print(f"{name}: fibres {muscle.direction_error:.1f}° from the vectors of their cells on average")
    law = ", ".join(f"{name} {value:g} Pa" for name, value in model.passive.parameters.items())
    console.print(f"tissue {loaded.tissue.preset}: {law}, nu {model.passive.nu:g}, density {model.density:g} kg/m³")
    for name, course in simulation.activation.items():
        stress = model.sigma_max.get(name, model.sigma_max.get(base_name(name), 0.0))
        ends = ", ".join(f"{1e3 * t:g} ms: {course(t):.2g}" for t in [0.0, *course.kinks])
        console.print(f"{name}: {ends}, at most {stress / 1e3:g} kPa")
    for name, motion in model.moving.items():
        console.print(f"{name} moves until {1e3 * max(motion.kinks):g} ms")
    for name, contact in model.contacts.items():
        console.print(f"contact with {name}: {contact.form}")
    WeakForm(model, [])  # is the tongue at rest outside the obstacles?
    console.print(f"to t = {loaded.time.end:g} s in steps of at most {1e3 * simulation.stepping.step_max:g} ms")


@app.command()
def calibrate(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.toml", help="The stresses, as a scenario takes them.")],
    mesh: MeshFile = None,
    preset: MeshPreset = None,
    tissue: Tissue = "calka",
    strain: Annotated[float, typer.Option(help="Von Mises Hencky strain to reach, 99th percentile by volume.")] = 0.5,
    muscle: Muscles = None,
) -> None:
    """Find the peak stress with which each tongue muscle alone reaches a strain."""
    import tomli_w
    from mpi4py import MPI

    from ..core.parallel import on_rank_zero
    from ..studies import calibration
    from ..studies import single_muscle as solo

    comm = MPI.COMM_WORLD
    if output.suffix != ".toml":
        raise InputError(f"{output}: the file must end in .toml.")
    preset = _solo_options(mesh, preset, tissue, muscle, calibration.TONGUE_MUSCLES)
    calibration.check_target(strain)
    on_rank_zero(comm, lambda: check_outputs(output.parent, [output.name]))
    with tempfile.TemporaryDirectory() as folder, ProgressBar(console, comm.rank == 0, lines=False) as bar:
        path = solo.mesh_of(mesh, preset, Path(comm.bcast(folder)))
        muscles = solo.muscles_in(path, calibration.TONGUE_MUSCLES, muscle)
        found = calibration.calibrate(path, muscles, tissue, strain, bar.say, bar)
    if comm.rank == 0:
        name = f"parametric tongue, {preset}" if mesh is None else mesh.name
        output.write_text(calibration.HEADER + tomli_w.dumps(calibration.table(found, name, tissue, strain)), encoding="utf-8")
        table = Table("muscle", "peak stress kPa", "strain", "runs", "", title=f"{name}, tissue {tissue}, strain {strain:g}")
        for key, f in found.items():
            note = "" if f.reached else f"{strain:g} is not reached up to {1e-3 * f.limit:g} kPa"
            table.add_row(key, f"{1e-3 * f.stress:g}", f"{f.strain:.3f}", str(f.runs), note)
        console.print(table)
        console.print(f"wrote {output}")


@app.command()
def atlas(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="A run folder for each muscle, the table and the plate.")],
    mesh: MeshFile = None,
    preset: MeshPreset = None,
    tissue: Tissue = "calka",
    muscle: Muscles = None,
) -> None:
    """Move each muscle alone: a table of what it does, and a plate of pictures."""
    from mpi4py import MPI

    from ..core.parallel import on_rank_zero
    from ..studies import atlas
    from ..studies import single_muscle as solo

    comm = MPI.COMM_WORLD
    preset = _solo_options(mesh, preset, tissue, muscle, atlas.MUSCLES)
    on_rank_zero(comm, lambda: check_outputs(output, atlas.FILES))
    with ProgressBar(console, comm.rank == 0, lines=False) as bar:
        path = solo.mesh_of(mesh, preset, output)
        muscles = solo.muscles_in(path, atlas.MUSCLES, muscle)
        runs = atlas.movements(output, path, muscles, tissue, bar.say, bar)
    if comm.rank == 0:
        from ..plotting import atlas_plate as plate

        columns, *rows = atlas.written(runs, output)
        table = Table(*columns, title=f"each muscle alone, tissue {tissue}; x backward, z upward")
        for row in rows:
            table.add_row(*row)
        console.print(table)
        title = f"{next(iter(runs.values())).summary['name']}, tissue {tissue}: each muscle alone at full activation for 250 ms"
        plate.plate(runs, output / "atlas.png", title)
        console.print("wrote " + ", ".join(str(output / name) for name in atlas.FILES))


@app.command()
def postures(
    scenarios: Annotated[list[Path], typer.Argument(metavar="SCENARIO.toml...", help="Postures, such as demos/postures/*.toml.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Run folders, the table and the sheet.")],
    changes: Changes = None,
) -> None:
    """Run postures without gravity, upright and supine, and compare the airway over the tongue."""
    from mpi4py import MPI

    from ..core.parallel import on_rank_zero
    from ..scenario.files import load
    from ..studies import postures

    comm = MPI.COMM_WORLD
    cases = {path.stem: load(path, changes) for path in scenarios}
    if len(cases) < len(scenarios):
        raise InputError("two scenarios have the same name; their runs would share a folder.")
    for path in scenarios:
        postures.check(path, cases[path.stem])
    on_rank_zero(comm, lambda: check_outputs(output, postures.FILES))
    with ProgressBar(console, comm.rank == 0, lines=False) as bar:
        found = postures.runs(cases, output, bar.say, bar)
    if comm.rank == 0:
        from ..plotting.posture_sheet import sheet

        passages = postures.airways(found)
        columns, *rows = postures.written(found, passages, output)
        table = Table(*columns, title="mm backward and upward at the end; narrowest place of the airway")
        for row in rows:
            table.add_row(*row)
        console.print(table)
        sheet(found, passages, output / "postures.png")
        console.print("wrote " + ", ".join(str(output / name) for name in postures.FILES))


def _solo_options(mesh: Path | None, preset: str | None, tissue: str, some: list[str] | None, known: Collection[str]) -> str:
    """Check what calibrate, atlas and verify have in common; return the preset."""
    from ..meshing.presets import PRESETS
    from ..scenario.schema import TISSUES

    if mesh is not None and preset is not None:
        raise InputError("--mesh and --preset: give one of them.")
    preset = preset or "coarse"
    named: list[tuple[str, str, Collection[str]]] = [("--preset", preset, PRESETS), ("--tissue", tissue, TISSUES)]
    for option, value, accepted in (*named, *(("--muscle", name, known) for name in some or ())):
        if value not in accepted:
            raise InputError(f"{option}: {value!r} is not one of {', '.join(accepted)}.")
    return preset


@app.command()
def verify(
    only: Annotated[str | None, typer.Option("--only", metavar="NAME", help="One case, such as patch, fibres or calculix.")] = None,
    anatomy: Annotated[bool, typer.Option("--anatomy", help="Instead: does each muscle alone do what anatomy says?")] = False,
    subject: Annotated[
        Path | None, typer.Option("--subject", metavar="SUBJECT_FOLDER", help="With --anatomy: a real subject as well.")
    ] = None,
    robust: Annotated[bool, typer.Option("--robust", help="With --anatomy: also at 0.8 and 1.2 of the peak stresses.")] = False,
    mesh: MeshFile = None,
    muscle: Muscles = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="With --anatomy: keep the runs and the matrix here.")
    ] = None,
) -> None:
    """Compare the model with closed forms and with CalculiX, or muscles with anatomy; exit 0 only if everything holds."""
    if anatomy:
        if only is not None:
            raise InputError("--only and --anatomy: give one of them.")
        holds = _verify_anatomy(subject, robust, mesh, muscle, output)
    else:
        if subject or robust or mesh or muscle or output:
            raise InputError("--subject, --robust, --mesh, --muscle and --output belong to --anatomy.")
        holds = _verify_cases(only)
    if not holds:
        raise SystemExit(3)


def _verify_cases(only: str | None) -> bool:
    """Print the table of the cases; say whether every row holds."""
    from mpi4py import MPI

    from ..verification import CASES

    if only is not None and only not in CASES:
        raise InputError(f"--only: {only!r} is not one of {', '.join(CASES)}.")
    table = Table("case", "reference", "error", "limit", "", "holds", title="verification")
    holds = True
    for name in CASES if only is None else [only]:
        if MPI.COMM_WORLD.rank == 0 and console.is_terminal:
            console.print(f"running {name} …")
        for row in CASES[name]():
            verdict = "skipped" if row.skipped else "yes" if row.holds else "[red]NO[/]"
            table.add_row(row.case, row.reference, f"{row.error:.2g}", f"{row.limit:g}", row.note, verdict)
            holds = holds and row.holds
    if MPI.COMM_WORLD.rank == 0:
        console.print(table)
    return holds


def _verify_anatomy(subject: Path | None, robust: bool, mesh: Path | None, some: list[str] | None, output: Path | None) -> bool:
    """Print the matrix of the anatomical criteria; say whether all of them hold."""
    from mpi4py import MPI

    from ..core.parallel import on_rank_zero
    from ..studies import anatomy_check as matrix
    from ..studies import atlas
    from ..studies import single_muscle as solo

    comm = MPI.COMM_WORLD
    preset = _solo_options(mesh, None, "calka", some, atlas.MUSCLES)
    if output is not None:
        on_rank_zero(comm, lambda: check_outputs(output, matrix.FILES))
    with tempfile.TemporaryDirectory() as temporary, ProgressBar(console, comm.rank == 0, lines=False) as bar:
        folder = output or Path(comm.bcast(temporary))
        person = None if subject is None else solo.subject_mesh(subject, folder)
        settings = matrix.columns(solo.mesh_of(mesh, preset, folder), person, robust)
        muscles = {path: solo.muscles_in(path, atlas.MUSCLES, some) for path in {column.mesh: None for column in settings}}
        found = matrix.check(folder, {column: muscles[column.mesh] for column in settings}, bar.say, bar)
    if comm.rank == 0:
        labels = [column.label for column in settings]
        table = Table("muscle", "part", "statement", "bounds", *labels, title="what each muscle must do alone")
        for name, criterion in matrix.ordered(found):
            cells = (matrix.shown(found[name, criterion].get(column), "[red]NO {}[/]") for column in settings)
            table.add_row(name, criterion.part, criterion.says, criterion.bounds, *cells)
        console.print(table)
        for column in settings:
            verdicts = [cells[column].holds for cells in found.values() if column in cells]
            console.print(f"{column.label}: {sum(verdicts)} of {len(verdicts)} hold")
        if output is not None:
            matrix.written(found, settings, output)
            console.print("wrote " + ", ".join(str(output / name) for name in matrix.FILES))
    return all(cell.holds for cells in found.values() for cell in cells.values())


@app.command()
def doctor() -> None:
    """Say what is installed, what is wrong and how to mend it."""
    from .doctor import findings

    wrong = False
    for name, fine, text in findings():
        console.print(f"[green]ok [/]{name}: {text}" if fine else f"[red]bad[/] {name}: {text}", highlight=False)
        wrong = wrong or not fine
    if wrong:
        raise SystemExit(2)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exit with 0 done, 2 bad input, 3 the solve failed, 130 interrupted."""
    code = _exit_code(lambda: app(args=arguments, standalone_mode=False))
    sys.exit(code)


def _exit_code(command: Callable[[], Any]) -> int:
    try:
        result = command()
        return result if isinstance(result, int) else 0
    except (InputError, SolveError) as error:
        if _rank() == 0:
            errors.print(f"[red]error:[/] {_escaped(str(error))}")
        return 2 if isinstance(error, InputError) else 3
    except typer.TyperException as error:
        if _rank() == 0:
            errors.print(f"[red]error:[/] {_escaped(error.format_message())} See tongue --help.")
        return 2
    except SystemExit as leaving:
        return leaving.code if isinstance(leaving.code, int) else 1
    except KeyboardInterrupt:
        if _rank() == 0:
            errors.print("interrupted")
        return 130
    except Exception:
        traceback.print_exc()
        if _size() > 1:  # the other ranks wait in a collective call
            from mpi4py import MPI

            MPI.COMM_WORLD.Abort(1)
        return 1


def _escaped(text: str) -> str:
    return " ".join(text.split()).replace("[", "\\[")


def _rank() -> int:
    module = sys.modules.get("mpi4py.MPI")
    return int(module.COMM_WORLD.rank) if module else 0


def _size() -> int:
    module = sys.modules.get("mpi4py.MPI")
    return int(module.COMM_WORLD.size) if module else 1
