# SPDX-License-Identifier: MIT
"""The motion of a run's surface, small enough to travel inside a page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.types import Floats, Ints
from ..geometry.surface import Surface
from ..geometry.tetrahedron import QUARTERS, boundary, mid_sides, volumes
from ..runs.run import Run

FINE = 20_000
"""Above so many nodes on the surface only the corners of the tetrahedra are shown."""

STRAIN = "hencky_von_mises"
"""The field of which `strain` is."""

COLOURS = {STRAIN: "strain (von Mises, Hencky)", "jacobian": "volume over rest volume, J", "cauchy": "stress (von Mises) in kPa"}
"""Fields of the cells that the surface is coloured by, where a run has them."""

OBSTACLE = 12_000
"""Triangles of an obstacle that are shown at most."""


def evenly(n: int, at_most: int) -> Ints:
    """At most so many of the numbers 0 … n − 1, evenly spread, with the first and the last."""
    return np.unique(np.linspace(0, n - 1, min(n, at_most)).round().astype(np.int64))


class Shared:
    """Arrays in base64 that several runs may have in common, such as a mesh or a bone; each stands once in the page."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._surfaces: dict[bytes, dict[str, int]] = {}

    @property
    def texts(self) -> list[str]:
        """The arrays."""
        return list(self._numbers)

    def put(self, values: NDArray[Any], kind: str) -> int:
        """The number of an array among them."""
        return self._numbers.setdefault(pack(values, kind), len(self._numbers))

    def put_surface(self, surface: Surface) -> dict[str, int]:
        """The numbers of the ``points`` in mm and ``triangles`` of an obstacle, with `OBSTACLE` triangles at most."""
        key = surface.points.tobytes() + surface.triangles.tobytes()
        if key not in self._surfaces:
            if len(surface.triangles) > OBSTACLE:
                surface = Surface.from_pyvista(surface.to_pyvista().decimate(1 - OBSTACLE / len(surface.triangles)))
            self._surfaces[key] = {"points": self.put(1e3 * surface.points, "<f4"), "triangles": self.put(surface.triangles, "<u4")}
        return self._surfaces[key]


def motion(run: Run, frames: int, shared: Shared, colours: Sequence[str] = ()) -> dict[str, Any]:
    """The surface at rest, its displacement at some outputs, and the obstacles, lengths in mm.

    Parameters
    ----------
    run : Run
        The run.
    frames : int
        How many outputs are kept at most.
    shared : Shared
        Gets the meshes.
    colours : sequence of str
        Fields of the cells, of which those that the run has come along.

    Returns
    -------
    dict
        ``times`` in s; ``outputs``, how many there were; ``start``, the frame farthest from rest; ``largest``, the largest
        displacement; ``rest`` (n, 3), ``triangles`` (m, 3) and those of the mid-sagittal ``section``, numbers in `shared`; ``displacement``
        (n_frames, n, 3) as 16-bit integers in base64, times ``unit``; ``fields``, each with ``low``, ``high`` and ``values`` (n_frames, n)
        between them as 8-bit integers in base64; ``obstacles``, each with ``name``, ``points``, ``triangles`` and one ``poses`` row per
        frame, a rotation (9) and an offset (3).

    Raises
    ------
    ValueError
        If a displacement is not finite.
    """
    outputs = run.output_times
    kept = evenly(len(outputs), frames)
    points, cells = run.mesh
    nodes, triangles = boundary(cells, FINE)
    inner = mid_sides(points, cells)
    inner = inner[:, QUARTERS].reshape(-1, 3) if np.isin(cells[:, 4:], nodes).any() else inner[:, :3]
    drawn, places = np.unique(np.concatenate([nodes[triangles], inner]), return_inverse=True)
    nodes, triangles, inner = drawn, *np.split(places.reshape(-1, 3), [len(triangles)])
    u = 1e3 * np.array([run.field("displacement", int(index))[nodes] for index in kept])
    if not np.isfinite(u).all():
        raise ValueError("a displacement is not finite")
    unit = float(abs(u).max()) / 32767 or 1.0
    return {
        "times": outputs[kept].tolist(),
        "outputs": len(outputs),
        "start": int(np.argmax((u**2).sum(axis=(1, 2)))),
        "largest": float(np.linalg.norm(u, axis=2).max()),
        "rest": shared.put(1e3 * points[nodes], "<f4"),
        "triangles": shared.put(triangles, "<u4"),
        "section": shared.put(inner, "<u4"),
        "fields": {name: _colours(run, name, kept, nodes) for name in colours if name in run.fields},
        "unit": unit,
        "displacement": pack((u / unit).round(), "<i2"),
        "obstacles": [_obstacle(run, name, surface, kept, shared) for name, surface in run.obstacles_at_rest.items()],
    }


def _colours(run: Run, name: str, outputs: Ints, nodes: Ints) -> dict[str, Any]:
    """A field of the cells at nodes, the mean of the cells around each."""
    cells = run.mesh[1]
    around = np.bincount(cells.ravel())
    values = []
    for index in outputs:
        field = run.field(name, int(index))
        if field.ndim == 3:  # a stress
            shear = field - np.trace(field, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
            field = 1e-3 * np.sqrt(1.5 * (shear**2).sum(axis=(1, 2)))
        values.append((np.bincount(cells.ravel(), np.repeat(field, cells.shape[1])) / around)[nodes])
    low, high = float(np.min(values)), float(np.max(values))
    share = (np.array(values) - low) / ((high - low) or 1.0)
    return {"low": low, "high": high, "values": pack((255 * share).round(), "<u1")}


def _obstacle(run: Run, name: str, surface: Surface, outputs: Ints, shared: Shared) -> dict[str, Any]:
    poses = [run.pose(name, int(index)) for index in outputs]
    return {
        "name": name,
        **shared.put_surface(surface),
        "poses": [np.r_[rotation.ravel(), 1e3 * offset].round(6).tolist() for rotation, offset in poses],
    }


def strain(run: Run) -> tuple[Floats, Floats, Floats]:
    """Times in s and the mean and 99th percentile of the von Mises Hencky strain of the cells by volume at the outputs, (n,) each."""
    points, cells = run.mesh
    volume = volumes(points[cells[:, :4]])
    times = run.output_times
    fields = [run.field(STRAIN, index) for index in range(len(times))]
    mean = [np.average(field, weights=volume) for field in fields]
    high = [np.percentile(field, 99, weights=volume, method="inverted_cdf") for field in fields]
    return times, np.array(mean), np.array(high)


def pack(values: NDArray[Any], kind: str) -> str:
    """An array of a kind of numbers in base64."""
    return base64.b64encode(values.astype(kind).tobytes()).decode()
