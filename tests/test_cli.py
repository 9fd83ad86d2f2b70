# SPDX-License-Identifier: MIT
"""The command line: exit codes, and one clear sentence for each kind of bad input."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import EXAMPLE, write_block

import tongue_fenicsx as tf
from tongue_fenicsx.anatomy.catalogue import CALKA_STRESS
from tongue_fenicsx.cli.app import main
from tongue_fenicsx.scenario.files import dump, load
from tongue_fenicsx.studies import fit_file

HOUSE = Path(__file__).parents[1]

SCENARIO = """
[mesh]
file = "tongue.msh"

[time]
end = 0.01

[activation.GGP]
pieces = [[0.1, 0.0, 1.0]]
"""


def tongue(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """Run the command in this process; return its exit code and what it printed."""
    with pytest.raises(SystemExit) as leaving:
        main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return int(leaving.value.code or 0), out + err


@pytest.fixture
def scenario(tongue_file: Path) -> Path:
    path = tongue_file.parent / "scenario.toml"
    path.write_text(SCENARIO)
    return path


BAD = [
    (["mesh.file=nowhere.msh"], "nowhere.msh: the file does not exist"),
    (["tisue.nu=0.4"], "unknown key 'tisue'; did you mean 'tissue'?"),
    (["tissue.mu=0.4"], "unknown key 'tissue.mu'; did you mean 'nu'?"),
    (["activation.GGP.peices=[]"], "unknown key 'activation.GGP.peices'; did you mean 'pieces'?"),
    (["activation.GPG.pieces=[[0.1, 0.0, 1.0]]"], "no muscle 'GPG' in the mesh; did you mean GGP?"),
    (["activation.GGP_L.pieces=[[0.1, 0.0, 1.0]]"], "GGP_L is activated twice"),
    (["tissue.nu=0.5"], "nu: 0.5 needs the mixed form"),
    (["tissue.c10=-1"], "tissue.c10: -1 Pa; a positive number is expected"),
    (["tissue.preset='cork'"], "tissue.preset: 'cork'; one of calka, buchaillard, kappert is expected"),
    (["activation.GGP.pieces=[[0.1, 0.0, 1.2]]"], "activation.GGP.pieces.0.2: 1.2; a number from 0 to 1 is expected"),
    (["activation.GGP.pieces=[[0.1, 0.0, nan]]"], "activation.GGP.pieces.0.2: nan; a number from 0 to 1 is expected"),
    (["activation.GGP.pieces=[[0.1, 0.0]]"], "activation.GGP.pieces.0: more numbers are expected"),
    (["tissue.nu='0.49'"], "tissue.nu: '0.49'; a number above -1 and up to 0.5 is expected"),
    (["time.quasi_static=1"], "time.quasi_static: 1; true or false is expected"),
    (["tissue.law='rubber'"], "tissue.law: 'rubber'; one of yeoh, neo_hookean, mooney_rivlin is expected"),
    (["tissue.law='neo_hookean'", "tissue.c20=9.0"], "c20 is no number of the law neo_hookean; it has c10, nu, volumetric"),
    (["output.fields=['stress']"], "output.fields.0: 'stress'; one of displacement, velocity"),
    (["activation.GGP.table='nowhere.csv'"], "either pieces or table is expected"),
    (["activation.HG.table='nowhere.csv'"], "nowhere.csv: the file does not exist"),
    (["excitation.rise=0.0"], "excitation.rise: 0.0 s; a number from 0.0001 to 1 s is expected"),
    (["mesh.shape.width=0.05"], "shape and split belong to parametric"),
    (["tissue=3"], "tissue: a table is expected (given: 3)"),
    (["boundary.fixed=[]"], "boundary.fixed: nothing is fixed"),
    (["muscles.sigma_max={XYZ=1.0}"], "no muscle 'XYZ' in the mesh"),
    (["time.step_min=0.1"], "step_min: 0.1 s is larger than step_max"),
    (["probes.p=[1.0, 2.0]"], "probes.p: [1.0, 2.0]; the name of a landmark or three numbers [x, y, z] are expected"),
    (["output.every=1e-9"], "output.every: 1e-09 s; a number from 0.0001 to 100 s is expected"),
    (["boundary.fixed=['maxilla']"], "the mesh has no surface 'maxilla'; it has free, hyoid, mandible"),
    (["time.step=0.01", "time.step_max=0.01"], "time: either step or step_max is expected, not both"),
    (["units='cm'"], "units: 'cm'; one of m, mm is expected"),
    (["muscles.force_velocity='fast'"], "muscles.force_velocity: 'fast'; one of grenoble, hill, none is expected"),
    (["muscles.sigma_max={GGP=-1.0}"], "muscles.sigma_max.GGP: -1.0 Pa; zero or a positive number is expected"),
    (["time.end=0"], "time.end: 0 s; a number from 1e-06 to 100 s is expected"),
    (["probes.tip='nose'"], "no landmark 'nose' in the mesh; it has dorsum, edge_left"),
    (["mesh.parametric='coarse'"], "exactly one of file, parametric and subject is expected"),
    (["nonsense"], "--set nonsense: key=value is expected"),
]


@pytest.mark.parametrize(("changes", "message"), BAD, ids=[c[0][:30] for c, _ in BAD])
def test_bad_scenarios(scenario: Path, capsys: pytest.CaptureFixture[str], changes: list[str], message: str) -> None:
    """Each fault is one line that names the key and what is accepted; the exit code is 2."""
    options = [part for change in changes for part in ("--set", change)]
    code, text = tongue(capsys, "check", scenario, *options)
    assert code == 2
    assert message in text
    assert text.startswith("error:")
    assert len(text.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--shape", "width=90"], "shape.width: 0.09 m; a length from 0.04 to 0.06 m is expected"),
        (["--shape", "girth=50"], "'girth' is not one of length, width, height, root, tip, scale"),
        (["--shape", "width=wide"], "KEY=NUMBER is expected"),
        (["--sex", "both"], "sex: 'both' is not one of male, female"),
        (["--age", "8"], "--age: needs --sex"),
        (["--sex", "male", "--age", "-3"], "age: -3 years is out of range"),
        (["--split", "HG"], "split: 'HG' is not one of GGP, SL"),
        (["--compare", "nowhere"], "nowhere: the subject folder does not exist"),
        ([str(EXAMPLE), "--shape", "width=45"], "belong to the parametric tongue, not to a subject"),
        (["--preset", "tiny"], "--preset: 'tiny' is not one of coarse, medium, reference"),
        (["--size", "0.1"], "0.1 mm is out of range; 1 to 20 mm is accepted"),
    ],
)
def test_bad_builds(tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str) -> None:
    """Exit code 2 and one sentence; nothing is written."""
    code, text = tongue(capsys, "build", "-o", tmp_path / "mesh.msh", *options)
    assert code == 2
    assert message in text
    assert not list(tmp_path.iterdir())


def test_build_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every figure of a tongue is printed, muscles are compared, and two pictures lie beside the mesh."""
    code, text = tongue(capsys, "build", EXAMPLE, "-o", tmp_path / "egg.msh", "--size", "9", "--compare", EXAMPLE, "--figures")
    assert code == 0
    for word in ("tongue proper", "dorsal arc", "chord", "oral width", "mid-sagittal area", "landmarks", "smallest SICN", "Dice", "GGP_L"):
        assert word in text, word
    assert {path.name for path in tmp_path.iterdir()} == {"egg.msh", "egg.h5", "egg.json", "egg-muscles.png", "egg-bones.png"}


