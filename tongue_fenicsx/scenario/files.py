# SPDX-License-Identifier: MIT
"""Scenario files."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from ..core.errors import InputError, reading, short
from ..core.values import explain
from ..geometry.surface import SUFFIXES
from .schema import Scenario


def load(path: Path, changes: list[str] | None = None) -> Scenario:
    """Read a scenario and check it.

    Parameters
    ----------
    path : Path
        A TOML file; a mesh file in it is looked for beside it.
    changes : list of str
        ``key.sub=value`` with a TOML value, as of ``--set``.

    Raises
    ------
    InputError
        If the file is missing or not TOML, or a key or value is not accepted.
    """
    with reading(path, "a scenario in TOML"):
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    for change in changes or []:
        _change(data, change)
    source = data.get("mesh")
    if isinstance(source, dict):
        for key in ("file", "subject"):
            if isinstance(source.get(key), str):
                source[key] = str(path.parent / source[key])
    for section in data["contact"].values() if isinstance(data.get("contact"), dict) else ():
        if isinstance(section, dict) and isinstance(section.get("surface"), str) and Path(section["surface"]).suffix in SUFFIXES:
            section["surface"] = str(path.parent / section["surface"])
    for section in data["activation"].values() if isinstance(data.get("activation"), dict) else ():
        if isinstance(section, dict) and isinstance(section.get("table"), str):
            section["table"] = str(path.parent / section["table"])
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, Scenario)}") from error


def _change(data: dict[str, Any], change: str) -> None:
    key, separator, text = change.partition("=")
    shown = f"--set {short(change)[1:-1]}"
    if not separator or not key or not text.strip():
        raise InputError(f"{shown}: key=value is expected, such as tissue.nu=0.499.")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError) as error:
        if text.strip()[0] in "[{'\"":
            raise InputError(f"{shown}: {' '.join(str(error).split())}; a value in TOML is expected.") from error
        value = text  # a bare word is a string
    *parents, last = key.split(".")
    table = data
    for parent in parents:
        table = table.setdefault(parent, {})
        if not isinstance(table, dict):
            raise InputError(f"{shown}: {parent} is a value, not a table.")
    table[last] = value


def dump(scenario: Scenario) -> str:
    """The scenario as TOML, with all defaults written out."""
    return tomli_w.dumps(scenario.model_dump(exclude_none=True))
