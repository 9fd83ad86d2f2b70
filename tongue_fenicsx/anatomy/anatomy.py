# SPDX-License-Identifier: MIT
"""A tongue as plain data: surface, muscles, bones, landmarks. No finite elements here.

Frame: x posterior, y right, z up, metres, mid-sagittal plane y = 0. The parametric tongue has its origin at the
superior genial spine; an imported subject keeps its own coordinates and states where the spine is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.types import Bools, Floats
from ..geometry.fibre_bundle import FibreBundle
from ..geometry.polyline import arc_length
from ..geometry.surface import Surface

if TYPE_CHECKING:
    import pyvista as pv

ADULT = 32e-3
"""Height in m of the dorsum over the genial spine from which a tongue is measured as an adult's."""

TIP_DIRECTION = np.array([-np.cos(np.radians(20)), 0.0, np.sin(np.radians(20))])


@dataclass(frozen=True)
class Muscle:
    """One muscle of one side.

    Attributes
    ----------
    name : str
        Abbreviation with side, such as ``GGP_L``; unpaired muscles have no side.
    fibres : FibreBundle
        Its fibres.
    region : callable
        Takes points (n, 3) in m, returns whether each lies in the muscle, (n,).
    pcsa : float, optional
        Physiological cross-section of this side in m²; further facts are in `muscles.CATALOGUE`.
    anchor : (3,) float array, optional
        Where the part outside the tongue pulls to, in m, such as the styloid process.
    measured_volume : float, optional
        Volume in m³ of the region in the data that it comes from, to judge the mesh by.
    """

    name: str
    fibres: FibreBundle
    region: Callable[[Floats], Bools]
    pcsa: float | None = None
    anchor: Floats | None = None
    measured_volume: float | None = None


@dataclass(frozen=True)
class Anatomy:
    """Everything that meshing needs to know of a tongue.

    Attributes
    ----------
    name : str
        What the tongue is called in files and pictures.
    surface : Surface
        Closed outer surface; its labels say what is bonded to which bone.
    muscles : dict
        Name with side to `Muscle`.
    genial_spine : (3,) float array
        Superior genial spine in m, the origin that shape figures refer to.
    bones : dict
        Name to surface, for contact and pictures.
    mirrored : bool
        Whether the surface is a half at y > 0 and its mirror image, so that the mesh may be too.
    notes : list of str
        What a reader must know of how it was made (repairs, assumptions).
    """

    name: str
    surface: Surface
    muscles: dict[str, Muscle]
    genial_spine: Floats
    bones: dict[str, Surface] = field(default_factory=dict)
    mirrored: bool = False
    notes: list[str] = field(default_factory=list)

    def fibre_length(self, name: str) -> float:
        """Mean length in m, inside the tongue, of the fibres of a muscle."""
        fibres = self.muscles[name].fibres
        points, _, lengths = fibres.segments
        return float(lengths[self.surface.contains(points, 1e-3)].sum() / len(fibres.lines))

    def mesh(self, size: float = 4e-3) -> Any:
        """Mesh the tongue with elements of `size` (m) and load it (see `meshing.build` for files that last)."""
        raise ImportError("import tongue_fenicsx.meshing first: it gives an anatomy its method mesh")


@dataclass(frozen=True)
class Shape:
    """Shape figures of a tongue, in the terms of the literature (lengths in m, areas in m², volumes in m³).

    The tongue proper is what lies more than 2 mm above the genial spine, without the mouth floor.
    """

    volume: float
    proper_volume: float
    arc_length: float
    chord: float
    width: float
    midsagittal_area: float
    landmarks: dict[str, Floats]


