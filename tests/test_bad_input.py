# SPDX-License-Identifier: MIT
"""Bad input of every kind: one sentence that names the file, the key and what is accepted, exit code 2, and nothing is written."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
import pyvista as pv
from conftest import EXAMPLE, opened, write_block
from dolfinx.mesh import entities_to_geometry, exterior_facet_indices
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import tongue_fenicsx as tf
from tongue_fenicsx.cli.app import main
from tongue_fenicsx.geometry.surface import Surface, close_surface
from tongue_fenicsx.mechanics.support import check_held
from tongue_fenicsx.meshing.build import _write_h5 as write_h5
from tongue_fenicsx.meshing.muscle_fields import MuscleField
from tongue_fenicsx.meshing.tetrahedra import Tetrahedra
from tongue_fenicsx.meshing.tongue_mesh import _read_h5 as read_h5
from tongue_fenicsx.runs.figures import FIGURES
from tongue_fenicsx.scenario.build import simulation_of
from tongue_fenicsx.scenario.files import dump, load
from tongue_fenicsx.testing import box

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
        return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name != ".lock"}

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
    (f"{SCENARIO}[{'x' * 100_000}]\na = 1", "xxx…'; Known here: units, seed, mesh"),
    (f"{SCENARIO}['[red]']\na = 1", "unknown key '[red]'; Known here: units, seed, mesh"),
    (f"{SCENARIO}['[key]']\na = 1", "unknown key '[key]'; Known here: units, seed, mesh"),
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
    (SCENARIO.replace('file = "block.msh"', f'subject = "{"x" * 5000}"'), "File name too long"),
    (f'{SCENARIO}[contact.p]\nsurface = "{"x" * 5000}.stl"', "File name too long"),
    (SCENARIO.replace('"block.msh"', "3"), "mesh.file: input should be a valid string (given: 3)"),
    (SCENARIO.replace('"block.msh"', "['block.msh']"), "mesh.file: input should be a valid string (given: ['block.msh'])"),
    (SCENARIO.replace('file = "block.msh"', ""), "mesh: exactly one of file, parametric and subject is expected"),
    (SCENARIO.replace('["left"]', '"left"'), "boundary.fixed: a list is expected (given: 'left')"),
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
    ("activation.GGP=high", "activation.GGP"),
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
    ("output.fields=x", "output.fields: a list is expected (given: 'x')"),
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
    ("activation.X.pieces=[[0.1,0,1,1]]", "activation.X.pieces.0: at most 3 entries are expected"),
    ("activation.X.pieces=[[0.1,0,true]]", "activation.X.pieces.0.2: True; a number from 0 to 1"),
    ("activation.X.pieces=ramp", "activation.X.pieces: a list is expected (given: 'ramp')"),
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


Tagged = list[tuple[int, list[int]]]
"""Elements: the tag of the group and volume or surface, 0 for none, and the nodes."""


@dataclass
class Mesh:
    """A box of tetrahedra, 20 × 10 × 10 mm: volume ``passive``, surfaces ``left`` and ``free``; and what a mesh file says of it."""

    points: np.ndarray
    cells: Tagged
    facets: Tagged
    names: dict[tuple[int, int], str]

    @classmethod
    def box(cls) -> Mesh:
        tongue = box((0.02, 0.01, 0.01), (2, 1, 1))
        mesh, bonded = tongue.mesh, set(tongue.facets(["wall"]).tolist())
        facets = exterior_facet_indices(mesh.topology)
        corners = entities_to_geometry(mesh, 2, facets).tolist()
        cells = mesh.geometry.dofmaps[0].copy()
        inverted = np.linalg.det(mesh.geometry.x[cells[:, 1:]] - mesh.geometry.x[cells[:, :1]]) < 0
        cells[inverted] = cells[inverted][:, [1, 0, 2, 3]]
        tagged = [(2 if facet in bonded else 3, nodes) for facet, nodes in zip(facets.tolist(), corners, strict=True)]
        names = {(3, 1): "passive", (2, 2): "left", (2, 3): "free"}
        return cls(mesh.geometry.x.copy(), [(1, nodes) for nodes in cells.tolist()], tagged, names)

    def add(self, other: Mesh) -> None:
        """Put other tetrahedra beside these."""
        n = len(self.points)
        self.points = np.vstack([self.points, other.points])
        self.cells += [(tag, [n + node for node in nodes]) for tag, nodes in other.cells]
        self.facets += [(3, [n + node for node in nodes]) for _, nodes in other.facets]

    def write(self, path: Path) -> None:
        """In Gmsh's format 2, as text."""
        elements = [(2, *facet) for facet in self.facets] + [(4, *cell) for cell in self.cells]
        path.write_text(
            "\n".join(
                ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(self.names))]
                + [f'{dim} {tag} "{name}"' for (dim, tag), name in self.names.items()]
                + ["$EndPhysicalNames", "$Nodes", str(len(self.points))]
                + [f"{i} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(self.points.tolist(), 1)]
                + ["$EndNodes", "$Elements", str(len(elements))]
                + [
                    f"{i} {kind} 2 {tag} {tag or 9} {' '.join(str(n + 1) for n in nodes)}"
                    for i, (kind, tag, nodes) in enumerate(elements, 1)
                ]
                + ["$EndElements", ""]
            )
        )


