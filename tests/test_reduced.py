# SPDX-License-Identifier: MIT
"""The reduced tongue: memories by closed forms, what holds for any weights, and one that is made from nothing."""

from __future__ import annotations

import json
import multiprocessing
import queue
import re
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista as pv
from conftest import Browser
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.core.errors import InputError
from tongue_fenicsx.core.types import Floats
from tongue_fenicsx.geometry.surface import Surface
from tongue_fenicsx.geometry.tetrahedron import boundary
from tongue_fenicsx.reduced.basis import coordinates_of, mirror_of, modes_of
from tongue_fenicsx.reduced.network import fade
from tongue_fenicsx.reduced.room import Room
from tongue_fenicsx.reduced.tongue import SHIPPED, ReducedTongue, inputs_of
from tongue_fenicsx.reduced.training import Sequences, initial, train
from tongue_fenicsx.report.live import live_page
from tongue_fenicsx.report.serving import serve
from tongue_fenicsx.scenario.files import load

MUSCLES = ["GGP", "SL"]


def any_tongue(seed: int = 0, doubt: float = 1.0, sides: Sequence[str] = (), odd: int = 0) -> ReducedTongue:
    """A single tetrahedron with weights that nobody trained."""
    random = np.random.default_rng(seed)
    points = np.vstack([np.zeros(3), np.eye(3), np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]) / 2]) * 0.01
    modes = random.standard_normal((4, 10, 3))
    told = {"doubt": doubt, "rest": {}, "sides": sides, "odd": odd}
    return ReducedTongue(points, np.arange(10)[None], modes, initial(len(MUSCLES) + len(sides), 4, seed), MUSCLES, {}, told)


def test_memories_fade_exactly() -> None:
    """One step is as many, and a ramp is followed with a lag of one time constant."""
    whole = fade(0.03, 0.2, 0.1, 0.7, 0.02)
    half = fade(0.03, fade(0.03, 0.2, 0.1, 0.4, 0.01), 0.4, 0.7, 0.01)
    assert whole == pytest.approx(half, rel=1e-12)
    assert fade(0.03, 0.0, 0.0, 5.0, 5.0) == pytest.approx(5.0 - 0.03, rel=1e-9)
    assert fade(0.03, 1.0, 0.0, 0.0, 0.03) == pytest.approx(np.exp(-1), rel=1e-12)


def test_rest_and_hold() -> None:
    """With any weights: rest stays rest, a hold comes to rest wherever it came from, and what was before is forgotten."""
    one, other = any_tongue(), any_tongue()
    for _ in range(20):
        assert not one.step({}, 0.005).any()
    for i in range(40):
        one.step({"GGP": 0.5 + 0.5 * np.sin(i), "SL": 0.3}, 0.005)
    for tongue in (one, other):
        for dt in (0.005, 5.0):
            tongue.step({"GGP": 0.4}, dt)
    np.testing.assert_allclose(one.coordinates, other.coordinates, atol=1e-6)
    held = one.coordinates
    np.testing.assert_allclose(one.step({"GGP": 0.4}, 5.0), held, atol=1e-6)
    assert np.linalg.norm(held) > 0.1
    one.reset()
    assert (one.time, one.doubt, abs(one.coordinates).max()) == (0.0, 0.0, 0.0)


def test_many_at_once() -> None:
    """Runs at once are those one by one; of some nodes the displacement is that of all, out of walls too."""
    tongue = ReducedTongue.shipped()
    time, random = np.array([0.0, 0.02, 0.033, 0.1]), np.random.default_rng(0)
    levels = random.uniform(0, 0.6, (4, 3, len(tongue.muscles))) * np.array([0, 1, 1, 1])[:, None, None]
    together = tongue.sequences(time, tongue.inputs(dict(zip(tongue.muscles, np.moveaxis(levels, -1, 0), strict=True))))
    for run in range(3):
        np.testing.assert_allclose(
            together[:, run], tongue.sequence(time, tongue.inputs(dict(zip(tongue.muscles, levels[:, run].T, strict=True))))[0], atol=1e-12
        )
    nodes = np.array([17, 4000, 3, 250])
    np.testing.assert_allclose(tongue.displacement(together, nodes), tongue.displacement(together)[..., nodes, :], atol=1e-15)


