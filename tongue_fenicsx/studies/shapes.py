# SPDX-License-Identifier: MIT
"""A speaker's tongue in a posture, laid on ours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..analysis.tongue_grid import cut
from ..core.errors import InputError
from ..core.types import Floats
from ..geometry.registration import SmoothMap, lay_on, scatter
from ..geometry.surface import Surface

LAYS = ("rigid", "scale", "smooth")
"""By a turn and a shift in the mid-sagittal plane; also by a scale; also by a smooth map, after which both have the same shape at rest."""


@dataclass(frozen=True)
class Shape:
    """The surface of a tongue in a posture, and that of the same one at rest, if it is not in our frame.

    Attributes
    ----------
    surface : Surface
        In our axes, in m; open ones will do.
    rest : Surface, optional
        Likewise.
    align : str
        By what `rest` is laid on our tongue at rest, and `surface` with it: one of `LAYS`.
    """

    surface: Surface
    rest: Surface | None = None
    align: str = "scale"

    def on(self, skin: Surface) -> tuple[Surface, str]:
        """The surface in the posture, laid on a tongue with a `skin` at rest, and how that went, in words."""
        if self.rest is None:
            return self.surface, "as it lies"
        if self.align == "smooth":
            bent = SmoothMap(self.rest, skin)
            laid, apart, forward = bent.similarity, bent.distance, bent.forward
        else:
            laid, apart = lay_on(self.rest, skin, rigid=self.align == "rigid")
            forward = laid.forward
        turn = np.degrees(np.arctan2(laid.rotation[0, 2], laid.rotation[0, 0]))
        return self.surface.transform(forward), f"turned by {turn:.1f}°, scaled by {laid.scale:.2f}; at rest {1e3 * apart:.1f} mm apart"


def spread(surface: Surface, n: int) -> Floats:
    """Places (n, 3) in mm all over a surface."""
    return 1e3 * scatter(surface, n)


def spread_in_plane(surface: Surface, n: int, name: str) -> Floats:
    """Places (n, 2), x and z in mm, evenly along the mid-sagittal contour of a surface.

    Raises
    ------
    InputError
        If the mid-sagittal plane misses it.
    """
    lines = cut(surface)
    if len(lines) == 0:
        raise InputError(f"surface.{name}: the mid-sagittal plane y = 0 misses it; axes and mid_plane say where it is in the file.")
    start, step = lines[:, 0], lines[:, 1] - lines[:, 0]
    along = np.append(0.0, np.cumsum(np.linalg.norm(step, axis=1)))
    at = (np.arange(n) + 0.5) / n * along[-1]
    which = np.searchsorted(along, at, side="right") - 1
    share = (at - along[which]) / np.diff(along)[which]
    return np.asarray(start[which] + share[:, None] * step[which])
