# SPDX-License-Identifier: MIT
"""What the fields of a value accept, said once: by its type, for Python and for files alike.

A field of a value is annotated with one of these types; `checked` holds values made in Python to them, pydantic those read from a
file, with the same sentence. Lengths carry the unit m, by which `in_metres` finds them.
"""

from __future__ import annotations

import math
import numbers
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from difflib import get_close_matches
from functools import cache, partial
from types import UnionType
from typing import Annotated, Any, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, TypeAdapter, ValidationError
from pydantic_core import CoreSchema, core_schema

from .errors import InputError, short


@dataclass(frozen=True)
class Accepts(ABC):
    """What a field accepts, as metadata of its type.

    Attributes
    ----------
    unit : str
        Of the number.
    label : str
        What it is called in tables and pictures.
    """

    unit: str = ""
    label: str = ""

    @property
    @abstractmethod
    def expected(self) -> str:
        """How a sentence ends that refuses a value."""

    @abstractmethod
    def take(self, value: Any) -> Any:
        """The value as it is kept; None if it is not accepted."""

    def check(self, value: Any) -> Any:
        """The value as it is kept.

        Raises
        ------
        ValueError
            If it is not accepted.
        """
        taken = self.take(value)
        if taken is None:
            unit = f" {self.unit}" if self.unit and isinstance(value, numbers.Real) else ""
            raise ValueError(f"{short(value)}{unit}; {self.expected} expected")
        return taken

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """A check is all that pydantic needs to know."""
        return core_schema.no_info_plain_validator_function(self.check)


@dataclass(frozen=True)
class Real(Accepts):
    """A finite number from `low` to `high`; whether they count themselves say `above` and `below`."""

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    below: bool = False
    whole: bool = False

    @property
    def expected(self) -> str:
        """As of `Accepts`."""
        number = "whole number" if self.whole else "length" if self.unit == "m" else "number"
        if math.isinf(self.low) and math.isinf(self.high):
            return f"a {number} is"
        if math.isinf(self.high) and self.low == 0:
            return f"a positive {number} is" if self.above else f"zero or a positive {number} is"
        low, high = f"{self.low:g}", f"{self.high:g}{f' {self.unit}' if self.unit else ''}"
        if not (self.above or self.below):
            return f"a {number} from {low} to {high} is"
        end = "and below" if self.below else "and up to"
        return f"a {number} {'above' if self.above else 'from'} {low} {end} {high} is"

    def take(self, value: Any) -> float | int | None:
        """As of `Accepts`."""
        if isinstance(value, bool) or not isinstance(value, numbers.Integral if self.whole else numbers.Real):
            return None
        try:
            finite = math.isfinite(value)
        except OverflowError:  # an integer of hundreds of digits
            return None
        number: float | int = int(cast(Any, value)) if self.whole else float(value)
        inside = (self.low < number if self.above else self.low <= number) and (number < self.high if self.below else number <= self.high)
        return number if finite and inside else None


@dataclass(frozen=True)
class Vector(Accepts):
    """Three finite numbers; or, where `named`, the name of a landmark."""

    named: bool = False

    @property
    def expected(self) -> str:
        """As of `Accepts`."""
        return "the name of a landmark or three numbers [x, y, z] are" if self.named else "three numbers are"

    def take(self, value: Any) -> tuple[float, ...] | str | None:
        """As of `Accepts`."""
        if isinstance(value, str):
            return value if self.named else None
        if not isinstance(value, Sequence | np.ndarray) or len(value) != 3:
            return None
        taken = [Real().take(part) for part in value]
        return None if None in taken else cast(tuple[float, ...], tuple(taken))


@dataclass(frozen=True)
class OneOf(Accepts):
    """One of some names or numbers, which may grow."""

    names: Collection[Any] = ()

    def __hash__(self) -> int:
        """Of the names, which may be a table, for `typing` hashes what it joins."""
        return hash(tuple(self.names))

    @property
    def expected(self) -> str:
        """As of `Accepts`."""
        return f"one of {', '.join(map(str, self.names))} is"

    def take(self, value: Any) -> Any:
        """As of `Accepts`."""
        return value if isinstance(value, str | int) and not isinstance(value, bool) and value in self.names else None


@dataclass(frozen=True)
class _Flag(Accepts):
    """True or false."""

    @property
    def expected(self) -> str:
        """As of `Accepts`."""
        return "true or false is"

    def take(self, value: Any) -> bool | None:
        """As of `Accepts`."""
        return bool(value) if isinstance(value, bool | np.bool_) else None


