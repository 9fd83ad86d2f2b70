# SPDX-License-Identifier: MIT
"""What ``tongue build`` prints of a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from ..anatomy.comparison import Agreement


def print_agreement(console: Console, found: Mapping[str, Agreement], name: str) -> None:
    """Print each muscle judged by that of a subject."""
    table = Table(
        "muscle", "Dice overlap", "fibre angle °", "length ratio", "volume ratio", title=f"against {name}, aligned by spine, tip and root"
    )
    for muscle, a in found.items():
        table.add_row(muscle, f"{a.dice:.2f}", f"{a.angle:.1f}", f"{a.length_ratio:.2f}", f"{a.volume_ratio:.2f}")
    console.print(table)


def print_mesh(console: Console, figures: Mapping[str, Any], path: Path) -> None:
    """Print the muscles and figures of a mesh that was built at `path`."""
    columns = ("muscle", "volume cm³", "in the data cm³", "cells", "fibre length mm", "direction off by °", "PCSA mm²", "peak stress kPa")
    table = Table(*columns, title=str(figures["name"]))
    for name, m in figures["muscles"].items():
        stress = "/".join(f"{1e-3 * s:.3g}" for s in m.get("peak_stress_pa", {}).values())
        table.add_row(
            name,
            f"{1e6 * m['volume_m3']:.2f}",
            _number(m["measured_volume_m3"], 1e6, ".2f"),
            str(m["n_cells"]),
            f"{1e3 * m['mean_length_m']:.0f}",
            _number(m["direction_error_deg"], 1.0, ".1f"),
            _number(m["pcsa_m2"], 1e6, ".0f"),
            stress or "–",
        )
    console.print(table)
    console.print("peak stress for calka/buchaillard/kappert tissue; full names and sources stand in the .json beside the mesh")
    console.print(
        f"volume {1e6 * figures['volume_m3']:.1f} cm³, of it the tongue proper {1e6 * figures['proper_volume_m3']:.1f} cm³ "
        f"({1e6 * figures['proper_volume_m3']:.0f} g at 1000 kg/m³), dorsal arc {1e3 * figures['arc_length_m']:.1f} mm, "
        f"chord {1e3 * figures['chord_m']:.1f} mm, oral width {1e3 * figures['width_m']:.1f} mm, "
        f"mid-sagittal area {1e4 * figures['midsagittal_area_m2']:.1f} cm²"
    )
    if figures["gaps_m"]:
        gaps = ", ".join(f"{name.replace('_', ' to ')} {1e3 * gap:.1f} mm" for name, gap in figures["gaps_m"].items())
        console.print(f"gaps at rest: {gaps}")
    if figures["bones_m"]:
        sizes = (f"{name} {' × '.join(f'{1e3 * side:.0f}' for side in sides)} mm" for name, sides in figures["bones_m"].items())
        console.print(f"bones: {', '.join(sizes)}")
    landmarks = (f"{name} ({', '.join(f'{1e3 * c:.1f}' for c in point)})" for name, point in figures["landmarks"].items())
    console.print(f"landmarks in mm: {', '.join(landmarks)}")
    console.print(f"{figures['n_nodes']} nodes (quadratic), {figures['n_cells']} tetrahedra, smallest SICN {figures['min_sicn']:.2f}")
    for note in figures["notes"]:
        console.print(note)
    console.print(f"wrote {path}, {path.with_suffix('.h5').name} and {path.with_suffix('.json').name}")


def _number(value: float | None, factor: float, form: str) -> str:
    return "–" if value is None else format(factor * value, form)
