# SPDX-License-Identifier: MIT
"""What is known of each tongue muscle: names, cross-sections, peak stresses, and where each number comes from."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.resources import files
from typing import Any

from ..core.errors import InputError

SOURCE = "Buchaillard, Perrier, Payan 2009; Stavness et al. 2011"


@dataclass(frozen=True)
class MuscleFacts:
    """Literature facts of one muscle.

    Attributes
    ----------
    full_name : str
        Latin name in lower case with underscores.
    course : str
        Origin and insertion (Gray's anatomy).
    pcsa : float
        Physiological cross-section, both sides, in m² (maximal force over 0.40 N/mm²).
    source : str
        Where the cross-section and the measured fibres come from.
    """

    full_name: str
    course: str
    pcsa: float
    source: str = SOURCE


CATALOGUE: dict[str, MuscleFacts] = {
    "GGP": MuscleFacts("genioglossus_posterior", "superior genial spine to the root", 168e-6),
    "GGH": MuscleFacts(
        "genioglossus_hyoid",
        "superior genial spine to the hyoid: the lowest fibres of GGP, where they are split off",
        34e-6,
        "a fifth of GGP, as of its fibres; division after Calka et al. 2025 (G-OBIM)",
    ),
    "GGM": MuscleFacts("genioglossus_medial", "superior genial spine to the middle of the dorsum", 55e-6),
    "GGA": MuscleFacts("genioglossus_anterior", "superior genial spine to the blade", 82e-6),
    "SG": MuscleFacts("styloglossus", "styloid process to the side of the tongue and the tip", 109e-6),
    "HG": MuscleFacts("hyoglossus", "hyoid body and greater horn to the side of the tongue", 295e-6),
    "IL": MuscleFacts("inferior_longitudinal", "root and hyoid to the underside of the apex", 41e-6),
    "SL": MuscleFacts("superior_longitudinal", "root and septum to the tip and the edges, under the dorsum", 86e-6),
    "VERT": MuscleFacts("verticalis", "dorsum to the underside, lateral to genioglossus", 91e-6),
    "TRANS": MuscleFacts("transversus", "septum to the lateral margins", 227e-6),
    "GH": MuscleFacts("geniohyoid", "inferior genial spine to the hyoid body", 80e-6),
    "MH": MuscleFacts("mylohyoid", "mylohyoid line of the mandible to the median raphe", 117e-6),
}

BUCHAILLARD_STRESS: dict[str, float] = {
    "GGP": 49.7e3, "GGH": 49.7e3, "GGM": 57.1e3, "GGA": 74.7e3, "SG": 151e3, "HG": 245e3, "VERT": 12.3e3,
    "TRANS": 15.9e3, "IL": 126e3, "SL": 51.6e3, "GH": 162e3, "MH": 154e3,
}  # fmt: skip
"""Peak active stress in Pa with the same virial as the published maximal forces along the published fibres
(Buchaillard 2009; sum of force times length over muscle volume)."""

CALIBRATION: dict[str, Any] = tomllib.loads((files(__package__) / "data" / "calka_stress.toml").read_text(encoding="utf-8"))
"""What ``tongue calibrate`` wrote for the tissue of the chapter: the stresses, and how they were found."""

CALKA_STRESS: dict[str, float] = CALIBRATION["muscles"]["sigma_max"] | {
    name: CALIBRATION["muscles"]["sigma_max"]["GGP"] * BUCHAILLARD_STRESS[name] / BUCHAILLARD_STRESS["GGP"] for name in ("GGH", "GH", "MH")
}
"""Peak active stress in Pa for the cadaver-soft tissue of the chapter, which prints none: each tongue muscle alone at full activation
reaches its Hencky strain of about 0.5. GH and MH, bonded at both ends, keep their published ratio to GGP, and GGH is a part of it."""

PEAK_STRESS: dict[str, dict[str, float]] = {
    "calka": CALKA_STRESS,
    "buchaillard": BUCHAILLARD_STRESS,
    "kappert": {name: stress * 273 / 192 for name, stress in CALKA_STRESS.items()},
}
"""Peak active stress in Pa by tissue preset; ``kappert`` scales ``calka`` by the ratio of C10."""


def pcsa(name: str) -> float:
    """Cross-section in m² of both sides of a muscle of the catalogue."""
    return CATALOGUE[base_name(name)].pcsa


def base_name(name: str) -> str:
    """The muscle without its side: ``GGP_L`` becomes ``GGP``."""
    return name[:-2] if name.endswith(("_L", "_R")) else name


def resolve(name: str, available: Iterable[str], where: str) -> list[str]:
    """The muscles of a mesh that a name stands for: itself, or its left and right.

    Raises
    ------
    InputError
        If the mesh has no such muscle; the nearest known names are suggested.
    """
    muscles = sorted(available)
    found = [m for m in muscles if name in (m, base_name(m))]
    if not found:
        known = sorted({*muscles, *map(base_name, muscles)})
        near = get_close_matches(name.upper(), known, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]}? " if near else ""
        raise InputError(f"{where}: no muscle {name!r} in the mesh; {hint}It has {', '.join(known) or 'no muscles with fibres'}.")
    return found


def peak_stress(muscles: Iterable[str], table: Mapping[str, float], where: str = "muscles.sigma_max") -> dict[str, float]:
    """Peak stress in Pa of every muscle of a mesh, from a table keyed by muscle or by muscle and side.

    Raises
    ------
    InputError
        If a muscle of the mesh is in the table neither by side nor by name.
    """
    stress = {}
    for name in muscles:
        value = table.get(name, table.get(base_name(name)))
        if value is None:
            raise InputError(
                f"{where}: no peak stress for muscle {name!r}; give one in Pa, or use a standard name: {', '.join(CATALOGUE)}."
            )
        stress[name] = value
    return stress
