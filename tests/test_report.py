# SPDX-License-Identifier: MIT
"""The page of runs: what stands in it, that it needs nothing from outside, and that a browser moves the tongue."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import Browser
from PIL import Image
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx import report
from tongue_fenicsx.cli.app import main
from tongue_fenicsx.geometry.surface import Surface
from tongue_fenicsx.report import motion as packing
from tongue_fenicsx.report import write_report
from tongue_fenicsx.report.page import Detail

SCENARIO = """
[mesh]
file = "tongue.msh"
[time]
end = 0.02
[output]
every = 0.005
[activation.GGP]
pieces = [[0.02, 0.0, 1.0]]
[contact.palate]
"""
ARXIV = "https://arxiv.org/abs/2407.13259"


class Page(HTMLParser):
    """What a page loads, links, shows and says."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.pictures: list[dict[str, str]] = []
        self.labels: list[str] = []
        self.words = ""
        self.scripts = 0
        self._raw = ""
        self._hidden = False
        self.text = path.read_text(encoding="utf-8")
        self.feed(self.text)
        self.data: dict[str, Any] = json.loads(self._raw)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        of = {name: value or "" for name, value in attrs}
        self.loads += [of[name] for name in ("src", "srcset", "data", "poster", "xlink:href") if name in of]
        if "href" in of:
            (self.links if tag == "a" else self.loads).append(of["href"])
        if tag == "img":
            self.pictures.append(of)
        self.labels += [of["aria-label"]] if tag == "svg" else []
        self._hidden, self._json = tag in ("script", "style"), of.get("type") == "application/json"
        self.scripts += tag == "script"

    def handle_endtag(self, tag: str) -> None:
        self._hidden = False

    def handle_data(self, data: str) -> None:
        if not self._hidden:
            self.words += data
        elif self._json:
            self._raw += data


