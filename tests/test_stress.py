# SPDX-License-Identifier: MIT
"""The stress set: what is in it, how it is judged, and that hard cases take no more work than they did."""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from conftest import LIVING

import tongue_fenicsx as tf
from tongue_fenicsx.scenario.build import Workbench, activation_of
from tongue_fenicsx.studies import cases, stress
from tongue_fenicsx.studies.atlas import MUSCLES

GOLD = json.loads(Path(__file__).with_name("gold.json").read_text(encoding="utf-8"))
MARGIN = 1.2
"""How much more work is no news: another processor rounds otherwise."""


def test_the_set() -> None:
    """Half a thousand different cases, the same every time, of every kind; every beginning of it is spread over the kinds."""
    every = stress.cases()
    assert every == stress.cases()
    assert len({name for _, name, _ in every}) == len(every) >= 500
    whole, begin = (Counter(kind for kind, *_ in part) for part in (every, stress.select(None, 50)))
    assert set(whole) == {"level", "pair", "random", "jump", "antagonists", "palate"}
    assert all(abs(begin[kind] - 50 * whole[kind] / len(every)) <= 1 for kind in whole)
    assert {kind for kind, *_ in stress.select("jump", None)} == {"jump"}


def test_scenarios(tongue_file: Path) -> None:
    """Each case is a scenario with all eleven muscles, among the bones."""
    chosen = stress.select(None, 40)
    for (scenario, told), (kind, name, _) in zip(stress.runs(chosen, tongue_file, ["palate"]), chosen, strict=True):
        assert told == {"kind": kind, "case": name}
        assert set(scenario.activation) == set(MUSCLES)
        assert list(scenario.contact) == ["palate"]
        tissue = scenario.tissue.model_dump()
        assert f"{tissue['preset']} {tissue['nu']:g}" in name


@pytest.mark.parametrize(("wrong", "message"), [((("none"), None), "--only none: one of .*jump"), ((None, 0), "--sample 0: a positive")])
def test_bad_choice(wrong: tuple[Any, Any], message: str) -> None:
    """What there is, is said."""
    with pytest.raises(tf.InputError, match=message):
        stress.select(*wrong)


def test_judgement(tmp_path: Path) -> None:
    """A run that does not reach the end is named with its reason; one in five hundred may."""
    done = {
        "kind": "level", "case": "GGP 1", "status": "done", "reason": "", "n_steps": "10", "n_rejected": "1", "newton_iterations": "30",
        "krylov_iterations": "300", "min_jacobian": "0.7", "energy_balance_error": "0.02",
    }  # fmt: skip
    lost = dict.fromkeys(done, "") | {"kind": "jump", "case": "HG", "status": "failed", "reason": "smallest J 0.01 in HG_L"}
    assert stress.by_kind([done, lost])[1:] == [
        ["jump", "1", "0.0 %", *[""] * 7],
        ["level", "1", "100.0 %", "10", "1", "3.00", "3.00", "10.0", "0.70", "2.00 %"],
        ["all", "2", "50.0 %", "10", "1", "3.00", "3.00", "10.0", "0.70", "2.00 %"],
    ]
    assert stress.failures([done, lost]) == ["HG: smallest J 0.01 in HG_L"]
    assert stress.holds([done] * 499 + [lost])
    assert not stress.holds([done] * 498 + [lost] * 2)
    stress.write([done, lost], tmp_path)
    assert "| jump | 1 | 0.0 % |" in (tmp_path / "stress.md").read_text(encoding="utf-8")


def work(tongue_file: Path) -> dict[str, Counter[str]]:
    """Steps, rejected ones, Newton and Krylov iterations of hard cases of some milliseconds: jumps, both tissues, ν = 0.499, contact.

    A jump in soft tissue takes 23 to 34 Newton iterations by luck; so of that it is the sum over five strengths of SL."""
    base = tomllib.loads(LIVING) | {"time": {"end": 0.02}, "output": {"every": 0.02}}
    everything, bench, found = {f"activation.{name}": [(0.1, 1.0, 1.0)] for name in ("GGP", "MH", "SL")}, Workbench(), {}
    soft = {"tissue.preset": "calka", **everything}
    design: dict[str, list[dict[str, Any]]] = {
        "ramp": [{"activation.GGP": [(0.02, 0.0, 1.0)]}],
        "jump": [soft | {"muscles.sigma_max.SL": stress} for stress in range(3500, 3701, 50)],
        "living jump": [everything],
        "jump at 0.499": [{"tissue.nu": 0.499, **everything}],
    }
    for name, changes in design.items():
        found[name] = Counter[str]()
        for scenario, _ in cases.scenarios(base, tongue_file.parent, changes):
            summary = bench.simulation(scenario).run(activation_of(scenario), scenario.time.end).summary
            found[name].update({key: summary[key] for key in ("n_steps", "n_rejected", "newton_iterations", "krylov_iterations")})
    bench.clear()
    return found


def test_work_has_not_grown(tongue_file: Path) -> None:
    """Hard cases reach their end with the committed numbers of iterations, within a margin."""
    found = work(tongue_file)
    assert set(found) == set(GOLD)
    more = {
        f"{name}: {key} {value}, committed {GOLD[name][key]}"
        for name, counts in found.items()
        for key, value in counts.items()
        if value > MARGIN * GOLD[name][key] + 2
    }
    assert not more
