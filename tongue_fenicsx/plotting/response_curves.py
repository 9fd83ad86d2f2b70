# SPDX-License-Identifier: MIT
"""Response curves: columns of a table of runs over a key that was varied."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..analysis.comparison import OUTCOME, naturally
from ..analysis.tables import Table
from ..core.errors import InputError
from .canvas import PATHS
from .run_figures import DASHES, PROBES

TOWARD = {"x": "backward", "y": "to the right", "z": "upward"}
COLUMNS = 3


def draw_responses(table: Table, path: str | Path, x: str | None = None, y: Sequence[str] = (), by: str | None = None) -> Path:
    """Draw columns of a table over one of its keys, and return the picture.

    Parameters
    ----------
    table : Table
        One line a run.
    path : path
        PNG, PDF or SVG.
    x : str, optional
        The key; by default the one with most values of those that were varied, numbers first.
    y : sequence of str
        Columns, a panel each; by default displacements of tip, dorsum and root backward and upward.
    by : str, optional
        The key whose values are lines; by default another that was varied, if it is the only one and has few values. Runs that differ in
        further keys are dots without a line.

    Raises
    ------
    InputError
        If the table has no such column, nothing was varied, or lines could not be told apart.
    """
    x = x or _most_varied(table)
    table.cells(x)
    shown = list(y) or _responses(table)
    others = [key for key in table.varied if key not in (x, *shown)]
    most = len(PATHS) * len(DASHES)
    if by is None and len(others) == 1 and len(set(table.columns[others[0]])) <= most:
        by = others[0]
    groups = [""] * len(table.cells(x)) if by is None else table.cells(by)
    names = sorted(set(groups), key=naturally if by is None or not table.is_number(by) else float)
    if len(names) > most:
        raise InputError(f"plot: {by} has {len(names)} values; up to {most} are expected, the most that lines can tell apart.")
    columns = min(COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(4 * columns + (2 if by else 0), 3.2 * rows + 0.4), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True).ravel()
    for axes, column in zip(panels, shown, strict=False):
        _draw(axes, table, x, column, groups, names)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    for axes in panels[max(len(shown) - columns, 0) : len(shown)]:
        axes.set_xlabel(x)
        axes.tick_params(labelbottom=True)
    if by is not None:
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, title=by, loc="outside right upper", frameon=False)
    n_done = len(groups)
    figure.suptitle(f"{n_done} runs" if n_done == table.n_runs else f"{n_done} of {table.n_runs} runs, those that are done", fontsize=11)
    figure.savefig(path, dpi=150)
    return Path(path)


def _most_varied(table: Table) -> str:
    if not table.varied:
        raise InputError(f"{table.path}: no key differs between its runs; name one of its columns: {', '.join(table.columns)}.")
    return max(table.varied, key=lambda key: (table.is_number(key), len(set(table.columns[key]))))


def _responses(table: Table) -> list[str]:
    found = [name for axis in "xz" for name in (f"{probe}_{axis}_m" for probe in PROBES) if name in table.columns]
    if not found:
        names = list(table.columns)
        after = names[names.index("status") + 1 :] if "status" in names else [name for name in names if "." not in name]
        found = [name for name in after if name not in table.varied and table.is_number(name) and len(set(table.columns[name])) > 1][:6]
    if not found:
        raise InputError(
            f"{table.path}: no column of numbers differs between its runs; name one of its columns: {', '.join(table.columns)}."
        )
    return found


def _draw(axes: Axes, table: Table, x: str, column: str, groups: Sequence[str], names: Sequence[str]) -> None:
    """One panel: a line for each group, or dots where a group has several runs at one place."""
    factor, label = _label(column)
    values = factor * table.numbers(column)
    numeric = table.is_number(x)
    order = sorted(set(table.cells(x)), key=naturally)
    across = table.numbers(x) if numeric else np.array([order.index(cell) for cell in table.cells(x)], dtype=float)
    for name, (dash, colour) in zip(names, product(DASHES, PATHS), strict=False):
        of = np.array([group == name for group in groups]) & np.isfinite(across) & np.isfinite(values)
        place = np.argsort(across[of], kind="stable")
        line = dash if len(set(across[of])) == of.sum() else "none"
        axes.plot(across[of][place], values[of][place], "o", linestyle=line, color=colour, markersize=4, linewidth=1.3, label=name)
    if numeric:
        axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    else:
        axes.set_xticks(range(len(order)), order)
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)


def _label(column: str) -> tuple[float, str]:
    """Factor and label of a column by its name: lengths in mm, and of probes the direction."""
    if column in OUTCOME:
        label, factor, unit = OUTCOME[column]
        return factor, f"{label} in {unit}" if unit else label
    length = column.endswith("_m")
    name, _, axis = column.removesuffix("_m").rpartition("_")
    label = f"{name} {TOWARD[axis]}" if length and axis in TOWARD else column.removesuffix("_m")
    return (1e3, f"{label.replace('_', ' ')} in mm") if length else (1.0, label.replace("_", " "))