def test_a_long_step_is_many(tmp_path: Path) -> None:
    """And a tongue that was saved is the same within the digits of the file."""
    one, other = any_tongue(), any_tongue()
    one.step({"GGP": 0.6}, 0.02)
    for i in range(1, 5):
        other.step({"GGP": 0.15 * i}, 0.005)
    np.testing.assert_allclose(one.coordinates, other.coordinates, rtol=1e-12)
    one.save(tmp_path / "tongue.npz")
    again = ReducedTongue.load(tmp_path / "tongue.npz")
    again.step({"GGP": 0.6}, 0.02)
    np.testing.assert_allclose(again.displacement(), one.displacement(), atol=1e-3 * abs(one.displacement()).max())
    assert again.doubt == pytest.approx(one.doubt, rel=1e-4)


def test_sides_apart() -> None:
    """With any weights: both sides together leave odd shapes at rest, swapped sides give the mirror image, and of many at once too."""
    one, image, together = (any_tongue(sides=["GGP"], odd=1) for _ in range(3))
    levels = [{"GGP_L": 0.6, "SL": 0.2}, {"GGP_L": 0.3, "GGP_R": 0.8}, {"GGP": 0.5, "GGP_R": 0.1, "SL": 0.7}]
    swapped = {"GGP_L": "GGP_R", "GGP_R": "GGP_L"}
    for at in levels:
        q = one.step(at, 0.02)
        np.testing.assert_allclose(
            image.step({swapped.get(name, name): level for name, level in at.items()}, 0.02), q * [1, 1, 1, -1], atol=1e-12
        )
        assert not together.step({"GGP": at.get("GGP", 0.4), "SL": 0.3}, 0.02)[-1]
    assert abs(q[-1]) > 1e-3
    assert one.doubt == pytest.approx(image.doubt)
    time, runs = np.array([0.0, 0.02, 0.04, 0.06]), {}
    for name in ("GGP_L", "GGP_R", "SL"):
        course = [at.get(name, at.get(name[:-2], 0.0)) for at in levels]
        runs[name] = np.transpose([[0.0, *course], np.full(4, 0.3)])  # and another run at once
    np.testing.assert_allclose(one.sequences(time, one.inputs(runs))[-1, 0], q, atol=1e-12)
    even = one.inputs({"GGP": runs["GGP_L"], "SL": runs["SL"]})
    assert not one.sequences(time, even)[..., -1].any()
    with pytest.raises(InputError, match=r"SL_L: .*it has GGP, SL, and with _L or _R GGP"):
        one.step({"SL_L": 0.5}, 0.01)


