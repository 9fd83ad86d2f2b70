# SPDX-License-Identifier: MIT
"""The page itself: what stands in it and in which order."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from PIL import Image

from ..core.errors import reading
from ..core.types import Floats
from ..runs.figures import FIGURES
from ..runs.run import WHOLE, Run
from .charts import Line, chart
from .motion import motion, strain

STATUS = {
    "done": "Done.",
    "interrupted": "Interrupted before its end: the page shows what was computed until then.",
    "failed": "The solve failed before the end: the page shows the run up to its last good state.",
}
KILLED = "There is no summary: the run was killed, or it still goes on. The page shows what was on disk."

Quantities = dict[str, tuple[str, float, str]]
"""Key in ``summary.json`` to label, factor and unit."""

OUTCOME: Quantities = {
    "t_end": ("time reached", 1e3, "ms"),
    "peak_speed_m_s": ("peak speed", 1e2, "cm/s"),
    "hencky_von_mises_max": ("von Mises Hencky strain, 99th percentile", 1.0, ""),
    "volume_change_max": ("largest change of volume", 1e2, "%"),
    "min_jacobian": ("smallest J", 1.0, ""),
    "contact_force_max_N": ("largest contact force", 1.0, "N"),
    "wall_seconds": ("wall time", 1.0, "s"),
}
SOLVER: Quantities = {
    "n_nodes": ("nodes", 1, ""),
    "n_cells": ("tetrahedra", 1, ""),
    "n_dofs": ("unknowns", 1, ""),
    "ranks": ("ranks", 1, ""),
    "n_steps": ("steps", 1, ""),
    "n_rejected": ("rejected steps", 1, ""),
    "newton_iterations": ("Newton iterations", 1, ""),
    "krylov_iterations": ("Krylov iterations", 1, ""),
    "fallbacks": ("fallbacks", 1, ""),
    "setup_seconds": ("set-up", 1.0, "s"),
    "wall_seconds": ("wall time", 1.0, "s"),
    "energy_balance_error": ("energy balance error", 1e2, "%"),
}
MODEL: Quantities = {
    "c10": ("C₁₀", 1.0, "Pa"),
    "c01": ("C₀₁", 1.0, "Pa"),
    "c20": ("C₂₀", 1.0, "Pa"),
    "c30": ("C₃₀", 1.0, "Pa"),
    "nu": ("ν", 1.0, ""),
    "density": ("density", 1.0, "kg/m³"),
    "rayleigh_alpha": ("Rayleigh α", 1.0, "1/s"),
    "rayleigh_beta": ("Rayleigh β", 1.0, "s"),
    "tendon_length_m": ("tendon length", 1e3, "mm"),
    "sigma_max": ("peak stress", 1e-3, "kPa"),
}


@dataclass(frozen=True)
class Detail:
    """How much of each run is shown: frames at most, and the largest width of a picture in pixels (None: as it is)."""

    frames: int
    width: int | None = None


def page(runs: Mapping[str, Run], detail: Detail, reduced: bool) -> str:
    """The HTML text.

    Parameters
    ----------
    runs : mapping of str to Run
        By the name shown.
    detail : Detail
        How much of each is shown.
    reduced : bool
        Whether the page says that this is less than it would like to show.

    Raises
    ------
    InputError
        If the files of a run are damaged.
    """
    motions = {}
    for label, run in runs.items():
        with reading(run.folder / "fields.h5", WHOLE):
            motions[label] = motion(run, detail.frames)
    data = {"largest": max(m["largest"] for m in motions.values()), "runs": list(motions.values())}
    return _resource("page.html").substitute(
        title=escape(", ".join(runs)),
        style=_resource("page.css").template,
        script=_resource("viewer.js").template,
        data=json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        selector=_selector(runs),
        together=_together(runs) if len(runs) > 1 else "",
        note=_note(detail) if reduced else "",
        runs="".join(_article(label, run, motions[label], detail) for label, run in runs.items()),
    )


def _resource(name: str) -> Template:
    return Template((files(__package__) / name).read_text(encoding="utf-8"))


def _selector(runs: Iterable[str]) -> str:
    options = "".join(f'<option value="{number}">{escape(label)}</option>' for number, label in enumerate(runs))
    hidden = "" if options.count("<option") > 1 else " hidden"
    return f'<label class="selector"{hidden}>Run <select id="selector" autocomplete="off">{options}</select></label>'


def _note(detail: Detail) -> str:
    text = f"To keep the page small, it shows at most {detail.frames} moments of a run, and pictures of at most {detail.width} pixels."
    return f'<p class="note">{text}</p>'


def _together(runs: Mapping[str, Run]) -> str:
    """All runs side by side: their numbers and the paths of their probes."""
    shown = {key: names for key, names in OUTCOME.items() if any(key in run.summary for run in runs.values())}
    head = "".join(f'<th scope="col">{escape(label)}{f" in {unit}" if unit else ""}</th>' for label, _, unit in shown.values())
    rows = "".join(
        f'<tr><th scope="row">{escape(label)}</th><td>{escape(run.summary.get("status", "no summary"))}</td>'
        + "".join(f"<td>{_value(run.summary.get(key, '–'), factor)}</td>" for key, (_, factor, _) in shown.items())
        + "</tr>"
        for label, run in runs.items()
    )
    paths: dict[str, dict[str, Floats]] = {}
    for label, run in runs.items():
        for name, u in run.probes.items():
            paths.setdefault(name, {})[label] = u
    charts = "".join(_paths(_words(name), of) for name, of in paths.items())
    return (
        '<section><h2>All runs</h2><div class="wide"><table class="runs">'
        f'<thead><tr><th scope="col">run</th><th scope="col">status</th>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
        f'<h3>Paths of the probes in the mid-sagittal plane</h3><div class="charts">{charts}</div></section>'
    )


def _paths(title: str, displacements: Mapping[str, Floats]) -> str:
    """Displacements (n_t, 3) in m by name as paths in the mid-sagittal plane."""
    lines = [Line(name, 1e3 * u[:, 0], 1e3 * u[:, 2]) for name, u in displacements.items()]
    return chart(title, "← forward · displacement in mm · backward →", "upward in mm", lines, equal=True)


def _article(label: str, run: Run, moved: Mapping[str, Any], detail: Detail) -> str:
    """Everything about one run but its motion."""
    s = run.summary
    status = s.get("status", "unknown")
    shown = len(moved["times"])
    frames = f"{shown} moments" if shown == moved["outputs"] else f"{shown} of {moved['outputs']} moments"
    tiles = {"largest displacement": f"{moved['largest']:.3g} mm"} | dict(_rows(s, OUTCOME))
    seen = f"The 3D view shows {frames} until {1e3 * run.time[-1]:.4g} ms."
    parts = [
        f'<h2><span class="badge {escape(status)}">{escape(status)}</span> {escape(label)}</h2>',
        f"<p>{escape(s.get('name', 'Tongue'))}. {STATUS.get(status, KILLED)} {seen}</p>",
        '<dl class="tiles">' + "".join(f"<div><dt>{escape(name)}</dt><dd>{value}</dd></div>" for name, value in tiles.items()) + "</dl>",
        f'<h3>History</h3><div class="charts">{_charts(run)}</div>',
        f"<h3>Pictures <small>(one that is clicked grows)</small></h3>{_pictures(run, detail.width)}",
        '<div class="tables">',
        _table("Model", _rows(s.get("model", {}), {key: (_words(key), 1.0, "") for key in s.get("model", {})} | MODEL)),
        _table("Solver", _rows(s, SOLVER)),
        _table("Versions", [(name, escape(version)) for name, version in s.get("versions", {}).items()]),
        "</div>",
        _scenario(run),
    ]
    return f'<article class="run" aria-label="{escape(label)}">{"".join(parts)}</article>'


def _charts(run: Run) -> str:
    time = 1e3 * run.time
    with reading(run.folder / "fields.h5", WHOLE):
        moments, mean, high = strain(run)
    probes = {_words(name): u for name, u in run.probes.items()}
    charts = [_paths("Paths of the probes, from rest (0, 0) to the end (ring)", probes)] if probes else []

    def over_time(title: str, y_label: str, lines: list[Line]) -> None:
        if lines:
            charts.append(chart(title, "time in ms", y_label, lines, over_time=True))

    lengths = {name: 1e3 * np.linalg.norm(u, axis=1) for name, u in probes.items()}
    over_time("Displacement of the probes", "mm", [Line(name, time, length) for name, length in lengths.items()])
    strains = {"mean": mean, "99th percentile": high}
    over_time("Von Mises Hencky strain of the cells", "strain", [Line(name, 1e3 * moments, values) for name, values in strains.items()])
    over_time("Volume", "change in %", [Line("change of volume", time, 100 * (run.volume_ratio - 1))])
    energies = {_words(name): 1e3 * values for name, values in run.energy.items() if values.any()}
    over_time("Energies and works", "mJ", [Line(name, time, values) for name, values in energies.items()])
    forces = {_words(name): np.linalg.norm(touch["force"], axis=1) for name, touch in run.contact.items()}
    over_time("Force of contact", "N", [Line(name, time, values) for name, values in forces.items()])
    areas = {_words(name): 1e6 * touch["area"] for name, touch in run.contact.items()}
    over_time("Area of contact", "mm²", [Line(name, time, values) for name, values in areas.items()])
    return "".join(charts)


def _pictures(run: Run, width: int | None) -> str:
    paths = {path.stem: path for path in sorted((run.folder / "figures").glob("*.png"))}
    figures = []
    for name in sorted(paths, key=lambda name: (list(FIGURES).index(name) if name in FIGURES else len(FIGURES), name)):
        caption = escape(FIGURES[name].caption if name in FIGURES else _words(name))
        data, (across, down) = _picture(paths[name], width)
        source = f'src="data:image/png;base64,{base64.b64encode(data).decode()}" width="{across}" height="{down}"'
        figures.append(f'<figure tabindex="0"><img {source} alt="{caption}" decoding="async"><figcaption>{caption}</figcaption></figure>')
    return f'<div class="pictures">{"".join(figures)}</div>' if figures else "<p>The run has drawn none.</p>"


def _picture(path: Path, width: int | None) -> tuple[bytes, tuple[int, int]]:
    """A picture, made smaller where it is wider than asked, and its size in pixels."""
    with reading(path, "a PNG picture"), Image.open(path) as picture:
        if width is None or picture.width <= width:
            return path.read_bytes(), picture.size
        picture.thumbnail((width, 10 * width))
        buffer = io.BytesIO()
        picture.save(buffer, "PNG", optimize=True)
        return buffer.getvalue(), picture.size


def _scenario(run: Run) -> str:
    path = run.folder / "scenario.toml"
    if not path.is_file():
        return ""
    with reading(path, WHOLE):
        text = path.read_text(encoding="utf-8")
    return f"<details><summary>scenario.toml: the whole scenario</summary><pre>{escape(text)}</pre></details>"


def _rows(values: Mapping[str, Any], quantities: Quantities) -> list[tuple[str, str]]:
    """Label and value as HTML of every quantity that is there."""
    found = [(names, values[key]) for key, names in quantities.items() if key in values]
    return [(label, f"{_value(value, factor)} {unit}".strip()) for (label, factor, unit), value in found]


def _value(value: Any, factor: float) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{escape(name)} {_value(item, factor)}" for name, item in value.items()) or "none"
    if isinstance(value, int | float):
        return f"{value:,}".replace(",", "\u202f") if isinstance(value, int) and factor == 1 else f"{factor * value:.4g}"
    return escape(str(value))


def _table(title: str, rows: Iterable[tuple[str, str]]) -> str:
    body = "".join(f'<tr><th scope="row">{escape(name)}</th><td>{value}</td></tr>' for name, value in rows)
    return f"<section><h3>{title}</h3><table>{body}</table></section>" if body else ""


def _words(name: str) -> str:
    return name.replace("_", " ")