def test_missing_and_broken_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A scenario that is missing or not TOML, a mesh that is not one, an unknown option, an unknown preset."""
    broken = tmp_path / "broken.toml"
    broken.write_text("[mesh")
    mesh = tmp_path / "text.msh"
    mesh.write_text("not a mesh")
    uses = tmp_path / "uses.toml"
    uses.write_text(SCENARIO.replace("tongue.msh", "text.msh"))
    faults: list[tuple[list[object], str]] = [
        (["check", tmp_path / "none.toml"], "none.toml: the file does not exist; a scenario in TOML is expected"),
        (["check", broken], "broken.toml: cannot be read"),
        (["check", uses], "text.msh"),
        (["check", uses, "--fast"], "No such option: --fast"),
        (["build", "--preset", "huge"], "'huge' is not one of coarse, medium, reference"),
        (["build", "--size", "0.1", "-o", tmp_path / "a.msh"], "0.1 mm is out of range"),
        (["build", tmp_path / "nobody"], "the subject folder does not exist"),
        (["build", "-o", tmp_path / "a.vtk"], "must end in .msh"),
    ]
    for arguments, message in faults:
        code, text = tongue(capsys, *arguments)
        assert (code, message in text) == (2, True), text


def test_foreign_meshes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A mesh without muscles says so when one is activated; a mesh with a facet in two surfaces is refused."""
    import gmsh

    write_block(tmp_path / "tongue.msh", (0.02, 0.01, 0.01), (2, 1, 1))
    path = tmp_path / "s.toml"
    path.write_text(SCENARIO)
    code, text = tongue(capsys, "check", path, "--set", "boundary.fixed=['left']")
    assert code == 2
    assert "It has no muscles" in text
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.open(str(tmp_path / "tongue.msh"))
    gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntities(2)], name="skin")
    gmsh.write(str(tmp_path / "tongue.msh"))
    gmsh.finalize()
    code, text = tongue(capsys, "check", path)
    assert code == 2
    assert "and skin; exactly one is accepted" in text


