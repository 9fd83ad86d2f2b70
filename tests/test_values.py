# SPDX-License-Identifier: MIT
"""What fields accept, what makes a value, and how little it takes to check a scenario."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

import tongue_fenicsx as tf
from tongue_fenicsx.core.fingerprint import fingerprint
from tongue_fenicsx.core.values import Length, OneOf, Point, Real, checked, in_metres
from tongue_fenicsx.geometry.surface import Surface
from tongue_fenicsx.mechanics.activation import FunctionOfTime
from tongue_fenicsx.scenario.files import dump, load

SQUARE = Surface(np.array([[0.0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0], [0, 0.02, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))


@dataclass(frozen=True)
@checked("thing")
class Thing:
    """A value as a user would write one."""

    long: Length
    where: Point
    heavy: Annotated[float, Real("kg", low=0)] = 1.0


def test_kinds_of_values_can_be_joined() -> None:
    """`typing` of Python 3.12 hashes what it joins."""
    choice = Annotated[str, OneOf(names={"a": 1})]
    assert {choice, choice | None} == {choice, choice | None}
    assert OneOf(names={"a": 1}) == OneOf(names={"a": 1}) != OneOf(names={"b": 1})


def test_one_definition_for_python_and_files() -> None:
    """A field is refused with one sentence; lengths are found by their type, and defaults are not scaled."""
    assert Thing(1, np.zeros(3)).where == (0.0, 0.0, 0.0)  # type: ignore[arg-type]
    for wrong, sentence in (
        ({"long": -1.0}, r"thing\.long: -1\.0 m; a positive length is expected\."),
        ({"where": (0, 0, 0, 1)}, r"thing\.where: \(0, 0, 0, 1\); three numbers are expected\."),
        ({"heavy": "much"}, r"thing\.heavy: 'much'; zero or a positive number is expected\."),
    ):
        with pytest.raises(tf.InputError, match=sentence):
            Thing(**{"long": 1.0, "where": (0, 0, 0)} | wrong)  # type: ignore[arg-type]
    assert in_metres(Thing, {"long": 2, "where": [1, 2, 3], "heavy": 5}) == {"long": 2e-3, "where": [1e-3, 2e-3, 3e-3], "heavy": 5}


VALUES: list[tuple[Any, Any]] = [
    (tf.Sphere((0, 0, 0), 0.01), tf.Sphere((0, 0, 0), 0.01, inside=True)),
    (tf.Plane((0, 0, 0), (0, 0, 1)), tf.Plane((0, 0, 0), (0, 1, 1))),
    (tf.Triangulated(SQUARE), tf.Triangulated(SQUARE, spacing=1e-3)),
    (tf.Triangulated(SQUARE), tf.Triangulated(SQUARE, band=6e-3)),
    (tf.Tissue.calka(), replace(tf.Tissue.calka(), peak_stress={"GGP": 1.0})),
    (tf.RigidMotion(angle=[(0.1, 0, 5)]), tf.RigidMotion(angle=[(0.1, 0, 6)])),
    (tf.ramp(0.1, 0.1), tf.Excited(tf.ramp(0.1, 0.1))),
    (FunctionOfTime(lambda t: t), FunctionOfTime(lambda t: t / 2)),
    ({"tip": np.zeros(3)}, {"tip": np.ones(3)}),
]


@pytest.mark.parametrize(("value", "other"), VALUES)
def test_fingerprints_tell_values_apart(value: Any, other: Any) -> None:
    """The same value twice has one fingerprint, another has another."""
    assert fingerprint(value, 0.1) == fingerprint(value, 0.1) != fingerprint(other, 0.1)


def test_fingerprint_does_not_depend_on_the_object() -> None:
    """Made twice, in other words, a value is the same; where its numbers come from does not matter."""
    assert fingerprint(tf.Plane([0, 0, 0], np.array([0, 0, 1]))) == fingerprint(tf.Plane((0.0, 0.0, 0.0), (0, 0, 1)))  # type: ignore[arg-type]
    assert fingerprint(replace(tf.Tissue.calka(), source="elsewhere")) == fingerprint(tf.Tissue.calka())
    with pytest.raises(tf.InputError, match="object has no fingerprint; a dataclass, or a property `fingerprint`, is expected"):
        fingerprint(object())


def test_function_of_time_is_not_asked_beyond_the_end() -> None:
    """A function that is right until the end of the run is right."""
    course = FunctionOfTime(lambda t: t / 0.5)
    assert max(course.description(0.4)) == pytest.approx(0.8)
    with pytest.raises(tf.InputError, match="the function returns"):
        course.description(0.6)


def test_model_says_what_differs(block: tf.TongueMesh, workspace: Path) -> None:
    """The parts of a model have fingerprints of their own; that of the mesh is of its files."""
    one = tf.Model(block, fixed=["left"])
    other = replace(one, gravity=(0, 0, -9.81), tissue=replace(one.tissue, density=900.0))
    differs = {name for name, of in one.fingerprint().items() if other.fingerprint()[name] != of}
    assert differs == {"gravity", "tissue"}
    assert len(block.digest) == 64
    if block.comm.size == 1:
        again = workspace / "same.msh"
        again.write_bytes((workspace / "block.msh").read_bytes())
        assert tf.TongueMesh.read(again).digest == block.digest
        again.with_suffix(".fibres.json").write_text("{}")
        assert tf.TongueMesh.read(again).digest != block.digest


MISTAKES: list[tuple[Callable[[tf.TongueMesh], object], str]] = [
    (lambda b: tf.Model(tf.parametric_tongue()), r"model\.tongue: Anatomy is given, a TongueMesh is expected; its \.mesh\(size=…\)"),  # type: ignore[arg-type]
    (lambda b: tf.Model(b, fixed=["left"], contacts={"wall": SQUARE}), r"model\.contacts\.wall: Surface is given, Contact is expected"),  # type: ignore[dict-item]
    (lambda b: tf.Contact(SQUARE), r"contact\.obstacle: Surface is given, Obstacle is expected"),  # type: ignore[arg-type]
    (lambda b: tf.Model(b, fixed=["left"], gravity=(0, 0, -9.81, 0)), r"model\.gravity: .*; three numbers are expected"),
    (lambda b: tf.Model(b, tf.Yeoh(1.0, 1.0), fixed=["left"]), r"model\.tissue: Yeoh is given, Tissue is expected"),  # type: ignore[arg-type]
    (
        lambda b: tf.Model(b, replace(tf.Tissue.calka(), peak_stress={"GPP": 1.0}), fixed=["left"]),
        r"peak_stress\.GPP: no muscle 'GPP' in the mesh",
    ),
]


@pytest.mark.parametrize(("mistake", "sentence"), MISTAKES)
def test_mistakes_are_said_at_the_call(block: tf.TongueMesh, mistake: Callable[[tf.TongueMesh], object], sentence: str) -> None:
    """One sentence that names what is accepted."""
    with pytest.raises(tf.InputError, match=sentence):
        mistake(block)


DEMOS = [
    path
    for path in sorted((Path(__file__).parents[1] / "demos").rglob("*.toml"))
    if path.parent.name not in ("example_subject", "targets") and path.stem != "fit" and "sweep" not in path.name
]


@pytest.mark.parametrize("path", DEMOS, ids=lambda path: path.stem)
def test_saved_scenarios_load_again(path: Path, tmp_path: Path) -> None:
    """What is saved of a demo says the same again, in m, and holds at most one of step and step_max."""
    scenario = load(path)
    (tmp_path / "saved.toml").write_text(dump(scenario), encoding="utf-8")
    again = load(tmp_path / "saved.toml")
    assert again.model_copy(update={"mesh": scenario.mesh}) == scenario
    assert None in (scenario.time.step, scenario.time.step_max)


def test_a_scenario_is_checked_without_the_solver(tmp_path: Path) -> None:
    """A mistyped key is found before anything heavy is imported."""
    path = tmp_path / "typo.toml"
    path.write_text('[mesh]\nparametric = "coarse"\n[time]\nend = 0.1\n[tisue]\nnu = 0.4\n', encoding="utf-8")
    heavy = ["dolfinx", "ufl.core", "gmsh", "pyvista", "matplotlib", "scipy", "h5py", "petsc4py", "mpi4py.MPI"]
    script = (
        "import sys\nfrom tongue_fenicsx.cli.app import main\n"
        f"try:\n    main(['check', {str(path)!r}])\nfinally:\n    print([name for name in {heavy} if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (2, "[]")
    assert "unknown key 'tisue'; did you mean 'tissue'?" in done.stderr
