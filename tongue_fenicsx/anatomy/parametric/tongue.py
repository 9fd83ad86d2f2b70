# SPDX-License-Identifier: MIT
"""The built-in tongue: a smooth symmetric surface from a mid-sagittal contour and half-widths, and eleven muscles.

The numbers are millimetres in the frame of the superior genial spine (x posterior, y right, z up). The contour and the
muscle paths follow means published for the Grenoble tongue (Buchaillard, Perrier, Payan 2009; Stavness et al. 2011),
the fans and layers follow Gray's anatomy. The surface is the zero set of h(x, z)² − y², where the half-width h falls to
zero at the contour like a superellipse, so that edges and tip are round.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import cache, partial

import numpy as np
from scipy.interpolate import make_interp_spline

from ...core.errors import InputError
from ...core.types import Bools, Floats
from ...geometry.fibre_bundle import FibreBundle
from ...geometry.polyline import arc_length
from ...geometry.surface import LABEL, Surface
from ..anatomy import Anatomy, Muscle
from ..catalogue import pcsa
from .bones import parametric_bones
from .profile import Profile
from .size import SPLITTABLE, TongueShape


def parametric_tongue(shape: TongueShape | None = None, split: Collection[str] = ()) -> Anatomy:
    """The built-in tongue: mandible and hyoid attachments, eleven muscles, palate, teeth, mandible, hyoid and pharynx.

    Parameters
    ----------
    shape : TongueShape
        Length, width, height and scale, if not those of the tongue as drawn; bones and muscles follow.
    split : collection of str
        ``"GGP"`` gives the lowest fibres of genioglossus, to the hyoid, as a muscle of their own, GGH (four parts as in
        the G-OBIM tongue of Calka et al. 2025); ``"SL"`` gives the superior longitudinal a left and a right half.

    Returns
    -------
    Anatomy
        In m; its mesh is a mirrored half, so that symmetric activation moves it symmetrically.

    Raises
    ------
    InputError
        If `split` names another muscle.
    """
    for name in split:
        if name not in SPLITTABLE:
            raise InputError(f"split: {name!r} is not one of {', '.join(SPLITTABLE)}.")
    shape = shape or TongueShape()
    profile, half, drawn = _as_drawn()
    labels = _attachment(half.centroids)
    n = len(half.points)
    mirrored = half.points * (1, -1, 1)
    points = np.vstack([half.points, mirrored])
    on_plane = np.arange(n)[half.points[:, 1] < 1e-6]
    twin = np.arange(n) + n
    twin[on_plane] = on_plane
    triangles = np.vstack([half.triangles, twin[half.triangles][:, ::-1]])
    surface = Surface(shape.place(points), triangles, np.concatenate([labels, labels]))
    if surface.volume < 0:
        surface = Surface(surface.points, triangles[:, ::-1].copy(), surface.labels)
    muscles = {muscle.name: muscle for muscle in _muscles(profile, shape, split)}
    bones = {name: bone.transform(shape.place) for name, bone in drawn.items()}
    return Anatomy("parametric tongue", surface, muscles, np.zeros(3), bones, mirrored=True)


@cache
def _as_drawn() -> tuple[Profile, Surface, dict[str, Surface]]:
    """Profile, right half and bones in mm, of which every shape is made; kept, as they take seconds."""
    profile = Profile()
    return profile, profile.surface(), parametric_bones(profile)


def _attachment(centroids: Floats) -> np.ndarray:
    """Labels of surface triangles (mm): symphysis and mylohyoid line to the mandible, body and greater horns to the hyoid."""
    x, y, z = centroids.T
    symphysis = (x < np.where(z < -5.0, 4.0, 2.0)) & (z < 5.0)
    line = np.interp(x, [0, 6, 10, 16, 24], [-9.0, -7.0, -5.5, -2.5, 1.0])
    mylohyoid = (abs(z - line) < 3.0) & (x < 24.0) & (y > 4.0)
    body = (x > 30.5) & (x < 37.0) & (y < 12.0) & (z < -9.0)
    horn = (abs(y - np.interp(x, [35, 42, 54], [10.0, 14.5, 20.5])) < 4.0) & (x > 34.0) & (z < -5.0)
    hyoid = body | horn
    return np.select([symphysis | mylohyoid, hyoid], ["mandible", "hyoid"], "free").astype(LABEL)


# Muscles of the right side, in mm. Each yields the fibres and the radius around them that the muscle fills.

Lines = list[Floats]

STYLOID = np.array([73.5, 36.0, 52.0])
"""Where styloglossus starts, at the styloid process."""


def _smooth(points: object, n: int = 24) -> Floats:
    """A curve through a few points."""
    through = np.asarray(points, dtype=float)
    s = arc_length(through)
    curve: Floats = make_interp_spline(s, through, k=min(2, len(through) - 1))(np.linspace(0, s[-1], n))
    return curve


def _to_surface(profile: Profile, start: Floats, angle: float, under: float) -> Floats:
    """End (x, z) of the mid-sagittal ray at `angle` (degrees above posterior) that stops `under` mm below the contour."""
    r = np.arange(8.0, 70.0, 0.25)[:, None]
    ray = start + r * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    outside = profile.depth(ray) < under
    return np.asarray(ray[max(int(np.argmax(outside)) - 1, 0)])


def _genioglossus(profile: Profile, angles: Floats, spread: tuple[float, ...]) -> Lines:
    """The fan from the tendon line at the spine: the fibres leave backward and turn up, the more the further forward they end."""
    lines = []
    for angle in angles:
        start = np.array([0.3, np.interp(angle, [-1, 45, 65], [-6.5, -0.5, 1.5])])
        if angle < 66:
            end = _to_surface(profile, start, angle, 3.5)
            along = np.radians(angle)
            bend = np.interp(angle, [0.0, 30.0, 65.0], [0.5, 2.5, 5.5])
            knee = (start + end) / 2 + bend * np.array([np.sin(along), -np.cos(along)])
        else:
            end = _to_surface(profile, np.array([10.5 - 0.2 * (angle - 66), 15.0]), angle, 3.5)
            knee = np.array([8.5 - 0.15 * (angle - 66), 13.0 + 0.04 * (angle - 66)])
        for y in spread:
            lines.append(_smooth([(start[0], 0.6 + 0.2 * y, start[1]), (knee[0], 0.6 * y + 0.4, knee[1]), (end[0], y, end[1])]))
    return lines


def _styloglossus(profile: Profile) -> Lines:
    """From the styloid process a band to the side of the tongue; three fibres go on to the tip and two turn to the septum."""
    entries = [(31.0, 22.0, 30.0), (33.0, 22.0, 27.5), (35.0, 22.0, 25.5), (36.5, 22.0, 23.5), (38.5, 22.0, 21.5)]
    ends = [
        [(25.0, 18.0, 21.5), (14.0, 15.0, 18.5), (0.0, 12.0, 20.0), (-13.0, 8.5, 21.5)],
        [(26.0, 17.5, 18.5), (13.0, 13.0, 14.5), (0.0, 10.0, 16.5), (-13.0, 6.5, 20.5)],
        [(28.0, 16.5, 16.0), (13.0, 9.5, 12.5), (0.0, 8.0, 16.5), (-12.0, 5.0, 20.5)],
        [(30.0, 17.5, 20.0), (25.0, 11.0, 15.0), (23.0, 1.5, 14.0)],
        [(28.0, 16.5, 17.5), (21.0, 10.0, 12.5), (18.5, 1.5, 11.0)],
    ]
    return [np.vstack([STYLOID, _smooth([entry, *end], 48)]) for entry, end in zip(entries, ends, strict=True)]


def _hyoglossus(profile: Profile) -> Lines:
    lines = []
    for s in np.linspace(0, 1, 11):
        origin = np.array([33.0 + 17 * s, 9.5 + 8.5 * s, -10.0 + 1.5 * s])
        middle = np.array([30.0 + 17 * s, 14.0 + 5 * s, 5.0 + 3.0 * s])
        end = np.array([21.5 + 15 * s, 13.0 + 5.0 * s, 19.0 + 14 * s])
        lines.append(_smooth([origin, middle, end]))
    return lines


def _inferior_longitudinal(profile: Profile) -> Lines:
    path = np.array([
        (50.0, 12.5, -6.0), (38.0, 10.5, -6.5), (31.0, 9.5, -3.0), (28.0, 9.5, 5.0), (23.0, 9.0, 13.5), (12.0, 8.5, 16.0),
        (0.0, 7.0, 18.0), (-9.0, 6.0, 20.5), (-17.0, 4.0, 22.8),
    ])  # fmt: skip
    return [_smooth(path + np.array([0.0, side, 0.0]), 48) for side in (-1.5, 1.5)]


def _dorsal_shell(profile: Profile, fractions: Floats, under: float) -> Lines:
    """Curves `under` mm below the dorsal surface from the tip to the vallecula, at fractions of the half-width."""
    contour = profile.contour
    tip = int(np.argmin(contour[:, 0]))
    contour = np.roll(contour, -tip, axis=0)
    if contour[len(contour) // 10, 1] < contour[0, 1]:
        contour = np.roll(contour[::-1], 1, axis=0)
    stop = int(np.argmax((contour[:, 0] > 20) & (contour[:, 1] < -8.0)))
    start = int(np.argmax(contour[:, 1] > contour[0, 1] + 3.0))
    station = contour[np.linspace(start, stop, 30).astype(int)]
    inward = profile.inward(np.insert(station, 1, 0.0, axis=1))[:, [0, 2]]
    d = np.arange(0.0, 12.0, 0.25)
    paths = station[:, None] + d[None, :, None] * inward[:, None]
    width = profile.half_width(paths.reshape(-1, 2)).reshape(len(station), len(d))
    widest = np.minimum(np.maximum.accumulate(width, axis=1)[:, -1], 24.0)
    lines = []
    for fraction in fractions:
        y = fraction * widest
        at = np.argmax(width >= y[:, None], axis=1)
        surface = paths[np.arange(len(station)), at]
        skin = np.insert(surface, 1, y, axis=1)
        lines.append(skin + under * profile.inward(skin))
    return lines


def _superior_longitudinal(profile: Profile) -> Lines:
    lines = _dorsal_shell(profile, np.array([0.03, 0.2, 0.4, 0.6, 0.78, 0.92]), 2.2)
    return [line[::-1] for line in [*lines, *(line * (1, -1, 1) for line in lines)]]


def _verticalis(profile: Profile) -> Lines:
    """A fan beside genioglossus; before the mid dorsum its laminae alternate with those of GGM and GGA, near the mid-line too."""
    lines = []
    beside = np.linspace(0.3, 0.82, 6)
    for fraction, under_skin in zip([0.1, 0.2, *beside], _dorsal_shell(profile, np.array([0.1, 0.2, *beside]), 2.5), strict=True):
        for top in under_skin[2:-2]:
            if fraction < beside[0] and top[0] > 24.0:
                continue
            # like the fan of genioglossus, but without turning inward in the blade
            front = np.clip(-top[0] / 16, 0, 1)
            centre = np.array([2.0, (0.35 + 0.6 * front) * top[1], 2.0 + 6.0 * front])
            reach = np.linspace(0.0, 16.0, 17)[:, None] * (centre - top) / np.linalg.norm(centre - top)
            line = top + reach
            line = line[np.minimum.accumulate(profile.level(line) > 1.5)]
            lines.append(line[[0, len(line) // 2, -1]])
    return lines


def _transversus(profile: Profile) -> Lines:
    lines = []
    for x in np.arange(-15.0, 48.0, 5.0):
        for z in np.arange(-9.0, 38.0, 5.0):
            if profile.depth(np.array([[x, z]]))[0] < 4.0 or (z < 17.0 and x < 20.0 - 0.5 * z):
                continue
            end = min(0.66 * float(profile.half_width(np.array([[x, z]]))[0]), 17.0)
            backward, upward = 0.07 + 0.006 * (x - z), 0.34 - 0.0045 * x - 0.01 * z  # a fan
            lines.append(np.array([(x + backward * y, y, z + upward * y) for y in (0.0, end / 2, end)]))
    return lines


def _geniohyoid(profile: Profile) -> Lines:
    """Level under the tongue; its end bends down to the hyoid's body."""

    def line(y: float) -> Floats:
        return _smooth([(1.5, 2.0 + y, -10.5), (16.5, 3.5 + y, -11.5), (26.0, 4.0 + y, -12.9), (33.0, 4.5 + 1.3 * y, -15.0)])

    return [line(0.0), line(2.5)]


