# SPDX-License-Identifier: MIT
"""Runs over each other and in motion, and response curves of tables."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.analysis.comparison import differing_keys, naturally, open_runs
from tongue_fenicsx.analysis.moments import field_at, obstacles_at
from tongue_fenicsx.analysis.tables import Table
from tongue_fenicsx.analysis.trajectories import read_places, write_places
from tongue_fenicsx.plotting.movie import draw_movie
from tongue_fenicsx.plotting.response_curves import draw_responses
from tongue_fenicsx.plotting.scene import stage, values_at

SCENARIO = """
[tissue]
c10 = {c10}
[activation.GGP]
pieces = [[0.01, 0.0, {level}]]
"""

Copy = Callable[..., Path]


@pytest.fixture(scope="module")
def run(tongue: tf.TongueMesh, workspace: Path) -> tf.Run:
    """Three outputs among a plane that sinks, with all kinds of fields."""
    plane = tf.Contact(tf.Plane((0.0, 0.0, 0.1), (0.0, 0.0, -1.0)), motion=tf.RigidMotion(translation=[(0.01, (0, 0, 0), (0, 0, -0.01))]))
    stepping = tf.Stepping(step_max=2.5e-3, output_every=5e-3, fields=["cauchy", "fibre_stretch"])
    model = tf.Model(tongue, contacts={"plane": plane})
    folder = workspace / "pictured"
    tf.Simulation(model, stepping=stepping).run({"GGP": tf.ramp(0.01, 0.01)}, 0.01, folder)
    (folder / "scenario.toml").write_text(SCENARIO.format(c10=192.0, level=1.0))
    return tf.Run(folder)


@pytest.fixture
def changed(run: tf.Run, tmp_path: Path) -> Copy:
    """Copies of the run: its displacement times a factor, another scenario."""

    def copy(name: str, factor: float = 1.0, scenario: str = SCENARIO.format(c10=192.0, level=1.0)) -> Path:
        folder = Path(shutil.copytree(run.folder, tmp_path / name))
        with h5py.File(folder / "fields.h5", "r+") as fields, h5py.File(folder / "history.h5", "r+") as history:
            for data in (*fields["displacement"].values(), history["probes"]):
                data[...] = factor * data[...]
        (folder / "scenario.toml").write_text(scenario)
        return folder

    return copy


def test_between_outputs(run: tf.Run) -> None:
    """Fields and obstacles at an output are those stored; half-way between two they are half-way."""
    first, second = (run.field("displacement", index) for index in (1, 2))
    np.testing.assert_array_equal(field_at(run, "displacement", 0.005), first)
    np.testing.assert_allclose(field_at(run, "displacement", 0.0075), (first + second) / 2, atol=1e-12)
    for index in (0, 2):
        np.testing.assert_allclose(obstacles_at(run, run.output_times[index])["plane"].points, run.obstacles(index)["plane"].points)
    height = {t: obstacles_at(run, t)["plane"].points[:, 2].mean() for t in (0.0, 0.006, 0.00625, 0.0075)}
    assert height[0.0] == pytest.approx(0.1)
    assert height[0.00625] == pytest.approx((height[0.006] * 5 + height[0.0075]) / 6)


def test_fields_as_colours_show_them(run: tf.Run) -> None:
    """In units of pictures: mm, cm/s, kPa; of a stress the von Mises measure."""
    np.testing.assert_allclose(values_at(run, "velocity", 0.01), 100 * np.linalg.norm(run.field("velocity"), axis=1))
    s = run.field("cauchy")[7]
    x, y, z, xy, yz, zx = s[0, 0], s[1, 1], s[2, 2], s[0, 1], s[1, 2], s[2, 0]
    mises = np.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2 + 3 * (xy**2 + yz**2 + zx**2))
    assert values_at(run, "cauchy", 0.01)[7] == pytest.approx(1e-3 * mises)


@pytest.mark.parametrize(
    ("field", "label"),
    [
        ("displacement", "displacement in mm"),
        ("jacobian", "present volume over rest volume J"),
        ("fibre_stretch_GGP_L", "fibre stretch λ̄ of a muscle, 1 outside it GGP_L"),
    ],
)
@pytest.mark.parametrize("view", ["side", None])
def test_what_a_picture_says(run: tf.Run, field: str, label: str, view: str | None) -> None:
    """Clock, title, what the colours mean; colours hold all values, or show that some lie beyond."""
    with stage(run, field, run.output_times, view) as (figure, show):
        show(0.0075)
        texts = [text.get_text() for text in figure.texts]
        assert texts == [f"{run.folder.name}: GGP (parametric tongue)", "8 ms"]
        assert label in {axes.get_ylabel() for axes in figure.axes}


def test_movies(run: tf.Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An MP4 that every player reads and a GIF: so many frames at such a rate, the motion in them, and no more files."""
    code, said = command(
        capsys, "movie", run.folder, "-o", tmp_path / "new" / "a.mp4", "--seconds", "0.2", "--fps", "20", "--quantity", "J"
    )
    assert (code, "a.mp4" in said) == (0, True)
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "new" / "a.mp4"))
    facts = next(reader)
    assert (facts["codec"], facts["size"], facts["fps"]) == ("h264", (1280, 720), 20.0)
    assert facts["pix_fmt"].startswith("yuv420p")
    frames = [np.frombuffer(frame, np.uint8).astype(int) for frame in reader]
    assert len(frames) == 4
    assert (abs(frames[0] - frames[-1]) > 60).sum() > 500
    seen: list[tuple[int, int]] = []
    draw_movie(run, tmp_path / "new" / "b.gif", view=None, start=0.005, seconds=0.15, fps=20, report=lambda *at: seen.append(at))
    with Image.open(tmp_path / "new" / "b.gif") as gif:
        assert (gif.n_frames, gif.size, gif.info["duration"], gif.info["loop"]) == (3, (1280, 720), 50, 0)  # type: ignore[attr-defined]
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["a.mp4", "b.gif"]


