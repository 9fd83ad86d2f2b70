# SPDX-License-Identifier: MIT
"""Activations from movement: what made a movement is found again, interrupted or not, and bad input is said."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from test_carry_over import SURFACES, needs_surfaces
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.geometry.surface import Surface
from tongue_fenicsx.reduced.tongue import ReducedTongue
from tongue_fenicsx.scenario.build import activation_of, simulation_of
from tongue_fenicsx.scenario.files import load
from tongue_fenicsx.studies import articulography, beside, fit_file, fit_run, fitting, goals, openness
from tongue_fenicsx.studies.shapes import Shape, spread_in_plane
from tongue_fenicsx.studies.single_muscle import LANDMARKS
from tongue_fenicsx.testing import box
from tongue_fenicsx.verification.gradient import bar_with

FIT = """
muscles = ["GGP", "MH"]
knots = 0.02
effort = 1e-4
haste = 1e-4
noise = 0.1
iterations = {iterations}
[base]
mesh = {{ file = "{mesh}" }}
time = {{ end = 0.04, step = 0.01 }}
output = {{ every = 0.04 }}
[target.dorsum]
table = "dorsum.csv"
[target.root]
table = "root.csv"
unit = "m"
"""


def test_a_twin() -> None:
    """The activations of two muscles of a bar that strikes a floor, from the paths of two of its points."""
    model = bar_with("nitsche").model
    bar = tf.Simulation(model, {"end": (0.02, 0.005, 0.005), "side": (0.01, 0.0, 0.01)}, tf.Stepping(5e-3, output_every=0.05))
    knots = np.array([0.0, 0.025, 0.05])
    truth = {"GGP_L": np.array([0.0, 0.5, 0.3]), "VERT_L": np.array([0.0, 0.2, 0.6])}
    run = bar.run(fitting.courses(knots, truth), 0.05)
    paths = {name: goals.Track(run.time, path, name) for name, path in run.probes.items()}
    told: list[fitting.Fit] = []
    found = fitting.fit(bar, fitting.Search(paths, list(truth), knots, effort=1e-5, haste=1e-5), iterations=12, report=told.append)
    for name, levels in truth.items():
        np.testing.assert_allclose(found.levels[name], levels, atol=0.05)
    assert max(found.distance.values()) < 0.05 < max(told[0].distance.values())
    objectives = [fit.objective for fit in told]
    assert objectives == sorted(objectives, reverse=True)
    assert found.objective == objectives[-1]
    again = bar.run(found.activation, 0.05)
    away = [np.sqrt(np.mean(np.sum((1e3 * (again.probes[n] - run.probes[n])[1:]) ** 2, axis=1))) for n in paths]
    np.testing.assert_allclose(list(found.distance.values()), away, rtol=1e-3)


def test_a_guess_is_a_twin_of_the_reduced_tongue() -> None:
    """What it did itself it finds again, over time and held; a bound that holds already asks for nothing."""
    tongue, knots = ReducedTongue.shipped(), np.array([0.0, 0.1, 0.2])
    truth = {"GGP": [0.0, 0.4, 0.2], "SL": [0.0, 0.1, 0.3], "MH": [0.0, 0.3, 0.3]}
    times = np.linspace(0.0, 0.2, 9)
    rest = dict.fromkeys(tongue.muscles, np.zeros(9))
    inputs = tongue.inputs(rest | {name: np.interp(times, knots, levels) for name, levels in truth.items()})
    nodes = {name: int(np.linalg.norm(tongue.points - place, axis=1).argmin()) for name, place in tongue.told["rest"].items()}
    u = tongue.displacement(tongue.sequence(times, inputs)[0])
    paths = {name: goals.Track(times, u[:, node], name) for name, node in nodes.items()}
    probes = {name: tongue.points[node] for name, node in nodes.items()}
    search = fitting.Search(paths, list(truth), knots, effort=0.0, haste=0.0)
    for name, found in fitting.guess(fitting.Surrogate(tongue, search, probes), tries=2).items():
        np.testing.assert_allclose(found, truth[name], atol=0.02, err_msg=name)
    still = fitting.Search({"tip": goals.Within("tip", np.full(3, -5.0), np.full(3, 5.0))}, list(truth), knots, hold=True, effort=1.0)
    for found in fitting.guess(fitting.Surrogate(tongue, still, probes), tries=1).values():
        np.testing.assert_allclose(found, 0.0, atol=1e-6)
    tense = replace(still, bounds={"GGP": (0.2, 0.4)})  # which the antagonists need not answer within 5 mm
    for name, found in fitting.guess(fitting.Surrogate(tongue, tense, probes), tries=1).items():
        np.testing.assert_allclose(found[1:], 0.2 if name == "GGP" else 0.0, atol=1e-6)
    assert list(tense.begin({"GGP": np.full(3, 0.9)})) == [0.4, 0.1, 0.1]


@pytest.mark.slow
def test_the_reduced_tongue_is_corrected(tongue: tf.TongueMesh) -> None:
    """What a tongue of another mesh and without bones did, which the reduced one does otherwise, is found in some runs; the last knot, of
    which little shows yet, less well."""
    model = tf.Model(tongue, tissue=tf.Tissue.buchaillard())
    full, knots = tf.Simulation(model, stepping=tf.Stepping(0.01, output_every=0.1)), np.array([0.0, 0.05, 0.1])
    truth = {"GGP": np.array([0.0, 0.4, 0.2]), "MH": np.array([0.0, 0.2, 0.5])}
    run = full.run(fitting.courses(knots, truth), 0.1)
    paths = {name: goals.Track(run.time, u, name) for name, u in run.probes.items()}
    search = fitting.Search(paths, list(truth), knots, effort=1e-4, haste=1e-4)
    surrogate = fitting.Surrogate(ReducedTongue.shipped(), search, full.probes.rest)
    told: list[fitting.Fit] = []
    found = fitting.correct(full, surrogate, fitting.guess(surrogate, tries=1), report=told.append)
    assert told[-1].objective == found.objective < 0.1 * told[0].objective
    assert max(found.distance.values()) < 0.1
    for name, levels in truth.items():
        assert (abs(found.levels[name] - levels) < [0.05, 0.05, 0.1]).all(), name
    search = replace(search, each={"nose": goals.Within("nose", np.zeros(3), np.ones(3))})
    with pytest.raises(tf.InputError, match="no probe 'nose'; the simulation follows"):
        fitting.Surrogate(surrogate.tongue, search, surrogate.probes)


@pytest.mark.slow
def test_the_command(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It leaves a scenario, how it went and a run; called again it goes on from the best, which is no worse."""
    tongue = tf.TongueMesh.read(tongue_file)
    truth = {"GGP": tf.Activation([(0.02, 0.0, 0.3), (0.02, 0.3, 0.2)]), "MH": tf.Activation([(0.02, 0.0, 0.1), (0.02, 0.1, 0.4)])}
    run = tf.Simulation(tf.Model(tongue), stepping=tf.Stepping(0.01, output_every=0.04)).run(truth, 0.04)
    for name, unit, head in (("dorsum", 1e3, "t,x,y,z"), ("root", 1.0, "")):
        rows = np.column_stack([run.time, unit * run.probes[name]])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header=head, comments="")
    file, output = tmp_path / "fit.toml", tmp_path / "fit"
    best = []
    for iterations in (3, 12):
        file.write_text(FIT.format(mesh=os.path.relpath(tongue_file, tmp_path), iterations=iterations))
        code, said = command(capsys, "fit", file, "-o", output)
        assert code == 0, said
        with open(output / "fit.csv", newline="") as table:
            best.append(float(list(csv.DictReader(table))[-1]["objective_mm2"]))
    assert best[1] < 0.5 * best[0]
    found = activation_of(load(output / "best.toml"))
    for name, course in truth.items():  # what the last knot does has hardly begun to show
        assert found[name](0.02) == pytest.approx(course(0.02), abs=0.05)
    assert np.linalg.norm(tf.Run(output / "run").probes["dorsum"][-1] - run.probes["dorsum"][-1]) < 1e-4
    with open(output / "open.csv", newline="") as table:
        intervals = {(row["muscle"], float(row["time_s"])): (float(row["low"]), float(row["high"])) for row in csv.DictReader(table)}
    for (name, t), (low, high) in intervals.items():
        assert low <= truth[name](t) <= high, (name, t)
    widths = {key: high - low for key, (low, high) in intervals.items()}
    assert widths["GGP", 0.02] < 0.5 < widths["MH", 0.04]  # in 20 ms a muscle hardly moves anything
    assert "combinations of levels are determined" in said
    assert "open: " in said
    assert (output / "fit.png").stat().st_size > 2e4
    mesh = load(output / "best.toml").mesh.file
    assert mesh is not None
    assert Path(mesh).samefile(tongue_file)  # from where best.toml lies
    before, good = (output / "best.toml").read_bytes(), file.read_text()
    file.write_text(good.replace('unit = "m"', 'unit = "cm"').replace('"GGP", ', ""))
    code, said = command(capsys, "fit", file, "-o", output)
    assert (code, "holds a fit with another muscles, target; --overwrite replaces it" in said) == (2, True), said
    code, said = command(capsys, "fit", file, "-o", output / "run")
    assert (code, "run: holds a run; another folder is expected" in said) == (2, True), said
    assert (output / "best.toml").read_bytes() == before
    fit_run.begin(fit_file.read(file), output, overwrite=True)
    assert not (output / "best.toml").exists()