def test_weights_for_others() -> None:
    """A tongue with more shapes, in another order, and with sides apart begins by doing what the one did that it begins with."""
    one = any_tongue()
    modes = np.linalg.qr(np.random.default_rng(3).standard_normal((30, 30)))[0][:6] * np.sqrt(10)
    modes[:4] = np.linalg.qr(one.modes.reshape(4, -1).T)[0].T[::-1] * np.sqrt(10)  # the same span
    weights = one.weights_for(["SL", "GGP"], ["SL"], modes.reshape(6, 10, 3))
    other = ReducedTongue(one.points, one.cells, modes.reshape(6, 10, 3), weights, ["SL", "GGP"], {}, one.told | {"sides": ["SL"]})
    own = one.modes.reshape(4, -1)
    for tongue in (one, other):
        tongue.step({"GGP": 0.3, "SL": 0.6}, 0.02)
    expected = one.coordinates @ own @ modes.T / 10  # least squares: rows of modes have a mean square of one, and 4 are orthogonal
    np.testing.assert_allclose(other.coordinates, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("levels", "dt", "message"),
    [({"GGX": 0.5}, 0.01, "GGX: .*it has GGP, SL"), ({"GGP": 1.5}, 0.01, "GGP: 1.5; an activation"), ({}, -1.0, "dt: -1.0; a positive")],
)
def test_bad_steps(levels: dict[str, float], dt: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        any_tongue().step(levels, dt)


def test_room() -> None:
    """What got into a wall comes out at its face, nothing else moves, and with a room a tongue stays out whatever its weights."""
    ball = Surface.from_pyvista(pv.Sphere(radius=0.02, center=(0.0, 0.0, -0.02), theta_resolution=60, phi_resolution=60))
    tongue = any_tongue()
    room = Room.among([ball], tongue.points)
    random, centre = np.random.default_rng(0), np.array([0.0, 0.0, -20.0])
    direction = random.standard_normal((400, 3)) * (0.3, 0.3, 0.1) + (0.0, 0.0, 2.0)
    height = random.uniform(-2.5, 5.0, 400)
    places = (20 + height)[:, None] * direction / np.linalg.norm(direction, axis=1)[:, None] + centre
    cleared = room.clear(places)
    found = np.linalg.norm(cleared - centre, axis=1) - 20
    assert abs(found[height < 0]).max() < 0.1
    assert np.array_equal(cleared[height > 0.1], places[height > 0.1])
    assert np.linalg.norm(cleared - places, axis=1).max() < 2.7  # the shortest way
    near = ReducedTongue(tongue.points, tongue.cells, tongue.modes, tongue.weights, MUSCLES, {}, tongue.told, room)
    q = random.standard_normal((20, 4))
    depth, before = (
        20 - np.linalg.norm(1e3 * (near.points + any_one.displacement(q))[:, near.skin] - centre, axis=2) for any_one in (near, tongue)
    )
    assert depth.max() < 0.3 < 1 < before.max()


def test_modes() -> None:
    """Shapes are independent, have a mean square of one, and give back what they are made of."""
    random = np.random.default_rng(0)
    displacement = np.einsum("ik,knd->ind", random.standard_normal((30, 3)), random.standard_normal((3, 8, 3)))
    modes = modes_of([displacement[:20], displacement[20:]], 3)
    np.testing.assert_allclose(np.einsum("and,bnd->ab", modes, modes) / 8, np.eye(3), atol=1e-9)
    back = 1e-3 * np.einsum("ik,knd->ind", coordinates_of(displacement, modes), modes)
    np.testing.assert_allclose(back, displacement, atol=1e-9)
    with pytest.raises(ValueError, match="no 4 independent"):
        modes_of([displacement], 4)


def test_modes_of_halves() -> None:
    """With a mirror the even shapes are their own image, the odd ones the opposite of it, and both together give back a displacement."""
    random = np.random.default_rng(0)
    points = random.uniform(0.01, 0.02, (6, 3))
    points = np.concatenate([points, points * (1, -1, 1)])
    mirror = mirror_of(points)
    assert mirror is not None
    assert np.array_equal(mirror, [*range(6, 12), *range(6)])
    assert mirror_of(points * (1, 1, 1) + np.eye(12, 3)) is None
    displacement = np.einsum("ik,knd->ind", random.standard_normal((30, 3)), random.standard_normal((3, 12, 3)))
    even, odd = (modes_of([displacement], 3, mirror, sign) for sign in (1, -1))
    for modes, sign in ((even, 1), (odd, -1)):
        np.testing.assert_allclose(modes[:, mirror] * (1, -1, 1), sign * modes, atol=1e-12)
    modes = np.concatenate([even, odd])
    np.testing.assert_allclose(1e-3 * np.einsum("ik,knd->ind", coordinates_of(displacement, modes), modes), displacement, atol=1e-9)


def elsewhere[Result](action: Callable[..., Result], *arguments: object) -> Result:
    """Call something that needs JAX in a process of its own: its threads do not survive that other tests fork this one."""
    if find_spec("optax") is None:
        pytest.skip("the extra rom is not installed")
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(action, *arguments).result(timeout=300)


def trained(runs: Sequences) -> tuple[dict[str, Floats], float]:
    """Weights after 600 iterations, and the last error that was told."""
    said: list[float] = []
    weights = train(runs, iterations=600, seed=0, report=lambda i, error: said.append(error))
    return weights, said[-1]


def test_training_learns_a_lag() -> None:
    """Coordinates that follow the activation with a lag are found from runs of different steps, one shorter than the other."""
    random, n = np.random.default_rng(1), 60
    h = random.uniform(2e-3, 5e-3, (16, n))
    levels = np.concatenate([np.zeros((16, 1, 2)), np.cumsum(random.uniform(-0.1, 0.12, (16, n, 2)), axis=1).clip(0, 1)], axis=1)
    lag = np.zeros((16, n + 1, 2))
    for i in range(n):
        lag[:, i + 1] = fade(0.05, lag[:, i], levels[:, i], levels[:, i + 1], h[:, i, None])
    known = np.ones((16, n + 1), dtype=bool)
    known[0, n // 2 :] = False
    weights, error = elsewhere(trained, Sequences(h, levels, 5 * lag, known))
    assert error < 0.1 * 5 * lag.std()
    tongue = any_tongue()
    tongue = ReducedTongue(tongue.points, tongue.cells, tongue.modes[:2], weights, MUSCLES, {}, tongue.told)
    q, _ = tongue.sequence(np.concatenate([[0.0], np.cumsum(h[1])]), levels[1])
    assert np.sqrt(((q - 5 * lag[1]) ** 2).mean()) < 0.1 * 5 * lag.std()


def test_training_learns_sides() -> None:
    """An odd coordinate that follows the difference of the sides is found, from runs and their mirror images."""
    random, n = np.random.default_rng(1), 40
    h = np.full((16, n), 5e-3)
    left, right = np.cumsum(random.uniform(-0.1, 0.12, (2, 16, n + 1, 1)), axis=2).clip(0, 1)
    left[:, 0] = right[:, 0] = 0.0
    mean, difference = (left + right) / 2, (left - right) / 2
    wanted = np.concatenate([5 * mean, 3 * difference], axis=-1)
    weights, error = elsewhere(trained, Sequences(h, np.concatenate([mean, difference], -1), wanted, np.ones((16, n + 1), bool), 1, 1))
    assert error < 0.1 * wanted.std()
    bare = any_tongue()
    tongue = ReducedTongue(bare.points, bare.cells, bare.modes[:2], weights, ["GGP"], {}, bare.told | {"sides": ["GGP"], "odd": 1})
    time = np.linspace(0, 5e-3 * n, n + 1)
    q, _ = tongue.sequence(time, inputs_of({"GGP_L": left[1, :, 0], "GGP_R": right[1, :, 0]}, ["GGP"], ["GGP"]))
    assert np.sqrt(((q - wanted[1]) ** 2).mean()) < 0.1 * wanted.std()


def test_a_browser_computes_the_same(tmp_path: Path, browser: Browser) -> None:
    """The page, from disk: the surface after some steps is Python's to 1e-4 mm; play moves it, what is exported is a scenario, and nothing
    is logged."""
    tongue = any_tongue(sides=["GGP"], odd=1)
    palate = Surface.from_pyvista(pv.Sphere(radius=0.02, center=(0.0, 0.0, 0.02)))
    told = {
        "doubt": 0.7,
        "rest": {"tip": [0.01, 0, 0]},
        "tissue": {"preset": "buchaillard"},
        "mesh": "coarse",
        "runs": 2,
        "sides": ["GGP"],
        "odd": 1,
    }
    wall = Surface.from_pyvista(pv.Sphere(radius=0.02, center=(0.0, 0.0, -0.019)))
    tongue = ReducedTongue(
        tongue.points, tongue.cells, 3 * tongue.modes, tongue.weights, MUSCLES, {"bone": palate}, told | {"contact": ["palate"]},
        Room.among([wall], tongue.points),
    )  # fmt: skip
    tongue.save(tmp_path / "tongue.npz")
    tongue = ReducedTongue.load(tmp_path / "tongue.npz")
    (tmp_path / "page.html").write_bytes(live_page(tongue))
    window = browser(tmp_path / "page.html")
    steps = [
        ([0.3, 0.0], [0.3, 0.0], 0.005),
        ([0.8, 0.2], [0.8, 0.2], 0.016),
        ([0.8, 0.9], [0.1, 0.9], 0.033),
        ([0.0, 0.9], [0.3, 0.9], 0.2),
    ]
    surface = window.execute_script(
        "live.reset(); for (const step of arguments[0]) live.step(...step); return [live.surface(), live.model.doubt];",
        steps,
    )
    for left, right, dt in steps:
        tongue.step({"GGP_L": left[0], "GGP_R": right[0], "SL": left[1]}, dt)
    nodes, _ = boundary(tongue.cells)
    free = ReducedTongue(tongue.points, tongue.cells, tongue.modes, tongue.weights, MUSCLES, {}, told).displacement(tongue.coordinates)
    assert abs(free - tongue.displacement())[nodes].max() > 1e-4  # the wall has moved something
    np.testing.assert_allclose(surface[0], 1e3 * (tongue.points + tongue.displacement())[nodes].ravel(), atol=1e-4)
    assert surface[1] == pytest.approx(tongue.doubt, rel=1e-5)
    window.find_element("id", "play").click()
    window.execute_async_script("setTimeout(arguments[0], 300)")
    assert window.execute_script("return live.model.time") > 0
    window.find_element("id", "play").click()
    (tmp_path / "live.toml").write_text(window.execute_script("return live.toml()"))
    assert load(tmp_path / "live.toml").activation["GGP"].course()(0.2) == pytest.approx(0.5)
    assert window.execute_script("return live.csv()").splitlines()[5] == "0.2,0.5,0"
    window.find_element("id", "sides").click()
    moved = "const slider = document.querySelectorAll('#muscles input')[1]; slider.value = 0.9; slider.dispatchEvent(new Event('input'));"
    window.execute_script(moved)
    window.execute_async_script("setTimeout(arguments[0], 300)")
    assert window.find_element("id", "muscles").text.split()[::2] == ["GGP_L", "GGP_R", "SL"]
    assert window.execute_script("return Array.from(live.model.inputs)")[2] < 0  # the right side does more
    assert window.execute_script("return live.csv()").splitlines()[0] == "time_s,GGP_L,GGP_R,SL"
    (tmp_path / "sides.toml").write_text(window.execute_script("return live.toml()"))
    assert load(tmp_path / "sides.toml").activation["GGP_R"].course()(0.2) == pytest.approx(0.5)
    assert not [entry for entry in window.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]


def test_served_page() -> None:
    """It is there, its own questions are answered, those of other pages are not; a port that is taken is said."""
    told: queue.Queue[str] = queue.Queue()
    arguments = (b"<p>page</p>", 0, False, told.put, lambda text: {"heard": text})
    threading.Thread(target=serve, args=arguments, daemon=True).start()
    address = told.get(timeout=10)

    def ask(origin: str) -> bytes:
        question = urllib.request.Request(f"{address}check", b"[time]", {"Origin": origin})
        return bytes(urllib.request.urlopen(question, timeout=10).read())

    assert urllib.request.urlopen(address, timeout=10).read() == b"<p>page</p>"
    assert json.loads(ask(address.rstrip("/"))) == {"heard": "[time]"}
    with pytest.raises(urllib.error.HTTPError, match="403"):
        ask("http://elsewhere.example")
    with pytest.raises(InputError, match=r"--port \d+: cannot be had"):
        serve(b"", int(address.rstrip("/").rpartition(":")[2]), False, told.put, lambda text: {})


def test_check_with_the_full_model(tmp_path: Path, browser: Browser) -> None:
    """The button asks with a scenario, and says how far apart the paths are that come back; or what went wrong."""
    bare = any_tongue()
    told = {"doubt": 0.7, "rest": {"tip": [0.01, 0, 0]}, "tissue": {"preset": "buchaillard"}, "mesh": "coarse", "runs": 2, "contact": []}
    tongue = ReducedTongue(bare.points, bare.cells, bare.modes, bare.weights, MUSCLES, {}, told)
    address: queue.Queue[str] = queue.Queue()

    def above(text: str) -> dict[str, Any]:
        """What the reduced tongue does itself, but 1 mm higher; at the second time of asking an error."""
        if (tmp_path / "asked.toml").exists():
            return {"error": "the model diverged"}
        (tmp_path / "asked.toml").write_text(text)
        courses, path = {name: part.course() for name, part in load(tmp_path / "asked.toml").activation.items()}, []
        tongue.reset()
        for t in (0.0, 0.1, 0.15):
            if t:
                tongue.step({name: courses[name](t) for name in courses}, t - tongue.time)
            path.append((1e3 * (tongue.points + tongue.displacement())[1] + [0, 0, 1]).tolist())
        return {"folder": "runs/live-1", "seconds": 12.3, "time": [0.0, 0.1, 0.15], "paths": {"tip": path}}

    threading.Thread(target=serve, args=(live_page(tongue), 0, False, address.put, above), daemon=True).start()
    window = browser(address.get(timeout=10))

    def said() -> str:
        window.find_element("id", "check").click()
        for _ in range(100):
            text = str(window.find_element("id", "checked").text)
            if text and not text.startswith("The full model runs"):
                return text
            window.execute_async_script("setTimeout(arguments[0], 50)")
        raise TimeoutError(text)

    assert said() == "The full model took 12 s (runs/live-1, dotted). Mean distance: tip 1.00 mm."
    window.execute_script("document.getElementById('checked').textContent = ''")
    assert said() == "the model diverged"


SWEEP = """
[base]
mesh = {{ file = "{mesh}" }}
tissue = {{ preset = "buchaillard" }}
time = {{ end = 0.1, step = 0.01 }}
output = {{ every = 0.01 }}
contact = {{ palate = {{}} }}
[random_activations]
n = {n}
seed = {seed}
muscles = ["GGP", "MH"]
sides = "{sides}"
level = [0.0, 0.5]
"""


@pytest.mark.slow
def test_from_nothing(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Sweep, train, test and run: a small one, which begins with another's memories, follows runs of another seed and sides apart, its
    folder is that of a run, and its page is whole."""
    for name, n, seed, sides in (("learn", 9, 1, "together"), ("apart", 5, 2, "apart"), ("judge", 2, 3, "together")):
        (tmp_path / f"{name}.toml").write_text(SWEEP.format(mesh=tongue_file, n=n, seed=seed, sides=sides))
        code, said = command(capsys, "sweep", tmp_path / f"{name}.toml", "-o", tmp_path / name)
        assert code == 0, said
    model, first = tmp_path / "tongue.npz", tmp_path / "first.npz"
    learned, judged_by = tmp_path / "learn", tmp_path / "judge" / "runs" / "00000"
    points, cells = tf.Run(judged_by).mesh
    modes = np.random.default_rng(0).standard_normal((8, len(points), 3))
    ReducedTongue(points, cells, modes, initial(2, 8, 0), MUSCLES, {}, {"rest": {}}).save(first)
    options = ["-o", model, "--modes", "8", "--iterations", "300", "--begin"]
    code, said = command(capsys, "rom", "train", learned, *options, SHIPPED / "buchaillard.npz")
    assert (code, "--begin: is of another mesh" in said) == (2, True), said
    line = [sys.executable, "-m", "tongue_fenicsx", "rom", "train", *map(str, [learned, tmp_path / "apart", *options, first])]
    done = elsewhere(partial(subprocess.run, line, capture_output=True, text=True, timeout=280))
    assert done.returncode == 0, done.stderr
    assert "13 runs, 143 states" in done.stdout
    code, said = command(capsys, "rom", "test", SHIPPED / "buchaillard.npz", tmp_path / "judge")
    assert (code, "has another mesh than the reduced tongue" in said) == (2, True), said
    code, said = command(capsys, "rom", "test", model, tmp_path / "judge")
    assert code == 0, said
    judged, _, activity = said.partition("| muscles |")
    head, *_, last = [list(map(str.strip, line.split("|")[1:-1])) for line in judged.splitlines() if line]
    mean = dict(zip(head, last, strict=True))
    shares = [float(line.split("|")[2]) for line in activity.splitlines()[2:] if line.startswith("|")]
    assert sum(shares) == pytest.approx(100, abs=0.5)
    assert re.search(r"s where the full model took \d+ s: 1 / \d+", activity)
    assert float(mean["mean"]) < 0.4 * float(mean["movement"])
    scenario = judged_by / "scenario.toml"
    code, said = command(capsys, "rom", "run", model, scenario, "-o", tmp_path / "run")
    assert code == 0, said
    reduced, full = tf.Run(tmp_path / "run"), tf.Run(scenario.parent)
    assert np.array_equal(reduced.output_times, full.output_times)
    assert np.linalg.norm(reduced.probes["dorsum"][-1] - full.probes["dorsum"][-1]) < 2e-3
    code, said = command(capsys, "report", tmp_path / "run", scenario.parent, "-o", tmp_path / "report.html")
    assert code == 0, said
    code, said = command(capsys, "rom", "run", model, scenario, "-o", tmp_path / "run")
    assert (code, "--overwrite" in said) == (2, True), said
    (tmp_path / "cut.npz").write_bytes(model.read_bytes()[:1000])
    for bad in (tmp_path / "cut.npz", scenario):
        code, said = command(capsys, "rom", "run", bad, scenario, "-o", tmp_path / "bad")
        assert (code, "it is no archive, or a part of one); a reduced tongue" in said) == (2, True), said
    code, said = command(capsys, "rom", "run", model, scenario, "-o", tmp_path / "bad", "--set", "tissue.preset=kappert")
    assert (code, "tissue.preset: 'kappert'; the reduced tongue learned from runs with 'buchaillard'" in said) == (2, True), said
    code, said = command(capsys, "rom", "run", model, scenario, "-o", tmp_path / "down", "--set", "gravity.posture=upright")
    assert (code, "not followed: gravity" in said) == (0, True), said
    for given, message in (
        (("--tissue", "calka"), "--tissue calka: give one of them"),
        ((), "page.txt: a page named .html or .htm is expected"),
    ):
        code, said = command(capsys, "live", model, *given, "--save", tmp_path / "page.txt")
        assert (code, message in said) == (2, True), said
    code, said = command(capsys, "live", model, "--save", tmp_path / "page.html")
    assert code == 0, said
    assert set(re.findall(r"https?://[\w.]+", (tmp_path / "page.html").read_text())) == {"http://www.w3.org"}  # a name, not an address
    one_sided = tmp_path / "apart" / "runs" / "00000" / "scenario.toml"
    code, said = command(capsys, "rom", "run", model, one_sided, "-o", tmp_path / "sides")
    assert code == 0, said
    (left, right), (full_left, full_right) = (
        [run.probes[f"edge_{side}"][-1] for side in ("left", "right")] for run in (tf.Run(tmp_path / "sides"), tf.Run(one_sided.parent))
    )
    mirrored = np.array([1, -1, 1])
    apart = full_left - mirrored * full_right
    assert np.linalg.norm(left - mirrored * right - apart) < 0.5 * np.linalg.norm(apart)
