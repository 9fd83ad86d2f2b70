# SPDX-License-Identifier: MIT
"""Fading memories: from the activations of the muscles so far to coordinates of the shape.

Functions of the activations, bounded, are each remembered for a time of their own; functions of these and of the memories once more; the
coordinates are functions of all. Nothing is fed back, so that a network of any weights forgets every beginning, comes to rest in every
hold, and stays at rest where no muscle moves. Several networks answer at once; how much they differ says how far they can be trusted.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

type Weights = Mapping[str, Any]
"""Of `n` networks with `m` muscles: ``W1`` (n, m, h1), ``b1`` (n, 1, h1), ``log_tau1`` (n, 1, h1) in log s; ``W2`` (n, m + h1, h2), ``b2``,
``log_tau2``; ``W3`` (n, m + h1 + h2, h3), ``b3``; ``V`` (n, m + h1 + h2, r) and ``U`` (n, h3, r)."""


def features(weights: Weights, layer: int, seen: Any, tanh: Any = np.tanh) -> Any:
    """Bounded functions of what a layer sees, (n, …, seen) to (n, …, h); nil at rest."""
    b = weights[f"b{layer}"]
    return tanh(seen @ weights[f"W{layer}"] + b) - tanh(b)


def fade(tau: Any, memory: Any, before: Any, now: Any, h: Any, exp: Any = np.exp) -> Any:
    """Memories after `h` seconds in which what they follow went linearly from `before` to `now`: the solution of τ ẋ = z − x."""
    slope = (now - before) / h
    return now - tau * slope + (memory - before + tau * slope) * exp(-h / tau)


def answer(weights: Weights, everything: Any, tanh: Any = np.tanh) -> Any:
    """Coordinates (n, …, r) from activations and memories."""
    return everything @ weights["V"] + features(weights, 3, everything, tanh) @ weights["U"]