OPENED = """
muscles = ["GGP", "MH"]
begin = "live"
hold = true
knots = 0.05
rounds = 5
iterations = 0
effort = 1e-4
haste = 0.0
noise = 0.1
[opening]
centre = [75.0, 0.0, 45.0]
rise = 0.05
[base]
mesh = {{ file = "{mesh}" }}
tissue = {{ preset = "buchaillard" }}
time = {{ end = 0.08, step = 0.01 }}
output = {{ every = 0.08 }}
[target.tip]
table = "tip.csv"
[target.dorsum]
table = "dorsum.csv"
[target.root]
table = "root.csv"
"""


@pytest.mark.slow
def test_an_opening_is_found(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """How far the jaw opened, with the levels; the same command goes on from there, and what is kept is a scenario whose jaw opens."""
    tongue = tf.TongueMesh.read(tongue_file)
    jaw = tf.RigidMotion(angle=[(0.05, 0.0, 5.0)], centre=(0.075, 0.0, 0.045), axis=(0.0, -1.0, 0.0))
    resting = tf.Model(tongue, tissue=tf.Tissue.buchaillard())
    model = replace(resting, fixed=[name for name in resting.fixed if name != "mandible"], moving={"mandible": jaw})
    run = tf.Simulation(model, stepping=tf.Stepping(0.01, output_every=0.08)).run(
        {"GGP": tf.ramp(0.04, 0.04, 0.3), "MH": tf.ramp(0.04, 0.04, 0.0)}, 0.08
    )
    for name in ("tip", "dorsum", "root"):
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([run.time, 1e3 * run.probes[name]]), delimiter=",")
    file, output = tmp_path / "fit.toml", tmp_path / "fit"
    file.write_text(OPENED.format(mesh=tongue_file))
    code, said = command(capsys, "fit", file, "-o", output)
    assert code == 0, said
    assert "the jaw opens by 0.0°" in said.splitlines()[0]
    best = load(output / "best.toml")
    assert best.boundary.moving["mandible"].angle[-1][2] == pytest.approx(5.0, abs=0.3)
    assert activation_of(best)["GGP"](0.08) == pytest.approx(0.3, abs=0.03)
    np.testing.assert_allclose(tf.Run(output / "run").probes["tip"][-1], run.probes["tip"][-1], atol=2e-4)
    assert [(output / "nearby" / name).exists() for name in ("base", "opening", "GGP-2")] == [True, True, False]
    with open(output / "open.csv", newline="", encoding="utf-8") as table:
        (row,) = [row for row in csv.DictReader(table) if row["muscle"] == "opening"]
    assert float(row["time_s"]) == 0.05
    assert float(row["low"]) < 5.0 < float(row["high"]) < float(row["low"]) + 1.0
    assert "  opening: " in said
    file.write_text(OPENED.format(mesh=tongue_file).replace("rounds = 5", 'rounds = 3\nslopes = "full"'))
    code, said = command(capsys, "fit", file, "-o", output)
    assert code == 0, said
    assert (output / "nearby" / "GGP-2").exists()
    best = load(output / "best.toml")
    assert best.boundary.moving["mandible"].angle[-1][2] == pytest.approx(5.0, abs=0.02), said
    assert activation_of(best)["GGP"](0.08) == pytest.approx(0.3, abs=0.003)
    good = file.read_text()
    for old, new, message in (
        ('begin = "live"', 'begin = "flat"', 'slopes: "full" goes on from begin = "live"'),
        ("iterations = 0", "iterations = 2", 'opening: an angle is found with begin = "live" and iterations = 0 only'),
        ("[opening]", "[base.boundary.moving.mandible]\nangle = [[0.1, 0.0, 3.0]]\n[opening]", "opening: the mandible moves already"),
    ):
        file.write_text(good.replace(old, new, 1))
        with pytest.raises(tf.InputError, match=message):
            fit_file.read(file)


