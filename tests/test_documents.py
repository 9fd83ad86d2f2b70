# SPDX-License-Identifier: MIT
"""What the documents, the demos and the benchmarks say is so: scenarios fit their meshes, code runs, commands are known."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import tomllib
from collections.abc import Callable, Iterator
from copy import copy
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

import tongue_fenicsx as tf
from tongue_fenicsx.cli.app import app, main
from tongue_fenicsx.scenario.files import load
from tongue_fenicsx.simulation import quantities
from tongue_fenicsx.studies.anatomy_statements import STATEMENTS
from tongue_fenicsx.studies.fit_file import RecordingSection, SurfaceSection

HOUSE = Path(__file__).parents[1]
DOCUMENTS = sorted([*HOUSE.glob("*.md"), *HOUSE.glob("docs/*.md"), *HOUSE.glob("meshes/*.md")])
SUBJECT_FILES = HOUSE / "demos" / "example_subject"
SWEEPS = sorted(HOUSE.glob("demos/sweep*.toml"))
FITS = [HOUSE / "demos" / "fit.toml", *HOUSE.glob("demos/targets/*.toml")]
SCENARIOS = sorted(
    path
    for room in ("demos", "benchmarks")
    for path in HOUSE.glob(f"{room}/**/*.toml")
    if path.parent != SUBJECT_FILES and path not in SWEEPS + FITS
)
RECIPE = HOUSE / ".ci" / "conda" / "meta.yaml"
COMMANDS = get_command(app).commands  # type: ignore[attr-defined]

BONES_OF_PB = ["contact.palate_hard.surface=palate", "contact.pharynx_wall.surface=pharynx"]
"""The built-in tongue's names for the bones of the measured subject, who is not part of the sources."""


def name_of(path: Path) -> str:
    return str(path.relative_to(HOUSE))


def blocks(language: str) -> list[object]:
    """The fenced blocks of a language in all documents."""
    return [
        pytest.param(block, id=f"{name_of(path)}-{number}")
        for path in DOCUMENTS
        for number, block in enumerate(re.findall(rf"^```{language}\n(.*?)^```", path.read_text("utf-8"), re.DOTALL | re.MULTILINE))
    ]


def commands(pattern: str) -> list[object]:
    """Command lines in the documents and in the comments of scenarios that begin as the pattern."""
    line = re.compile(rf"{pattern}(?:mpiexec -n \d+ )?tongue ([a-z][^`\n]*)", re.MULTILINE)
    sources = [*DOCUMENTS, *SCENARIOS, *SWEEPS]
    found = sorted({(name_of(path), text.split(" #")[0].strip()) for path in sources for text in line.findall(path.read_text("utf-8"))})
    return [pytest.param(*command_of(COMMANDS, shlex.split(text)), id=f"{path}: {text}") for path, text in found]


def command_of(known: dict[str, Any], words: list[str]) -> tuple[Any, list[str]]:
    """The command that the words call, one of a group where the first names a group, and the rest of them."""
    command, rest = known[words[0]], words[1:]
    return command_of(command.commands, rest) if rest and hasattr(command, "commands") else (command, rest)


@pytest.fixture
def _in_scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where files may be left."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def shorten(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Let every tongue be the one at 8 mm that the tests share and every run end at a time in s."""

    def shorten(end: float) -> None:
        run, tongue = tf.Simulation.run, request.getfixturevalue("tongue")
        monkeypatch.setattr(tf.Anatomy, "mesh", lambda self, size: tongue)
        monkeypatch.setattr(
            tf.Simulation, "run", lambda self, activation, t_end, *more, **options: run(self, activation, min(t_end, end), *more, **options)
        )

    return shorten


@pytest.fixture
def _registrations_end() -> Iterator[None]:
    """Forget what a document registers."""
    tables: list[Any] = [quantities.FIELDS, *STATEMENTS.values(), app.registered_commands]
    before = [copy(table) for table in tables]
    yield
    for table, kept in zip(tables, before, strict=True):
        table.clear()
        (table.update if isinstance(table, dict) else table.extend)(kept)


