# SPDX-License-Identifier: MIT
"""What `make bench` times can be timed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from petsc4py import PETSc

from benchmarks import measure, scaling, stress, timing


def test_assembly(tongue_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A residual costs less than a tangent."""
    monkeypatch.setattr(timing, "PATIENCE", 0.0)
    for times in measure.assembly(tongue_file).values():
        assert 0 < times["residual"] < times["tangent"]


@pytest.mark.parametrize("preset", measure.PRESETS.values(), ids=list(measure.PRESETS))
def test_a_step(preset: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    """Every part of a Newton iteration on a small block takes time."""
    monkeypatch.setattr(timing, "PATIENCE", 0.0)
    PETSc.Log.begin()
    assert all(value > 0 for value in measure.solver(2, preset).values())


def test_steady(monkeypatch: pytest.MonkeyPatch) -> None:
    """A row is repeated until its medians are known: seven times if it hardly varies, more if it does, once if there is no patience."""

    def times(spread: float) -> int:
        rng, done = np.random.default_rng(1), []

        def work() -> timing.Row:
            done.append(float(rng.lognormal(0.0, spread)))
            return {"even": 2.0, "uneven": done[-1]}

        assert timing.steady(work) == {"even": 2.0, "uneven": np.median(done)}
        return len(done)

    assert times(0.001) == 7
    assert 20 < times(0.3) < 2000
    monkeypatch.setattr(timing, "PATIENCE", 0.0)
    assert times(0.3) == 1


PROJECT = """
import json, os, pathlib, sys
output = pathlib.Path(sys.argv[sys.argv.index("-o") + 1])
output.mkdir()
(output / "summary.json").write_text(json.dumps({{"name": "{0}"}}))
pathlib.Path(os.environ["PETSC_OPTIONS"].split(":")[1]).write_text("Rank,Event Name,Time\\n")
"""


def test_each_commit_runs_its_own_code(tmp_path: Path) -> None:
    """Wherever the benchmark is called from, and again where it has been."""
    for name in ("old", "new"):
        (tmp_path / name / "tongue_fenicsx").mkdir(parents=True)
        (tmp_path / name / "tongue_fenicsx" / "__main__.py").write_text(PROJECT.format(name))
        for step in ("1.25", "1.5", "1.25"):  # names that differ behind a dot, and a folder that is there already
            done = timing.run(tmp_path / "any.toml", tmp_path / "runs" / f"{name}-{step}", code=tmp_path / name)
            assert done.summary == {"name": name}
    assert len(list((tmp_path / "runs").glob("*.csv"))) == 4


def test_profiles() -> None:
    """The quicker solver of each case counts at 1, one that does not finish at none."""
    at, shares = stress.profiles({"ours": {"a": 1.0, "b": 4.0}, "plain": {"a": 3.0, "b": 2.0, "c": 5.0}})
    np.testing.assert_allclose(at, [1, 2, 3])
    np.testing.assert_allclose(shares["ours"], [1 / 3, 2 / 3, 2 / 3])
    np.testing.assert_allclose(shares["plain"], [2 / 3, 2 / 3, 1])


def test_prediction() -> None:
    """One and two ranks are met; what is shared halves again and again, what is not stays, and messages come on top."""
    one = {"unknowns": 1000, "krylov per newton": 10.0, "tangent (s)": 8.0, "residual (s)": 0.0, "set-up (s)": 0.0, "Krylov (s)": 3.0}
    two = one | {"tangent (s)": 4.0, "Krylov (s)": 2.0}
    assert scaling.shared(3.0, 2.0) == (2.0, 1.0)
    predicted = [scaling.prediction(one, two, 1000, ranks) - 10 * scaling.waiting(1000, ranks) for ranks in (1, 2, 4)]
    np.testing.assert_allclose(predicted, [11.0, 6.0, 3.5])
    assert scaling.prediction(one, two, 2000, 1) == pytest.approx(22.0)
    assert 0 == scaling.waiting(1000, 1) < scaling.waiting(1000, 2) < scaling.waiting(1000, 4) < 1e-3