def circle(n: int = 60) -> goals.Outline:
    """Of 10 mm about the origin."""
    angle = 2 * np.pi * np.arange(n) / n
    return goals.Outline(
        1e-2 * np.column_stack([np.cos(angle), np.zeros(n), np.sin(angle)]), np.column_stack([np.arange(n), np.roll(np.arange(n), -1)])
    )


def test_goals_on_a_circle() -> None:
    """Distances in closed form: from a wall 3 mm above, from a larger circle, from places beside it, of points out of bounds."""
    outline = circle()
    still = {name: np.zeros(3) for name in outline.probes}
    wall = np.column_stack([np.linspace(-5, 5, 21), np.full(21, 13.0)])
    assert goals.Constriction(outline, wall, (1.0, 2.0))(0.0, still)[0] == pytest.approx(1.0, abs=0.05)
    assert goals.Constriction(outline, wall, (2.0, 4.0))(0.0, still)[0] == 0.0
    angle = np.linspace(0, 6, 50)
    around = 12 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert goals.Contour(outline, around)(0.0, still)[0] == pytest.approx(4.0, rel=0.02)
    surface = np.array([[0.0, 0.0, 0.01], [0.0, 0.005, 0.01]])
    nearest = goals.Touch(surface, np.array([[0.0, 0.0, 12.0], [0.0, 5.0, 11.0]]))
    assert nearest(0.0, {name: np.zeros(3) for name in nearest.points})[0] == pytest.approx((4 + 1) / 2)
    square = np.array([[0.0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0], [0, 0.02, 0]])
    above = np.array([[5.0, 4.0, 3.0], [12.0, 15.0, -1.0], [24.0, 10.0, 3.0]])  # the last one beside it, 5 mm from an edge
    cover = goals.Cover(square, np.array([[0, 1, 2], [0, 2, 3]]), above)
    assert cover(0.0, {name: np.zeros(3) for name in cover.points})[0] == pytest.approx((9 + 1 + 25) / 3)
    inside = goals.Within("tip", np.array([-5.0, -np.inf, 0.0]), np.array([-2.0, np.inf, np.inf]))
    assert inside(0.0, {"tip": np.array([1e-3, 9.0, -2e-3])})[0] == pytest.approx(3**2 + 2**2)