def test_run_and_check(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The whole command leaves the whole run folder; a folder in the way is refused before anything starts."""
    code, text = tongue(capsys, "check", scenario)
    assert (code, f"GGP: 0 ms: 0, 100 ms: 1, at most {CALKA_STRESS['GGP'] / 1e3:g} kPa" in text) == (0, True), text
    _, text = tongue(capsys, "check", scenario, "--set", "time.end=0.2")
    rise = next(line for line in text.splitlines() if "▁" in line).split("│")[1]
    assert list(rise) == sorted(rise)
    assert rise[0] == "▁"
    assert rise[-1] == "█"
    assert "unknowns: some" in text
    folder = tmp_path / "run"
    code, text = tongue(capsys, "run", scenario, "-o", folder, "--set", "time.step=0.005")
    assert code == 0, text
    files = "scenario.toml fields.xdmf fields.h5 history.h5 summary.json log.txt checkpoint.h5"
    files += " figures/midsagittal.png figures/view3d.png figures/trajectories.png"
    for name in files.split():
        assert (folder / name).is_file(), name
    assert load(folder / "scenario.toml").time.step == 0.005
    code, text = tongue(capsys, "run", scenario, "-o", folder / "log.txt")
    assert code == 2
    assert "cannot be written" in text
    code, text = tongue(capsys, "run", scenario, "-o", tmp_path / "new", "--resume")
    assert f"{tmp_path / 'new'}: nothing to resume, as checkpoint.h5 is not there; run without --resume" in " ".join(text.split())
    assert code == 2
    assert "nothing to resume" in text


def test_bad_input_leaves_a_finished_run_alone(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whatever is refused, with or without --resume, not one byte of the run folder changes."""
    folder = tmp_path / "run"
    assert tongue(capsys, "run", scenario, "-o", folder, "--no-figures")[0] == 0
    assert not list((folder / "figures").iterdir())

    def content() -> dict[str, bytes]:
        return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}

    before = content()
    parametric = tmp_path / "parametric.toml"
    parametric.write_text(SCENARIO.replace('file = "tongue.msh"', 'parametric = "coarse"'))
    for arguments in (
        [scenario, "--set", "boundary.fixed=[]"],
        [scenario, "--set", "tissue.nu=0.4", "--resume"],
        [parametric, "--set", "activation.X.pieces=[[1, 0, 1]]"],
    ):
        code, text = tongue(capsys, "run", "-o", folder, *arguments)
        assert code == 2, text
        assert content() == before
    for name, damage in (("checkpoint.h5", b"garbage"), ("history.h5", b""), ("fields.h5", before["fields.h5"][:500])):
        (folder / name).write_bytes(damage)
        code, text = tongue(capsys, "run", scenario, "-o", folder, "--resume")
        assert (code, f"{name}: cannot be read" in text) == (2, True), text
        assert content() == before | {name: damage}
        (folder / name).write_bytes(before[name])


def test_damaged_fibre_file(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Garbage, NaN weights or another mesh in the .h5 beside the mesh is said, not computed with."""
    import shutil

    import h5py

    for suffix in (".msh", ".h5"):
        shutil.copy(tongue_file.with_suffix(suffix), tmp_path)
    path = tmp_path / "s.toml"
    path.write_text(SCENARIO)
    with h5py.File(tmp_path / "tongue.h5", "r+") as file:
        file["muscles/GGP_L/weight"][0] = float("nan")
    code, text = tongue(capsys, "check", path)
    assert (code, "tongue.h5: cannot be read (muscles/GGP_L is damaged)" in text) == (2, True), text
    (tmp_path / "tongue.h5").write_bytes(b"garbage")
    code, text = tongue(capsys, "check", path)
    assert (code, "tongue.h5: cannot be read" in text) == (2, True), text


def test_units_and_dump(scenario: Path) -> None:
    """Lengths in mm come out in m; what is dumped reads back the same."""
    changes = ["units='mm'", "muscles.tendon_length=4", "probes.p=[1.0, 2.0, 3.0]", "activation.GGP.pieces=[[0.1, 0, 1]]"]
    s = load(scenario, changes)
    assert s.muscles.tendon_length == pytest.approx(4e-3)
    assert s.probes is not None
    assert s.probes["p"] == pytest.approx((1e-3, 2e-3, 3e-3))
    copy = scenario.with_name("copy.toml")
    copy.write_text(dump(s))
    assert load(copy) == s


def test_doctor(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """All is well here; without a compiler it says how to get one and exits with 2."""
    code, text = tongue(capsys, "doctor")
    assert code == 0, text
    monkeypatch.setenv("CC", "no-such-compiler")
    code, text = tongue(capsys, "doctor")
    assert code == 2
    assert "bad C compiler: no-such-compiler is not on the PATH" in text
    monkeypatch.delenv("CC")
    monkeypatch.setattr("sysconfig.get_path", lambda name: "/nowhere")
    code, text = tongue(capsys, "doctor")
    assert (code, "bad C compiler: cc does not find Python's headers (Python.h)" in text) == (2, True)


def test_solve_that_fails_exits_with_3(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A load that no step survives: exit code 3, and the folder still reads."""
    options = ["gravity.acceleration=[0.0, 0.0, -1e6]", "gravity.rise=0.0", "time.step_min=0.004"]
    code, text = tongue(capsys, "run", scenario, "-o", tmp_path, *(part for o in options for part in ("--set", o)))
    assert (code, "last good state is saved" in text) == (3, True), text


def test_bad_input_on_two_ranks(scenario: Path) -> None:
    """Under MPI a fault is said once, and every rank leaves with 2."""
    mpiexec = Path(sys.executable).with_name("mpiexec")
    command = [
        str(mpiexec),
        "-n",
        "2",
        sys.executable,
        "-m",
        "tongue_fenicsx",
        "check",
        str(scenario),
        "--set",
        "activation.X.pieces=[[1, 0, 1]]",
    ]
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PMI", "MPI"))}
    result = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120, env=environment)
    assert result.returncode == 2
    assert result.stderr.count("no muscle 'X'") == 1


