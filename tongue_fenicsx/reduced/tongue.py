# SPDX-License-Identifier: MIT
"""The reduced tongue: loaded from a file, stepped through time; needs NumPy only."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np

from ..core.errors import InputError, reading
from ..core.files import at_once
from ..core.types import Floats, Ints
from ..geometry.surface import Surface
from ..geometry.tetrahedron import boundary
from .network import answer, fade, features
from .room import Room

SUFFIX = ".npz"
SHIPPED = Path(__file__).with_name("data")
STEP = 5e-3
"""Longest step in s; a longer one is taken in several."""


def inputs_of(levels: Mapping[str, Any], muscles: Sequence[str], sides: Sequence[str]) -> Floats:
    """What networks see, (…, n_inputs), of levels by muscle, each (…): the means of both sides of `muscles`, then half the differences,
    left less right, of `sides`. A name without side stands for both, and one that is missing is at rest."""
    left, right = ({name: levels.get(name + side, levels.get(name, 0.0)) for name in muscles} for side in ("_L", "_R"))
    means, differences = [left[name] + right[name] for name in muscles], [left[name] - right[name] for name in sides]
    return np.stack(np.broadcast_arrays(*means, *differences), axis=-1) / 2


@dataclass
class _Memory:
    """Of each network and run: levels, functions of them, and what is kept of these, of each layer."""

    levels: Floats
    seen: list[Floats]
    kept: list[Floats]


class ReducedTongue:
    """A tongue that is a few coordinates of shapes and memories of what its muscles did.

    Parameters
    ----------
    points : (n_nodes, 3) float array
        Rest shape in m.
    cells : (n_cells, 10) int array
        Quadratic tetrahedra in VTK order.
    modes : (n_modes, n_nodes, 3) float array
        Shapes, each with a mean square of one.
    weights : mapping
        See `network.Weights`; coordinates are in mm.
    muscles : sequence of str
        Names of the activations, in order.
    bones : mapping
        Name to surface of what lies around it at rest.
    told : mapping
        Where it comes from: ``tissue`` preset, ``mesh``, ``contact``, ``seeds`` of the runs, ``rest`` places of the landmarks in m,
        ``doubt`` (mm of error for a mm of disagreement), ``sides`` (muscles whose sides it knows apart, if any), ``odd`` (how many of the
        shapes, the last ones, are odd: their mirror image is their opposite), and more.
    room : Room, optional
        What walls leave: nodes of the surface do not go into them.

    Attributes
    ----------
    time : float
        In s, since the last `reset`.
    coordinates : (n_modes,) float array
        In mm.
    doubt : float
        Expected mean error of the nodes in mm, from how much the networks disagree.
    """

    def __init__(
        self,
        points: Floats,
        cells: Ints,
        modes: Floats,
        weights: Mapping[str, Floats],
        muscles: Sequence[str],
        bones: Mapping[str, Surface],
        told: Mapping[str, Any],
        room: Room | None = None,
    ) -> None:
        self.points, self.cells, self.modes = points, cells, modes
        self.muscles, self.bones, self.told = list(muscles), dict(bones), dict(told)
        self.weights = {name: np.asarray(value, dtype=float) for name, value in weights.items()}
        self.room, self.skin = room, boundary(cells)[0]
        self.sides, self.odd = list(self.told.get("sides", [])), int(self.told.get("odd", 0))
        self._mirror = np.repeat([1.0, -1.0], [len(self.muscles), len(self.sides)])
        self._taus = [np.exp(self.weights[f"log_tau{layer}"]) for layer in (1, 2)]
        self.reset()

    @classmethod
    def load(cls, path: str | Path) -> ReducedTongue:
        """Read it from a file.

        Raises
        ------
        InputError
            If the file is not one that `save` wrote.
        """
        with reading(Path(path), "a reduced tongue, as tongue rom train writes it,"):
            if not is_zipfile(path):
                raise ValueError("it is no archive, or a part of one")
            with np.load(path) as file:
                return cls._of(file)

    @classmethod
    def _of(cls, file: Any) -> ReducedTongue:
        told = json.loads(str(file["told"]))
        modes = file["modes"] * file["scales"][:, None, None]
        weights = {name.removeprefix("weights/"): file[name] for name in file.files if name.startswith("weights/")}
        surfaces = [(name, file[f"bones/{i}/points"], file[f"bones/{i}/triangles"]) for i, name in enumerate(told.pop("bones"))]
        bones = {name: Surface(points.astype(float), triangles.astype(np.int64)) for name, points, triangles in surfaces}
        room = Room(file["room/origin"], file["room/units"]) if "room/units" in file.files else None
        return cls(file["points"], file["cells"].astype(np.int64), modes, weights, told.pop("muscles"), bones, told, room)

    @classmethod
    def shipped(cls, tissue: str = "buchaillard") -> ReducedTongue:
        """One that comes with the package, of the coarse tongue in a tissue.

        Raises
        ------
        InputError
            If there is none of this tissue.
        """
        found = sorted(path.stem for path in SHIPPED.glob(f"*{SUFFIX}"))
        if tissue not in found:
            raise InputError(f"tissue: there is no reduced tongue of {tissue!r}; one of {', '.join(found)} is expected.")
        return cls.load(SHIPPED / f"{tissue}{SUFFIX}")

    def save(self, path: str | Path) -> None:
        """Write it into a file: shapes in 16 bits, weights in single precision.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        scales = self.scales
        arrays: dict[str, Any] = {
            "points": self.points,
            "cells": self.cells.astype(np.int32),
            "modes": np.round(self.modes / scales[:, None, None]).astype(np.int16),
            "scales": scales,
            "told": np.array(json.dumps({**self.told, "muscles": self.muscles, "bones": list(self.bones)})),
            **{f"weights/{name}": value.astype(np.float32) for name, value in self.weights.items()},
        }
        for i, bone in enumerate(self.bones.values()):
            arrays |= {f"bones/{i}/points": bone.points.astype(np.float32), f"bones/{i}/triangles": bone.triangles.astype(np.int32)}
        if self.room is not None:
            arrays |= {"room/origin": self.room.origin, "room/units": self.room.units}
        with at_once(Path(path)) as partial, open(partial, "wb") as file:
            np.savez_compressed(file, **arrays)

    @property
    def scales(self) -> Floats:
        """A unit for each shape, (n_modes,), in which 16 bits hold it."""
        return np.asarray(abs(self.modes).max(axis=(1, 2)) / 32767)

    def fits(self, points: Floats) -> bool:
        """Whether it is of a mesh with these nodes (n, 3) in m at rest."""
        return points.shape == self.points.shape and bool(np.allclose(points, self.points, atol=1e-9))

    def reset(self) -> None:
        """Back to rest, with all muscles relaxed."""
        self.time, self.doubt = 0.0, 0.0
        self.coordinates = np.zeros(len(self.modes))
        self._memory = self._at_rest(2 if self.sides else 1)

    def check(self, muscle: str) -> None:
        """Refuse a muscle that it does not have.

        Raises
        ------
        InputError
            If it is neither one of `muscles` nor, with ``_L`` or ``_R``, one of `sides`.
        """
        if muscle not in self.muscles and not (muscle.endswith(("_L", "_R")) and muscle[:-2] in self.sides):
            apart = f", and with _L or _R {', '.join(self.sides)}" if self.sides else ""
            raise InputError(f"activation.{muscle}: the reduced tongue has no such muscle; it has {', '.join(self.muscles)}{apart}.")

    def inputs(self, levels: Mapping[str, Any]) -> Floats:
        """See `inputs_of`."""
        return inputs_of(levels, self.muscles, self.sides)

    def step(self, levels: Mapping[str, float], dt: float) -> Floats:
        """Go on by `dt` seconds in which each muscle goes linearly to its new level.

        Parameters
        ----------
        levels : mapping
            Muscle to activation, 0…1, both sides or, with ``_L`` or ``_R``, one; those that are not named relax.
        dt : float
            In s.

        Returns
        -------
        (n_modes,) float array
            The coordinates.

        Raises
        ------
        InputError
            If a muscle is not known, a level not within 0…1 or `dt` not positive.
        """
        if not (np.isfinite(dt) and dt > 0):
            raise InputError(f"dt: {dt}; a positive number of seconds is expected.")
        for name, level in levels.items():
            self.check(name)
            if not 0 <= level <= 1:
                raise InputError(f"levels.{name}: {level}; an activation from 0 to 1 is expected.")
        return self._step(self.inputs(levels), dt)

    def _step(self, target: Floats, dt: float) -> Floats:
        answers = self._follow(self._memory, np.stack([target, target * self._mirror]) if self.sides else target[None], dt)
        answers = self._as_one(answers[:, 0], answers[:, -1])  # without sides the same
        self.time += dt
        self.coordinates = answers.mean(axis=0)
        self.doubt = self.told.get("doubt", 1.0) * float(np.sqrt(((answers - self.coordinates) ** 2).sum(axis=1).mean()))
        return self.coordinates

    def _as_one(self, there: Floats, image: Floats) -> Floats:
        """Coordinates (…, n_modes) from those of a run and of its mirror image."""
        odd = slice(len(self.modes) - self.odd, None)
        q = (there + image) / 2
        q[..., odd] = (there[..., odd] - image[..., odd]) / 2
        return np.asarray(q)

    def weights_for(self, muscles: Sequence[str], sides: Sequence[str], modes: Floats) -> dict[str, Floats]:
        """Its weights for other shapes (n_modes, n_nodes, 3) and other inputs; those that it does not have do nothing."""
        mine, wanted = ([*names, *(f"{name} apart" for name in apart)] for names, apart in ((self.muscles, self.sides), (muscles, sides)))
        overlap = self.modes.reshape(len(self.modes), -1) @ modes.reshape(len(modes), -1).T / modes.shape[1]
        weights = dict(self.weights)
        for name in ("W1", "W2", "W3", "V"):
            old = weights[name]
            rows = [old[:, mine.index(what)] if what in mine else np.zeros_like(old[:, 0]) for what in wanted]
            weights[name] = np.concatenate([np.stack(rows, axis=1), old[:, len(mine) :]], axis=1)
        return weights | {name: weights[name] @ overlap for name in ("V", "U")}

    def _at_rest(self, n_runs: int) -> _Memory:
        shape = len(self.weights["V"]), n_runs
        nothing = [np.zeros((*shape, tau.shape[-1])) for tau in self._taus]
        return _Memory(np.zeros((*shape, len(self._mirror))), nothing, [seen.copy() for seen in nothing])

    def _follow(self, memory: _Memory, target: Floats, dt: float) -> Floats:
        """What the networks answer, (n_networks, n_runs, n_modes), after `dt` seconds to inputs (n_runs, n_inputs); they remember."""
        start, n = memory.levels, int(np.ceil(dt / STEP - 1e-9))
        for k in range(1, n + 1):
            everything = memory.levels = start + (target - start) * (k / n)
            for i, tau in enumerate(self._taus):
                seen = features(self.weights, i + 1, everything)
                memory.kept[i] = fade(tau, memory.kept[i], memory.seen[i], seen, dt / n)
                memory.seen[i] = seen
                everything = np.concatenate([everything, memory.kept[i]], axis=-1)
        return np.asarray(answer(self.weights, everything))

    def displacement(self, coordinates: Floats | None = None, nodes: Ints | None = None) -> Floats:
        """Displacement in m of nodes (n,), by default all, (…, n, 3), for coordinates (…, n_modes) in mm, by default the present ones."""
        q = self.coordinates if coordinates is None else coordinates
        some = slice(None) if nodes is None else nodes
        points, skin = self.points[some], self.skin if nodes is None else np.flatnonzero(np.isin(nodes, self.skin))
        u = (q @ self.modes[:, some].reshape(len(self.modes), -1)).reshape(*q.shape[:-1], *points.shape)
        if self.room is not None:
            rest = 1e3 * points[skin]
            places = rest + u[..., skin, :]
            u[..., skin, :] = self.room.clear(places.reshape(-1, 3)).reshape(places.shape) - rest
        return 1e-3 * u

    def sequence(self, time: Floats, inputs: Floats) -> tuple[Floats, Floats]:
        """Coordinates (n_t, n_modes) in mm and doubt (n_t,) in mm from rest at ``time[0]``, for `inputs` (n_t, n_inputs)."""
        self.reset()
        coordinates, doubt = np.zeros((len(time), len(self.modes))), np.zeros(len(time))
        for i in range(1, len(time)):
            coordinates[i], doubt[i] = self._step(inputs[i], time[i] - time[i - 1]), self.doubt
        return coordinates, doubt

    def sequences(self, time: Floats, inputs: Floats) -> Floats:
        """Coordinates (n_t, n_runs, n_modes) in mm of many runs at once, for `inputs` (n_t, n_runs, n_inputs)."""
        n_runs, apart = inputs.shape[1], bool(inputs[..., len(self.muscles) :].any())
        seen = np.concatenate([inputs, inputs * self._mirror], axis=1) if apart else inputs
        memory = self._at_rest(seen.shape[1])
        answers = [self._follow(memory, seen[i], time[i] - time[i - 1]).mean(axis=0) for i in range(1, len(time))]
        q = np.stack([np.zeros_like(answers[0]), *answers])
        return self._as_one(q[:, :n_runs], q[:, -n_runs:])