def _mylohyoid(profile: Profile) -> Lines:
    lines = []
    for x in np.arange(5.5, 30.0, 1.5):
        z = float(np.interp(x, [0, 6, 10, 16, 22, 29], [-9.0, -6.5, -5, -1, 4, 10]))
        side = float(profile.half_width(np.array([[x, z]]))[0]) - 1.0
        low = -13.1
        drift = 0.3 * (x - 17.0)
        middle = (x + drift / 3, 0.82 * side, (z + low) / 2)
        lines.append(_smooth([(x, side, z), middle, (x + drift, 0.4 * side, low), (x + drift, 0.0, low - 0.6)]))
    return lines


RIGHT: dict[str, tuple[Callable[[Profile], Lines], float]] = {
    "GGP": (partial(_genioglossus, angles=np.arange(-1.0, 43.0, 3.0), spread=(1.2, 3.2, 5.2, 7.2)), 1.62),
    "GGM": (partial(_genioglossus, angles=np.arange(47.5, 64.0, 2.7), spread=(1.2, 2.9, 4.6)), 1.62),
    "GGA": (partial(_genioglossus, angles=np.arange(68.0, 122.0, 7.0), spread=(1.2, 4.5)), 1.78),
    "SG": (_styloglossus, 1.8),
    "HG": (_hyoglossus, 2.4),
    "IL": (_inferior_longitudinal, 1.9),
    "VERT": (_verticalis, 1.35),
    "TRANS": (_transversus, 2.75),
    "GH": (_geniohyoid, 2.4),
    "MH": (_mylohyoid, 1.72),
}
"""Fibres and the radius in mm around them that the muscle fills, for the muscles that have a left and a right."""


