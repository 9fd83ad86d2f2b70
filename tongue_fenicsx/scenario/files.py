# SPDX-License-Identifier: MIT
"""Scenario files."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from ..core.errors import InputError, reading
from ..core.values import explain
from ..geometry.surface import SUFFIXES
from .changes import set_option
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
        set_option(data, change, path.parent)
    if "base" in data:
        raise InputError(f"{path}: base: it is a key of a file for tongue sweep or tongue fit; a scenario is expected.")
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
    _each_path(data, lambda path: str(folder / path))
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{where}: {explain(error, Scenario)}") from error


def dump(scenario: Scenario, folder: Path | None = None) -> str:
    """The scenario as TOML, with all defaults written out, and paths in it from where it will lie, if that is not the working directory."""
    data = scenario.model_dump(exclude_none=True)
    if folder is not None:
        _each_path(data, lambda path: os.path.relpath(path, folder))
    return tomli_w.dumps(data)


def _each_path(data: dict[str, Any], change: Callable[[str], str]) -> None:
    """Change the paths that tables of a scenario hold."""
    places: list[tuple[Any, str]] = [(data.get("mesh"), key) for key in ("file", "subject")]
    for name, key in (("contact", "surface"), ("activation", "table")):
        sections = data.get(name)
        places += [(section, key) for section in (sections.values() if isinstance(sections, dict) else ())]
    for section, key in places:
        path = section.get(key) if isinstance(section, dict) else None
        if isinstance(path, str) and (key != "surface" or Path(path).suffix.lower() in SUFFIXES):
            section[key] = change(path)
