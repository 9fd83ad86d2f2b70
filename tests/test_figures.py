# SPDX-License-Identifier: MIT
"""Figures of a run: a user's own stands beside the standard ones, and drawing leaves his Matplotlib alone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import tongue_fenicsx as tf
from tongue_fenicsx.runs.figures import FIGURES, figure_files
from tongue_fenicsx.runs.store import Memory


@pytest.fixture(scope="module")
def run(tongue: tf.TongueMesh, workspace: Path) -> tf.Run:
    """A short one, without contact."""
    return tf.Simulation(tf.Model(tongue)).run({"GGP": tf.ramp(0.01, 0.01)}, 0.005, workspace / "drawn")


def test_a_figure_of_the_user(run: tf.Run) -> None:
    """A function in his script, registered by a line, is drawn with the others, or alone by its name."""
    from matplotlib.figure import Figure

    @tf.figure(caption="Height of the tip", applies=lambda run: "tip" in run.probes)
    def tip_height(run: tf.Run) -> Path:
        figure = Figure()
        figure.subplots().plot(run.time, run.probes["tip"][:, 2])
        path = run.folder / "figures" / "tip_height.png"
        figure.savefig(path)
        return path

    try:
        assert "figures/tip_height.png" in figure_files()
        assert [path.name for path in run.plot("tip_height")] == ["tip_height.png"]
        assert [path.stem for path in run.plot()] == ["midsagittal", "view3d", "trajectories", "tip_height"]
        for path in (run.folder / name for name in ("figures/tip_height.png", "figures/trajectories.pdf", "trajectories.csv")):
            assert path.stat().st_size > 500
        other = tf.Run(run.folder)
        del other.probes["tip"]
        with pytest.raises(tf.InputError, match="no figure 'tip_height'"):
            other.plot("tip_height")
    finally:
        del FIGURES["tip_height"]


@pytest.mark.parametrize("name", ["contact", "strain"])
def test_a_figure_that_the_run_has_not(run: tf.Run, name: str) -> None:
    """One that needs contact, and one that nobody registered."""
    with pytest.raises(tf.InputError, match=f"no figure '{name}'; it has midsagittal, view3d, trajectories"):
        run.plot(name)


def test_a_field_that_the_run_has_not(run: tf.Run) -> None:
    """The message names those that were stored."""
    with pytest.raises(tf.InputError, match=r"no field 'strain'; it has .*displacement, .*velocity"):
        run.field("strain")


def test_a_run_in_memory(run: tf.Run, tmp_path: Path) -> None:
    """It reads as one in a folder, is drawn when it has been saved, and says so before."""
    here = tf.Run(Memory({path.name: path.read_bytes() for path in run.folder.iterdir() if path.suffix in (".h5", ".json")}))
    assert here.summary == run.summary
    assert (here.field("displacement") == run.field("displacement")).all()
    with pytest.raises(tf.InputError, match="in memory and has no folder; save it"):
        here.plot()
    there = here.save(tmp_path / "saved")
    assert [path.parent.parent for path in there.plot("midsagittal")] == [tmp_path / "saved"]
    with pytest.raises(tf.InputError, match="is in a folder already"):
        there.save(tmp_path / "again")


def test_matplotlib_is_left_alone(run: tf.Run) -> None:
    """All rooms that draw are loaded and a run is drawn: backend, settings and open figures of the user are as they were."""
    code = f"""
import matplotlib
matplotlib.use("svg")
before = dict(matplotlib.rcParams)
from tongue_fenicsx.plotting import anatomy_figures, atlas_plate, posture_sheet, run_figures
import tongue_fenicsx as tf
tf.Run({str(run.folder)!r}).plot()
assert matplotlib.get_backend() == "svg", matplotlib.get_backend()
assert dict(matplotlib.rcParams) == before
import matplotlib.pyplot as plt
assert plt.get_fignums() == []
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr


def test_registering_is_light() -> None:
    """The standard figures are known before anything that draws is loaded."""
    code = """
import sys
from tongue_fenicsx.runs.figures import FIGURES
assert list(FIGURES) == ["midsagittal", "view3d", "trajectories", "contact", "epg", "airway"]
print(sorted({"numpy", "h5py", "matplotlib", "pyvista", "scipy"} & set(sys.modules)))
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
