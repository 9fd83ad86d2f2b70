# SPDX-License-Identifier: MIT
"""Line charts as inline SVG; colours come from the page's style."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from ..core.types import Floats
from .motion import evenly

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


def chart(title: str, x_label: str, y_label: str, lines: Sequence[Line], *, equal: bool = False, over_time: bool = False) -> str:
    """A figure with a caption and, for more than one line, a legend.

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
        x_range, y_range = _widened(x_range, scale * width), _widened(y_range, scale * height)

    def across(x: Floats) -> Floats:
        return np.asarray(LEFT + width * (x - x_range[0]) / (x_range[1] - x_range[0]))

    def up(y: Floats) -> Floats:
        return np.asarray(TOP + height * (y_range[1] - y) / (y_range[1] - y_range[0]))

    parts = []
    for value in _ticks(*x_range):
        at = f"{across(value):.1f}"
        parts.append(f'<path class="grid" d="M{at} {TOP}V{TOP + height}"/>')
        parts.append(f'<text x="{at}" y="{TOP + height + 16}" text-anchor="middle">{_number(value)}</text>')
    for value in _ticks(*y_range):
        at = f"{up(value):.1f}"
        parts.append(f'<path class="grid" d="M{LEFT} {at}H{LEFT + width}"/>')
        parts.append(f'<text x="{LEFT - 7}" y="{at}" dy="0.35em" text-anchor="end">{_number(value)}</text>')
    parts.append(f'<text x="{LEFT + width / 2}" y="{HEIGHT - 6}" text-anchor="middle">{escape(x_label)}</text>')
    parts.append(f'<text transform="translate(12 {TOP + height / 2}) rotate(-90)" text-anchor="middle">{escape(y_label)}</text>')
    for number, line in enumerate(lines):
        kept = evenly(len(line.x), POINTS)
        places = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across(line.x[kept]), up(line.y[kept]), strict=True))
        parts.append(f'<polyline class="line {_style(number)}" points="{places}"/>')
        if equal:
            x, y = places.split()[-1].split(",")
            parts.append(f'<circle class="line {_style(number)}" cx="{x}" cy="{y}" r="3.5"/>')
    ends = ""
    if over_time:
        parts.append(f'<path class="now" d="M0 {TOP}V{TOP + height}"/>')
        ends = f' data-from="{x_range[0]}" data-to="{x_range[1]}" data-left="{LEFT}" data-width="{width}"'
    names = ", ".join(line.name for line in lines)
    alt = escape(f"{title}: {y_label} against {x_label}; {names}.")
    picture = f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{alt}"{ends}>{"".join(parts)}</svg>'
    legend = "".join(f'<li class="{_style(number)}">{escape(line.name)}</li>' for number, line in enumerate(lines))
    keys = f'<ul class="legend">{legend}</ul>' if len(lines) > 1 else ""
    return f'<figure class="chart"><figcaption>{escape(title)}</figcaption>{picture}{keys}</figure>'


def _style(number: int) -> str:
    return f"c{number % COLOURS} d{number % DASHES}"


def _span(values: Floats, margin: float) -> tuple[float, float]:
    """From the smallest to the largest value and a share of that beyond; never empty."""
    low, high = float(values.min()), float(values.max())
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        low, high = low - (0.1 * abs(low) or 1.0), high + (0.1 * abs(high) or 1.0)
    return low - margin * (high - low), high + margin * (high - low)


def _widened(ends: tuple[float, float], length: float) -> tuple[float, float]:
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
