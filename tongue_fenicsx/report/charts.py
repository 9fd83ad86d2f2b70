# SPDX-License-Identifier: MIT
"""Line charts as inline SVG; colours come from the page's style."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from ..core.types import Floats
from .motion import evenly
from .templating import render

WIDTH, HEIGHT = 520, 300
LEFT, RIGHT, TOP, BOTTOM = 58, 12, 10, 44
COLOURS, DASHES = 8, 3
"""Of the style; together they tell 24 lines apart, also where one hides another."""
POINTS = 1000
"""Of a line that are drawn at most."""


@dataclass(frozen=True)
class Line:
    """A named curve, x and y (n,)."""

    name: str
    x: Floats
    y: Floats


def chart(title: str, x_label: str, y_label: str, lines: Sequence[Line], *, equal: bool = False, over_time: bool = False) -> Markup:
    """A figure as HTML with a caption and, for more than one line, a legend.

    Parameters
    ----------
    title, x_label, y_label : str
        Plain text.
    lines : sequence of Line
        At least one.
    equal : bool
        Both axes in the same scale; a ring marks where each line ends.
    over_time : bool
        x is time in ms: the chart gets a mark that the viewer moves.
    """
    x_range = _span(np.concatenate([line.x for line in lines]), 0.0 if over_time else 0.06)
    y_range = _span(np.concatenate([line.y for line in lines]), 0.06)
    width, height = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM
    if equal:
        scale = max((x_range[1] - x_range[0]) / width, (y_range[1] - y_range[0]) / height)
        x_range, y_range = _widen(x_range, scale * width), _widen(y_range, scale * height)

    def across(x: Floats) -> Floats:
        return np.asarray(LEFT + width * (x - x_range[0]) / (x_range[1] - x_range[0]))

    def up(y: Floats) -> Floats:
        return np.asarray(TOP + height * (y_range[1] - y) / (y_range[1] - y_range[0]))

    return render(
        "chart.html",
        title=title,
        x_label=x_label,
        y_label=y_label,
        size=(WIDTH, HEIGHT),
        left=LEFT,
        right=LEFT + width,
        top=TOP,
        bottom=TOP + height,
        x_ticks=[(f"{across(value):.1f}", _number(value)) for value in _ticks(*x_range)],
        y_ticks=[(f"{up(value):.1f}", _number(value)) for value in _ticks(*y_range)],
        lines=[_describe(number, line, across, up) for number, line in enumerate(lines)],
        rings=equal,
        span=x_range if over_time else None,
    )


def _describe(number: int, line: Line, across: Callable[[Floats], Floats], up: Callable[[Floats], Floats]) -> dict[str, Any]:
    """A line as the template takes it."""
    kept = evenly(len(line.x), POINTS)
    places = [f"{x:.1f},{y:.1f}" for x, y in zip(across(line.x[kept]), up(line.y[kept]), strict=True)]
    style = f"c{number % COLOURS} d{number % DASHES}"
    return {"name": line.name, "style": style, "points": " ".join(places), "end": places[-1].split(",")}


def _span(values: Floats, margin: float) -> tuple[float, float]:
    """From the smallest to the largest value and a share of that beyond; never empty."""
    low, high = float(values.min()), float(values.max())
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        low, high = low - (0.1 * abs(low) or 1.0), high + (0.1 * abs(high) or 1.0)
    return low - margin * (high - low), high + margin * (high - low)


def _widen(ends: tuple[float, float], length: float) -> tuple[float, float]:
    middle = sum(ends) / 2
    return middle - length / 2, middle + length / 2


def _ticks(low: float, high: float) -> Floats:
    """Round numbers from low to high, three to eight."""
    rough = (high - low) / 6
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough * (1 - 1e-9))
    return np.asarray(step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) + 0.0)  # no −0


def _number(value: float) -> str:
    return f"{value:.6g}".replace("-", "−")