def measure(surface: Surface, genial_spine: Floats) -> Shape:
    """Measure a tongue surface.

    The landmarks are ``tip`` (foremost mid-sagittal point along a line 20° above horizontal), ``dorsum`` (highest),
    ``root`` (the rear at mid-height between the dorsum and the upper end of the hyoid attachment), ``edge_left`` and
    ``edge_right`` (widest points of the coronal section halfway from tip to dorsum). The arc runs from the tip over the
    dorsum to the vallecula, 3 mm below the genial spine; the width is the largest above 17 mm over the spine, the oral part. In a tongue
    whose dorsum is less than 32 mm over the spine, a child's, these distances and that of the tongue proper shrink with it.
    """
    contour = _midsagittal(surface)
    start, top = int(np.argmax(contour @ TIP_DIRECTION)), int(np.argmax(contour[:, 2]))
    tip, dorsum = contour[start], contour[top]
    small = float(np.clip((dorsum[2] - genial_spine[2]) / ADULT, 0, 1))
    bonded = surface.points[surface.triangles[surface.labels == "hyoid"]].reshape(-1, 3)
    low = bonded[:, 2].max() if len(bonded) else contour[:, 2].min()
    rear = contour[contour[:, 0] > dorsum[0]]
    if not len(rear):
        raise InputError("the surface is highest where it is farthest back; with the right axes a tongue is not.")
    root = rear[np.argmin(abs(rear[:, 2] - (dorsum[2] + low) / 2))]
    ring = np.roll(contour, -start, axis=0)
    along = arc_length(ring)
    over = (top - start) % len(ring)
    if along[over] > along[-1] / 2:  # walk over the dorsum, not along the underside
        ring = np.roll(ring[::-1], 1, axis=0)
    behind = ring[:, 0] > dorsum[0]
    beneath = behind & (ring[:, 2] < genial_spine[2] - small * 3e-3)
    stop = int(np.argmax(beneath) if beneath.any() else np.argmin(np.where(behind, ring[:, 2], np.inf)))
    arc = float(arc_length(ring[: stop + 1])[-1])
    x, z = contour[:, 0], contour[:, 2]
    area = float(abs(np.sum(x * np.roll(z, -1) - z * np.roll(x, -1))) / 2)
    oral = surface.points[surface.points[:, 2] > genial_spine[2] + small * 17e-3]
    section = surface.points[abs(surface.points[:, 0] - (tip[0] + dorsum[0]) / 2) < 2e-3]
    landmarks = {
        "tip": tip,
        "dorsum": dorsum,
        "root": root,
        "edge_left": section[np.argmin(section[:, 1])],
        "edge_right": section[np.argmax(section[:, 1])],
    }
    return Shape(
        volume=surface.volume,
        proper_volume=abs(float(_above(surface, genial_spine[2] + small * 2e-3).volume)),
        arc_length=arc,
        chord=float(np.linalg.norm(tip - root)),
        width=float(np.ptp(oral[:, 1])),
        midsagittal_area=area,
        landmarks=landmarks,
    )


def gaps(anatomy: Anatomy, shape: Shape) -> dict[str, float]:
    """Rest gaps in m: dorsum and tip straight up to the palate, root straight back to the pharynx, as far as there are bones."""
    found = {}
    for name, landmark, way in (
        ("dorsum_palate", "dorsum", (0, 0, 1)),
        ("tip_palate", "tip", (0, 0, 1)),
        ("root_pharynx", "root", (1, 0, 0)),
    ):
        start = shape.landmarks[landmark]
        ends = [bone.to_pyvista().ray_trace(start, start + 0.05 * np.array(way))[0] for bone in anatomy.bones.values()]
        distances = [float(np.linalg.norm(hit - start)) for hits in ends for hit in hits]
        if distances:
            found[name] = min(distances)
    return found


def _above(surface: Surface, z: float) -> pv.PolyData:
    return surface.to_pyvista().clip_closed_surface(normal="z", origin=(0.0, 0.0, z)).triangulate()


def _midsagittal(surface: Surface) -> Floats:
    """The mid-sagittal contour, (n, 3), in order around the tongue."""
    plane = float(np.ptp(surface.points[:, 1])) * 1e-7  # off the vertices that lie on y = 0
    strips = surface.to_pyvista().slice(normal="y", origin=(0.0, plane, 0.0)).strip(join=True, max_length=100000)
    if not strips.n_cells:
        raise InputError("the mid-sagittal plane does not cut the surface; look at its axes and mid_plane.")
    longest = max((strips.get_cell(i) for i in range(strips.n_cells)), key=lambda cell: cell.n_points)
    contour = np.array(longest.points, dtype=float)
    contour[:, 1] = 0.0
    return contour[:-1] if np.allclose(contour[0], contour[-1]) else contour
