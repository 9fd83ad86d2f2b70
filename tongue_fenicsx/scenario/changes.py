# SPDX-License-Identifier: MIT
"""Other values of keys of a scenario, as of ``--set`` and of sweeps."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..core.errors import InputError, short
from ..core.values import explain
from .schema import ActivationSection

RISE = 0.1
"""Time in s in which a muscle that was at rest rises to the level that it is given."""


def set_option(data: dict[str, Any], change: str, folder: Path) -> None:
    """Set a key of nested tables as ``--set key.sub=value`` does; paths in them are relative to the folder."""
    key, separator, text = change.partition("=")
    shown = f"--set {short(change)[1:-1]}"
    if not separator or not key or not text.strip():
        raise InputError(f"{shown}: key=value is expected, such as tissue.nu=0.499.")
    try:
        value = toml_value(text)
    except ValueError as error:
        raise InputError(f"{shown}: {error}; a value in TOML is expected.") from error
    set_key(data, key, value, folder, shown)


def toml_value(text: str) -> Any:
    """A value of TOML; a bare word is text.

    Raises
    ------
    ValueError
        If it begins as a list, a table or a text in quotes, but is none.
    """
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError) as error:
        if text.strip()[0] in "[{'\"":
            raise ValueError(" ".join(str(error).split())) from error
        return text


def set_key(data: dict[str, Any], key: str, value: Any, folder: Path, where: str) -> None:
    """Set ``key.sub`` of nested tables; `where` begins the sentence about an error. ``activation.MUSCLE`` may also be pieces, or a number:
    the highest level of the pieces that are there, or one that is reached in `RISE` seconds and held."""
    table, _, muscle = key.partition(".")
    if table == "activation" and muscle and "." not in muscle and isinstance(value, int | float | list):
        before = data["activation"].get(muscle) if isinstance(data.get("activation"), dict) else None
        value = {"pieces": _scaled(before, value, folder, f"{where}: {key}") if isinstance(value, int | float) else value}
    *parents, last = key.split(".")
    here = data
    for parent in parents:
        here = here.setdefault(parent, {})
        if not isinstance(here, dict):
            raise InputError(f"{where}: {parent} is a value, not a table.")
    here[last] = value


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
