# SPDX-License-Identifier: MIT
"""Bad input of every kind: one sentence that names the file, the key and what is accepted, exit code 2, and nothing is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import write_block
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import tongue_fenicsx as tf
from tongue_fenicsx.cli.app import main
from tongue_fenicsx.scenario.files import dump, load

SCENARIO = """
[mesh]
file = "block.msh"
[boundary]
fixed = ["left"]
[time]
end = 0.01
"""
PULLED = SCENARIO.replace("block.msh", "bar.msh") + '[activation.GGP]\ntable = "levels.csv"\n'

SIGNS = "\ufeff\0\r\n\t #\"'[]{}.,=-+_0123456789aeéx"
"""What generated text is made of."""

few = settings(max_examples=100, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a passive block and a bar with a muscle, 20 × 10 × 10 mm."""
    folder = tmp_path_factory.mktemp("bad")
    write_block(folder / "block.msh", (0.02, 0.01, 0.01), (4, 2, 2))
    (folder / "bar.msh").write_bytes((folder / "block.msh").read_bytes())
    (folder / "bar.fibres.json").write_text('{"passive": {"direction": [1, 0, 0]}}')
    return folder


def refused(capsys: pytest.CaptureFixture[str], folder: Path, *arguments: object) -> str:
    """The one line with which a command is refused; whatever the folder holds stays as it is."""

    def content() -> dict[str, bytes]:
        return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    before = content()
    with pytest.raises(SystemExit) as leaving:
        main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert (leaving.value.code, out) == (2, ""), err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert len(err) < 900
    assert content() == before
    return err


TEXTS: list[tuple[str | bytes, str]] = [
    ("", "the key 'mesh' is missing"),
    (b"\0" * 100, "cannot be read (Invalid statement"),
    (SCENARIO.encode("utf-16"), "it is no text in UTF-8"),
    (f"{SCENARIO}# é".encode("latin-1"), "it is no text in UTF-8"),
    (f"{SCENARIO}\0", "cannot be read"),
    (f"{SCENARIO}end = 0.02", "Cannot overwrite a value"),
    (f"{SCENARIO}[time]", "Cannot declare ('time',) twice"),
    (f"{SCENARIO}x = {'[' * 10_000}", "maximum recursion depth"),
    (f"{SCENARIO}[tissue]\nnu = {'1' * 5000}", "Exceeds the limit"),
    (f"{SCENARIO}[tissue]\nnu = 1979-05-27", "tissue.nu: datetime.date(1979, 5, 27); a number above -1"),
    (f"{SCENARIO}[tissue]\nc10 = {'1' * 400}", "(400 characters) Pa; a positive number is expected"),
    (f"{SCENARIO}[tissue]\npreset = '{'x' * 100_000}'", "(100002 characters); one of calka, buchaillard, kappert is expected"),
    (f"{SCENARIO}[tissue]\n{'x' * 100_000} = 1", "xxx…'; Known here: preset, law"),
    (f"{SCENARIO}[{'x' * 100_000}]\na = 1", "xxx…'; Known here: units, mesh"),
    (f"{SCENARIO}['[red]']\na = 1", "unknown key '[red]'; Known here: units, mesh"),
    (f"{SCENARIO}['[key]']\na = 1", "unknown key '[key]'; Known here: units, mesh"),
    (f"{SCENARIO}[[tissue]]\nnu = 0.4", "tissue: a table is expected (given: [{'nu': 0.4}])"),
    (f"{SCENARIO}[[contact]]\nnu = 0.4", "contact: a table is expected"),
    (f"{SCENARIO}[probes]\n'a/b' = [0.01, 0.0, 0.0]", "probes: 'a/b'; a name of up to 64 letters, digits"),
    (f"{SCENARIO}[probes]\n'.' = [0.01, 0.0, 0.0]", "probes: '.'; a name of"),
    (f'{SCENARIO}[probes]\n"" = [0.01, 0.0, 0.0]', "probes: ''; a name of"),
    (f'{SCENARIO}[probes]\n"a\\u0000b" = [0.01, 0.0, 0.0]', "probes: 'a\\x00b'; a name of"),
    (f"{SCENARIO}[probes]\n'[/red]' = [0.01, 0.0, 0.0]", "probes: '[/red]'; a name of"),
    (f"{SCENARIO}[probes]\n'$x' = [0.01, 0.0, 0.0]", "probes: '$x'; a name of"),
    (f"{SCENARIO}[probes]\n{'x' * 65} = [0.01, 0.0, 0.0]", "; a name of up to 64"),
    (f"{SCENARIO}[contact.'a/b'.sphere]\ncentre = [0, 0, 1]\nradius = 0.1", "contact: 'a/b'; a name of"),
    (f'{SCENARIO}[contact."..".sphere]\ncentre = [0, 0, 1]\nradius = 0.1', "contact: '..'; a name of"),
    (SCENARIO.replace("block.msh", "a\\u0000b"), "a\\x00b: the file does not exist"),
    (SCENARIO.replace("block.msh", ""), "is a folder; a Gmsh .msh file"),
    (SCENARIO.replace("block.msh", "x" * 5000), "File name too long"),
    (SCENARIO.replace('"block.msh"', "3"), "mesh.file: input should be a valid string (given: 3)"),
    (SCENARIO.replace('"block.msh"', "['block.msh']"), "mesh.file: input should be a valid string (given: ['block.msh'])"),
    (SCENARIO.replace('file = "block.msh"', ""), "mesh: exactly one of file, parametric and subject is expected"),
    (SCENARIO.replace('["left"]', '"left"'), "boundary.fixed: input should be a valid list (given: 'left')"),
    (SCENARIO.replace('["left"]', "[1]"), "boundary.fixed.0: input should be a valid string (given: 1)"),
    (SCENARIO.replace('["left"]', '["left", "left"]'), "boundary: left is named 2 times among fixed, moving and suspended"),
    (SCENARIO.replace('["left"]', '["LEFT"]'), "boundary.fixed: the mesh has no surface 'LEFT'; it has free, left, right"),
    (SCENARIO.replace('["left"]', '["a/b"]'), "model.fixed.0: 'a/b'; a name of"),
]