HEAVY = ("dolfinx", "gmsh", "matplotlib", "pymeshfix", "pyvista", "scipy", "ufl")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    """That of the distribution; without a command the help, and what is missing."""
    code, said = tongue(capsys)
    assert (code, said.splitlines()[-1]) == (2, "error: A command is expected. See tongue --help.")
    assert tongue(capsys, "--version") == (0, f"tongue_fenicsx {tf.__version__}\n")


@pytest.mark.parametrize("arguments", [["--help"], ["check", "--help"], ["chekc", "a.toml"], ["check", "a.toml", "--fast"], ["run"]])
def test_light(arguments: list[str]) -> None:
    """Help, and a command that is mistyped, are answered without any library that takes long to load."""
    code = f"""
import sys
from tongue_fenicsx.cli.app import main
try:
    main({arguments!r})
except SystemExit:
    print("loaded:", *(name for name in {HEAVY!r} if name in sys.modules))
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "Usage" in result.stdout or "error:" in result.stderr, result.stderr
    assert result.stdout.splitlines()[-1].split() == ["loaded:"]


def test_without_dolfinx() -> None:
    """A command that needs it says so in one sentence."""
    code = """
import sys
sys.modules["dolfinx"] = None
from tongue_fenicsx.cli.app import main
main(["check", sys.argv[1]])
"""
    result = subprocess.run(
        [sys.executable, "-c", code, str(EXAMPLE.parent / "cantilever.toml")], capture_output=True, text=True, timeout=60
    )
    assert (result.returncode, result.stdout) == (2, "")
    assert re.fullmatch("error: .*dolfinx.*; tongue doctor says how to install what is missing.", result.stderr.strip())


def test_text_is_printed_as_it_is(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Brackets in names, paths and remedies are no markup."""
    code, text = tongue(capsys, "check", "[/red]:smile:.toml")
    assert (code, "[/red]:smile:.toml: the file does not exist" in text) == (2, True), text
    monkeypatch.setitem(sys.modules, "dolfinx", None)
    code, text = tongue(capsys, "doctor")
    assert (code, "pip install 'tongue_fenicsx[wheel]'" in text) == (2, True), text


@pytest.mark.parametrize("kind", ["muscle", "vowel", "contact", "subject", "block", "sweep", "fit"])
def test_init(kind: str, tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What it writes is taken by the command that it names, and is never written over a file."""
    path = tmp_path / "mine.toml"
    code, said = tongue(capsys, "init", kind, "-o", path)
    assert (code, f"wrote {path}" in said.replace("\n", "")) == (0, True), said
    code, said = tongue(capsys, "init", kind, "-o", path)
    assert (code, "is there already" in said) == (2, True), said
    if kind == "sweep":
        code, said = tongue(capsys, "sweep", path, "--dry-run")
    elif kind == "fit":
        code, said = 0 if fit_file.read(path).file.hold else 1, ""
    else:
        mesh = HOUSE / "demos" / "cantilever.msh" if kind == "block" else tongue_file
        code, said = tongue(capsys, "check", path, "--set", f"mesh={{file='{mesh}'}}")
    assert code == 0, said
    code, said = tongue(capsys, "init", "poem", "-o", tmp_path / "other.toml")
    assert (code, "is not one of muscle" in said) == (2, True), said
