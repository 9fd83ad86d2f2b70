# SPDX-License-Identifier: MIT
"""Callbacks for PETSc that keep nobody alive."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any


def weakly(method: Callable[..., Any]) -> Callable[..., Any]:
    """A bound method, to be called while its object lives. PETSc's objects hold their callbacks where Python's garbage collector does not
    see them: whoever holds such an object and is called by it would live for ever."""
    reference = weakref.WeakMethod(method)

    def call(*arguments: Any) -> Any:
        alive = reference()
        assert alive is not None
        return alive(*arguments)

    return call
