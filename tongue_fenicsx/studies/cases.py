# SPDX-License-Identifier: MIT
"""The scenario of each run of a design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..anatomy.catalogue import base_name
from ..core.errors import InputError, short
from ..core.values import explain
from ..scenario.files import scenario_of, set_key
from ..scenario.schema import ActivationSection, Scenario
from .designs import Change

RISE = 0.1
"""Time in s in which a muscle that the base leaves at rest rises to the level that a design gives it."""


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
        tables.append((changed(base, change, folder, where), where))
    named = {name for data, _ in tables if isinstance(data.get("activation"), dict) for name in data["activation"]}
    for data, _ in tables:
        if isinstance(data.get("activation", {}), dict):
            data["activation"] = _with_resting(data.get("activation", {}), named)
    return [(scenario_of(data, folder, where), change) for (data, where), change in zip(tables, design, strict=True)]


def changed(base: Mapping[str, Any], change: Change, folder: Path, where: str) -> dict[str, Any]:
    """Tables of a scenario with other values of some keys; ``activation.MUSCLE`` may be a number (see `sweep`) or pieces."""
    data: dict[str, Any] = deepcopy(dict(base))
    for key, value in change.items():
        table, _, muscle = key.partition(".")
        if table == "activation" and "." not in muscle and not isinstance(value, dict):
            before = data.get("activation", {}).get(muscle)
            value = {"pieces": _scaled(before, value, folder, f"{where}: {key}") if isinstance(value, int | float) else value}
        set_key(data, key, value, where)
    return data


def _scaled(section: Any, level: float, folder: Path, where: str) -> list[tuple[float, float, float]]:
    """The pieces of a section of activation with their highest level at `level`."""
    if section is None:
        return [(RISE, 0.0, level)]
    if isinstance(section, dict) and isinstance(section.get("table"), str):
        section = section | {"table": str(folder / section["table"])}
    try:
        pieces = ActivationSection.model_validate(section).course().pieces
    except ValidationError as error:
        raise InputError(f"{where}: {explain(error, ActivationSection)}") from error
    highest = max(max(start, target) for _, start, target in pieces)
    if highest == 0:
        return [(RISE, 0.0, level)]
    return [(duration, level * (start / highest), level * (target / highest)) for duration, start, target in pieces]


def _with_resting(activation: Mapping[str, Any], named: set[str]) -> dict[str, Any]:
    """Activations with those muscles at rest that only others have named, in one order."""
    sided = {base_name(name) for name in named if base_name(name) != name}
    wanted = (named - sided) | {f"{muscle}_{side}" for muscle in sided & named for side in "LR"}
    resting = [name for name in wanted if name not in activation and base_name(name) not in activation]
    both = {**activation, **{name: {"pieces": [(1.0, 0.0, 0.0)]} for name in resting}}
    return {name: both[name] for name in sorted(both)}