@pytest.mark.parametrize(("text", "message"), TEXTS)
def test_scenarios(place: Path, capsys: pytest.CaptureFixture[str], text: str | bytes, message: str) -> None:
    """Files that are no TOML, unknown keys, wrong types, endless values, names that no file could carry."""
    path = place / "bad.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    said = refused(capsys, place, "check", path)
    assert said.startswith(f"error: {path}: ")
    assert message in said


CHANGES = [
    ("=1", "--set =1: key=value is expected"),
    ("tissue.nu", "--set tissue.nu: key=value is expected"),
    ("tissue.nu=", "--set tissue.nu=: key=value is expected"),
    ("tissue..nu=0.4", "unknown key 'tissue.'"),
    (".=1", "unknown key ''"),
    ("[red]=1", "unknown key '[red]'"),
    ("'tissue'.nu=0.4", "did you mean 'tissue'?"),
    ("x" * 100_000, "(100002 characters: key=value is expected"),
    (f"{'x' * 100_000}=1", "xxx…'; Known here"),
    (f"tissue.preset={'y' * 100_000}", "(100002 characters); one of calka"),
    ("time.end.x=1", "--set time.end.x=1: end is a value, not a table"),
    ("tissue.nu.x=1", "tissue.nu: {'x': 1}; a number above -1"),
    ("tissue.nu=0,4", "tissue.nu: '0,4'; a number above -1"),
    ("tissue.nu=\0", "tissue.nu: '\\x00'; a number above -1"),
    ("probes.p=[0.01,0.005,0.005", "--set probes.p=[0.01,0.005,0.005: Unclosed array"),
    ("probes.p='tip", "--set probes.p='tip: "),
    ("probes.p=[nan,0,0]", "probes.p: [nan, 0, 0]; the name of a landmark or three numbers"),
    ("probes.p=[1e400,0,0]", "probes.p: [inf, 0, 0]"),
    ("probes.p=[10,0,0]", "probes.p: the point lies 9980.0 mm outside the tongue; at most 1 mm is accepted"),
    ("probes.p=tip", "probes.p: no landmark 'tip' in the mesh; it has none; or give [x, y, z]"),
    ("time.end=1e-7", "time.end: 1e-07 s; a number from 1e-06 to 100 s is expected"),
    ("time.end=true", "time.end: True s; a number from"),
    ("time.end=inf", "time.end: inf s; a number from"),
    ("time.step=-1", "time.step: -1 s; a number from"),
    ("time.tolerance=2", "time.tolerance: 2; a number above 0 and below 1"),
    ("time.spectral_radius=1.5", "time.spectral_radius: 1.5; a number from 0 to 1"),
    ("output.fields=x", "output.fields: input should be a valid list (given: 'x')"),
    ("solver.max_newton=0", "solver.max_newton: 0; a whole number from 1 to 1000"),
    ("solver.rtol=-1", "solver.rtol: -1; a number above 0 and below 1"),
    ("gravity.acceleration=[0,0]", "gravity.acceleration: [0, 0]; three numbers"),
    ("gravity.posture=lying", "gravity.posture: 'lying'; one of upright, supine"),
    ("gravity.rise=-1", "gravity.rise: -1 s; a number from 0 to 100 s"),
    ("muscles.tendon_length=1", "muscles.tendon_length: 1 m; a length from 0 to 0.05 m"),
    ("muscles.optimal_stretch=0", "muscles.optimal_stretch: 0; a number from 0.5 to 2"),
    ("muscles.sigma_max=[1]", "muscles.sigma_max: a table is expected (given: [1])"),
    ("tissue.density=0", "tissue.density: 0 kg/m³; a positive number"),
    ("load.up.pressure.pieces=[[0.1,0,1000]]", "load.up: the mesh has no surface 'up'; it has free, left, right"),
    ("load.right={}", "load.right: one of pressure is expected"),
    ("region.passive={law='neo_hookean',nu=0.4}", "region.passive: the law neo_hookean needs c10"),
    ("region.x={law='neo_hookean',nu=0.4,c10=9.0}", "region.x: the mesh has no volume 'x'; it has passive"),
    ("boundary.moving.right={}", "boundary.moving.right: motion: neither angle nor translation is given"),
    ("boundary.suspended.right.mass=-1", "boundary.suspended.right.mass: -1 kg; zero or a positive number"),
    ("contact.p.plane={point=[0,0,-0.01],normal=[0,0,0]}", "contact.p.plane: plane: the normal [0, 0, 0] has no direction"),
    ("contact.p.plane={point=[0,0,0.005],normal=[0,0,1]}", "contact.p: at rest the tongue is 5.00 mm inside it"),
    ("contact.p.sphere={centre=[0,0,0],radius=-1}", "contact.p.sphere.radius: -1 m; a positive length"),
    ("contact.p.surface=x.stl", "x.stl: the file does not exist; a surface in STL"),
    ("contact.p.surface=x.xyz", "contact.p.surface: the mesh has no bone 'x.xyz'"),
    ("contact.p={moves_with='jaw'}", "contact.p.moves_with: 'jaw' does not move; moving in boundary.moving: none"),
    ("mesh.size=1", "mesh: size belongs to parametric or subject"),
    ("activation.X.pieces=[[0.1,0,1]]", "activation.X: no muscle 'X' in the mesh; It has no muscles with fibres"),
    ("activation.X.pieces=[]", "activation.X: activation: no pieces"),
    ("activation.X.pieces=[[0,0,1]]", "activation.X.pieces.0.0: 0 s; a positive number"),
    ("activation.X.pieces=[[0.1,0,1,1]]", "activation.X.pieces.0: tuple should have at most 3 items"),
    ("activation.X.pieces=[[0.1,0,true]]", "activation.X.pieces.0.2: True; a number from 0 to 1"),
    ("activation.X.pieces=ramp", "activation.X.pieces: 'str' instances are not allowed as a Sequence value (given: 'ramp')"),
]