@dataclass(frozen=True)
class _Name(Accepts):
    """What can be a name in files, tables and pictures."""

    @property
    def expected(self) -> str:
        """As of `Accepts`."""
        return "a name of up to 64 letters, digits, spaces and _ - + . ( ), which begins with a letter or digit, is"

    def take(self, value: Any) -> str | None:
        """As of `Accepts`."""
        return value if isinstance(value, str) and re.fullmatch(r"\w[\w .+()-]{0,63}", value) else None


UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
"""Units of length of files, in m."""

Number = Annotated[float, Real()]
Positive = Annotated[float, Real(low=0, above=True)]
NotNegative = Annotated[float, Real(low=0)]
Share = Annotated[float, Real(low=0, high=1)]
Below1 = Annotated[float, Real(low=0, high=1, above=True, below=True)]
Seconds = Annotated[float, Real("s", low=1e-6, high=100)]
"""Times that make sense for a tongue, so that no run is endless by a slip."""
Duration = Annotated[float, Real("s", low=0, above=True)]
Seed = Annotated[int, Real(low=0, high=2**63, whole=True)]
Rise = Annotated[float, Real("s", low=0, high=100)]
Length = Annotated[float, Real("m", low=0, above=True)]
Point = Annotated[Sequence[float], Vector("m")]
Direction = Annotated[Sequence[float], Vector()]
Flag = Annotated[bool, _Flag()]
Name = Annotated[str, _Name()]


def checked[T](where: str) -> Callable[[type[T]], type[T]]:
    """Hold a dataclass to the types of its fields; stands below ``@dataclass``.

    Parameters
    ----------
    where : str
        What the value is called in a sentence that refuses a field.

    Raises
    ------
    InputError
        When a value is made with what a field does not accept.
    """

    def wrap(cls: type[T]) -> type[T]:
        whole = getattr(cls, "__post_init__", None)

        def post_init(self: Any) -> None:
            for name, check in _checks(cast(Hashable, type(self))).items():
                try:
                    value = check(getattr(self, name))
                except ValidationError as error:
                    raise InputError(explain(error, type(self), [where, name])) from error
                except ValueError as error:
                    raise InputError(f"{where}.{name}{'.' if isinstance(error, _Within) else ': '}{error}.") from error
                object.__setattr__(self, name, tuple(value) if isinstance(value, list) else value)
            if whole is not None:
                whole(self)

        cls.__post_init__ = post_init  # type: ignore[attr-defined]
        cls.__pydantic_config__ = CONFIG  # type: ignore[attr-defined]
        return cls

    return wrap


CONFIG = ConfigDict(extra="forbid", arbitrary_types_allowed=True)


@cache
def _checks(cls: Any) -> dict[str, Callable[[Any], Any]]:
    types = get_type_hints(cls, include_extras=True)
    return {item.name: _check(types[item.name]) for item in fields(cls) if _says(types[item.name])}


def _says(hint: Any) -> bool:
    """Whether a type says what is accepted, or one in it."""
    checks = isinstance(hint, Accepts) or hasattr(hint, "__pydantic_config__") or getattr(hint, "_is_runtime_protocol", False)
    return checks or any(_says(part) for part in get_args(hint))


def _check(hint: Any) -> Callable[[Any], Any]:
    """What holds a value to a type; pydantic where sequences and choices are nested, which takes it longer to prepare."""
    simple = next((part for part in getattr(hint, "__metadata__", ()) if isinstance(part, Accepts)), None)
    if simple is not None:
        return simple.check
    if isinstance(hint, type):
        return partial(_instance, hint)
    if get_origin(hint) is Mapping:
        return partial(_mapping, *map(_check, get_args(hint)))
    return TypeAdapter(hint, config=ConfigDict(arbitrary_types_allowed=True)).validate_python


def _instance(kind: type, value: Any) -> Any:
    if not isinstance(value, kind):
        raise ValueError(f"{type(value).__name__} is given, {kind.__name__} is expected")
    return value