def _beside(mesh: Mesh, away: float) -> None:
    other = Mesh.box()
    other.points[:, 0] += away
    mesh.add(other)


def _invert(mesh: Mesh) -> None:
    tag, nodes = mesh.cells[0]
    mesh.cells[0] = tag, [nodes[1], nodes[0], *nodes[2:]]


def _share(mesh: Mesh) -> None:
    mesh.cells.append((4, mesh.cells[0][1]))
    mesh.names[3, 4] = "more"


def _rename(mesh: Mesh, **names: str) -> None:
    mesh.names = {place: names.get(name, name) for place, name in mesh.names.items()}


MESHES: list[tuple[Callable[[Mesh], object], str]] = [
    (lambda m: _beside(m, 0.05), "2 pieces that no common face joins, the smallest of 12 tetrahedra at (10, 5, 5) mm; one is expected."),
    (lambda m: _beside(m, 0.02), "2 pieces that no common face joins … so merge nodes that lie in one place"),
    (lambda m: m.cells.extend(m.cells[:3]), "3 tetrahedra are there twice or more, the first at"),
    (lambda m: m.cells.append((0, m.cells[0][1])), "some volume is in no physical group, 1 tetrahedra, the first at"),
    (_share, "1 tetrahedra are there twice or more"),
    (lambda m: m.facets.append((3, m.facets[0][1])), "1 triangles of physical surfaces are there twice or more, the first at"),
    (lambda m: m.cells.append((1, [0, 1, 2, 999])), "cannot be read (Wrong node index 1000"),
    (lambda m: m.cells.append((1, [0, 1, 2, 2])), "is inverted or flat (SICN"),
    (_invert, "is inverted or flat (SICN -"),
    (lambda m: m.points.__setitem__((0, 0), np.nan), "a coordinate is not a finite number"),
    (lambda m: m.points.__setitem__((0, 0), 1e300), "the mesh is 1e+300 m long; 0.001 to 1 m is accepted"),
    (
        lambda m: m.points.__imul__(1e3),
        "the mesh is 20 m long; 0.001 to 1 m is accepted, so convert its unit to metres or state it in mesh.unit",
    ),
    (lambda m: m.points.__imul__(1e-3), "the mesh is 2e-05 m long"),
    (lambda m: m.facets.clear(), "no physical surface; name at least the one to be fixed"),
    (lambda m: m.cells.clear(), "linear tetrahedra only are expected in the volume; found no volume elements"),
    (lambda m: _rename(m, left=""), "physical surface 2 has no name of its own"),
    (lambda m: _rename(m, left="free"), "has no name of its own"),
]


