# SPDX-License-Identifier: MIT
"""The page itself: what stands in it and in which order."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from PIL import Image

from ..analysis.comparison import MISSING, OUTCOME, Quantities, differing_keys
from ..anatomy.catalogue import base_name
from ..core.errors import reading
from ..core.types import Floats
from ..runs.figures import FIGURES
from ..runs.run import Run
from .charts import Line, chart
from .motion import COLOURS, STRAIN, Shared, evenly, motion, strain
from .templating import include, render

STATUS = {
    "done": "Done.",
    "interrupted": "Interrupted before its end: the page shows what was computed until then.",
    "failed": "The solve failed before the end: the page shows the run up to its last good state.",
}
KILLED = "There is no summary: the run was killed, or it still goes on. The page shows what was on disk."

ROWS = 1000
"""Of the table of a run at most."""

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
    """How much of each run is shown: frames at most, the largest width of a picture in pixels (None: as it is), and whether fields that
    the surface may be coloured by and the table are there."""

    frames: int
    width: int | None = None
    whole: bool = True


def page(runs: Mapping[str, Run], detail: Detail, reduced: bool, limit: int, shared: Shared) -> bytes | None:
    """The HTML text in UTF-8; None if it is larger than a limit, as soon as that shows.

    Parameters
    ----------
    runs : mapping of str to Run
        By the name shown.
    detail : Detail
        How much of each is shown.
    reduced : bool
        Whether the page says that this is less than it would like to show.
    limit : int
        Bytes.
    shared : Shared
        Gets the meshes; the same for all details.

    Raises
    ------
    InputError
        If the files of a run are damaged.
    """
    motions, articles, size = [], [], 0
    for label, run in runs.items():
        with run.reading("fields.h5"):
            moved = motion(run, detail.frames, shared, list(COLOURS) if detail.whole else [])
        motions.append(moved | {"label": label, "table": _table(run) if detail.whole else ""})
        articles.append(_article(label, run, motions[-1], detail))
        fields = sum(len(field["values"]) for field in motions[-1]["fields"].values())
        size += len(motions[-1]["displacement"]) + fields + len(motions[-1]["table"]) + len(articles[-1])
        if size + sum(map(len, shared.texts)) > limit:
            return None
    text = render(
        "page.html",
        title=_title(list(runs)),
        style=include("page.css"),
        script=include("stage.js") + include("viewer.js"),
        data={"scales": (scales := _scales(motions)), "shared": shared.texts, "runs": motions},
        scales=scales,
        labels=list(runs),
        together=_together(runs) if len(runs) > 1 else "",
        detail=detail if reduced else None,
        runs=Markup().join(articles),
    ).encode()
    return text if len(text) <= limit else None


def _scales(motions: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """By what the surface is coloured: label, and the least and the greatest value in all runs."""
    scales = {"displacement": {"label": "displacement in mm", "low": 0.0, "high": max(m["largest"] for m in motions)}}
    for name, label in COLOURS.items():
        if of := [m["fields"][name] for m in motions if name in m["fields"]]:
            scales[name] = {"label": label, "low": min(field["low"] for field in of), "high": max(field["high"] for field in of)}
    return scales


def _table(run: Run) -> str:
    """The history as CSV in SI units."""
    columns = run.to_dict()
    rows = np.column_stack(list(columns.values()))[evenly(len(run.time), ROWS)]
    return "\n".join([",".join(columns), *(",".join(f"{value:.5g}" for value in row) for row in rows)]) + "\n"


def _title(labels: list[str]) -> str:
    """Names of few runs, or of the first and last of many."""
    return ", ".join(labels) if len(labels) <= 4 else f"{len(labels)} runs, {labels[0]} to {labels[-1]}"


def _together(runs: Mapping[str, Run]) -> Markup:
    """All runs side by side: their numbers and the paths of their probes."""
    shown = {key: names for key, names in OUTCOME.items() if any(key in run.summary for run in runs.values())}
    differing = differing_keys(runs)
    rows = [
        (
            label,
            run.summary.get("status", "no summary"),
            [values[number] for values in differing.values()],
            [_value(run.summary.get(key, MISSING), shown[key][1]) for key in shown],
        )
        for number, (label, run) in enumerate(runs.items())
    ]
    paths: dict[str, dict[str, Floats]] = {}
    for label, run in runs.items():
        for name, u in run.probes.items():
            paths.setdefault(name, {})[label] = u
    charts = Markup().join(_paths(_words(name), of) for name, of in paths.items())
    head = [f"{label} in {unit}" if unit else label for label, _, unit in shown.values()]
    return render("together.html", keys=list(differing), head=head, rows=rows, charts=charts)


def _paths(title: str, displacements: Mapping[str, Floats]) -> Markup:
    """Displacements (n_t, 3) in m by name as paths in the mid-sagittal plane."""
    lines = [Line(name, 1e3 * u[:, 0], 1e3 * u[:, 2]) for name, u in displacements.items()]
    return chart(title, "← forward · displacement in mm · backward →", "upward in mm", lines, equal=True)


def _article(label: str, run: Run, moved: Mapping[str, Any], detail: Detail) -> Markup:
    """Everything about one run but its motion."""
    s = run.summary
    status = s.get("status", "unknown")
    shown = len(moved["times"])
    frames = f"{shown} moments" if shown == moved["outputs"] else f"{shown} of {moved['outputs']} moments"
    moments = f"The 3D view shows {frames} until {1e3 * run.time[-1]:.4g} ms."
    model = s.get("model", {})
    return render(
        "run.html",
        label=label,
        status=status,
        about=f"{s.get('name', 'Tongue')}. {STATUS.get(status, KILLED)} {moments}",
        tiles=[("largest displacement", f"{moved['largest']:.3g} mm"), *_rows(s, OUTCOME)],
        charts=_charts(run),
        pictures=_pictures(run, detail.width),
        tables={
            "Model": _rows(model, {key: (_words(key), 1.0, "") for key in model} | MODEL),
            "Solver": _rows(s, SOLVER),
            "Versions": list(s.get("versions", {}).items()),
        },
        scenario=_scenario(run),
    )


def _charts(run: Run) -> Markup:
    time = 1e3 * run.time
    probes = {_words(name): u for name, u in run.probes.items()}
    charts = [_paths("Paths of the probes, from rest (0, 0) to the end (ring)", probes)] if probes else []

    def over_time(title: str, y_label: str, lines: list[Line]) -> None:
        if lines:
            charts.append(chart(title, "time in ms", y_label, lines, over_time=True))

    sides: dict[str, Floats] = {}
    for name, level in run.activation.items():
        other = run.activation.get(f"{base_name(name)}_L")
        alike = other is not None and np.array_equal(other, level)
        if level.any():
            sides[base_name(name) if alike else name] = level
    over_time("Activation", "level", [Line(name, time, level) for name, level in sides.items()])
    lengths = {name: 1e3 * np.linalg.norm(u, axis=1) for name, u in probes.items()}
    over_time("Displacement of the probes", "mm", [Line(name, time, length) for name, length in lengths.items()])
    strains: dict[str, Floats] = {}
    if STRAIN in run.fields:
        with run.reading("fields.h5"):
            moments, strains["mean"], strains["99th percentile"] = strain(run)
    over_time("Von Mises Hencky strain of the cells", "strain", [Line(name, 1e3 * moments, values) for name, values in strains.items()])
    over_time("Volume", "change in %", [Line("change of volume", time, 100 * (run.volume_ratio - 1))])
    energies = {_words(name): 1e3 * values for name, values in run.energy.items() if values.any()}
    over_time("Energies and works", "mJ", [Line(name, time, values) for name, values in energies.items()])
    forces = {_words(name): np.linalg.norm(touch["force"], axis=1) for name, touch in run.contact.items()}
    over_time("Force of contact", "N", [Line(name, time, values) for name, values in forces.items()])
    areas = {_words(name): 1e6 * touch["area"] for name, touch in run.contact.items()}
    over_time("Area of contact", "mm²", [Line(name, time, values) for name, values in areas.items()])
    return Markup().join(charts)


def _pictures(run: Run, width: int | None) -> list[dict[str, Any]]:
    """The pictures of a run, those of registered figures first."""
    paths = {path.stem: path for path in sorted((run.folder / "figures").glob("*.png"))}
    pictures = []
    for name in [*(name for name in FIGURES if name in paths), *(name for name in paths if name not in FIGURES)]:
        data, kind, (across, down) = _picture(paths[name], width)
        caption = FIGURES[name].caption if name in FIGURES else _words(name)
        source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
        pictures.append({"source": source, "width": across, "height": down, "caption": caption})
    return pictures


def _picture(path: Path, width: int | None) -> tuple[bytes, str, tuple[int, int]]:
    """A picture, its format and its size in pixels; with a width it is as WebP, which takes a fifth, and no wider."""
    with reading(path, "a PNG picture"), Image.open(path) as picture:
        if width is None:
            return path.read_bytes(), "png", picture.size
        small = picture.convert("RGB")
        small.thumbnail((width, 10 * width))
        buffer = io.BytesIO()
        small.save(buffer, "WEBP", quality=80)
        return buffer.getvalue(), "webp", small.size


def _scenario(run: Run) -> str | None:
    if not run.store.has("scenario.toml"):
        return None
    with run.reading("scenario.toml"):
        return run.store.read("scenario.toml").decode()


def _rows(values: Mapping[str, Any], quantities: Quantities) -> list[tuple[str, str]]:
    """Label and value of every quantity that is there."""
    found = [(names, values[key]) for key, names in quantities.items() if key in values]
    return [(label, f"{_value(value, factor)} {unit}".strip()) for (label, factor, unit), value in found]


def _value(value: Any, factor: float) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_value(item, factor)}" for name, item in value.items()) or "none"
    if isinstance(value, int | float):
        return f"{value:,}".replace(",", "\u202f") if isinstance(value, int) and factor == 1 else f"{factor * value:.4g}"
    return str(value)


def _words(name: str) -> str:
    return name.replace("_", " ")