@pytest.mark.parametrize(("change", "message"), CHANGES, ids=[change[:40] for change, _ in CHANGES])
def test_changes(place: Path, capsys: pytest.CaptureFixture[str], change: str, message: str) -> None:
    """``--set`` that is no key and value, and values that a scenario does not take; a run writes nothing."""
    path = place / "good.toml"
    path.write_text(SCENARIO)
    said = refused(capsys, place, "check", path, "--set", change)
    assert message in said
    assert said.startswith((f"error: {path}: ", "error: --set "))


TABLES = [
    (b"", "it has less than two rows"),
    (b"0,0\n", "it has less than two rows"),
    (b"\0\1\2", "it has less than two rows"),
    (b"\xff\xfe0\0", "it is no text in UTF-8"),
    (b"0,0\n0,1,1\n", "'0,1,1' is other than two columns of numbers parted by ','; decimal commas need ';'"),
    (b"0,0,0\n0.1,1,1\n", "'0,0,0' is other than two columns"),
    (b"0\n1\n", "'0' is other than two columns"),
    (b"0 0\n0.1 1\n", "'0.1 1' is other than two columns"),
    (b"t,a\nu,b\n0,0\n0.1,1", "'u,b' is other than two columns"),
    (b"0,0\n0.1,100%\n", "'0.1,100%' is other than two columns"),
    (b"0;0\n0.1;1;1\n", "is other than two columns of numbers parted by ';'"),
    (b"0.1,1\n0,0\n", "the times do not grow from 0 on"),
    (b"0,0\n0,1\n", "the times do not grow from 0 on"),
    (b"-1,0\n0,0\n0.1,1\n", "the times do not grow from 0 on"),
    (b"nan,0\n0.1,1\n0.2,1\n", "the times do not grow from 0 on"),
    (b"0,0\ninf,1\n", "activation.pieces.0.0: inf s; a positive number"),
    (b"0,nan\n0.1,1\n", "activation.pieces.0.1: nan; a number from 0 to 1"),
    (b"0;0\n100;50\n", "activation.pieces.0.2: 50.0; a number from 0 to 1"),
    (b"0,-0.1\n0.1,1\n", "activation.pieces.0.1: -0.1; a number from 0 to 1"),
]


