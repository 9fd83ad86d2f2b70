# SPDX-License-Identifier: MIT
"""The rows of ``tongue verify``: every one holds, and fails when a constant of the model is off by 5 %."""

from __future__ import annotations

import shutil

import pytest

from tongue_fenicsx import passive, verify
from tongue_fenicsx.cli import main

needs_calculix = pytest.mark.skipif(shutil.which(verify.CALCULIX) is None, reason="CalculiX (ccx) is not installed")


@pytest.mark.parametrize("name", ["patch", "manufactured", "time", "decay", pytest.param("calculix", marks=needs_calculix)])
def test_rows_hold(name: str) -> None:
    """Each row is within its limit."""
    rows = list(verify.CASES[name]())
    assert rows
    for row in rows:
        assert row.holds, row


@needs_calculix
def test_calculix_notices_a_wrong_stiffness(monkeypatch: pytest.MonkeyPatch) -> None:
    """With C₁₀ 5 % off in our law alone the comparison fails."""
    right = passive.Yeoh.isochoric_energy

    def wrong(self: passive.Yeoh, I1: object, I2: object, parameters: object) -> object:
        return right(self, I1, I2, {**parameters, "c10": 1.05 * parameters["c10"]})

    monkeypatch.setattr(passive.Yeoh, "isochoric_energy", wrong)
    assert not any(row.holds for row in verify.calculix())


def test_skipped_without_calculix(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the other code is missing the row says so instead of passing silently."""
    monkeypatch.setattr(verify, "CALCULIX", "no-such-program")
    (row,) = verify.calculix()
    assert row.skipped
    assert "not installed" in row.note


def test_command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The table is printed; a row that fails gives exit code 3, an unknown name 2."""
    with pytest.raises(SystemExit) as leaving:
        main(["verify", "--only", "patch"])
    assert not leaving.value.code
    assert "patch test" in capsys.readouterr().out
    monkeypatch.setitem(verify.CASES, "patch", lambda: iter([verify.Row("a", "b", 2.0, 1.0)]))
    with pytest.raises(SystemExit) as leaving:
        main(["verify", "--only", "patch"])
    assert leaving.value.code == 3
    with pytest.raises(SystemExit) as leaving:
        main(["verify", "--only", "nothing"])
    assert leaving.value.code == 2
