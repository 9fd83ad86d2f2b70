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
    data = read_toml(path, "a scenario in TOML")
    for change in changes or []:
        set_option(data, change)
    return scenario_of(data, path.parent, str(path))


def read_toml(path: Path, expected: str) -> dict[str, Any]:
    """What a TOML file holds.

    Raises
    ------
    InputError
        If it is missing or not TOML.
    """
    with reading(path, expected):
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))


def scenario_of(data: dict[str, Any], folder: Path, where: str) -> Scenario:
    """The scenario that tables of TOML describe.

    Parameters
    ----------
    data : dict
        The tables; paths in them are then those from the working directory.
    folder : Path
        From where they were before.
    where : str
        Begins the sentence about an error.

    Raises
    ------
    InputError
        If a key or value is not accepted.
    """
    source = data.get("mesh")
    if isinstance(source, dict):
        for key in ("file", "subject"):
            if isinstance(source.get(key), str):
                source[key] = str(folder / source[key])
    for section in data["contact"].values() if isinstance(data.get("contact"), dict) else ():
        if isinstance(section, dict) and isinstance(section.get("surface"), str) and Path(section["surface"]).suffix.lower() in SUFFIXES:
            section["surface"] = str(folder / section["surface"])
    for section in data["activation"].values() if isinstance(data.get("activation"), dict) else ():
        if isinstance(section, dict) and isinstance(section.get("table"), str):
            section["table"] = str(folder / section["table"])
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{where}: {explain(error, Scenario)}") from error


def set_option(data: dict[str, Any], change: str) -> None:
    """Set a key of nested tables as ``--set key.sub=value`` does."""
    key, separator, text = change.partition("=")
    shown = f"--set {short(change)[1:-1]}"
    if not separator or not key or not text.strip():
        raise InputError(f"{shown}: key=value is expected, such as tissue.nu=0.499.")
    try:
        value = toml_value(text)
    except ValueError as error:
        raise InputError(f"{shown}: {error}; a value in TOML is expected.") from error
    set_key(data, key, value, shown)


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


def set_key(data: dict[str, Any], key: str, value: Any, where: str) -> None:
    """Set ``key.sub`` of nested tables; `where` begins the sentence about an error."""
    *parents, last = key.split(".")
    table = data
    for parent in parents:
        table = table.setdefault(parent, {})
        if not isinstance(table, dict):
            raise InputError(f"{where}: {parent} is a value, not a table.")
    table[last] = value


def dump(scenario: Scenario) -> str:
    """The scenario as TOML, with all defaults written out."""
    return tomli_w.dumps(scenario.model_dump(exclude_none=True))