@pytest.mark.parametrize(("spoil", "message"), MESHES, ids=[message[:40] for _, message in MESHES])
def test_meshes(tmp_path: Path, spoil: Callable[[Mesh], object], message: str) -> None:
    """Own meshes that are in pieces, hold something twice, are inverted, without groups, or in another unit: how much, and where."""
    path = tmp_path / "own.msh"
    mesh = Mesh.box()
    mesh.write(path)
    assert tf.TongueMesh.read(path).surfaces == {"left": 2, "free": 3}
    spoil(mesh)
    mesh.write(path)
    with pytest.raises(tf.InputError) as refusal:
        tf.TongueMesh.read(path)
    said = str(refusal.value)
    assert said.startswith(f"{path}: ")
    assert all(part in said for part in message.split(" … "))


GARBAGE = [
    b"",
    b"garbage" * 100,
    bytes(range(256)) * 50,
    b"$MeshFormat\n4.1 1 8\n",
    b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n9\n1 0 0 0",
]


@pytest.mark.parametrize("content", GARBAGE, ids=range(len(GARBAGE)))
def test_no_mesh(tmp_path: Path, content: bytes) -> None:
    """Empty, damaged and other files; geometry that Gmsh would run is not opened."""
    path = tmp_path / "own.msh"
    path.write_bytes(content)
    with pytest.raises(tf.InputError, match=r"own.msh: "):
        tf.TongueMesh.read(path)
    script = tmp_path / "own.geo"
    script.write_text(f'SystemCall "touch {tmp_path}/done";')
    with pytest.raises(tf.InputError, match="it is no mesh of Gmsh"):
        tf.TongueMesh.read(script)
    assert not (tmp_path / "done").exists()