HYOID_FIBRES = 5.0
"""Genioglossus fibres up to this angle above the horizontal run to the hyoid (part GGh of Calka et al. 2025)."""


def _muscles(profile: Profile, shape: TongueShape, split: Collection[str]) -> Iterator[Muscle]:
    rules = dict(RIGHT)
    if "GGP" in split:
        rule, radius = rules["GGP"]
        assert isinstance(rule, partial)
        angles = rule.keywords["angles"]
        rules["GGP"] = partial(rule, angles=angles[angles > HYOID_FIBRES]), radius
        rules["GGH"] = partial(rule, angles=angles[angles <= HYOID_FIBRES]), radius
    bundles = {name: (FibreBundle(rule(profile), 3.0, 1.0), radius) for name, (rule, radius) in rules.items()}
    for name, (bundle, radius) in bundles.items():
        others = [bundles[other][0] for other in ("GGP", "GGH") if "GGP" in split and name in ("GGP", "GGH") and other != name]
        for side, sign in (("L", -1.0), ("R", 1.0)):
            fibres = FibreBundle([shape.place(line * (1, sign, 1)) for line in bundle.lines], 3e-3 * shape.scale)
            region = partial(_one_side, shape, bundle, others, radius, sign)
            anchor = shape.place(np.array([STYLOID * (1, sign, 1)]))[0] if name == "SG" else None
            section = pcsa(name) - (pcsa("GGH") if name == "GGP" and "GGP" in split else 0.0)
            yield Muscle(f"{name}_{side}", fibres, region, section / 2, anchor)
    shell = FibreBundle(_superior_longitudinal(profile), 3.0, 1.0)
    for name, sign in (("SL_L", -1.0), ("SL_R", 1.0)) if "SL" in split else (("SL", 0.0),):
        lines = [shape.place(line) for line in shell.lines if sign * line[0, 1] >= 0]
        yield Muscle(
            name, FibreBundle(lines, 3e-3 * shape.scale), partial(_under_skin, shape, profile, shell, sign), pcsa("SL") / (1 + abs(sign))
        )


def _one_side(shape: TongueShape, bundle: FibreBundle, others: list[FibreBundle], radius: float, sign: float, points: Floats) -> Bools:
    """Within `radius` of the fibres drawn on the right, mirrored by `sign`, and nearer to them than to `others`."""
    drawn = shape.to_drawing(points) * (1, sign, 1)
    inside = bundle.within(drawn, radius) & (drawn[:, 1] > 0)
    for other in others:
        inside[inside] = bundle.distance(drawn[inside]) <= other.distance(drawn[inside])
    return inside


def _under_skin(shape: TongueShape, profile: Profile, bundle: FibreBundle, sign: float, points: Floats) -> Bools:
    drawn = shape.to_drawing(points)
    near = bundle.within(drawn, 6.5) & (sign * drawn[:, 1] >= 0)
    near[near] = profile.level(drawn[near]) < 4.4
    return near