def test_points_beside_a_movie(run: tf.Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Places that are not where the probe is are drawn beside it, from a table that is written and read again to its digits."""
    times = np.array([0.0, run.output_times[-1]])
    places = run.rest["tip"] + np.array([[0.0, 0, 0], [-0.004, 0, 0.006]])
    write_places({"tip": (times, places), "late": (times[1:], places[1:] - 0.01)}, tmp_path / "paths.csv")
    read = read_places(tmp_path / "paths.csv")
    np.testing.assert_allclose(read["tip"][1], places, atol=1e-7)
    line = ["movie", run.folder, "--seconds", "0.1", "--fps", "20", "--beside", tmp_path / "paths.csv"]
    plain, beside = tmp_path / "plain.gif", tmp_path / "beside.gif"
    assert command(capsys, *line, "-o", beside, "--section", "midsagittal")[0] == 0
    draw_movie(run, plain, view=None, seconds=0.1, fps=20)
    last = []
    for path in (plain, beside):
        with Image.open(path) as gif:
            gif.seek(1)
            last.append(np.asarray(gif.convert("RGB")).astype(int))
    assert 200 < (abs(last[0] - last[1]).max(axis=-1) > 60).sum() < 10_000
    code, said = command(capsys, *line, "-o", beside)
    assert (code, "--section midsagittal is expected" in said) == (2, True)
    for table, message in (("a,b\n1,2\n", "NAME_x_m"), ("time_s,a_x_m,a_y_m,a_z_m\n0,1,,3\n", "NAME_x_m"), ("a_x_m\n0\n", "time_s")):
        (tmp_path / "paths.csv").write_text(table)
        code, said = command(capsys, *line, "-o", beside, "--section", "midsagittal")
        assert (code, message in said) == (2, True), said


def test_a_movie_that_fails_leaves_the_old_one(run: tf.Run, tmp_path: Path) -> None:
    """Nothing half-written stands where a movie stood."""
    path = tmp_path / "a.gif"
    path.write_bytes(b"old")

    def stop(frame: int, frames: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        draw_movie(run, path, view=None, seconds=0.1, report=stop)
    assert [file.name for file in tmp_path.iterdir()] == ["a.gif"]
    assert path.read_bytes() == b"old"


def test_a_comparison(run: tf.Run, changed: Copy, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What differs, and by how much, is printed and stands beside the picture."""
    other = changed("other", 1.5, SCENARIO.format(c10=400.0, level=0.5) + "[contact.palate]\nform = 'nitsche'\ntheta = 0\n")
    code, said = command(capsys, "compare", run.folder, other, "-o", tmp_path / "both.png")
    assert (code, "tissue.c10" in said) == (0, True)
    head, *rows = csv.reader((tmp_path / "both.csv").open(encoding="utf-8"))
    table = {row[0]: row[1:] for row in rows}
    assert head == ["", "pictured", "other"]
    assert table["tissue.c10"] == ["192.0", "400.0"]
    assert table["activation.GGP.pieces"] == ["[[0.01, 0.0, 1.0]]", "[[0.01, 0.0, 0.5]]"]
    assert table["contact.palate"] == ["–", "given"]
    assert not any(key.startswith("contact.palate.") for key in table)
    largest = 1e3 * np.linalg.norm(run.field("displacement"), axis=1).max()
    assert [float(cell) for cell in table["largest displacement in mm"]] == pytest.approx([largest, 1.5 * largest], rel=1e-3)
    assert [float(cell) for cell in table["largest difference from the first in mm"]] == pytest.approx([0, largest / 2], rel=1e-3)
    up = 1e3 * run.probes["tip"][-1, 2]
    assert [float(cell) for cell in table["tip upward in mm"]] == pytest.approx([up, 1.5 * up], rel=1e-3)
    assert (tmp_path / "both.md").read_text().startswith("|  | pictured | other |\n")
    assert Image.open(tmp_path / "both.png").size[0] > 1500
    code, said = command(capsys, "compare", run.folder, other, "-o", tmp_path / "both.pdf", "--time", "0.005")
    assert code == 0
    assert "| seen at, in ms | 5 | 5 |" in (tmp_path / "both.md").read_text()


def test_natural_order() -> None:
    """As people count."""
    assert sorted(["run10", "a", "run2", "run", "2", "10b", "run2b"], key=naturally) == ["2", "10b", "a", "run", "run2", "run2b", "run10"]


def test_keys_that_some_runs_have(changed: Copy) -> None:
    """A table of several keys is one row, a single key shows its value; what differs among those that have the table is said, too."""
    palate = "[contact.palate]\ntheta = {}\nform = 'nitsche'\n"
    runs = open_runs([changed(str(n), 1.0, text) for n, text in enumerate(("[time]\nend = 1.0\n", palate.format(0), palate.format(1)))])
    assert differing_keys(runs) == {
        "time.end": ["1.0", "–", "–"],
        "contact.palate": ["–", "given", "given"],
        "contact.palate.theta": ["–", "0", "1"],
    }


def test_bad_input(run: tf.Run, changed: Copy, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One sentence and exit code 2, and nothing is written."""
    stranger = changed("stranger")
    summary = json.loads((stranger / "summary.json").read_text())
    (stranger / "summary.json").write_text(json.dumps(summary | {"name": "subject X"}))
    (tmp_path / "out").mkdir()
    picture, film = tmp_path / "out" / "a.png", tmp_path / "out" / "a.mp4"
    damaged = changed("damaged")
    (damaged / "fields.h5").write_bytes((damaged / "fields.h5").read_bytes()[:5000])
    for arguments, message in (
        (["compare", run.folder, damaged, "-o", picture], "damaged/fields.h5: cannot be read"),
        (["movie", damaged, "-o", film], "damaged/fields.h5: cannot be read"),
        (["plot", damaged], "damaged/fields.h5: cannot be read"),
        (["compare", run.folder, "-o", picture], "1 runs are given; two to 18 are expected"),
        (
            ["compare", run.folder, stranger, "-o", picture],
            "on different anatomies (pictured of 'parametric tongue', stranger of",
        ),
        (["compare", run.folder, tmp_path, "-o", picture], "holds no run"),
        (["compare", run.folder, run.folder, "-o", film], "a file named .png, .pdf, .svg is expected"),
        (["compare", run.folder, run.folder, "-o", picture, "--time", "0.2"], "0.2 s; "),
        (["movie", run.folder, "-o", picture], "a movie named .mp4 or .gif is expected"),
        (["movie", tmp_path, "-o", film], "holds no run"),
        (["movie", run.folder, "-o", film, "--quantity", "strain"], "no field 'strain'; it has "),
        (["movie", run.folder, "-o", film, "--view", "back"], "view 'back' is not one of side, front, top, oblique"),
        (["movie", run.folder, "-o", film, "--section", "axial"], "'axial' is not midsagittal"),
        (["movie", run.folder, "-o", film, "--section", "midsagittal", "--view", "top"], "a section is seen from the side"),
        (["movie", run.folder, "-o", film, "--from", "0.008", "--to", "0.003"], "a start before the end is expected"),
        (["movie", run.folder, "-o", film, "--to", "5"], "has fields from 0 to 0.01 s"),
        (["movie", run.folder, "-o", film, "--fps", "0"], "--fps"),
    ):
        code, said = command(capsys, *arguments)
        assert (code, said.count("\n")) == (2, 1), said
        assert message in said
        assert not list((tmp_path / "out").iterdir())


HEAD = ["index", "tissue.c10", "tissue.preset", "activation.GGP", "status", "reason", "folder", "peak_speed_m_s", "tip_x_m", "tip_z_m"]


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    """The table of a sweep: two moduli, three levels, one run failed."""
    rows: list[list[object]] = []
    for c10 in (400, 192):
        for level in (1.0, 0.1, 0.5):
            failed = (c10, level) == (192, 0.5)
            end = (
                ["failed", "J < 0, at 3 ms", "run_0", "", "", ""] if failed else ["done", "", "run_0", level / 5, -level / c10, level / c10]
            )
            rows.append([len(rows), c10, "calka", level, *end])
    (tmp_path / "sweep").mkdir()
    with (tmp_path / "sweep" / "table.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([HEAD, *rows])
    return tmp_path / "sweep"


def test_a_table(sweep: Path) -> None:
    """Only runs that are done count; keys that differ between them are found."""
    table = Table.read(sweep / "table.csv")
    assert (len(table.cells("folder")), table.n_runs) == (5, 6)
    assert table.varied == ["tissue.c10", "activation.GGP"]
    np.testing.assert_allclose(table.numbers("tip_z_m"), [1 / 400, 0.1 / 400, 0.5 / 400, 1 / 192, 0.1 / 192])


def test_response_curves(sweep: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A line for each value of the other key, in order along the key across, in mm."""
    figures: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *args, **options: figures.append(self))
    table = Table.read(sweep / "table.csv")
    draw_responses(table, tmp_path / "a.png")
    first, second = figures[0].axes
    assert (first.get_ylabel(), second.get_ylabel(), first.get_xlabel()) == ("tip backward in mm", "tip upward in mm", "activation.GGP")
    lines = {line.get_label(): line.get_xydata() for line in second.lines}
    assert list(lines) == ["192", "400"]
    np.testing.assert_allclose(lines["400"], [[level, 1e3 * level / 400] for level in (0.1, 0.5, 1.0)])
    np.testing.assert_allclose(lines["192"], [[level, 1e3 * level / 192] for level in (0.1, 1.0)])
    assert figures[0].get_suptitle() == "5 of 6 runs, those that are done"
    draw_responses(table, tmp_path / "a.png", x="tissue.c10", y=["peak_speed_m_s"])
    (axes,) = figures[1].axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("tissue.c10", "peak speed in cm/s")
    assert [line.get_label() for line in axes.lines] == ["0.1", "0.5", "1.0"]
    np.testing.assert_allclose(axes.lines[2].get_xydata(), [[192, 20], [400, 20]])
    draw_responses(table, tmp_path / "a.png", x="tissue.preset")
    assert [label.get_text() for label in figures[2].axes[1].get_xticklabels()] == ["calka"]
    assert {line.get_linestyle() for line in figures[2].axes[1].lines} == {"None"}


def test_plot(changed: Copy, sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run's figure anew, a sweep's curves beside its table, a table of one's own by the names of its columns."""
    folder = changed("stopped")
    (folder / "summary.json").unlink()
    code, said = command(capsys, "plot", folder, "--figure", "contact")
    assert (code, said.split()) == (0, ["wrote", str(folder / "figures" / "contact.png")])
    assert (folder / "figures" / "contact.png").is_file()
    assert command(capsys, "plot", sweep)[0] == 0
    assert (sweep / "responses.png").is_file()
    (tmp_path / "own.csv").write_text("age,length_m\n3,0.05\n8,0.07\n", encoding="utf-8-sig")
    assert command(capsys, "plot", tmp_path / "own.csv", "--x", "age", "--y", "length_m", "-o", tmp_path / "new" / "own.pdf")[0] == 0
    assert (tmp_path / "new" / "own.pdf").stat().st_size > 1000


def test_bad_tables(run: tf.Run, sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One sentence and exit code 2."""
    table = sweep / "table.csv"
    texts = {"short": "a.b,c\n1\n", "twice": "a.b,a.b\n1,2\n", "same": "a.b,c\n1,2\n1,3\n", "none": "status\nfailed\n", "empty": ""}
    for name, text in texts.items():
        (tmp_path / f"{name}.csv").write_text(text)
    for arguments, message in (
        ([table, "--x", "tissue.c1"], "table.csv: no column 'tissue.c1'; did you mean 'tissue.c10'?"),
        ([table, "--y", "tip_zm"], "no column 'tip_zm'; did you mean 'tip_z_m'?"),
        ([table, "--y", "folder"], "the column 'folder' holds other than numbers"),
        ([table, "-o", tmp_path / "a.mp4"], "a file named .png, .pdf, .svg"),
        ([table, sweep, "-o", tmp_path / "a.png"], "one table and a file"),
        ([table, "--figure", "contact"], "is a table; it has --x, --y and --by"),
        ([run.folder, "--x", "tissue.c10"], "belong to tables; a run has --figure"),
        ([run.folder, "--figure", "midsagital"], "no figure 'midsagital'; "),
        ([tmp_path], "holds no run"),
        ([tmp_path / "nowhere.csv"], "nowhere.csv: the file does not exist"),
        ([tmp_path / "short.csv"], "line 2 has 1 cells under 2 names"),
        ([tmp_path / "twice.csv"], "two columns have one name"),
        ([tmp_path / "same.csv"], "no key differs between its runs"),
        ([tmp_path / "none.csv"], "none of its 1 runs is done"),
        ([tmp_path / "empty.csv"], "empty.csv: cannot be read"),
    ):
        code, said = command(capsys, "plot", *arguments)
        assert (code, said.count("\n")) == (2, 1), said
        assert message in said
