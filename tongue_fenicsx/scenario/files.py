# SPDX-License-Identifier: MIT
"""Scenario files."""

from __future__ import annotations

import tomllib
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import BaseModel, ValidationError

from ..core.errors import InputError, reading
from ..geometry.surface import SUFFIXES
from .schema import ActivationSection, ContactSection, MotionSection, Scenario, SuspensionSection


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
        data = tomllib.loads(path.read_text(encoding="utf-8"))
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
        raise InputError(f"{path}: {explain(error)}") from error


def _change(data: dict[str, Any], change: str) -> None:
    key, separator, text = change.partition("=")
    if not separator or not key:
        raise InputError(f"--set {change}: key=value is expected, such as tissue.nu=0.499.")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # a bare word is a string
        value = text
    *parents, last = key.split(".")
    table = data
    for parent in parents:
        table = table.setdefault(parent, {})
        if not isinstance(table, dict):
            raise InputError(f"--set {change}: {parent} is a value, not a table.")
    table[last] = value


def explain(error: ValidationError) -> str:
    """The first error of a validation as a sentence with the key, the fault and what is accepted."""
    first = error.errors()[0]
    where = [part for part in first["loc"] if not (isinstance(part, str) and part.startswith("tuple["))]
    key = ".".join(map(str, where))
    if first["type"] == "extra_forbidden":
        known = _known_keys(where[:-1])
        near = get_close_matches(str(where[-1]), known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}? " if near else ""
        return f"unknown key {key!r}; {hint}Known here: {', '.join(known)}."
    if first["type"] == "missing":
        if isinstance(where[-1], int):
            return f"{'.'.join(map(str, where[:-1]))}: more numbers are expected (given: {first.get('input')!r})."
        return f"the key {key!r} is missing."
    if first["type"] in ("model_type", "dict_type"):
        return f"{key}: a table is expected (given: {first.get('input')!r})."
    if where[0] == "probes" and len(where) > 1:
        return f"{'.'.join(map(str, where[:2]))}: the name of a landmark or three numbers [x, y, z] are expected."
    message = first["msg"].removeprefix("Value error, ")
    given = first.get("input")
    shown = f" (given: {given!r})" if isinstance(given, str | float | int) and not isinstance(given, bool) else ""
    return f"{key or 'scenario'}: {message[0].lower()}{message[1:].rstrip('.')}{shown}."


NAMED: dict[str, type[BaseModel]] = {
    "activation": ActivationSection,
    "contact": ContactSection,
    "moving": MotionSection,
    "suspended": SuspensionSection,
}
"""Tables of tables that the user names."""


def _known_keys(where: list[Any]) -> list[str]:
    model: type[BaseModel] = Scenario
    for part in where:
        field = model.model_fields.get(str(part))
        if field is None:  # a table named by the user
            continue
        if part in NAMED:
            model = NAMED[part]
            continue
        kind = field.annotation
        if not (isinstance(kind, type) and issubclass(kind, BaseModel)):
            continue
        model = kind
    return list(model.model_fields)


def dump(scenario: Scenario) -> str:
    """The scenario as TOML, with all defaults written out."""
    return tomli_w.dumps(scenario.model_dump(exclude_none=True))