@pytest.fixture(scope="module")
def done(tongue_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder written by the command: GGP for 20 ms under the palate."""
    scenario = tongue_file.parent / "report.toml"
    scenario.write_text(SCENARIO)
    folder = tmp_path_factory.mktemp("runs") / "done"
    with pytest.raises(SystemExit) as leaving:
        main(["run", str(scenario), "-o", str(folder)])
    assert leaving.value.code == 0
    return folder


def copied(folder: Path, to: Path) -> Path:
    shutil.copytree(folder, to)
    return to


def chosen_from(page: Page) -> list[str]:
    """The runs of the selector."""
    (selector,) = re.findall(r'<select id="selector".*?</select>', page.text)
    return re.findall(r"<option[^>]*>(.*?)</option>", selector)


def contents(folder: Path) -> dict[Path, tuple[bytes, int]]:
    return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.rglob("*") if path.is_file()}


def test_everything_is_there_and_nothing_comes_from_outside(done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Numbers, pictures, charts, scenario and citation; only data: is loaded; the run folder stays as it is."""
    before = contents(done)
    path = tmp_path / "new" / "page.html"
    code, said = command(capsys, "report", done, "-o", path)
    assert code == 0
    assert f"wrote {path}" in said
    assert contents(done) == before
    assert path.stat().st_size < report.LIMIT
    page, run = Page(path), tf.Run(done)
    assert page.links == [ARXIV]
    assert page.loads
    assert all(source.startswith("data:") for source in page.loads)
    assert not re.search(r"url\(|@import|fetch\(|XMLHttpRequest|\bimport\b", page.text)
    drawn = {base64.b64encode(picture.read_bytes()).decode() for picture in (done / "figures").glob("*.png")}
    assert len(drawn) == 6
    assert {of["src"].removeprefix("data:image/png;base64,") for of in page.pictures} == drawn
    assert all(len(of["alt"]) > 20 for of in page.pictures)
    charts = ["Paths", "Activation", "Displacement", "Von Mises", "Volume", "Energies", "Force of contact", "Area of contact"]
    assert [label[:5] for label in page.labels] == [name[:5] for name in charts]
    assert all(name in page.labels[0] for name in ("tip", "dorsum", "root", "edge left"))
    assert (done / "scenario.toml").read_text() in page.words
    s = run.summary
    words = ["done", "yeoh", "C₁₀", f"{s['n_steps']}", f"{s['krylov_iterations']}", "rejected", "fallbacks", "energy balance error"]
    for word in [*words, "peak stress", s["versions"]["petsc"], s["versions"]["tongue_fenicsx"], "5 moments"]:
        assert word in page.words
    citation = Path(__file__).parents[1].joinpath("CITATION.cff").read_text()
    for name in [*re.findall(r"(?:family|given)-names: (.*)", citation), *re.findall(r"title: (.*)", citation), "2024", "2407.13259"]:
        assert name in page.words


def test_the_motion_in_the_page_is_that_of_the_run(done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A closed surface, its normals outward, that moves as the run to a 30 000th; a fine one by the corners of the tetrahedra only."""
    run = tf.Run(done)
    points, cells = run.mesh
    a, b, c, d = (points[cells[:, i]] for i in range(4))
    volume = np.einsum("ij,ij->", np.cross(b - a, c - a), d - a) / 6
    sizes = []
    for fine, known in ((packing.FINE, points), (0, points[np.unique(cells[:, :4])])):
        monkeypatch.setattr(packing, "FINE", fine)
        page = Page(write_report([done], tmp_path / "page.html"))
        shown = page.data["runs"][0]
        rest = np.frombuffer(base64.b64decode(page.data["shared"][shown["rest"]]), "<f4").reshape(-1, 3) / 1e3
        triangles = np.frombuffer(base64.b64decode(page.data["shared"][shown["triangles"]]), "<u4").reshape(-1, 3).astype(int)
        moved = np.frombuffer(base64.b64decode(shown["displacement"]), "<i2").reshape(5, -1, 3) * shown["unit"] / 1e3
        surface = Surface(rest.astype(float), triangles)
        assert (surface.edge_sharing() == 2).all()
        assert surface.volume == pytest.approx(volume, rel=1e-5)
        nearest = np.array([np.linalg.norm(known - point, axis=1).argmin() for point in rest])
        np.testing.assert_allclose(known[nearest], rest, atol=1e-8)
        everywhere = run.field("displacement") if fine else run.field("displacement")[np.unique(cells[:, :4])]
        largest = np.linalg.norm(everywhere[nearest], axis=1).max()
        np.testing.assert_allclose(moved[-1], everywhere[nearest], atol=largest / 3e4)
        assert shown["largest"] == pytest.approx(1e3 * largest, rel=1e-6)
        assert shown["start"] == 4
        volumes = shown["fields"]["jacobian"]
        there = volumes["low"] + (volumes["high"] - volumes["low"]) / 255 * np.frombuffer(base64.b64decode(volumes["values"]), "<u1")
        every = points if fine else known
        for i in range(0, len(rest), 50):
            node = int(np.linalg.norm(points - every[nearest[i]], axis=1).argmin())
            around = run.field("jacobian")[(cells == node).any(axis=1)].mean()
            assert there.reshape(5, -1)[-1, i] == pytest.approx(around, abs=(volumes["high"] - volumes["low"]) / 500)
        np.testing.assert_allclose(shown["times"], run.output_times)
        sizes.append(len(rest))
    assert sizes[1] < sizes[0] / 3


def test_obstacles_stand_where_they_are_in_the_run(done: Path, tmp_path: Path) -> None:
    """An obstacle that turns and shifts does so in the page."""
    folder = copied(done, tmp_path / "turned")
    with h5py.File(folder / "history.h5", "r+") as file:
        n = len(file["time"])
        angle = np.linspace(0, 0.3, n)
        zero, one = np.zeros(n), np.ones(n)
        rows = [np.cos(angle), zero, np.sin(angle), zero, one, zero, -np.sin(angle), zero, np.cos(angle)]
        file["contact/palate/rotation"][:] = np.column_stack(rows)
        file["contact/palate/offset"][:] = np.column_stack([zero, zero, 0.01 * angle])
    run = tf.Run(folder)
    data = Page(write_report([folder], tmp_path / "page.html")).data
    (shown,) = data["runs"][0]["obstacles"]
    assert shown["name"] == "palate"
    points = np.frombuffer(base64.b64decode(data["shared"][shown["points"]]), "<f4").reshape(-1, 3)
    assert len(shown["poses"]) == 5
    for index, pose in enumerate(shown["poses"]):
        placed = points @ np.reshape(pose[:9], (3, 3)).T + pose[9:]
        np.testing.assert_allclose(placed, 1e3 * run.obstacles(index)["palate"].points, atol=1e-3)
    assert shown["poses"][0] != shown["poses"][-1]


def test_several_runs(done: Path, tmp_path: Path) -> None:
    """A selector, every run, and the paths of all of them in one chart a probe; names that repeat become paths."""
    other = copied(done, tmp_path / "other")
    page = Page(write_report([done, other], tmp_path / "page.html"))
    assert chosen_from(page) == ["done", "other"]
    assert len(page.data["runs"]) == 2
    assert page.text.count("<article") == 2
    together = [label for label in page.labels if label.endswith("done, other.")]
    assert [label.split(":")[0] for label in together] == ["dorsum", "edge left", "edge right", "root", "tip"]
    same = copied(done, tmp_path / "elsewhere" / "done")
    page = Page(write_report([done, same, same], tmp_path / "page.html"))
    names = chosen_from(page)
    assert [name.split(": ")[1] for name in names] == [str(done), str(same), str(same)]
    assert len(set(names)) == 3


def test_many_runs(done: Path, tmp_path: Path) -> None:
    """In natural order, with what differs between their scenarios; mesh and bones of all stand once in the page."""
    folders = [copied(done, tmp_path / f"run{number}") for number in (10, 2, 1)]
    for folder, c10 in zip(folders, (300.0, 200.0, 100.0), strict=True):
        scenario = (folder / "scenario.toml").read_text()
        (folder / "scenario.toml").write_text(scenario.replace("[tissue]\n", f"[tissue]\nc10 = {c10}\n"))
    page = Page(write_report(folders, tmp_path / "page.html"))
    assert chosen_from(page) == ["run1", "run2", "run10"]
    assert re.findall(r"<code>(.*?)</code>", page.text) == ["tissue.c10"]
    assert re.findall(r'<td class="setting">(.*?)</td>', page.text) == ["100.0", "200.0", "300.0"]
    one = Page(write_report(folders[:1], tmp_path / "one.html"))
    assert "what differs" not in one.words
    assert page.data["shared"] == one.data["shared"]
    for run in page.data["runs"]:
        assert (run["rest"], run["triangles"]) == (one.data["runs"][0]["rest"], one.data["runs"][0]["triangles"])


def test_a_large_page_shrinks_and_says_so(done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer moments and smaller pictures, until the page fits; if it never does, one sentence."""
    whole = write_report([done], tmp_path / "page.html").stat().st_size
    assert "To keep the page small" not in Page(tmp_path / "page.html").words
    monkeypatch.setattr(report, "LEVELS", (*report.LEVELS[:1], Detail(3, 400)))
    monkeypatch.setattr(report, "LIMIT", whole - 1)
    page = Page(write_report([done], tmp_path / "page.html"))
    assert len(page.text.encode()) < whole
    assert "at most 3 moments of a run, and pictures of at most 400 pixels" in page.words
    assert "3 of 5 moments" in page.words
    np.testing.assert_allclose(page.data["runs"][0]["times"], [0.0, 0.01, 0.02])
    for of in page.pictures:
        picture = Image.open(io.BytesIO(base64.b64decode(of["src"].split(",")[1])))
        assert picture.width == int(of["width"]) == 400
    monkeypatch.setattr(report, "LIMIT", 1000)
    with pytest.raises(tf.InputError, match="the most of one page; give fewer"):
        write_report([done], tmp_path / "page.html")


def test_bad_input(done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One sentence and exit code 2: no run, a damaged one, a page that cannot be written, a name that is no page."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("")
    damaged = copied(done, tmp_path / "damaged")
    (damaged / "fields.h5").write_bytes((done / "fields.h5").read_bytes()[:5000])
    half = copied(done, tmp_path / "half")
    (half / "summary.json").write_text('{"status": "do')
    endless = copied(done, tmp_path / "endless")
    with h5py.File(endless / "fields.h5", "r+") as file:
        file["displacement/00003"][0] = np.inf
    page = tmp_path / "page.html"
    for folders, output, message in (
        ([done, tmp_path / "empty"], page, "empty: holds no run (history.h5 is missing)"),
        ([tmp_path / "nowhere"], page, "nowhere: holds no run"),
        ([damaged], page, "fields.h5: cannot be read"),
        ([endless], page, "fields.h5: cannot be read (a displacement is not finite)"),
        ([half], page, "summary.json: cannot be read"),
        ([tmp_path / "nowhere"], tmp_path / "file" / "page.html", "cannot be written"),
        ([done], tmp_path / "page.pdf", "a file named .html is expected"),
        ([], page, "Missing argument"),
    ):
        code, said = command(capsys, "report", *folders, "-o", output)
        assert (code, said.count("\n")) == (2, 1), said
        assert message in said
        assert not output.exists()


def test_runs_that_did_not_end_well(block: tf.TongueMesh, done: Path, tmp_path: Path) -> None:
    """A run that failed and one that was killed have a page too, which says so."""
    model = tf.Model(block, fixed=["left"], gravity=(0.0, 0.0, -5e5), gravity_rise=0.01)
    stepping = tf.Stepping(step_max=5e-3, step_min=2e-3, output_every=5e-3)
    with pytest.raises(tf.SolveError):
        tf.Simulation(model, stepping=stepping, probes={"end": (0.02, 0.005, 0.005)}).run({}, 0.05, tmp_path / "failed")
    killed = copied(done, tmp_path / "killed")
    (killed / "summary.json").unlink()
    shutil.rmtree(killed / "figures")
    page = Page(write_report([tmp_path / "failed", killed], tmp_path / "page.html"))
    assert "The solve failed before the end" in page.words
    assert "There is no summary" in page.words
    assert "The run has drawn none" in page.words
    assert [len(of["times"]) for of in page.data["runs"]] == [len(tf.Run(tmp_path / "failed").output_times), 5]


def test_names_are_text(done: Path, tmp_path: Path) -> None:
    """Whatever a folder or a mesh is called, it adds no markup."""
    folder = copied(done, tmp_path / "a & <b>")
    summary = json.loads((folder / "summary.json").read_text())
    summary["name"] = "<script>alert(1)</script>"
    summary["model"]["law"] = "</td><img src=x>"
    (folder / "summary.json").write_text(json.dumps(summary))
    with h5py.File(folder / "history.h5", "r+") as file:
        file["contact"].move("palate", "<!--<script>")
    with h5py.File(folder / "fields.h5", "r+") as file:
        file["obstacles"].move("palate", "<!--<script>")
    plain, page = Page(write_report([done], tmp_path / "plain.html")), Page(write_report([folder], tmp_path / "page.html"))
    assert page.scripts == plain.scripts
    assert "a & <b>" in page.words
    assert "<script>alert(1)</script>" in page.words
    assert page.loads.count("x") == 0
    assert page.data["runs"][0]["obstacles"][0]["name"] == "<!--<script>"
    assert "<!--<script>" not in page.text


def test_needs_no_solver(done: Path, tmp_path: Path) -> None:
    """The command starts without DOLFINx, PETSc and UFL."""
    code = f"""
import sys
from tongue_fenicsx.cli.app import main
try:
    main(["report", {str(done)!r}, "-o", {str(tmp_path / "page.html")!r}])
except SystemExit as leaving:
    assert leaving.code == 0
print(sorted({{"dolfinx", "petsc4py", "ufl", "matplotlib.pyplot"}} & set(sys.modules)))
"""
    done_ = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done_.stdout.splitlines()[-1] == "[]"


def pixels(window: Any) -> np.ndarray:
    """The inside of the 3D view as it is now, (height, width, 3)."""
    window.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
    picture = window.find_element("id", "canvas").screenshot_as_png
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)[8:-8, 8:-8]  # within the mark of the focus


def differing(a: np.ndarray, b: np.ndarray) -> int:
    """How many pixels differ clearly."""
    return int((abs(a - b).max(axis=2) > 12).sum())


def errors(window: Any) -> list[dict[str, Any]]:
    return [entry for entry in window.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]


def test_a_browser_turns_and_moves_the_tongue(done: Path, tmp_path: Path, browser: Browser) -> None:
    """From disk: mouse, wheel, keys, slider, toggles and play change the view as they should, and no error is logged."""
    from selenium.webdriver import ActionChains, Keys

    window = browser(write_report([done], tmp_path / "page.html"))
    canvas, slider, play = (window.find_element("id", name) for name in ("canvas", "slider", "play"))
    assert not window.find_element("id", "missing").is_displayed()
    assert not window.find_element("id", "selector").is_displayed()
    first = pixels(window)
    assert slider.get_attribute("value") == "4"
    assert window.find_element("id", "clock").text == "20 ms"
    assert differing(first, pixels(window)) == 0
    assert differing(first, np.full_like(first, first[0, 0])) > 20_000

    ActionChains(window).drag_and_drop_by_offset(canvas, 120, 30).perform()
    turned = pixels(window)
    assert differing(first, turned) > 10_000
    ActionChains(window).scroll_from_origin(_origin(canvas), 0, -300).perform()
    assert _covered(pixels(window)) > 1.2 * _covered(turned)
    canvas.send_keys("0")
    assert differing(first, pixels(window)) == 0
    canvas.send_keys(Keys.ARROW_LEFT)
    assert differing(first, pixels(window)) > 3_000
    canvas.send_keys("0")
    for name in ("rest", "obstacles"):
        toggle = window.find_element("id", name)
        toggle.click()
        assert differing(first, pixels(window)) > 1_000
        toggle.click()
        assert differing(first, pixels(window)) == 0

    for change in ("#cut", "#colour option[value='jacobian']"):
        window.find_element("css selector", change).click()
        assert differing(first, pixels(window)) > 3_000
    window.find_element("css selector", "#colour option[value='displacement']").click()
    window.find_element("id", "cut").click()
    assert differing(first, pixels(window)) == 0
    window.execute_script("URL.createObjectURL = (content) => { window.saved = content; return 'data:,'; };")
    window.find_element("id", "table").click()
    head, *rows = window.execute_async_script("const done = arguments[0]; window.saved.text().then(done);").splitlines()
    run = tf.Run(done)
    np.testing.assert_allclose([float(cell) for cell in rows[-1].split(",")], [c[-1] for c in run.to_dict().values()], rtol=1e-4)
    assert head.split(",") == list(run.to_dict())
    window.find_element("id", "picture").click()
    _wait(lambda: window.execute_script("return window.saved.type;") == "image/png")

    slider.send_keys(Keys.HOME)
    at_rest = pixels(window)
    assert slider.get_attribute("value") == "0"
    assert differing(first, at_rest) > 3_000
    play.click()
    assert play.text == "Pause"
    _wait(lambda: slider.get_attribute("value") != "0")
    _wait(lambda: differing(at_rest, pixels(window)) > 1_000)
    canvas.send_keys(" ")
    assert play.text == "Play"
    paused, clock = pixels(window), window.find_element("id", "clock").text
    time.sleep(0.3)
    assert differing(paused, pixels(window)) == 0
    mark = window.find_element("css selector", "svg[data-from] .now")
    assert clock == window.find_element("id", "clock").text
    (shift,) = re.findall(r"translate\(([\d.]+) 0\)", mark.get_attribute("transform"))
    assert float(shift) == pytest.approx(58 + 450 * float(clock.split()[0]) / 20, abs=12)
    assert errors(window) == []


def test_the_near_side_hides_the_far_side(done: Path, tmp_path: Path, browser: Browser) -> None:
    """Where only the right half moves, it is yellow from the right, violet from the left."""
    folder = copied(done, tmp_path / "halves")
    with h5py.File(folder / "fields.h5", "r+") as file:
        right = file["mesh/points"][:, 1] > 0
        for data in file["displacement"].values():
            data[:] = np.where(right[:, None], [0.0, 0.0, 1e-3], 0.0)
    window = browser(write_report([folder], tmp_path / "page.html"))
    window.find_element("id", "obstacles").click()
    window.find_element("css selector", "[data-view='270,0']").click()
    colours = []
    for _ in range(2):
        view = pixels(window)
        height, width, _ = view.shape
        colours.append(view[height // 2, width // 2])
        canvas = window.find_element("id", "canvas")
        for _ in range(30):  # half a turn
            canvas.send_keys("\ue012")
    (left_red, left_green, left_blue), (red, green, blue) = colours
    assert left_blue > left_green + 30
    assert left_red < 100
    assert min(red, green) > blue + 60


def test_a_browser_changes_runs(done: Path, tmp_path: Path, browser: Browser) -> None:
    """The selector shows one run at a time, its motion and its numbers."""
    other = copied(done, tmp_path / "other")
    with h5py.File(other / "fields.h5", "r+") as file:
        for data in file["displacement"].values():
            data[:] = 3 * data[:]
    window = browser(write_report([done, other], tmp_path / "page.html"))
    before = pixels(window)
    shown = [article.is_displayed() for article in window.find_elements("css selector", "article.run")]
    assert shown == [True, False]
    window.find_element("css selector", "#other option[value='1']").click()
    assert differing(before, pixels(window)) > 1_000
    window.find_element("css selector", "#other option[value='-1']").click()
    assert differing(before, pixels(window)) == 0
    window.find_element("css selector", "#selector option[value='1']").click()
    assert differing(before, pixels(window)) > 3_000
    shown = [article.is_displayed() for article in window.find_elements("css selector", "article.run")]
    assert shown == [False, True]
    assert errors(window) == []


def test_without_webgl(done: Path, tmp_path: Path, browser: Browser) -> None:
    """A browser without WebGL says so and shows the rest."""
    window = browser(write_report([done], tmp_path / "page.html"), "--disable-3d-apis")
    assert "no WebGL" in window.find_element("id", "missing").text
    assert not window.find_element("id", "viewer").is_displayed()
    assert window.find_element("css selector", "article.run svg").is_displayed()


def _origin(element: Any) -> Any:
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin

    return ScrollOrigin.from_element(element)


def _covered(view: np.ndarray) -> int:
    """How many pixels are not background."""
    return differing(view, np.full_like(view, view[0, 0]))


def _wait(until: Callable[[], bool]) -> None:
    end = time.monotonic() + 20
    while not until():
        assert time.monotonic() < end, "nothing happened for 20 s"
        time.sleep(0.02)
