# SPDX-License-Identifier: MIT
"""What a run can leave: fields, history and summary, by one registration each; the standard ones register themselves the same way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError

if TYPE_CHECKING:
    from ..core.types import Floats


@dataclass(frozen=True)
class Quantity:
    """Something that a run leaves.

    Attributes
    ----------
    name : str
        In files; with parts, what comes before their names.
    unit, label : str
        For tables and figures; a unit of ``1`` is a plain number.
    evaluate : callable
        Takes a `snapshot.Snapshot` (fields and history) or a `summary.Ending` (summary) on all ranks at once, and returns the value, or a
        mapping of the names of parts to theirs.
    default : bool
        Whether it is left without being asked for.
    centre : str
        Of a field: ``Node`` (values local and flat, three to a node) or ``Cell`` (a number or a (3, 3) tensor per owned cell).
    """

    name: str
    unit: str
    label: str
    evaluate: Callable[[Any], Any]
    default: bool = True
    centre: str = ""

    def values(self, source: Any) -> dict[str, Any]:
        """Full name to value of every part; empty where there is none."""
        value = self.evaluate(source)
        if value is None:
            return {}
        if not isinstance(value, Mapping):
            return {self.name: value}
        return {f"{self.name}{'_' if self.centre else '/'}{part}": of for part, of in value.items()}


FIELDS: dict[str, Quantity] = {}
"""Stored at every output."""
HISTORY: dict[str, Quantity] = {}
"""Stored after every step."""
SUMMARY: dict[str, Quantity] = {}
"""Keys of ``summary.json``."""

type Register[T] = Callable[[Callable[[Any], T]], Callable[[Any], T]]


def field(
    name: str, *, unit: str, label: str, centre: str = "Cell", default: bool = False
) -> Register[Floats | Mapping[str, Floats] | None]:
    """Register a field (a decorator of its function); it is stored where `Stepping.fields` or ``output.fields`` names it, or by `default`.

    Raises
    ------
    InputError
        If there is a field of this name.
    """
    return _register(FIELDS, name, unit=unit, label=label, centre=centre, default=default)


def history(name: str, *, unit: str, label: str) -> Register[Any]:
    """Register a quantity of the history (a decorator of its function).

    Raises
    ------
    InputError
        If there is one of this name.
    """
    return _register(HISTORY, name, unit=unit, label=label)


def summary(name: str, *, unit: str, label: str) -> Register[Any]:
    """Register a key of the summary (a decorator of its function, whose value is written as JSON).

    Raises
    ------
    InputError
        If there is one of this name.
    """
    return _register(SUMMARY, name, unit=unit, label=label)


def _register(table: dict[str, Quantity], name: str, **facts: Any) -> Register[Any]:
    def register(evaluate: Callable[[Any], Any]) -> Callable[[Any], Any]:
        if name in table:
            raise InputError(f"{name!r} is registered already; another name is expected.")
        table[name] = Quantity(name, evaluate=evaluate, **facts)
        return evaluate

    return register
