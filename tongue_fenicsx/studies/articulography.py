# SPDX-License-Identifier: MIT
"""Articulography: what sensors glued to a speaker's tongue and jaw ask of ours."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

from ..anatomy.subject import Frame
from ..core.errors import InputError, reading
from ..core.number_tables import mark_of, number_in
from ..core.types import Floats
from ..geometry.polyline import arc_length
from ..geometry.registration import Similarity
from ..meshing.tongue_mesh import TongueMesh
from .goals import Track, outline_of

STILL = 0.3
"""In degrees: the jaw turns back where it has gone farther than this."""
SAGITTAL = np.array([1.0, 0.0, 1.0])
ALIGNMENTS = ("none", "rigid", "scale")


@dataclass(frozen=True)
class Recording:
    """Places of sensors over time; a run begins at rest, `lead` seconds before time `begin` of the table.

    Attributes
    ----------
    times : (n,) array
        In s, growing.
    places : dict
        Sensor to its places (n, 3) in m, in our axes.
    rest, begin, lead : float
        Time of the table at which the tongue has its rest shape, and at which the movement begins, and how long before that the run does.
    """

    times: Floats
    places: dict[str, Floats]
    rest: float
    begin: float
    lead: float

    @classmethod
    def read(
        cls, table: Path, time: str, columns: Mapping[str, Sequence[str]], frame: Frame, rest: float, begin: float | None, lead: float
    ) -> Recording:
        """Read a table with a line of names, of which `columns` names three for each sensor; lines that begin with # are skipped. Without
        `begin` the movement begins at rest.

        Raises
        ------
        InputError
            If a column is missing, has a cell that is no finite number, times do not grow, or the movement lies outside them.
        """
        with reading(table, "a table with a line of names"):
            lines = [line for line in table.read_text(encoding="utf-8-sig").splitlines() if line.strip() and not line.startswith("#")]
            mark = mark_of("\n".join(lines))
            rows = list(csv.DictReader(lines, delimiter=mark))
        found = rows[0] if rows else {}
        named = [time, *(name for names in columns.values() for name in names)]
        for name in named:
            if name not in found:
                raise InputError(f"{table}: no column {name!r}; it has {', '.join(map(str, found)) or 'no line'}.")
        with reading(table, "numbers in all columns that are named"):
            cells = {name: np.array([_number(row[name], mark) for row in rows]) for name in named}
            times = cells[time]
            places = {name: frame.metres(np.column_stack([cells[c] for c in names])) for name, names in columns.items()}
        if not (np.diff(times) > 0).all() or not all(np.isfinite(at).all() for at in (times, *places.values())):
            raise InputError(f"{table}: times that grow and finite places are expected; leave out the lines where a sensor was lost.")
        begin = rest if begin is None else begin
        for key, moment in (("rest", rest), ("begin", begin)):
            if not times[0] <= moment <= times[-1]:
                raise InputError(f"{table}: recording.{key}: {moment:g} s; a time from {times[0]:g} to {times[-1]:g} s is expected.")
        return cls(times, places, rest, begin, lead)

    def at_rest(self, sensor: str) -> Floats:
        """The place (3,) of a sensor."""
        return np.array([np.interp(self.rest, self.times, along) for along in self.places[sensor].T])

    def moving(self, sensor: str) -> tuple[Floats, Floats]:
        """Times (n,) of the run in s and places (n, 3) of a sensor from where the movement begins."""
        rows = self.times >= self.begin
        return self.times[rows] - self.begin + self.lead, self.places[sensor][rows]

    def tracks(self, sensors: Iterable[str], laid: Similarity, lateral: bool) -> dict[str, Track]:
        """Paths of sensors as they are laid on our tongue, from where they are at rest."""
        paths = {}
        for name in sensors:
            times, places = self.moving(name)
            moved = laid.scale * (places - self.at_rest(name)) @ laid.rotation.T
            paths[name] = Track(times, moved * (1.0 if lateral else SAGITTAL), name)
        return paths

    def jaw(self, sensor: str, laid: Similarity, centre: Floats) -> list[tuple[float, float, float]]:
        """The turn in degrees of a jaw with a sensor about the transverse axis through `centre` (3,) in m, downward, from where it is at
        rest: (duration, start, target) to where the movement begins and from one turning point to the next."""
        times, places = self.moving(sensor)
        x, _, z = (laid.forward(np.vstack([self.at_rest(sensor), places])) - centre).T
        angle = np.degrees(np.unwrap(np.arctan2(z, x)))
        angle = angle[1:] - angle[0]
        turns = [find_peaks(sign * angle, prominence=STILL)[0] for sign in (1, -1)]
        at = np.unique(np.concatenate([[0, len(angle) - 1], *turns]))
        times, angle = np.append(0.0, times[at]), np.append(0.0, angle[at])
        return list(zip(np.diff(times), angle[:-1], angle[1:], strict=True))


def _number(cell: str, mark: str) -> float:
    if (number := number_in(cell, mark)) is None:
        raise ValueError(f"{cell!r} is no number")
    return number


def lay(recording: Recording, glued: Mapping[str, Floats], align: str) -> tuple[Similarity, float]:
    """How a speaker's mid-sagittal plane is laid on ours: with the least distance of the sensors at rest from the points (3,) that they are
    glued to, by a turn and a shift ("rigid"), also a scale, or without a turn ("none"); and the root mean square in m that is left.

    Raises
    ------
    InputError
        If one sensor is to tell a turn.
    """
    theirs, ours = (np.array(places) * SAGITTAL for places in ([recording.at_rest(name) for name in glued], list(glued.values())))
    a, b = ((places - places.mean(axis=0)) @ [1, 0, 1j] for places in (theirs, ours))
    turn = np.vdot(a, b) / max(np.vdot(a, a).real, 1e-12)  # the least squares of b − turn a
    if align == "none":
        turn = 1.0
    elif len(glued) < 2:
        raise InputError('recording.align: one sensor does not tell how the head was turned; at least two, or "none" is expected.')
    rotation = Rotation.from_rotvec([0.0, -np.angle(turn), 0.0]).as_matrix()
    scale = float(abs(turn)) if align == "scale" else 1.0
    laid = Similarity(rotation, scale, ours.mean(axis=0) - scale * rotation @ theirs.mean(axis=0))
    return laid, float(np.sqrt(((laid.forward(theirs) - ours) ** 2).sum(axis=1).mean()))


def behind_tip(tongue: TongueMesh, length: float) -> Floats:
    """The point (3,) in m of the mid-line at a length in m behind the tip, along the dorsum.

    Raises
    ------
    InputError
        If the mesh has no landmarks tip and dorsum, no mid-plane, or the mid-line is shorter.
    """
    if missing := {"tip", "dorsum"} - tongue.landmarks.keys():
        raise InputError(f"recording: the tongue has no landmark {sorted(missing)[0]!r}; give the point as at = [x, y, z].")
    outline = outline_of(tongue)
    begin, top = (int(np.linalg.norm(outline.points - tongue.landmarks[name], axis=1).argmin()) for name in ("tip", "dorsum"))
    beside: dict[int, list[int]] = {}
    for a, b in outline.pieces:
        beside.setdefault(int(a), []).append(int(b))
        beside.setdefault(int(b), []).append(int(a))
    ways = []
    for first in beside[begin]:
        way = [begin, first]
        while way[-1] != begin:
            way.append(next(node for node in beside[way[-1]] if node != way[-2]))
        ways.append(way)
    way = min(ways, key=lambda nodes: nodes.index(top))
    line = outline.points[way]
    along = arc_length(line)
    if not 0 <= length <= along[-1] / 2:
        raise InputError(f"recording: {1e3 * length:g} mm behind the tip; from 0 to {1e3 * along[-1] / 2:.0f} is expected.")
    return np.array([np.interp(length, along, coordinate) for coordinate in line.T])