def _mapping(named: Callable[[Any], Any], check: Callable[[Any], Any], value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise ValueError(f"{type(value).__name__} is given, a mapping of names is expected")
    checked = {}
    for name, part in value.items():
        named(name)
        try:
            checked[name] = check(part)
        except ValueError as error:
            raise _Within(f"{name}{'.' if isinstance(error, _Within) else ': '}{error}") from error
    return checked


def check_name(where: str, name: Any) -> None:
    """Hold a name to what a `Name` accepts.

    Raises
    ------
    InputError
        Beginning with where the name stands.
    """
    try:
        _Name().check(name)
    except ValueError as error:
        raise InputError(f"{where}: {error}.") from error


def text(value: str | bytes) -> str:
    """A text of an HDF5 file, of fixed or of any length."""
    return value.decode() if isinstance(value, bytes) else str(value)


class _Within(ValueError):
    """The fault is in a part, which the sentence begins with."""


def explain(error: ValidationError, root: Any, where: Sequence[Any] = ()) -> str:
    """The first error of a validation as a sentence with the key, the fault and what is accepted.

    Parameters
    ----------
    error : ValidationError
        Of pydantic.
    root : type
        What was validated, whose keys are suggested for an unknown one.
    where : sequence of str
        Where it stands.
    """
    first = error.errors()[0]
    unknown = first["type"] in ("extra_forbidden", "unexpected_keyword_argument")
    place = first["loc"][:-2] if first["loc"][-1:] == ("[key]",) and not unknown else first["loc"]
    inner = [part for part in place if not (isinstance(part, str) and re.fullmatch(r"[a-z-]+\[.*\]", part))]
    path = [*where, *inner]
    key, given = ".".join(part if len(part) <= 80 else f"{part[:79]}…" for part in map(str, path)), first.get("input")
    if unknown:
        known = keys(kind_at(root, inner[:-1]))
        near = get_close_matches(str(path[-1])[:80], known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}? " if near else ""
        return f"unknown key {key!r}; {hint}Known here: {', '.join(known)}."
    if first["type"] == "missing":
        if isinstance(path[-1], int):
            return f"{'.'.join(map(str, path[:-1]))}: more numbers are expected (given: {short(given)})."
        return f"the key {key!r} is missing."
    if first["type"] in ("dataclass_type", "is_instance_of") and not isinstance(given, str | float | int | list):
        wanted = first["ctx"].get("class_name") or first["ctx"]["class"]
        return f"{key}: {type(given).__name__} is given, {wanted} is expected."
    if first["type"] in ("model_type", "dict_type", "dataclass_type", "mapping_type"):
        return f"{key or 'scenario'}: a table is expected (given: {short(given)})."
    if first["type"] in ("list_type", "tuple_type", "sequence_str"):
        return f"{key}: a list is expected (given: {short(given)})."
    if first["type"] in ("too_short", "too_long"):
        least, most = first["ctx"].get("min_length"), first["ctx"].get("max_length")
        counted = f"at least {least}" if first["type"] == "too_short" else f"at most {most}"
        return f"{key}: {counted} entries are expected (given: {short(given)})."
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "value_error":
        return f"{key or 'scenario'}: {message.rstrip('.')}."
    return f"{key or 'scenario'}: {message[0].lower()}{message[1:].rstrip('.')} (given: {short(given)})."


def keys(kind: Any) -> list[str]:
    """The keys of a table."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return list(kind.model_fields)
    return [item.name for item in fields(kind)]


@cache
def hints(kind: Any) -> dict[str, Any]:
    """Type of each key of a table."""
    if isinstance(kind, type) and (issubclass(kind, BaseModel) or is_dataclass(kind)):
        return {name: hint for name, hint in get_type_hints(kind, include_extras=True).items() if name in keys(kind)}
    return {}


def kind_at(root: Any, where: Sequence[Any]) -> Any:
    """The type of the table that stands at a place."""
    kind = root
    for part in where:
        kind = _table(kind)
        kind = hints(kind).get(part, kind) if hints(kind) else get_args(kind)[-1]
    return _table(kind)


def _table(hint: Any) -> Any:
    """The type without what may be said of it and without None."""
    if get_origin(hint) is Annotated:
        return _table(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType):
        return _table(next(arm for arm in get_args(hint) if arm is not type(None)))
    return getattr(hint, "__value__", hint)


def in_metres(hint: Any, data: Any) -> Any:
    """Data of a type, given with lengths in mm, with lengths in m; what is not of the type stays as it is."""
    if get_origin(hint) is Annotated:
        inner, *said = get_args(hint)
        return _scaled(data) if any(isinstance(part, Accepts) and part.unit == "m" for part in said) else in_metres(inner, data)
    if get_origin(hint) in (Union, UnionType):
        return in_metres(next(arm for arm in get_args(hint) if arm is not type(None)), data)
    origin = get_origin(hint)
    if isinstance(data, dict):
        if origin is not None and issubclass(origin, Mapping):
            return {name: in_metres(get_args(hint)[1], part) for name, part in data.items()}
        known = hints(hint)
        return {name: in_metres(known.get(name), part) for name, part in data.items()}
    if isinstance(data, list) and origin is tuple:
        return [*(in_metres(part, of) for part, of in zip(get_args(hint), data, strict=False)), *data[len(get_args(hint)) :]]
    if isinstance(data, list) and origin is not None:
        return [in_metres(get_args(hint)[0], part) for part in data]
    return data


def _scaled(data: Any) -> Any:
    if isinstance(data, list):
        return [_scaled(part) for part in data]
    return 1e-3 * data if isinstance(data, int | float) and not isinstance(data, bool) else data