def test_free_contours() -> None:
    """An ellipse of which a part was seen with the head turned and shifted is laid on itself; one of another size keeps its distance."""
    ring = circle()
    outline = replace(ring, points=ring.points * [2.0, 1.0, 1.0])
    still = {name: np.zeros(3) for name in outline.probes}
    angle, turn = np.linspace(-0.3, 3.0, 60), np.radians(6.0)
    seen = np.column_stack([20 * np.cos(angle), 10 * np.sin(angle)])
    moved = seen @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + [2.0, -1.5]
    assert goals.Contour(outline, moved)(0.0, still)[0] > 1.0
    free = goals.Contour(outline, moved, free=True)
    assert free(0.0, still)[0] < 0.01
    np.testing.assert_allclose(free.laid(still), seen, atol=0.2)
    larger = goals.Contour(outline, 1.2 * np.column_stack([20 * np.cos(2 * angle), 10 * np.sin(2 * angle)]), free=True)
    value, by = larger(0.0, still)
    assert value == pytest.approx(8.0, abs=1.5)  # from 2 mm at the sides to 4 mm at the ends, where few places are
    way = {name: 1e-3 * np.array([np.cos(300 * x), 0.0, np.sin(500 * x - 200 * z)]) for name, (x, _, z) in outline.probes.items()}
    up, down = (larger(0.0, {name: sign * 1e-3 * along for name, along in way.items()})[0] for sign in (1, -1))
    assert sum(float(by[name] @ way[name]) for name in by) == pytest.approx((up - down) / 2e-3, rel=1e-3)


def test_shapes_are_laid_as_at_rest(tongue: tf.TongueMesh, tmp_path: Path) -> None:
    """A tongue that is larger, turned and looks along other axes: its posture is found in ours, by its rest shape; a longer one after a
    smooth map."""
    skin = Surface(*goals.skin_of(tongue))
    x, y, z = skin.points.T
    posture = np.column_stack([x - 0.1 * z, y, z + 3e-3 * np.cos(60 * x)])  # the root leans forward, the dorsum rises
    turn = Rotation.from_rotvec([0.0, np.radians(5.0), 0.0]).as_matrix()
    theirs = {name: 1.1e3 * points @ turn.T + [20.0, 3.0, 30.0] for name, points in (("rest", skin.points), ("posture", posture))}
    for name, points in theirs.items():
        places = points * [1, -1, 1]  # P, L, S in mm: mirrored
        Surface(places[:, [1, 0, 2]], skin.triangles[:, ::-1]).to_pyvista().save(tmp_path / f"{name}.ply")
    section = """
[surface.vowel]
file = "posture.ply"
rest = "rest.ply"
axes = "LPS"
mid_plane = -3.0
midsagittal = true
places = 200
"""
    text = FIT.format(mesh="none.msh", iterations=1)
    file = tmp_path / "fit.toml"
    file.write_text(text[: text.index("[target")].replace('file = "none.msh"', 'parametric = "coarse"') + section)
    shape = fit_file.read(file).surfaces["vowel"]
    laid, how = shape.on(skin)
    assert "turned by -5.0°, scaled by 0.91; at rest 0.3 mm apart" in how  # as points that are spread over both are
    assert cKDTree(posture).query(laid.points)[0].max() < 3e-4
    rigid, _ = replace(shape, align="rigid").on(skin)
    assert np.ptp(rigid.points, axis=0) == pytest.approx(np.ptp(1.1 * posture, axis=0), rel=0.02)
    assert shape.rest is not None

    def longer(surface: Surface) -> Surface:
        return surface.transform(lambda at: at * [1.15, 1.0, 0.95])

    stretched = Shape(longer(shape.surface), longer(shape.rest), "smooth")
    outline = goals.outline_of(tongue)
    still = {name: np.zeros(3) for name in outline.probes}
    u = [np.array([-0.1 * z, 0.0, 3e-3 * np.cos(60 * x)]) for x, _, z in outline.points]
    goal = goals.Contour(outline, spread_in_plane(stretched.on(skin)[0], 200, "vowel"))
    assert np.sqrt(goal(0.0, still)[0]) > 1.5 > 0.7 > np.sqrt(goal(0.0, dict(zip(outline.probes, u, strict=True)))[0])
    for old, new, message in (
        ("midsagittal = true", "free = true", "surface.vowel: free: it is the mid-sagittal contour"),
        ('"LPS"', '"LPL"', "three letters are expected"),
        ('"posture.ply"', '"none.ply"', "does not exist"),
        ("places = 200", 'align = "free"', "surface.vowel.align: .*one of rigid, scale, smooth"),
    ):
        good = file.read_text()
        file.write_text(good.replace(old, new))
        with pytest.raises(tf.InputError, match=message):
            fit_file.read(file)
        file.write_text(good)
    aside = shape.surface.moved(np.eye(3), np.array([0.0, 0.1, 0.0]))
    with pytest.raises(tf.InputError, match=r"surface.vowel: the mid-sagittal plane y = 0 misses it"):
        spread_in_plane(aside, 200, "vowel")


