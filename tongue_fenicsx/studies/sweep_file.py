# SPDX-License-Identifier: MIT
"""Sweep files: a base scenario and what is varied in it; and the same from options of the command line."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ValidationError, model_validator

from ..core.errors import InputError
from ..core.values import Duration, Number, OneOf, Real, Seconds, Seed, Share, explain
from ..scenario.changes import set_option, toml_value
from ..scenario.files import read_toml
from ..scenario.schema import Section
from . import designs
from .designs import Change

Count = Annotated[int, Real(low=1, high=1_000_000, whole=True)]

RANGE = re.compile(r"([^:,\[\]]+):([^:,\[\]]+):(\d+)")
"""First value, last value and how many, as in ``0.1:1.0:10``."""


def _ascending(name: str, bounds: Sequence[float]) -> None:
    if not bounds[0] < bounds[1]:
        raise ValueError(f"{name}: {list(bounds)}; the smaller bound comes first")


class SampleSection(Section):
    """Points between bounds of keys."""

    n: Count
    seed: Seed = 0
    method: Annotated[str, OneOf(names=designs.SAMPLERS)] = "latin_hypercube"
    between: Mapping[str, tuple[Number, Number]]

    @model_validator(mode="before")
    @classmethod
    def _flat(cls, data: Any) -> Any:
        return data | {"between": _flatten(data["between"])} if isinstance(data, dict) and isinstance(data.get("between"), dict) else data

    @model_validator(mode="after")
    def _bounds(self) -> SampleSection:
        for name, bounds in self.between.items():
            _ascending(name, bounds)
        return self


class RandomSection(Section):
    """Random activations: see `designs.random_activations`."""

    n: Count
    seed: Seed = 0
    muscles: list[str]
    level: tuple[Share, Share] = (0.0, 1.0)
    spacing: tuple[Duration, Duration] = (0.05, 0.15)
    rest: Share = 0.3
    hold: Share = 0.0
    grid: Seconds = 1e-5
    sides: Annotated[str, OneOf(names=designs.SIDES)] = "together"

    @model_validator(mode="after")
    def _bounds(self) -> RandomSection:
        _ascending("level", self.level)
        _ascending("spacing", self.spacing)
        return self


class SweepFile(Section):
    """A base, and one or more designs; every run of each is combined with every one of the others."""

    base: Any
    vary: Mapping[str, Any] = {}
    table: str | None = None
    sample: SampleSection | None = None
    random_activations: RandomSection | None = None


def _flatten(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Nested tables as one with keys like ``tissue.c10``."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        flat |= _flatten(value, f"{before}{key}.") if isinstance(value, dict) else {before + key: value}
    return flat


def load(path: Path, changes: Sequence[str] | None = None) -> tuple[dict[str, Any], Path, list[Change]]:
    """Read a sweep file.

    Parameters
    ----------
    path : Path
        A TOML file; paths in it are relative to it, those in a base file to that.
    changes : sequence of str
        ``key.sub=value`` of the base, as of ``--set``.

    Returns
    -------
    tuple
        The tables of the base, the folder that its paths are relative to, and the design.

    Raises
    ------
    InputError
        If a file cannot be read, or a key or value is not accepted.
    """
    data = read_toml(path, "a sweep in TOML")
    if isinstance(data.get("vary"), dict):
        data["vary"] = _flatten(data["vary"])
    try:
        file = SweepFile.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, SweepFile)}") from error
    base, folder = base_of(file.base, path, changes)
    if not (file.vary or file.table or file.sample or file.random_activations):
        raise InputError(f"{path}: nothing is varied; one or more of vary, table, sample and random_activations are expected.")
    for drawn in (file.sample, file.random_activations):
        if drawn is not None:
            base["seed"] = drawn.seed
    parts: list[list[Change]] = []
    if file.table is not None:
        parts.append(designs.from_table(path.parent / file.table))
    if file.vary:
        parts.append(designs.factorial({key: _levels(value, f"{path}: vary.{key}") for key, value in file.vary.items()}))
    if (sample := file.sample) is not None:
        parts.append(designs.sampled(sample.between, sample.n, sample.seed, sample.method))
    if (given := file.random_activations) is not None:
        end = base["time"].get("end") if isinstance(base.get("time"), dict) else None
        if not isinstance(end, int | float):
            raise InputError(f"{path}: random_activations: a base with a number as time.end is expected.")
        distribution = {name: getattr(given, name) for name in ("level", "spacing", "rest", "hold", "grid", "sides")}
        parts.append(designs.random_activations(given.muscles, given.n, given.seed, end, **distribution))
    return base, folder, designs.product(*parts)


def from_options(path: Path, vary: Sequence[str], changes: Sequence[str] | None = None) -> tuple[dict[str, Any], Path, list[Change]]:
    """The same from a scenario and options ``key=value,value,…`` or ``key=first:last:number``.

    Raises
    ------
    InputError
        If the file cannot be read, or an option is not of this form.
    """
    base, folder = _base(path)
    _change(base, changes, folder)
    levels: dict[str, list[Any]] = {}
    for option in vary:
        key, separator, text = option.partition("=")
        if not separator or not key or not text:
            raise InputError(f"--vary {option}: key=value,value,… or key=first:last:number is expected, such as tissue.c10=192,400,1037.")
        if key in levels:
            raise InputError(f"--vary {option}: {key} is varied twice.")
        levels[key] = _levels(text if RANGE.fullmatch(text) else _several(text), f"--vary {key}")
    return base, folder, designs.factorial(levels)


def _several(text: str) -> list[Any]:
    """Values of TOML, or bare words, between commas."""
    try:
        return list(toml_value(f"[{text}]"))
    except ValueError:
        return text.split(",")


def base_of(base: Any, path: Path, changes: Sequence[str] | None) -> tuple[dict[str, Any], Path]:
    """The tables of a base, given so or by its file, with changes, and the folder that its paths are relative to.

    Raises
    ------
    InputError
        If it is neither, or cannot be read; beginning with the `path` of the file that has it.
    """
    if not isinstance(base, str | dict):
        raise InputError(f"{path}: base: {base!r}; the file of a scenario, or its tables, are expected.")
    data, folder = (base, path.parent) if isinstance(base, dict) else _base(path.parent / base)
    _change(data, changes, folder)
    return data, folder


def _base(path: Path) -> tuple[dict[str, Any], Path]:
    return read_toml(path, "a scenario in TOML"), path.parent


def _change(base: dict[str, Any], changes: Sequence[str] | None, folder: Path) -> None:
    for change in changes or ():
        set_option(base, change, folder)


def _levels(value: Any, where: str) -> list[Any]:
    """A list of values, or those of a range."""
    if isinstance(value, list) and value:
        return value
    if isinstance(value, str) and (found := RANGE.fullmatch(value)):
        try:
            first, last, n = float(found[1]), float(found[2]), int(found[3])
        except ValueError:
            n = 0
        if n >= 2:
            return [float(f"{level:.12g}") for level in np.linspace(first, last, n)]
    raise InputError(f"{where}: {value!r}; a list of values, or first:last:number as 0.1:1.0:10, is expected.")
