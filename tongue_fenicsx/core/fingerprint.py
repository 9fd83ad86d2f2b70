# SPDX-License-Identifier: MIT
"""What a value is made of, in plain numbers and names, and the hash of it: two values with one fingerprint make the same motion."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError


def describe(value: Any, t_end: float = 0.0) -> Any:
    """A value in plain numbers, texts, lists and dictionaries.

    A dataclass is its type and those of its fields that count in a comparison, so that a new field cannot be forgotten; a value that
    is made of something else states it as its `fingerprint`, and what goes on in time as its `description` until `t_end` (s).

    Raises
    ------
    InputError
        If the value, or one in it, does neither.
    """
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.generic):
        return describe(value.item())
    if isinstance(value, int | float):
        return float(value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray):
        return [list(value.shape), value.dtype.str, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, Mapping):
        return {str(key): describe(part, t_end) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [describe(part, t_end) for part in value]
    kind = type(value).__qualname__
    if hasattr(value, "description"):
        return [kind, describe(value.description(t_end))]
    if hasattr(value, "fingerprint"):
        return [kind, describe(value.fingerprint, t_end)]
    if is_dataclass(value) and not isinstance(value, type):
        return [kind, {item.name: describe(getattr(value, item.name), t_end) for item in fields(value) if item.compare}]
    raise InputError(f"{kind} has no fingerprint; a dataclass, or a property `fingerprint`, is expected.")


def fingerprint(value: Any, t_end: float = 0.0) -> str:
    """Hash of what `describe` says of a value."""
    return hashlib.sha256(json.dumps(describe(value, t_end), sort_keys=True).encode()).hexdigest()


def digest(paths: list[Path]) -> str:
    """Hash of the bytes of those of the files that exist, in this order."""
    return fingerprint({path.suffix: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths if path.is_file()})