@pytest.mark.parametrize(("table", "message"), TABLES, ids=[repr(table[:30]) for table, _ in TABLES])
def test_tables(tmp_path: Path, table: bytes, message: str) -> None:
    """Activations over time that are no table of two columns, or hold what is no time or level."""
    path = tmp_path / "levels.csv"
    path.write_bytes(table)
    with pytest.raises(tf.InputError) as refusal:
        tf.Activation.from_table(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert message in str(refusal.value)


@pytest.mark.parametrize(
    "table", ["0,0\n.1,1\n", "t,level\n0,0\n0.1,1\n", "\ufefft;GGP\r\n0;0\r\n0,1;1\r\n", '"0"\t"0"\n"0,1"\t"1"\n', "\ufeff+0,0\n0.1,1"]
)
def test_tables_as_programs_write_them(tmp_path: Path, table: str) -> None:
    """With a byte-order mark, names, quotes, tabulators, semicolons and decimal commas."""
    path = tmp_path / "levels.csv"
    path.write_text(table, encoding="utf-8")
    assert tf.Activation.from_table(path).pieces == ((0.1, 0.0, 1.0),)


def test_file_and_key_are_named(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is found after a scenario was read names it too: a table, a muscle without peak stress, fibres that fit no mesh."""
    path = place / "pulled.toml"
    path.write_text(PULLED)
    assert f"error: {path}: {place / 'levels.csv'}: the file does not exist" in refused(capsys, place, "check", path)
    assert f"error: {path}: activation.GGP: no muscle 'GGP'" in refused(
        capsys, place, "check", path, "--set", "activation.GGP={pieces=[[1,0,1]]}"
    )
    path.write_text(SCENARIO.replace("block.msh", "bar.msh") + "[activation.passive]\npieces = [[0.1, 0, 1]]\n")
    assert f"error: {path}: muscles.sigma_max: no peak stress for muscle 'passive'; give one in Pa" in refused(capsys, place, "check", path)
    assert "no peak stress for muscle 'passive'" in refused(capsys, place, "run", path, "-o", place / "out")


def attempt[T](action: Callable[[], T]) -> T | tf.InputError:
    """What an action gives, or the sentence that refuses it."""
    try:
        return action()
    except tf.InputError as refusal:
        return refusal


@few
@given(st.binary(max_size=200) | st.text(SIGNS, max_size=200).map(lambda text: f"{SCENARIO}{text}".encode()))
@example("\ufeff[mesh]".encode())
def test_parser(place: Path, text: bytes) -> None:
    """Whatever a file holds, it is a scenario that can be written and read again, or one sentence."""
    path = place / "any.toml"
    path.write_bytes(text)
    scenario = attempt(lambda: load(path))
    if isinstance(scenario, tf.InputError):
        assert str(scenario).startswith(f"{path}: ")
        assert len(str(scenario)) < 900
    else:
        path.write_text(dump(scenario), encoding="utf-8")
        assert load(path).model_copy(update={"mesh": scenario.mesh}) == scenario


KEYS = [
    "tissue.nu",
    "time.end",
    "muscles.sigma_max.GGP",
    "probes.p",
    "activation.GGP.pieces",
    "contact.p.sphere",
    "boundary.fixed",
    "units",
]
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(SIGNS, max_size=20).map(repr),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["a", "centre", "radius"]), inner, max_size=2),
    max_leaves=6,
)


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(part)}" for key, part in value.items()) + "}"
    return str(value).replace("True", "true").replace("False", "false")


@few
@given(st.sampled_from(KEYS) | st.text(SIGNS, max_size=20), VALUES.map(_toml) | st.text(SIGNS, max_size=20))
def test_set(place: Path, key: str, value: str) -> None:
    """Whatever is set, the scenario takes it or says what it does not take."""
    path = place / "set.toml"
    path.write_text(SCENARIO)
    scenario = attempt(lambda: load(path, [f"{key}={value}"]))
    if isinstance(scenario, tf.InputError):
        assert str(scenario).startswith((f"{path}: ", "--set "))
        assert len(str(scenario)) < 900
    else:
        assert 1e-6 <= scenario.time.end <= 100
        assert -1 < scenario.tissue.tissue().law.nu <= 0.5


@few
@given(st.lists(st.tuples(st.floats(), st.floats(), st.floats()), max_size=4))
@example([(0.1, 0.0, 1.0), (5e-324, 1.0, 0.0)])
def test_pieces(pieces: list[tuple[float, float, float]]) -> None:
    """Pieces are taken if their levels are levels and their times are times, and then every level on the way is one."""
    fits = bool(pieces) and all(0 < duration < np.inf and 0 <= a <= 1 and 0 <= b <= 1 for duration, a, b in pieces)
    course = attempt(lambda: tf.Activation(pieces))
    assert fits == isinstance(course, tf.Activation)
    if isinstance(course, tf.Activation):
        assert course.kinks == sorted(course.kinks)
        assert all(0 <= course(t) <= 1 for t in [0.0, *course.kinks, *np.linspace(0, 2 * min(course.kinks[-1], 1e6), 17)])