def test_mesh_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A mesh in mm is read where the scenario, or `mesh.unit`, says so, with the fibres beside it; a saved scenario says it again."""
    mesh = Mesh.box()
    mesh.points *= 1e3
    mesh.write(tmp_path / "block.msh")
    (tmp_path / "block.fibres.json").write_text('{"passive": [[[0, 5, 5], [20, 5, 5]]]}')
    tongue = tf.TongueMesh.read(tmp_path / "block.msh", unit="mm")
    assert np.ptp(tongue.mesh.geometry.x, axis=0) == pytest.approx([0.02, 0.01, 0.01])
    assert abs(tongue.muscles["passive"].direction[..., 0]) == pytest.approx(1.0)
    path = tmp_path / "s.toml"
    for lines, unit in (('units = "mm"', "mm"), ('units = "mm"\nmesh.unit = "cm"', "cm"), ('mesh.unit = "mm"', "mm"), ("", None)):
        path.write_text(lines + SCENARIO.replace("[mesh]\nfile", "mesh.file"))
        assert load(path).mesh.unit == unit
        path.write_text(dump(load(path)))
        assert load(path).mesh.unit == unit
    assert "mesh: unit belongs to file" in refused(capsys, tmp_path, "check", path, "--set", "mesh={parametric='coarse',unit='mm'}")


@pytest.mark.parametrize("curved", [False, True])
def test_quadratic_meshes(tmp_path: Path, curved: bool) -> None:
    """Straight quadratic tetrahedra are read by their corners, and it is said; curved ones are refused with the largest deviation."""
    path = tmp_path / "quadratic.msh"
    write_block(path, (0.02, 0.01, 0.01), (2, 1, 1))
    with opened(path):
        gmsh.model.mesh.setOrder(2)
        if curved:
            tags, points, _ = gmsh.model.mesh.getNodes()
            node = int(np.argmin(np.linalg.norm(points.reshape(-1, 3) - [0.02, 0.005, 0.0], axis=1)))  # the middle of an edge
            gmsh.model.mesh.setNode(tags[node], [0.02, 0.005, 0.0004], [])
        gmsh.write(str(path))
    if curved:
        with pytest.raises(
            tf.InputError, match=r"tetrahedra that are curved, by up to 0\.4 mm at \(20, 5, 0\) mm; straight ones are expected"
        ):
            tf.TongueMesh.read(path)
    else:
        tongue = tf.TongueMesh.read(path)
        assert "read by their corners" in tongue.notes[0]
        assert tongue.mesh.geometry.x.shape[1] == 3
        assert tongue.mesh.topology.index_map(0).size_global == 12


FIBRES = [
    (
        "[[[0, 5, 5], [20, 5, 5]]]",
        "muscle 'passive': its fibres, up to 2e+04 mm long, lie … they may be in mm; fibres that run through it",
    ),
    ("[[[0, 5e-6, 5e-6], [2e-5, 5e-6, 5e-6]]]", "muscle 'passive': its fibres, up to 0.02 mm long, … they may be in m; "),
    ("[[[5, 5, 5], [5.02, 5, 5]]]", "muscle 'passive': its fibres, up to 20 mm long, lie 86 … mm from it, which is 20 mm long"),
    ('{"toward": [10, 5, 5]}', "muscle 'passive': its fibres meet 1.222e+04 mm away from it, … times its size"),
    ("[[[0, 0, 0], [0, 0, 0]]]", "'passive': fibres: they have no length"),
    ("[[[0, 0, 0], [NaN, 0, 0]]]", "'passive': a polyline of two or more finite points"),
    ("[[0, 0, 0], [1, 0, 0]]", "'passive': a polyline of two or more finite points"),
    ('{"direction": [0, 0, 0]}', "'passive': 'direction': direction (of some length) or toward"),
    ('{"direction": [1, 0, 0], "toward": [0, 0, 0]}', "'passive': {'direction': [1, 0, 0], 'toward': [0, 0, 0]}; one of polylines"),
    ("{}", "'passive': {}; one of polylines"),
    ("null", "'passive': None; one of polylines"),
    ('"x"', "'passive': 'x'; one of polylines"),
    ('{"direction": "x"}', "'passive': could not convert string to float: 'x'"),
    ('{"direction": 1}', "'passive': 'int' object is not iterable"),
]


@pytest.mark.parametrize(("fibres", "message"), FIBRES, ids=[fibres for fibres, _ in FIBRES])
def test_fibres(place: Path, capsys: pytest.CaptureFixture[str], fibres: str, message: str) -> None:
    """Fibres in another unit, far away, without length, or no fibres: the file, the muscle, and how far it is."""
    (place / "spoiled.msh").write_bytes((place / "block.msh").read_bytes())
    (place / "spoiled.fibres.json").write_text(f'{{"passive": {fibres}}}')
    path = place / "spoiled.toml"
    path.write_text(SCENARIO.replace("block.msh", "spoiled.msh"))
    said = refused(capsys, place, "check", path)
    assert f"error: {path}: {place / 'spoiled.fibres.json'}: " in said
    assert all(part in said for part in message.split(" … "))


def _edit(folder: Path, name: str, change: Callable[[Any], Any]) -> None:
    path = folder / name
    path.write_text(json.dumps(change(json.loads(path.read_text()))))


def _scaled_bone(folder: Path, length: float) -> None:
    pv.Cube(x_length=length, y_length=length / 2, z_length=length / 2).triangulate().save(folder / "jaw.vtp")


def _spike(folder: Path) -> None:
    """Push one vertex of the surface through the other side."""
    surface = pv.read(folder / "tongue_surface.obj")
    surface.points[np.argmax(surface.points[:, 2])] -= (0.0, 0.0, 60.0)
    surface.save(folder / "tongue_surface.obj")


def _open(folder: Path) -> None:
    surface = pv.read(folder / "tongue_surface.obj")
    surface.extract_cells(range(1, surface.n_cells)).extract_surface(algorithm=None).save(folder / "tongue_surface.ply")
    (folder / "tongue_surface.obj").unlink()


def _fibres(lines: object) -> Callable[[Path], None]:
    return lambda folder: _edit(folder, "fibres.json", lambda data: data | {"GGP_L": lines})


def _frame(text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / "frame.toml").write_text(text)


SUBJECTS: list[tuple[str, Callable[[Path], object], str]] = [
    ("frame.toml", _frame("unit = 'inch'"), "unit: 'inch' is not one of m, cm, mm, nor the length of another in m"),
    ("frame.toml", _frame("axes = 'LLS'"), "axes: 'LLS'; three letters are expected"),
    ("frame.toml", _frame("axes = 3"), "axes: 3; three letters are expected"),
    ("frame.toml", _frame("units = 'mm'"), "unknown key 'units'; known are unit, axes"),
    ("frame.toml", _frame("mid_plane = 'y'"), "mid_plane: 'y'; a number is expected"),
    ("frame.toml", _frame("mid_plane = nan"), "mid_plane: nan; a number is expected"),
    ("frame.toml", _frame("unit = true"), "unit: True is not one of m, cm, mm"),
    ("frame.toml", _frame("unit = -1.0"), "unit: -1.0 is not one of m, cm, mm"),
    ("frame.toml", _frame("unit = inf"), "unit: inf is not one of m, cm, mm"),
    ("frame.toml", _frame("unit = [1]"), "unit: [1] is not one of m, cm, mm"),
    ("frame.toml", _frame("cap = 1"), "cap: 1; true or false is expected"),
    ("frame.toml", _frame("muscles = 'mine'"), "muscles: 'mine' is not one of measured, built-in"),
    ("frame.toml", _frame("repair = -1"), "repair: -1; zero or a positive number is expected"),
    ("frame.toml", _frame("genial_spine = [1, 2]"), "genial_spine: [1, 2]; three numbers are expected"),
    ("frame.toml", _frame("unit ="), "cannot be read (Invalid value"),
    (
        "tongue_surface.obj",
        _frame("unit = 'm'\naxes = 'LPS'"),
        "a tongue of 0.03 to 0.3 m and 5 to 400 cm³ is expected, so state its unit in frame.toml (unit = 'mm', not 'm', would",
    ),
    ("tongue_surface.obj", _spike, "triangles cross each other around ( … mm; a surface that does not cross itself is expected"),
    ("tongue_surface.ply", _open, "the surface is open (3 edges belong to one triangle only)"),
    ("tongue_surface.obj", lambda f: (f / "tongue_surface.obj").write_text("v 0 0 nan\n"), "a coordinate is not a finite number"),
    ("jaw.vtp", lambda f: _scaled_bone(f, 0.08), "the bone is 8e-05 m long; 0.003 to 0.6 m is expected, in the unit of the folder"),
    ("jaw.vtp", lambda f: _scaled_bone(f, 8e4), "the bone is 80 m long"),
    ("jaw.vtp", lambda f: (f / "jaw.vtp").write_bytes(b"garbage"), "holds no triangles that have an area"),
    (
        "attachments.json",
        lambda f: _edit(f, "attachments.json", lambda d: d | {"teeth": d["mandible"]}),
        "'teeth' and 'mandible' share 16 triangles",
    ),
    (
        "attachments.json",
        lambda f: _edit(f, "attachments.json", lambda d: {"mandible": [[0, 0, 900]]}),
        "'mandible', entry 0, lies … mm from",
    ),
    ("attachments.json", lambda f: _edit(f, "attachments.json", lambda d: {"a/b": d["mandible"]}), "'a/b' is not accepted as a name"),
    ("attachments.json", lambda f: _edit(f, "attachments.json", lambda d: {"mandible": [1, 2, 3]}), "there is no tongue_hex.vtu"),
    ("no.obj", lambda f: _edit(f, "attachments.json", lambda d: {"mandible": "no.obj"}), "no.obj: the file does not exist"),
    ("fibres.json", _fibres([]), "'GGP_L': fibres: they have no length"),
    ("fibres.json", _fibres([[[0, 0, 0], [0, 0, 0]]]), "'GGP_L': fibres: they have no length"),
    ("fibres.json", _fibres([[[0, 0, 0], [float("nan"), 0, 0]]]), "a point is not three finite numbers"),
    ("fibres.json", _fibres([[[0, 0, 0], [0.05, 0, 0.05]]]), "% of the fibre length of 'GGP_L' lies inside"),
    ("fibres.json", _fibres([[[900, 0, 0], [950, 0, 50]]]), "only 0 % of the fibre length of 'GGP_L' lies inside the tongue surface"),
    ("fibres.json", _fibres("x"), "'GGP_L' as a list of polylines"),
    ("fibres.json", lambda f: (f / "fibres.json").write_text("[]"), 'an object {"GGP_L"'),
]


@pytest.mark.parametrize(("name", "spoil", "message"), SUBJECTS, ids=[message[:40] for _, _, message in SUBJECTS])
def test_subjects(tmp_path: Path, name: str, spoil: Callable[[Path], object], message: str) -> None:
    """A folder with another unit, a surface that is open or crosses itself, bones of no size, patches that overlap, fibres elsewhere."""
    folder = tmp_path / "someone"
    shutil.copytree(EXAMPLE, folder)
    spoil(folder)
    with pytest.raises(tf.InputError) as refusal:
        tf.read_subject(folder)
    said = str(refusal.value)
    assert name in said
    assert all(part in said for part in message.split(" … "))


@few
@given(
    st.lists(st.tuples(st.integers(0, 11), st.floats(-0.03, 0.03), st.floats(-0.03, 0.03)), max_size=3),
    st.sets(st.integers(0, 19), max_size=2),
)
@example([], set())
@example([(0, 0.03, 0.03)], set())
def test_surfaces(moves: list[tuple[int, float, float]], missing: set[int]) -> None:
    """An icosahedron with vertices moved and triangles missing is refused, or closed, nowhere crossed, with normals outward."""
    solid = Surface.from_pyvista(pv.Icosahedron(radius=0.02))
    points = solid.points.copy()
    for vertex, x, z in moves:
        points[vertex] += (x, 0.0, z)
    triangles = np.delete(solid.triangles, sorted(missing), axis=0)
    closed = attempt(lambda: close_surface(Surface(points, triangles), Path("solid.stl"))[0])
    if isinstance(closed, tf.InputError):
        assert moves or missing
        assert str(closed).startswith("solid.stl: ")
    else:
        assert not missing
        assert (closed.edge_sharing() == 2).all()
        assert len(closed.crossing()) == 0
        assert closed.volume > 0


def test_crossing_triangles_are_repaired_if_asked(tmp_path: Path) -> None:
    """A dent that goes through the other side by a little is mended within a distance that was stated, and it is said; no farther."""
    solid = pv.Icosphere(radius=0.02, nsub=2)
    surface = Surface.from_pyvista(solid)
    points = surface.points.copy()
    top = np.argmax(points[:, 2])
    near = np.argsort(np.linalg.norm(points - points[top], axis=1))[:2]
    points[near[0]], points[near[1]] = surface.points[near[1]], surface.points[near[0]]  # two neighbours in each other's place
    crossed = Surface(points, surface.triangles)
    assert len(crossed.crossing()) > 0
    mended, note = close_surface(crossed, tmp_path / "a.stl", within=5e-3)
    assert len(mended.crossing()) == 0
    assert "were repaired with pymeshfix" in str(note)
    assert "It moved by at most" in str(note)
    with pytest.raises(tf.InputError, match=r"the repair moves the surface by .* mm; repair allows 0\.001 mm"):
        close_surface(crossed, tmp_path / "a.stl", within=1e-6)


OBSTACLES: list[tuple[Callable[[], pv.PolyData], str]] = [
    (lambda: pv.Sphere(radius=0.45, center=(0, 0, -0.6)), "contact.o: obstacle: the surface is 0.899 × 0.894 × 0.9 m large, too much"),
    (lambda: pv.Plane(center=(0, 0, -0.1), i_size=0.9, j_size=0.9), "contact.o: obstacle: the surface is 0.9 × 0.9 × 0 m large, too much"),
    (lambda: pv.Sphere(radius=1.0, center=(0, 0, -1.2)), "o.stl is 2 m long; 0.001 to 1 m is accepted"),
    (lambda: pv.Sphere(radius=1e-5), "o.stl is 2e-05 m long"),
    (lambda: pv.Sphere(radius=0.01, center=(0, 0, -0.05)).flip_faces(), "free points within 48 mm are behind the surface; its normals"),
    (lambda: pv.PolyData(np.eye(4, 3) * 0, [3, 0, 1, 2]), "o.stl: holds no triangles that have an area"),
    (lambda: pv.PolyData(np.outer(range(3), (0.01, 0, 0)), [3, 0, 1, 2]), "o.stl: holds no triangles that have an area"),
]


@pytest.mark.parametrize(("surface", "message"), OBSTACLES, ids=[message[:40] for _, message in OBSTACLES])
def test_obstacles(place: Path, capsys: pytest.CaptureFixture[str], surface: Callable[[], pv.PolyData], message: str) -> None:
    """Obstacles that are too large or small, degenerate, or turned inside out though far away; at once."""
    surface().triangulate().save(place / "o.stl")
    path = place / "good.toml"
    path.write_text(SCENARIO)
    assert message in refused(capsys, place, "check", path, "--set", "contact.o.surface=o.stl")


@pytest.mark.parametrize("name", ["mesh", "mesh.stl", "mesh.MSH.gz"])
def test_build_names_are_checked_first(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """What is no name of a mesh is refused before the tongue is drawn."""
    assert "the mesh file must end in .msh" in refused(capsys, tmp_path, "build", "-o", tmp_path / name)


def test_a_damaged_mesh_file_is_known(tmp_path: Path) -> None:
    """Whatever bytes of the file beside a mesh are changed, it is read or refused, and no HDF5 library waits for ever: nothing that could
    lead it in a circle is without a check sum."""
    path = tmp_path / "tongue.h5"
    mesh = Tetrahedra(np.eye(4, 3), np.array([[3, 0, 1, 2]]), np.array([[0, 1, 2]]), np.array(["free"]))
    muscle = MuscleField(np.array([0]), np.arange(4), np.ones(4), np.tile([1.0, 0.0, 0.0], (4, 1)), np.ones(1), 1.0)
    anatomy = tf.Anatomy(
        "größte", Surface(np.eye(3), np.array([[0, 1, 2]])), {}, np.zeros(3), {"jaw": Surface(np.eye(3), np.array([[0, 1, 2]]))}
    )
    write_h5(anatomy, mesh, {"M1": muscle}, {"tip": np.zeros(3)}, path)
    whole = path.read_bytes()
    assert b"GCOL" not in whole  # the heap of texts of any length, in which it waited
    assert b"TREE" not in whole
    stored = read_h5(path)
    assert stored is not None
    assert stored["name"] == "größte"
    rng = np.random.default_rng(1)
    n_refused = 0
    for _ in range(300):
        spoiled = bytearray(whole)
        for at in rng.integers(0, len(whole), 4):
            spoiled[at] = rng.integers(0, 256)
        path.write_bytes(spoiled)
        n_refused += isinstance(attempt(lambda: read_h5(path)), tf.InputError)
    assert n_refused > 30


def run(folder: Path, capsys: pytest.CaptureFixture[str], text: str, *changes: str) -> tuple[int, str]:
    """Exit code of a run into ``out``, and what it printed."""
    path = folder / "run.toml"
    path.write_text(text)
    with pytest.raises(SystemExit) as leaving:
        main(["run", str(path), "-o", str(folder / "out"), "--overwrite", *(part for change in changes for part in ("--set", change))])
    out, err = capsys.readouterr()
    return int(leaving.value.code or 0), out + err


def test_round_off_and_many_probes(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An end within round-off of an output is that output; thousands of probes fit into a history."""
    probes = "\n".join(f"p{i} = [0.01, 0.005, {1e-6 * i}]" for i in range(3000))
    text = f"{SCENARIO.replace('0.01', '0.0200000005')}[probes]\n{probes}\n[gravity]\nposture = 'upright'"
    code, said = run(place, capsys, text, "time.step=0.01")
    assert code == 0, said
    done = tf.Run(place / "out")
    assert len(done.probes) == 3000
    assert done.output_times == pytest.approx([0.0, 0.01, 0.02], abs=1e-8)


