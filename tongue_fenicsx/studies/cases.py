# SPDX-License-Identifier: MIT
"""The scenario of each run of a design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

from ..anatomy.catalogue import base_name
from ..core.errors import InputError, short
from ..scenario.changes import set_key
from ..scenario.files import scenario_of
from ..scenario.schema import Scenario
from .designs import Change


def scenarios(base: Mapping[str, Any], folder: Path, design: Sequence[Change]) -> list[tuple[Scenario, Change]]:
    """The scenario of each run, checked, and what it changes.

    A muscle that any run moves is at rest, not absent, in those that do not move it: so the tendons are the same in all, and
    so are the forms.

    Parameters
    ----------
    base : mapping
        Tables of a scenario.
    folder : Path
        That paths in them are relative to.
    design : sequence of dict
        What each run changes.

    Raises
    ------
    InputError
        If a scenario is not accepted; it says which.
    """
    if not design:
        raise InputError("the design has no runs; one or more are expected.")
    tables = []
    for index, change in enumerate(design):
        where = f"run {index} ({', '.join(f'{key} = {short(value, 40)}' for key, value in change.items())})"
        tables.append((_changed(base, change, folder, where), where))
    named = {name for data, _ in tables if isinstance(data.get("activation"), dict) for name in data["activation"]}
    for data, _ in tables:
        if isinstance(data.get("activation", {}), dict):
            data["activation"] = _with_resting(data.get("activation", {}), named)
    return [(scenario_of(data, folder, where), change) for (data, where), change in zip(tables, design, strict=True)]


def _changed(base: Mapping[str, Any], change: Change, folder: Path, where: str) -> dict[str, Any]:
    """Tables of a scenario with other values of some keys."""
    data: dict[str, Any] = deepcopy(dict(base))
    for key, value in change.items():
        set_key(data, key, value, folder, where)
    return data


def _with_resting(activation: Mapping[str, Any], named: set[str]) -> dict[str, Any]:
    """Activations with those muscles at rest that only others have named, in one order."""
    sided = {base_name(name) for name in named if base_name(name) != name}
    wanted = (named - sided) | {f"{muscle}_{side}" for muscle in sided & named for side in "LR"}
    resting = [name for name in wanted if name not in activation and base_name(name) not in activation]
    both = {**activation, **{name: {"pieces": [(1.0, 0.0, 0.0)]} for name in resting}}
    return {name: both[name] for name in sorted(both)}
