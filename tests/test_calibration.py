# SPDX-License-Identifier: MIT
"""The search for a stress on strains known in closed form, and the command on a small mesh."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.anatomy.catalogue import CALIBRATION, CALKA_STRESS, PEAK_STRESS
from tongue_fenicsx.scenario.files import load
from tongue_fenicsx.studies import calibration
from tongue_fenicsx.studies import single_muscle as solo
from tongue_fenicsx.studies.calibration import BOUND, Found, search


def find_stress(strain: Callable[[float], float], target: float, tolerance: float = calibration.TOLERANCE) -> Found:
    """The search, with a strain in closed form, which may fail."""
    steps = search(target, tolerance)
    stress = next(steps)
    while True:
        try:
            reached = strain(stress)
        except tf.SolveError:
            reached = math.inf
        try:
            stress = steps.send(reached)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]


def saturating(most: float, half: float) -> Callable[[float], float]:
    """Strain most·s/(s + half): half of the most at the stress `half` in Pa."""
    return lambda stress: most * stress / (stress + half)


@pytest.mark.parametrize(("most", "half"), [(0.9, 3e3), (0.7, 300.0), (1.4, 60e3), (0.55, 1e3)])
def test_reaches_the_target(most: float, half: float) -> None:
    """A strain that saturates above the target: the stress found gives the target within the tolerance, in a few runs, to two digits."""
    found = find_stress(saturating(most, half), 0.5)
    assert found.reached
    assert found.strain == pytest.approx(0.5, abs=calibration.TOLERANCE)
    assert found.stress == pytest.approx(half / (most / 0.5 - 1), rel=0.45)
    assert found.stress == float(f"{found.stress:.2g}")
    assert found.runs <= 6


def test_a_tight_tolerance_ends() -> None:
    """Two digits cannot meet 1e-6; the search ends all the same, at the nearest of them."""
    found = find_stress(saturating(0.9, 3e3), 0.5, tolerance=1e-6)
    assert not found.reached
    assert found.stress == pytest.approx(3.75e3, rel=0.03)


def test_out_of_reach() -> None:
    """A strain that saturates below the target: the bound is tried, and the table says what it can."""
    found = find_stress(saturating(0.4, 2e3), 0.5)
    assert not found.reached
    assert (found.stress, found.limit) == (BOUND, BOUND)
    assert found.strain == pytest.approx(0.4, rel=0.02)


def test_solves_that_fail() -> None:
    """Where the solve fails from 10 kPa on, the search ends close below, and says so; if it fails everywhere it is an error."""

    def strain(stress: float) -> float:
        if stress > 10e3:
            raise tf.SolveError("too much")
        return 0.05 * math.log(stress)

    found = find_stress(strain, 0.5)
    assert not found.reached
    assert 9e3 < found.stress <= 10e3 < found.limit < 12e3
    with pytest.raises(tf.SolveError, match="the solve failed, or the tongue was too fast, at every stress tried"):
        find_stress(lambda stress: strain(1e6), 0.5)


def test_the_table_of_the_package() -> None:
    """The tissue of the chapter carries calibrated stresses, which reach a strain of 0.5 ± 0.05, and the published ratios."""
    measured = CALIBRATION
    assert set(measured["muscles"]["sigma_max"]) == set(calibration.TONGUE_MUSCLES)
    for name, stress in measured["muscles"]["sigma_max"].items():
        assert CALKA_STRESS[name] == stress
        assert measured["calibration"]["strain"][name] == pytest.approx(0.5, abs=0.05)
    assert CALKA_STRESS["GH"] / CALKA_STRESS["GGP"] == pytest.approx(162 / 49.7)
    assert CALKA_STRESS["MH"] / CALKA_STRESS["GGP"] == pytest.approx(154 / 49.7)
    assert PEAK_STRESS["kappert"]["SL"] == pytest.approx(CALKA_STRESS["SL"] * 273 / 192)


def test_command(tongue_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """One muscle on the small mesh for 60 ms: each run is said, and the file is a piece of a scenario that gives the strain."""
    monkeypatch.setattr(solo, "RISE", 0.03)
    monkeypatch.setattr(solo, "HOLD", 0.03)
    output = tmp_path / "stress.toml"
    code, text = command(capsys, "calibrate", "-o", output, "--mesh", tongue_file, "--muscle", "GGM", "--strain", "0.25")
    assert code == 0, text
    assert re.search(r"GGM: 4 kPa, strain 0\.\d{3}, peak speed \d+ cm/s\n", text)
    assert (tmp_path / "stress-runs" / "GGM-4000Pa" / "summary.json").is_file()
    found = tomllib.loads(output.read_text())
    stress, strain = found["muscles"]["sigma_max"]["GGM"], found["calibration"]["strain"]["GGM"]
    assert strain == pytest.approx(0.25, abs=0.02)
    scenario = tmp_path / "s.toml"
    scenario.write_text(
        f'[mesh]\nfile = "{tongue_file}"\n[time]\nend = 0.35\n[activation.GGM]\npieces = [[0.1, 0.0, 1.0]]\n'
        + output.read_text().partition("[calibration]")[0]
    )
    assert load(scenario).muscles.sigma_max["GGM"] == stress
    monkeypatch.setattr(calibration, "FASTEST", 0.0)
    code, text = command(capsys, "calibrate", "-o", output, "--mesh", tongue_file, "--muscle", "GGM", "--strain", "0.25")
    assert code == 3, text
    assert "cm/s: too fast" in text
    assert "or the tongue was too fast, at every stress tried" in text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--muscle", "GH"], "--muscle: 'GH' is not one of GGP, GGM"),
        (["--tissue", "cork"], "--tissue: 'cork' is not one of calka, buchaillard, kappert"),
        (["--preset", "tiny"], "--preset: 'tiny' is not one of coarse, medium, reference"),
        (["--strain", "5"], "--strain: 5; a number from 0.05 to 1.5 is expected"),
        (["--mesh", "nowhere.msh"], "nowhere.msh: the file does not exist"),
        (["--mesh", "a.msh", "--preset", "coarse"], "--mesh and --preset: give one of them"),
    ],
)
def test_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str) -> None:
    """Exit code 2 and one sentence before anything is computed; nothing is written."""
    code, text = command(capsys, "calibrate", "-o", tmp_path / "stress.toml", *options)
    assert (code, message in text) == (2, True), text
    assert not list(tmp_path.iterdir())