@needs_surfaces
@pytest.mark.slow
def test_a_vowel_of_a_speaker(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The mid-sagittal contour of an /u/ from MRI is reached, from the same speaker's schwa, to 2 mm, and drawn."""
    speaker = SURFACES / "ultrax" / "Speaker01_Phoneme"
    file, output = tmp_path / "u.toml", tmp_path / "u"
    file.write_text(VOWEL.format(posture=f"{speaker}06.ply", rest=f"{speaker}09.ply"))
    code, said = command(capsys, "fit", file, "-o", output)
    assert code == 0, said
    assert "u: turned by 15.7°, scaled by 1.05; at rest 0.6 mm apart" in said
    assert float(re.findall(r"run 1: u (\S+) mm away", said)[0]) < 2.0
    assert (output / "contours.png").stat().st_size > 10_000


VOWEL = """
muscles = ["GGP", "GGM", "GGA", "SG", "HG", "IL", "SL", "VERT", "TRANS", "GH", "MH"]
begin = "live"
hold = true
knots = 0.1
since = 0.15
effort = 0.5
haste = 0.0
rounds = 1
iterations = 0
[base]
mesh = {{ parametric = "coarse" }}
tissue = {{ preset = "buchaillard" }}
time = {{ end = 0.2, step = 0.01 }}
output = {{ every = 0.1 }}
[surface.u]
file = "{posture}"
rest = "{rest}"
axes = "LPS"
mid_plane = 0.6
align = "smooth"
midsagittal = true
places = 100
"""


def test_goals_have_the_derivatives_of_their_values() -> None:
    """Of a circle that is bent at random, and of a surface."""
    random, outline = np.random.default_rng(3), circle()
    surface = 0.01 * random.standard_normal((30, 3))
    wall = np.column_stack([np.linspace(-8, 8, 40), np.full(40, 14.0)])
    some: dict[str, goals.Goal] = {
        "path": goals.Track(np.array([0.0, 1.0]), random.standard_normal((2, 3)) * 1e-3, "tip"),
        "bounds": goals.Within("tip", np.array([0.1, -1.0, 0.2]), np.array([0.2, 1.0, np.inf])),
        "narrow": goals.Constriction(outline, wall, (1.0, 2.0)),
        "drawn": goals.Contour(outline, 11 * random.standard_normal((25, 2))),
        "cover": goals.Cover(surface, random.integers(0, 30, (60, 3)), 12 * random.standard_normal((20, 3))),
        "touch": goals.Touch(surface, 12 * random.standard_normal((20, 3))),
    }
    names = ["tip", *(name for goal in some.values() for name in goal.points)]
    u = {name: 1e-3 * random.standard_normal(3) for name in names}
    way = {name: random.standard_normal(3) for name in names}
    for label, goal in some.items():
        value, by = goal(0.3, u)
        assert value > 0, label
        up, down = (goal(0.3, {name: u[name] + sign * 1e-8 * way[name] for name in names})[0] for sign in (1, -1))
        assert sum(float(by[name] @ way[name]) for name in by) == pytest.approx((up - down) / 2e-8, rel=1e-5), label
    together = goals.Goals(some, since=0.2, end=0.4)
    assert together(0.2, 0.1, u) == (0.0, {})
    added = together(0.25, 0.1, u)[0]  # of the step only what is after 0.2 s counts: a quarter of the time
    assert added == pytest.approx(0.25 * np.mean([goal(0.25, u)[0] for goal in some.values()]))
    more = goals.Goals({name: some[name] for name in ("path", "bounds")}, 0.0, 1.0, {"path": 3.0})
    value, by = more(1.0, 1.0, u)
    (path, by_path), (bounds, by_bounds) = (some[name](1.0, u) for name in ("path", "bounds"))
    assert value == pytest.approx(0.75 * path + 0.25 * bounds)
    np.testing.assert_allclose(by["tip"], 0.75 * by_path["tip"] + 0.25 * by_bounds["tip"])
    assert more.distance == pytest.approx({"path": np.sqrt(path), "bounds": np.sqrt(bounds)})


def test_goals_of_different_points_keep_their_own(tongue: tf.TongueMesh) -> None:
    """Two palatal targets with points of their own, followed by one simulation, have the values that each has alone."""
    skin, _ = goals.skin_of(tongue)
    front, back = skin[:40], skin[40:90]
    each = {name: goals.Touch(points, 1e3 * points[::5] + 2.0) for name, points in (("front", front), ("back", back))}
    simulation = fitting.following(tf.Simulation(tf.Model(tongue)), each)
    u = {name: 0.1 * point for name, point in simulation.probes.rest.items()}
    for goal in each.values():
        alone = {name: 0.1 * point for name, point in goal.points.items()}
        assert goal(0.0, u)[0] == pytest.approx(goal(0.0, alone)[0])


def test_the_outline_of_a_tongue(tongue: tf.TongueMesh) -> None:
    """It is closed: every point of it ends two pieces; its points and the surface's are nodes of the quadratic tongue."""
    (surface, triangles), outline = goals.skin_of(tongue), goals.outline_of(tongue)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
    assert set(np.bincount(outline.pieces.ravel())) == {2}
    assert abs(outline.points[:, 1]).max() < 1e-9
    assert np.linalg.norm(outline.points - tongue.landmarks["tip"], axis=1).min() < 3e-3
    assert {tuple(point) for point in outline.points.round(9)} <= {tuple(point) for point in surface}
    aside = box((0.02, 0.01, 0.01), (2, 1, 1))
    aside.mesh.geometry.x[:, 1] += 1e-3
    with pytest.raises(tf.InputError, match="no faces on the mid-plane"):
        goals.outline_of(aside)


def test_what_is_open() -> None:
    """Two muscles that do the same: their sum is known as well as the noise says, their difference not at all."""
    time, slope = np.array([0.0, 0.1]), np.array([4e-3, 0.0, 3e-3])  # m per level, so 5 mm
    found = fitting.Fit(time, {"GGP": np.array([0.0, 0.4]), "GGM": np.array([0.0, 0.6])}, {"tip": 0.0}, 0.0, 1)

    def run(fit: fitting.Fit) -> SimpleNamespace:
        return SimpleNamespace(time=time, probes={"tip": np.outer([0.0, sum(at[-1] for at in fit.levels.values())], slope)})

    def slopes_of(fit: fitting.Fit, search: fitting.Search) -> np.ndarray:
        runs = {beside.BASE: run(fit)} | {name: run(moved) for name, (moved, _) in beside.nearby(fit, search).items()}
        by = beside.Beside(fit, search, runs).slopes(lambda one: openness.measured(paths, one))  # type: ignore[arg-type]
        assert list(by) == search.names
        return np.array(list(by.values()))

    paths = {"tip": goals.Track(time, np.outer([0.0, 1.0], slope), "tip")}
    search = fitting.Search(paths, list(found.levels), time)
    assert search.names == ["GGP-1", "GGM-1"]
    known = openness.openness(found, paths, 0.1, slopes_of(found, search))
    (wide, difference), (narrow, both) = known.combinations
    assert wide == pytest.approx(np.sqrt(openness.BEFORE))
    assert narrow == pytest.approx(0.1 / (5 * np.sqrt(2)), rel=1e-2)  # noise over the change along (1, 1)/√2
    assert difference["GGP"] == pytest.approx(-difference["GGM"])
    assert both["GGP"] == pytest.approx(both["GGM"])
    assert known.determined == 1
    assert known.open_ones()[0].endswith("(± 0.58)")
    assert {"GGP at 100 ms", "GGM at 100 ms"} <= {word.strip("+− ") for word in re.split(r"(?<=ms) ", known.open_ones()[0])}
    held = replace(
        found, knots=np.array([0.0, 0.05, 0.1]), levels={n: np.insert(at, 1, at[1]) for n, at in found.levels.items()}, hold=True
    )
    holding = replace(search, knots=held.knots, hold=True)
    at_once = beside.nearby(held, holding)
    assert {name: tuple(fit.levels["GGP"]) for name, (fit, _) in at_once.items()} == {"GGP-2": (0.0, 0.45, 0.45), "GGM-2": (0.0, 0.4, 0.4)}
    slopes = slopes_of(held, holding)
    of_postures = openness.openness(held, paths, 0.1, slopes)
    assert [deviation for deviation, _ in of_postures.combinations] == pytest.approx([wide, narrow])
    assert [len(levels) for levels in of_postures.levels.values()] == [1, 1]
    far = fitting.Fit(time, found.levels, {"tip": 3.0}, 9.0, 1)  # a target that is not reached says less
    assert openness.openness(far, paths, 0.1, slopes).noise == pytest.approx(np.sqrt(3))


@pytest.mark.slow
def test_interrupted(tongue_file: Path, tmp_path: Path) -> None:
    """Ctrl-C leaves the best so far, and says so."""
    for name in ("dorsum", "root"):
        (tmp_path / f"{name}.csv").write_text("0,0,0,0\n0.04,1e-3,0,0\n")
    (tmp_path / "fit.toml").write_text(FIT.format(mesh=tongue_file, iterations=1000))
    line = [sys.executable, "-m", "tongue_fenicsx", "fit", str(tmp_path / "fit.toml"), "-o", str(tmp_path / "fit")]
    process = subprocess.Popen(line, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    while not (tmp_path / "fit" / "best.toml").exists() and process.poll() is None:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, "best.toml" in said.replace("\n", "")) == (130, True), said
    assert set(load(tmp_path / "fit" / "best.toml").activation) == {"GGP", "MH"}


def test_the_demo() -> None:
    """It can be read, and its path is that of the tip."""
    task = fit_file.read(Path(__file__).parents[1] / "demos" / "fit.toml")
    assert list(task.paths) == ["tip"]
    np.testing.assert_allclose(task.knots, [0, 0.05, 0.1, 0.15, 0.2])
    np.testing.assert_allclose(task.paths["tip"].at(0.2), [2e-3, 0, 5e-3])


@pytest.mark.parametrize("posture", ["a", "i", "k", "t", "u"])
def test_targets_of_postures(posture: str, tongue: tf.TongueMesh) -> None:
    """They can be read, and their places are there on the walls of the built-in tongue."""
    task = fit_file.read(Path(__file__).parents[1] / "demos" / "targets" / f"{posture}.toml")
    walls = {name: tf.Contact(tf.Triangulated(tongue.bones[name])) for name in ("palate", "velum", "pharynx")}
    found = fit_run.goals_of(task, tf.Simulation(tf.Model(tongue, contacts=walls), stepping=tf.Stepping(0.01)), print)
    assert list(found) == [*task.file.point, *task.file.constriction, *task.file.touch]
    np.testing.assert_allclose(task.knots, [0, 0.1, 0.35])
    at_rest = {name: np.zeros(3) for goal in found.values() for name in [*goal.points, *LANDMARKS]}
    assert goals.Goals(found, 0.25, 0.35)(0.35, 0.1, at_rest)[0] > 0.5  # a tongue at rest says nothing


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"GGP", "MH"', '"GGX"', "no muscle 'GGX'"),
        ("target.root", "target.nose", "no probe 'nose'"),
        ("knots = 0.02", "knots = 0", "knots: 0"),
        ("root.csv", "none.csv", "does not exist"),
        ("dorsum.csv", "fit.toml", "four columns"),
        ("dorsum.csv", "empty.csv", "target.dorsum: "),
        ("dorsum.csv", "empty.csv", "it has no line of numbers"),
        ("dorsum.csv", "lost.csv", "line 2 of its numbers is not finite"),
        ("dorsum.csv", "milliseconds.csv", "target.dorsum: times from 0 to 80 s; some after 0 and up to time.end, 0.04 s, are expected"),
        ('unit = "m"', 'unit = "m"\nweight = 2\n[target.tip]\ntable = "dorsum.csv"\nunit = "m"', "target.tip: it moves by up to 1000 mm"),
        (
            "[target.root]",
            '[contour.drawn]\ntable = "drawn.csv"\nunit = "m"\n[target.root]',
            "contour.drawn: it lies up to 40000 mm from the origin",
        ),
        (
            "[target.root]",
            '[contour.drawn]\ntable = "drawn.csv"\nfree = true\n[target.root]',
            "contour.drawn: 2 places that are free; at least 3",
        ),
        ('"GGP", "MH"', '"GGP", "GGP"', "muscles: 'GGP' is named twice"),
        ('["GGP", "MH"]', '"GGP"', "muscles: a list is expected (given: 'GGP')"),
        ("[target.root]", "[point.tip]\nx = 5\n[target.root]", "point.tip.x: a list is expected (given: 5)"),
        ('unit = "m"', 'unit = "inch"', "one of m, cm, mm"),
        ('"GGP", "MH"', "", "muscles: at least one"),
        ("knots = 0.02", "knots = 0.02\nbounds = { SL = [0.1, 0.2] }", "bounds.SL: [0.1, 0.2]; one of muscles, GGP, MH, is expected"),
        ("knots = 0.02", "knots = 0.02\nbounds = { MH = [0.3, 0.2] }", "bounds.MH: [0.3, 0.2]; the least level first is expected"),
        ("knots = 0.02", "knots = 0.02\nbounds = { MH = [0.3, 1.2] }", "bounds.MH"),
        ("[target.root]", "[point.tip]\nx = [3.0, 1.0]\n[target.root]", "point.tip.x: [3, 1]; the least value first is expected"),
        ("step = 0.01", "step = -1", "base: time.step"),
    ],
)
def test_bad_fits(old: str, new: str, message: str, tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One sentence, before anything is computed."""
    (tmp_path / "dorsum.csv").write_text("t;x;y;z\n0;0;0;0\n0,04;1,0;0;0\n")
    (tmp_path / "root.csv").write_text("0,0,0,0\n0.04,1e-3,0,0\n")
    (tmp_path / "milliseconds.csv").write_text("0,0,0,0\n40,1,0,0\n80,1,0,0\n")
    (tmp_path / "lost.csv").write_text("0,0,0,0\n0.02,nan,0,0\n")
    (tmp_path / "drawn.csv").write_text("x,z\n10,40\n12,38\n")
    (tmp_path / "empty.csv").touch()
    (tmp_path / "fit.toml").write_text(FIT.format(mesh=tongue_file, iterations=1).replace(old, new))
    code, said = command(capsys, "fit", tmp_path / "fit.toml", "-o", tmp_path / "fit")
    assert (code, message in said) == (2, True), said
    assert not (tmp_path / "fit" / "run").exists()


def test_other_files_than_fits(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A scenario is no fit, a fit no scenario; processes are counted before anything runs."""
    scenario, fit = tmp_path / "scenario.toml", tmp_path / "fit.toml"
    scenario.write_text(f'[mesh]\nfile = "{tongue_file}"\n[time]\nend = 0.1\n')
    fit.write_text(FIT.format(mesh=tongue_file, iterations=1))
    for name in ("dorsum", "root"):
        (tmp_path / f"{name}.csv").write_text("0,0,0,0\n0.04,1e-3,0,0\n")
    for words, message in (
        (("fit", scenario, "-o", tmp_path / "out"), "it is a scenario; a fit, which has one as its base, is expected"),
        (("check", fit), "base: it is a key of a file for tongue sweep or tongue fit; a scenario is expected"),
        (("fit", fit, "-o", tmp_path / "out", "--jobs", "0"), "--jobs 0: a positive number is expected"),
    ):
        code, said = command(capsys, *words)
        assert (code, message in said) == (2, True), said
    assert not (tmp_path / "out").exists()


RECORDING = """
[recording]
table = "ema.csv"
time = "t_s"
axes = "ALS"
rest = 0.3
begin = 0.1
lead = 0.02
align = "scale"
[recording.sensor.TT]
columns = ["TT_x", "TT_y", "TT_z"]
behind_tip = 10
[recording.sensor.TR]
columns = ["TR_x", "TR_y", "TR_z"]
at = "root"
[recording.jaw]
columns = ["J_x", "J_y", "J_z"]
centre = [75.0, 0.0, 45.0]
"""


def test_sensors_of_a_speaker(tongue: tf.TongueMesh, tongue_file: Path, tmp_path: Path) -> None:
    """Their tables, in mm of a frame that is turned, larger and looks the other way, become paths and a jaw's motion in ours."""
    glued = {"TT": articulography.behind_tip(tongue, 10e-3), "TR": tongue.landmarks["root"]}
    turn = Rotation.from_rotvec([0.0, np.radians(8.0), 0.0]).as_matrix()
    times, centre, tooth = np.linspace(0.0, 0.3, 31), np.array([0.075, 0.0, 0.045]), np.array([-0.02, 0.0, 0.02])
    away = np.column_stack([2e-3 * np.sin(20 * times), 1e-3 * times, 3e-3 * np.cos(15 * times)])
    away -= away[-1]
    open_by = np.interp(times, [0.0, 0.1, 0.2, 0.3], [4.0, 4.0, 9.0, 0.0])
    jaw = np.array([centre + Rotation.from_rotvec([0.0, -np.radians(angle), 0.0]).apply(tooth - centre) for angle in open_by])
    columns = {"t_s": times}
    for name, places in {"TT": glued["TT"] + away, "TR": glued["TR"] - 0.5 * away, "J": jaw}.items():
        theirs = 1.2e3 * places @ turn + [30.0, 0.0, -5.0]  # in mm
        columns |= {f"{name}_x": -theirs[:, 0], f"{name}_y": -theirs[:, 1], f"{name}_z": theirs[:, 2]}
    np.savetxt(tmp_path / "ema.csv", np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    (tmp_path / "ema.csv").write_text("# somebody\n" + (tmp_path / "ema.csv").read_text())
    file = tmp_path / "fit.toml"
    text = FIT.format(mesh=tongue_file, iterations=1)
    file.write_text(text[: text.index("[target")] + RECORDING)
    said: list[str] = []
    task = fit_run.glue(fit_file.read(file), said.append)
    assert "turned by 8.0°, scaled by 0.83; at rest the sensors lie 0.0 mm" in said[0]
    assert task.scenario.probes is not None
    np.testing.assert_allclose(np.array(task.scenario.probes["TT"], dtype=float), glued["TT"])
    assert {"tip", "TR"} <= task.scenario.probes.keys()
    for name, share in (("TT", 1.0), ("TR", -0.5)):
        path = task.paths[name]
        np.testing.assert_allclose(path.times, times[10:] - 0.1 + 0.02, atol=1e-12)
        np.testing.assert_allclose(path.displacement, share * away[10:] * [1, 0, 1], atol=1e-8)
    moving = simulation_of(task.scenario, tmp_path).model.moving["mandible"]
    assert task.file.since == 0.02
    for t, angle in ((0.02, 4.0), (0.12, 9.0), (0.22, 0.0)):
        np.testing.assert_allclose(moving.displacement(tooth[None], t)[0], jaw[np.isclose(open_by, angle)][-1] - tooth, atol=1e-6)
    good = file.read_text()
    lines = (tmp_path / "ema.csv").read_text()
    (tmp_path / "comma.csv").write_text(lines.replace(",", ";").replace(".", ","))
    (tmp_path / "slow.csv").write_text("".join(line for i, line in enumerate(lines.splitlines(keepends=True)) if i in (0, 1, 2, 17, 32)))
    file.write_text(good.replace("ema.csv", "comma.csv"))
    np.testing.assert_allclose(fit_run.glue(fit_file.read(file), said.append).paths["TT"].displacement, task.paths["TT"].displacement)
    for old, new in (('align = "scale"', 'align = "rigid"\nunit = "cm"'), ('"ALS"', '"PLS"')):
        file.write_text(good.replace(old, new))
        with pytest.raises(tf.InputError, match=r"recording: turned by .*; its unit, its axes, when it is at rest"):
            fit_run.glue(fit_file.read(file), said.append)
    for old, new, message in (
        ("TT_z", "gone", "no column 'gone'; it has t_s"),
        ('"ALS"', '"AAS"', "three letters are expected"),
        ("behind_tip = 10", "", "behind_tip"),
        ("behind_tip = 10", "behind_tip = 10\nweight = 0", "recording.sensor.TT.weight: 0"),
        ('"ema.csv"', '"slow.csv"', "recording: no two times from 0.1 to 0.12 s"),
        ("rest = 0.3", "rest = 9.0", "recording.rest: 9 s; a time from 0 to 0.3 s is expected"),
        ("lead = 0.02", "lead = 0.5", "recording.lead: 0.5 s; less than time.end, 0.04 s, is expected"),
        ("[recording]", "[base.boundary.moving.mandible]\nangle = [[0.1, 0.0, 3.0]]\n[recording]", "moves already"),
    ):
        file.write_text(good.replace(old, new, 1))
        with pytest.raises(tf.InputError, match=message):
            fit_file.read(file)


def test_lengths_behind_the_tip(tongue: tf.TongueMesh) -> None:
    """They are measured over the dorsum, backward from the tip."""
    points = np.array([articulography.behind_tip(tongue, length) for length in np.linspace(0, 0.06, 61)])
    assert np.linalg.norm(points[0] - tongue.landmarks["tip"]) < 3e-3
    assert abs(points[:, 1]).max() < 1e-9
    np.testing.assert_allclose(np.linalg.norm(np.diff(points, axis=0), axis=1), 1e-3, rtol=0.1)
    assert np.linalg.norm(points - tongue.landmarks["dorsum"], axis=1).min() < 2e-3
    with pytest.raises(tf.InputError, match="900 mm behind the tip; from 0 to"):
        articulography.behind_tip(tongue, 0.9)