@pytest.mark.slow
@pytest.mark.parametrize("path", SCENARIOS, ids=name_of)
def test_scenarios_fit_their_meshes(path: Path, tongue_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``tongue check``, with the small tongue where the scenario has one."""
    mesh = load(path).mesh.file
    changes = [] if mesh and Path(mesh).is_file() else [f"mesh={{file='{tongue_file}'}}"]
    changes += BONES_OF_PB if path.stem == "subject_palate" else []
    with pytest.raises(SystemExit) as leaving:
        main(["check", str(path), *(word for change in changes for word in ("--set", change))])
    assert (leaving.value.code, capsys.readouterr().err) == (0, "")


@pytest.mark.parametrize("path", SWEEPS, ids=name_of)
def test_sweeps_are_designs(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every run is a scenario."""
    with pytest.raises(SystemExit) as leaving:
        main(["sweep", str(path), "--dry-run"])
    assert (leaving.value.code, capsys.readouterr().err) == (0, "")


@pytest.mark.slow
@pytest.mark.usefixtures("_in_scratch")
def test_ggp_from_python(shorten: Callable[[float], None]) -> None:
    """The demo at 8 mm until the muscle is fully active; it checks its own number."""
    shorten(0.1)
    runpy.run_path(str(HOUSE / "demos" / "ggp.py"), run_name="__main__")
    assert Path("runs/ggp_python/summary.json").is_file()


def test_beam_of_heart_muscle() -> None:
    """The demo on its coarsest mesh, which is too stiff by less than a twentieth; the finer ones are a row of ``tongue verify``."""
    demo = runpy.run_path(str(HOUSE / "demos" / "land_beam.py"))
    assert demo["deformed_height"]((10, 1, 1)) == pytest.approx(4.17, rel=0.05)


@pytest.mark.parametrize("block", blocks("python"))
@pytest.mark.usefixtures("_in_scratch", "_registrations_end")
def test_python_of_documents(block: str, shorten: Callable[[float], None]) -> None:
    """It runs as it stands, where the demos are, with tongues at 8 mm to 10 ms at most, and is of 30 lines at most."""
    if "parametric_tongue" in block:
        shorten(0.01)
    else:
        Path("demos").symlink_to(HOUSE / "demos")
    assert block.count("\n") <= 30
    exec(compile(block, "document", "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize("block", blocks("toml"))
def test_toml_of_documents(block: str, tmp_path: Path) -> None:
    """A scenario loads, as does a part of a fit; a file of the example's, named in the first line, is as it stands."""
    if named := re.match(r"# (\S+\.toml)\n", block):
        assert tomllib.loads(block) == tomllib.loads((SUBJECT_FILES / named[1]).read_text("utf-8"))
    elif "[recording]" in block:
        RecordingSection.model_validate(tomllib.loads(block)["recording"])
    elif "[surface." in block:
        SurfaceSection.model_validate(tomllib.loads(block)["surface"]["vowel"])
    else:
        (tmp_path / "scenario.toml").write_text(block, encoding="utf-8")
        load(tmp_path / "scenario.toml")


@pytest.mark.parametrize("block", blocks("json"))
def test_json_of_documents(block: str) -> None:
    """It is JSON."""
    assert json.loads(block)


@pytest.mark.parametrize(("command", "arguments"), commands(r"(?:^    |#\s+)"))
def test_command_lines(command: Any, arguments: list[str]) -> None:
    """The command is known, so are its options, and nothing that it needs is left out."""
    command.make_parser(command.context_class(command, info_name=command.name)).parse_args(arguments)


@pytest.mark.parametrize(("command", "arguments"), commands("`"))
def test_commands_in_sentences(command: Any, arguments: list[str]) -> None:
    """The command is known, and so are the options that are spoken of."""
    known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    assert {word for word in arguments if word.startswith("-")} <= known


def test_make_of_documents() -> None:
    """The targets that the documents name are in the Makefile."""
    named = {target for path in DOCUMENTS for target in re.findall(r"(?:^    |`)make ([a-z-]+)", path.read_text("utf-8"), re.MULTILINE)}
    declared = re.findall(r"^([a-z-]+):", (HOUSE / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert {"demo", "test"} <= named <= set(declared)


def test_picture_of_the_rooms() -> None:
    """It is that of the code (``make rooms``), the rooms in words are those of the contract, in the same order, and so is the map."""
    drawing = runpy.run_path(str(HOUSE / "docs" / "draw_rooms.py"))
    text = (HOUSE / "docs" / "architecture.md").read_text("utf-8")
    assert drawing["page"]() == text
    (contract,) = tomllib.loads((HOUSE / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    assert " < ".join(reversed(contract["layers"])) in " ".join(text.split())
    rooms = re.findall(r"^\| (`.*?) \|", (HOUSE / "CONTRIBUTING.md").read_text("utf-8"), re.MULTILINE)
    assert set(re.findall(r"\w+", " ".join(rooms))) == set(contract["layers"])


def test_one_version() -> None:
    """`pyproject.toml` has it; the installed package and the citation say the same."""
    number = tomllib.loads((HOUSE / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert tf.__version__ == version("tongue_fenicsx") == number
    assert f"\nversion: {number}\n" in (HOUSE / "CITATION.cff").read_text("utf-8")
    assert f'set version = "{number}"' in RECIPE.read_text("utf-8")
    assert f"\n## {number}\n" in (HOUSE / "CHANGELOG.md").read_text("utf-8")


def test_recipe_for_conda() -> None:
    """It asks for what the distribution asks for, by conda's names, and for DOLFINx."""
    needs = tomllib.loads((HOUSE / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    ours = {"gmsh": "python-gmsh", "matplotlib": "matplotlib-base"}
    wanted = {f"{ours.get(name, name)} >={least}" for name, least in (need.split(">=") for need in needs)}
    run = RECIPE.read_text("utf-8").partition("  run:\n")[2].partition("\n\n")[0]
    found = {line.removeprefix("    - ") for line in run.splitlines()}
    assert found - wanted == {"python >=3.12", "fenics-dolfinx >=0.11", "petsc * real_*", "c-compiler"}
    assert wanted <= found


@pytest.mark.parametrize(
    "room",
    ["core", "geometry", "anatomy", "mechanics", "forms", "solvers", "runs", "simulation", "analysis", "reduced", "scenario", "studies"],
)
def test_a_room_lists_its_modules(room: str) -> None:
    """So tab completion shows them, and the list is whole."""
    folder = HOUSE / "tongue_fenicsx" / room
    modules = {path.stem for path in folder.glob("[!_]*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}
    assert set(import_module(f"tongue_fenicsx.{room}").__all__) == modules


def test_the_root_lists_what_a_user_needs() -> None:
    """Every public name loads and is completed."""
    assert {"Model", "Simulation", "Tissue", "field", "parametric_tongue"} <= set(dir(tf))
    assert all(getattr(tf, name) is not None for name in dir(tf))


SOURCES = "\n".join(
    re.sub(r'"\s*\n\s*f?"', "", path.read_text("utf-8")) for path in (HOUSE / "tongue_fenicsx").rglob("*.py")
)  # texts that go on in the next line, joined


@pytest.mark.parametrize("message", re.findall(r"^\| `([^`]+)`", (HOUSE / "docs" / "messages.md").read_text("utf-8"), re.MULTILINE))
def test_messages_exist(message: str) -> None:
    """What the page of messages explains is said somewhere."""
    for part in filter(None, map(str.strip, message.split("…"))):
        assert part in SOURCES


@pytest.mark.parametrize("posture", ["a", "i", "k", "t", "u"])
def test_postures_of_the_page(posture: str) -> None:
    """The presets of ``tongue live`` have the levels of the scenarios."""
    script = (HOUSE / "tongue_fenicsx" / "report" / "templates" / "live.js").read_text("utf-8")
    (levels,) = re.findall(rf'"/{posture}/": hold\({{ (.*?) }}', script)
    activation = load(HOUSE / "demos" / "postures" / f"{posture}.toml").activation
    held = {name: level for name, section in activation.items() if (level := section.course()(0.3)) > 0}
    assert {name: float(level) for name, _, level in (item.partition(": ") for item in levels.split(", "))} == pytest.approx(held)