def test_pictures_never_fail_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh away from y = 0 is cut in its middle; a picture that cannot be drawn is one line."""
    mesh = Mesh.box()
    mesh.points[:, 1] += 0.05
    mesh.write(tmp_path / "block.msh")

    def broken(run: tf.Run) -> Path:
        raise ZeroDivisionError("no light")

    monkeypatch.setitem(FIGURES, "view3d", replace(FIGURES["view3d"], draw=broken))
    code, said = run(tmp_path, capsys, SCENARIO, "gravity.posture=upright", "time.step=0.01")
    assert code == 0, said
    assert "note: the picture view3d could not be drawn (ZeroDivisionError: no light); the run is whole" in said
    assert (tmp_path / "out" / "figures" / "midsagittal.png").is_file()


NOTES = [
    ([], "nothing moves the tongue: neither an activation above 0, gravity, a load nor a moving bone is given"),
    (["tissue.density=1.0"], "tissue.density: 1 kg/m³; soft tissue has about 1000"),
    (
        ["tissue.nu=0.475", PULL := "activation.passive.pieces=[[0.1,0,1]]"],
        "tissue.nu: 0.475 lets active tissue shrink by some percent; 0.49 and",
    ),
    (["activation.passive.pieces=[[0.1,1,1]]"], "activation.passive jumps at 0 ms; excitation.rise lets it follow"),
    (["activation.passive.pieces=[[1e-6,0,1]]"], "activation.passive jumps at 0 ms"),
    (["activation.passive.pieces=[[0.005,0,0.5],[0.1,0.9,0.9]]"], "activation.passive jumps at 5 ms"),
]


@pytest.mark.parametrize(("changes", "message"), NOTES, ids=[message[:40] for _, message in NOTES])
def test_notes(place: Path, capsys: pytest.CaptureFixture[str], changes: list[str], message: str) -> None:
    """What is accepted but may be a slip is said, and nothing else of it; a scenario without slips has no note."""
    path = place / "notes.toml"
    path.write_text(SCENARIO.replace("block.msh", "bar.msh"))

    def notes(*some: str) -> list[str]:
        with pytest.raises(SystemExit) as leaving:
            main(["check", str(path), *(part for change in ("muscles.sigma_max.passive=1e4", *some) for part in ("--set", change))])
        out, err = capsys.readouterr()
        assert leaving.value.code == 0, err
        return [line for line in out.splitlines() if line.startswith("note: ")]

    assert notes(PULL) == []
    assert notes("activation.passive.pieces=[[0.1,1,1]]", "excitation.rise=0.01") == []
    (note,) = notes(*changes) if len(changes) != 1 or "density" not in changes[0] else notes(*changes, PULL)
    assert message in note


def test_nothing_holds_it(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An equilibrium on a frictionless plane has three free motions, in a cup three, in a box none; a body all bonded can touch nothing."""
    path = place / "free.toml"
    path.write_text(SCENARIO.replace('["left"]', "[]"))
    plane = "contact.{}.plane={{point=[{},0,0],normal=[{},{},{}]}}"
    floor = plane.format("floor", 0, 0, 0, 1)
    said = refused(capsys, place, "check", path, "--set", floor, "--set", "time.quasi_static=true")
    assert "time.quasi_static: nothing holds the tongue sideways, 3 rigid motions are free (along x and y, about z)" in said
    check_held(load_model(path, [floor, plane.format("wall", 0, 1, 0, 0), plane.format("side", 0, 0, 1, 0)]))
    everything = "boundary.fixed=['left','right','free']"
    assert "contact: no surface can touch, as all of it is bonded" in refused(
        capsys, place, "check", path, "--set", floor, "--set", everything
    )


def load_model(path: Path, changes: list[str]) -> tf.Model:
    """The model of a scenario."""
    return simulation_of(load(path, changes), path.parent).model
