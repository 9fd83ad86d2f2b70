# SPDX-License-Identifier: MIT
"""Pictures. Loading this room registers the standard figures of a run; what draws them is loaded on first use."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..runs.figures import figure

if TYPE_CHECKING:
    from ..runs.run import Run


def _both(name: str) -> tuple[str, str]:
    return f"figures/{name}.png", f"figures/{name}.pdf"


def _has_probes(run: Run) -> bool:
    return bool(run.probes)


def _has_contact(run: Run) -> bool:
    return bool(run.contact)


def _has_palate(run: Run) -> bool:
    from ..analysis.electropalatogram import PALATES

    return not PALATES.isdisjoint(run.contact)


def _has_airway(run: Run) -> bool:
    from ..analysis.airway import WALLS

    return not run.contact.keys().isdisjoint(WALLS)


@figure(
    *_both("midsagittal"),
    caption="Mid-sagittal section at rest and where the tongue is farthest from rest, coloured by displacement",
)
def midsagittal(run: Run) -> Path:
    """The mid-sagittal section."""
    from .run_figures import draw_midsagittal

    return draw_midsagittal(run)


@figure(caption="The tongue from the front left where it is farthest from rest, in its transparent rest shape")
def view3d(run: Run) -> Path:
    """The tongue in 3D."""
    from .run_figures import draw_view3d

    return draw_view3d(run)


@figure(
    "trajectories.csv",
    *_both("trajectories"),
    caption="Paths of the probes in the mid-sagittal plane and over time",
    applies=_has_probes,
)
def trajectories(run: Run) -> Path:
    """How the probes move, also as a table."""
    from ..analysis.trajectories import write_trajectories
    from .run_figures import draw_trajectories

    write_trajectories(run, run.folder / "trajectories.csv")
    return draw_trajectories(run)


@figure(*_both("contact"), caption="Force and area of contact over time", applies=_has_contact)
def contact(run: Run) -> Path:
    """How the tongue touches the obstacles."""
    from .run_figures import draw_contact

    return draw_contact(run)


@figure(
    "epg.csv",
    *_both("epg"),
    caption="Virtual electropalatogram: electrodes touched over time, front at the top",
    applies=_has_palate,
)
def epg(run: Run) -> Path:
    """The electropalatogram, also as a table."""
    from ..analysis.electropalatogram import electropalatogram
    from .run_figures import draw_electropalatogram

    record = electropalatogram(run)
    record.write(run.folder / "epg.csv")
    return draw_electropalatogram(run, record)


@figure(
    "airway.csv",
    *_both("airway"),
    caption="Airway: distance from palate, velum and pharynx to the tongue along the mid-line",
    applies=_has_airway,
)
def airway(run: Run) -> Path:
    """The airway, also as a table."""
    from ..analysis.airway import airway as measure
    from .run_figures import draw_airway

    passage = measure(run)
    passage.write(run.folder / "airway.csv")
    return draw_airway(run, passage)
