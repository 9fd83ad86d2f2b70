# SPDX-License-Identifier: MIT
"""A page in which a reduced tongue lives: it computes in the browser, and needs nothing from outside."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..analysis.electropalatogram import PALATES, REACH, electrodes
from ..analysis.tongue_grid import cut
from ..anatomy.catalogue import CATALOGUE
from ..core.types import Floats, Ints
from ..geometry.tetrahedron import boundary, mid_edges
from ..reduced.room import SPACING, STEPS, UNIT, Room
from ..reduced.tongue import STEP, ReducedTongue
from .motion import Shared, pack
from .templating import include, render

TRAILS = ("tip", "dorsum", "root")


def live_page(tongue: ReducedTongue) -> bytes:
    """The page as HTML in UTF-8, with the model, its surface and the bones in it.

    Parameters
    ----------
    tongue : ReducedTongue
        As trained.
    """
    nodes, triangles = boundary(tongue.cells)
    points, modes, scales = tongue.points[nodes], tongue.modes[:, nodes], tongue.scales
    shared = Shared()
    rest = {name: np.asarray(point) for name, point in tongue.told["rest"].items()}
    palate = next((tongue.bones[name] for name in PALATES if name in tongue.bones), None)
    data: dict[str, Any] = {
        "step": STEP,
        "muscles": [{"name": name, "says": CATALOGUE[name].full_name, "apart": name in tongue.sides} for name in tongue.muscles],
        "odd": tongue.odd,
        "weights": {name: {"shape": list(value.shape), "values": pack(value, "<f4")} for name, value in tongue.weights.items()},
        "doubt": tongue.told["doubt"],
        "rest": pack(1e3 * points, "<f4"),
        "triangles": pack(triangles, "<u4"),
        "modes": pack(np.round(modes / scales[:, None, None]), "<i2"),
        "scales": scales.tolist(),
        "outline": outline(points, triangles),
        "trails": {name: int(np.linalg.norm(points - rest[name], axis=1).argmin()) for name in TRAILS if name in rest},
        "bones": [
            {"name": name, **shared.put_surface(surface), "section": pack(cut(surface), "<f4")} for name, surface in tongue.bones.items()
        ],
        "shared": shared.texts,
        "room": None if tongue.room is None else room(tongue.room),
        "electrodes": [] if palate is None else (1e3 * electrodes(palate)).round(3).tolist(),
        "reach": 1e3 * REACH,
        "scenario": scenario(tongue),
    }
    told = tongue.told
    about = f"{told['tissue'].get('preset', 'own')} tissue, learned from {told['runs']} runs of the full model"
    style, script = include("page.css") + include("live.css"), include("stage.js") + include("live.js")
    return render("live.html", style=style, script=script, data=data, about=about).encode()


def room(of: Room) -> dict[str, Any]:
    """Distances from walls, as `reduced.room` has them."""
    return {
        "origin": of.origin.tolist(),
        "shape": list(of.units.shape),
        "spacing": SPACING,
        "unit": UNIT,
        "steps": STEPS,
        "units": pack(of.units, "i1"),
    }


def outline(points: Floats, triangles: Ints) -> list[list[int]]:
    """The mid-sagittal outline of a mirrored surface: chains of its points on the mid-plane."""
    import pyvista as pv

    edges = mid_edges(points, triangles)
    lines = pv.PolyData(points, lines=np.column_stack([np.full(len(edges), 2), edges]).ravel()).strip(max_length=len(edges) + 1).lines
    chains = []
    while len(lines):
        chains.append(lines[1 : lines[0] + 1].tolist())
        lines = lines[lines[0] + 1 :]
    return chains


def scenario(tongue: ReducedTongue) -> str:
    """The beginning of a scenario as the runs were that the tongue learned from; the activations follow."""
    told = tongue.told
    tissue = [f"{key} = {f'{chr(34)}{value}{chr(34)}' if isinstance(value, str) else value}" for key, value in told["tissue"].items()]
    contact = [f"[contact.{name}]" for name in told["contact"]]
    return "\n".join(["[mesh]", f'parametric = "{told["mesh"]}"', "", "[tissue]", *tissue, "", *contact, ""])
