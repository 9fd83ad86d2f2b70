# SPDX-License-Identifier: MIT
"""The rows of ``tongue verify``: every one holds, and fails when a constant of the model is off by 5 %.

What is off is a number, not a form, so that nothing is compiled for it.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from dolfinx.fem import petsc as fem_petsc

from tongue_fenicsx.cli.app import main
from tongue_fenicsx.core.types import Floats
from tongue_fenicsx.forms import nodal_forces as forces
from tongue_fenicsx.forms import weak_form
from tongue_fenicsx.forms.fibre_slots import FibreSlots
from tongue_fenicsx.forms.passive_terms import PassiveTerms
from tongue_fenicsx.geometry import obstacles
from tongue_fenicsx.mechanics import loads
from tongue_fenicsx.runs.run import Run
from tongue_fenicsx.scenario.build import activation_of, simulation_of
from tongue_fenicsx.scenario.files import load
from tongue_fenicsx.simulation import energy as measures
from tongue_fenicsx.solvers import adjoint
from tongue_fenicsx.solvers import time_integration as timestep
from tongue_fenicsx.verification import CASES, Row, calculix, contact, heart, material, motion

needs_calculix = pytest.mark.skipif(shutil.which(calculix.CALCULIX) is None, reason="CalculiX (ccx) is not installed")

SHORT: dict[str, Callable[[], Iterator[Row]]] = CASES | {
    "manufactured": lambda: material.manufactured((3, 6)),
    "decay": lambda: motion.decay(5e-3),
    "contraction": lambda: motion.contraction(0.05, 1e-2),
    "ranks": lambda: motion.ranks((2, 4), 5e-3),
    "hertz": lambda: contact.hertz((10,)),
    "incline": lambda: contact.incline(0.05),
    "land": lambda: heart.land(2),
}
"""The cases, the long ones in a short form."""

MARKS = {"calculix": needs_calculix, "gradient": pytest.mark.parallel}
NAMES = [pytest.param(name, marks=MARKS.get(name, ())) for name in CASES]


@pytest.mark.parametrize("name", NAMES)
def test_rows_hold(name: str) -> None:
    """Each row is within its limit."""
    rows = list(SHORT[name]())
    assert rows
    for row in rows:
        assert row.holds, row
        assert not row.skipped, row


def _stiffer(patch: pytest.MonkeyPatch) -> None:
    right = PassiveTerms.renew

    def wrong(self: PassiveTerms, *arguments: Any) -> None:
        right(self, *arguments)
        for part in self._parts:
            part.parameters["c10"].value *= 1.05

    patch.setattr(PassiveTerms, "renew", wrong)


def _stiffer_tangent(patch: pytest.MonkeyPatch) -> None:
    right = fem_petsc.assemble_matrix

    def wrong(form: Any) -> Any:
        matrix = right(form)
        matrix.assemble()
        matrix.scale(1.05)
        return matrix

    patch.setattr(material, "fem_petsc", SimpleNamespace(assemble_matrix=wrong))


def _stronger(patch: pytest.MonkeyPatch) -> None:
    right = FibreSlots.activate

    def wrong(self: FibreSlots, levels: Mapping[str, float]) -> None:
        right(self, levels)
        for tension in self.tensions:
            tension.x.array[:] *= 1.05

    patch.setattr(FibreSlots, "activate", wrong)


def _other_gamma(patch: pytest.MonkeyPatch) -> None:
    right = timestep.GeneralizedAlpha.__init__

    def wrong(self: timestep.GeneralizedAlpha, *arguments: Any) -> None:
        right(self, *arguments)
        self.gamma *= 1.05

    patch.setattr(timestep.GeneralizedAlpha, "__init__", wrong)


def _longer_back(patch: pytest.MonkeyPatch) -> None:
    right = adjoint.Adjoint._solve

    def wrong(self: adjoint.Adjoint, side: Floats) -> None:
        right(self, 1.05 * side)

    patch.setattr(adjoint.Adjoint, "_solve", wrong)


def _more_damping(patch: pytest.MonkeyPatch) -> None:
    right = forces.Forces.__init__

    def wrong(self: forces.Forces, weak: weak_form.WeakForm, scheme: Any) -> None:
        tissue = weak.model.tissue
        weak.model = replace(weak.model, tissue=replace(tissue, damping=replace(tissue.damping, alpha=1.05 * tissue.damping.alpha)))
        right(self, weak, scheme)

    patch.setattr(forces.Forces, "__init__", wrong)


def _wrong_energy(patch: pytest.MonkeyPatch) -> None:
    right = measures.EnergyBalance._read

    def wrong(self: measures.EnergyBalance, *forces: Any) -> Any:
        now = right(self, *forces)
        self.balance.elastic *= 1.05
        self.balance.kinetic *= 1.05
        return now

    patch.setattr(measures.EnergyBalance, "_read", wrong)


def _heavier(patch: pytest.MonkeyPatch) -> None:
    right = weak_form.WeakForm.load

    def wrong(self: weak_form.WeakForm, t: float, levels: Any) -> None:
        right(self, t, levels)
        self.gravity.value[:] *= 1.05

    patch.setattr(weak_form.WeakForm, "load", wrong)


def _less_pressure(patch: pytest.MonkeyPatch) -> None:
    right = loads.Pressure.at
    patch.setattr(loads.Pressure, "at", lambda self, t: 0.95 * right(self, t))


def _larger_ball(patch: pytest.MonkeyPatch) -> None:
    right = obstacles.Triangulated.evaluate

    def wrong(self: obstacles.Triangulated, points: Any) -> Any:
        gap, normal, curvature = right(self, points)
        return gap - 0.05 * 5e-3, normal, curvature

    patch.setattr(obstacles.Triangulated, "evaluate", wrong)


def _stiffer_on_two_ranks(patch: pytest.MonkeyPatch) -> None:
    def in_this_process(n: int, home: Path, end: float, changes: tuple[str, ...] = ()) -> Run:
        scenario = load(motion.write_scenario(home, end), [*changes, *(["tissue.c10=201.6"] if n == 2 else [])])
        return simulation_of(scenario, home).run(activation_of(scenario), end)

    patch.setattr(motion, "_on_ranks", in_this_process)


@pytest.mark.parametrize(
    ("name", "spoil", "rows"),
    [
        ("laws", _stiffer, 4),
        ("patch", _stiffer, 1),
        ("manufactured", _stiffer, 2),
        ("cook", _stiffer, 1),
        ("taylor", _stiffer_tangent, 4),
        ("fibres", _stronger, 3),
        ("time", _other_gamma, 3),
        ("decay", _more_damping, 1),
        ("contraction", _wrong_energy, 1),
        ("ranks", _stiffer_on_two_ranks, 2),
        ("gradient", _longer_back, 5),
        ("contact", _stiffer_tangent, 4),
        ("pressed", _stiffer, 3),
        ("hertz", _stiffer, 1),
        ("incline", _heavier, 1),
        ("incline", _wrong_energy, 1),
        ("triangles", _larger_ball, 1),
        ("land", _less_pressure, 1),
        pytest.param("calculix", _stiffer, 2, marks=needs_calculix),
    ],
)
def test_rows_notice_five_percent(
    name: str, spoil: Callable[[pytest.MonkeyPatch], None], rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one constant 5 % off, that many rows fail: all, but for the halved steps, which any constant leaves convergent."""
    spoil(monkeypatch)
    assert sum(not row.holds for row in SHORT[name]()) == rows


def test_skipped_without_calculix(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the other code is missing the row says so instead of passing silently."""
    monkeypatch.setattr(calculix, "CALCULIX", "no-such-program")
    (row,) = calculix.calculix()
    assert row.skipped
    assert "not installed" in row.note


def test_command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The table is printed; a row that fails gives exit code 3, an unknown name 2."""
    with pytest.raises(SystemExit) as leaving:
        main(["verify", "--only", "patch"])
    assert not leaving.value.code
    assert "patch test" in capsys.readouterr().out
    monkeypatch.setitem(CASES, "patch", lambda: iter([Row("a", "b", 2.0, 1.0)]))
    with pytest.raises(SystemExit) as leaving:
        main(["verify", "--only", "patch"])
    assert leaving.value.code == 3
    with pytest.raises(SystemExit) as leaving:
        main(["verify", "--only", "nothing"])
    assert leaving.value.code == 2
