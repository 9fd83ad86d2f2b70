# SPDX-License-Identifier: MIT
"""Tongues of which only a surface is known: frame, cap, and the muscles of the built-in tongue."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from conftest import SUBJECT, needs_subject
from test_cli import tongue as command

import tongue_fenicsx as tf
from tongue_fenicsx.anatomy.anatomy import Anatomy
from tongue_fenicsx.anatomy.carry_over import CarriedOver
from tongue_fenicsx.anatomy.comparison import compare
from tongue_fenicsx.anatomy.frame_guess import guess_frame, likely_unit
from tongue_fenicsx.geometry.registration import Similarity, SmoothMap, scatter
from tongue_fenicsx.geometry.surface import Surface, read_surface
from tongue_fenicsx.meshing import build as meshing

SURFACES = SUBJECT.parent / "surfaces"
needs_surfaces = pytest.mark.skipif(not SURFACES.is_dir(), reason="surfaces as people have them are not beside the project")


@cache
def drawn() -> tf.Anatomy:
    """The built-in tongue."""
    return tf.parametric_tongue()


def bent(points: np.ndarray) -> np.ndarray:
    """Another person's: narrower, longer, with an arched back."""
    x, y, z = points.T
    return np.column_stack([1.1 * x, 0.92 * y, z + 2e-3 * np.sin(40 * x)])


def test_similarity_is_found_again() -> None:
    """Of points that one has moved."""
    points = np.random.default_rng(0).normal(size=(20, 3))
    c, s = np.cos(0.3), np.sin(0.3)
    moved = Similarity(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), 1.7, np.array([1.0, 2.0, 3.0])).forward(points)
    found = Similarity.between(points, moved)
    np.testing.assert_allclose(found.forward(points), moved, atol=1e-12)
    np.testing.assert_allclose(found.backward(moved), points, atol=1e-12)


def test_smooth_map_lays_one_surface_on_another() -> None:
    """Its inverse is one, within the tongue too, where it is near what bent it."""
    source = drawn().surface
    laid = SmoothMap(source, source.transform(bent))
    assert laid.distance < 0.7e-3
    inside = np.random.default_rng(0).uniform(source.points.min(axis=0), source.points.max(axis=0), (2000, 3))
    inside = inside[source.contains(inside)]
    np.testing.assert_allclose(laid.backward(laid.forward(inside)), inside, atol=2e-5)
    off = np.linalg.norm(laid.forward(inside) - bent(inside), axis=1)
    assert off.mean() < 2.5e-3  # a surface does not say what slides along it


def test_muscles_come_along() -> None:
    """To another person's tongue: they fill what they filled there, along the same fibres, from the same bones."""
    source = drawn()
    surface = source.surface.transform(bent)
    plain = Surface(surface.points, surface.triangles)
    carried = CarriedOver(plain, plain)
    assert list(carried.muscles) == list(source.muscles)
    assert np.mean(carried.surface.labels == surface.labels) > 0.95
    np.testing.assert_allclose(carried.genial_spine, 0.0, atol=2.5e-3)
    assert "nobody has measured them" in carried.notes[0]
    grid = scatter(plain, 4000) * 0.7
    for name, muscle in source.muscles.items():
        there, expected = carried.muscles[name].region(bent(grid)), muscle.region(grid)
        if expected.sum() > 100:
            assert 2 * (there & expected).sum() / (there.sum() + expected.sum()) > 0.7, name
        assert carried.muscles[name].fibres.lines[0].shape == muscle.fibres.lines[0].shape


def _as_found(folder: Path) -> Path:
    """The built-in tongue in mm, LPS, off the mid-plane, tilted by 12°, without its floor."""
    surface = drawn().surface
    c, s = np.cos(np.radians(12)), np.sin(np.radians(12))
    points = 1e3 * surface.points @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    given = np.column_stack([-points[:, 1] + 31.0, points[:, 0] - 100.0, points[:, 2] + 7.0])
    kept = surface.triangles[surface.centroids[:, 2] > -8e-3]
    Surface(given, kept).to_pyvista().clean().save(folder / "scan.ply")
    return folder / "scan.ply"


def test_folder_from_a_scan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Unit, axes, mid-plane and hole are found; the folder becomes a mesh with muscles and bonds."""
    scan, folder = _as_found(tmp_path), tmp_path / "anna"
    code, said = command(capsys, "subject", "init", folder, scan)
    assert code == 0, said
    assert "axes: LPS" in said
    assert "holes: with" in said
    assert 'unit = "mm"' in (folder / "frame.toml").read_text(encoding="utf-8")
    anatomy = tf.read_subject(folder)
    assert set(anatomy.surface.edge_sharing()) == {2}
    assert abs(anatomy.surface.points[:, 1].min() + anatomy.surface.points[:, 1].max()) < 1e-3
    notes = " ".join(anatomy.notes)
    assert "left open was closed by" in notes
    assert "the cap of its hole is bonded" in notes
    assert {*anatomy.surface.labels} == {"free", "mandible", "hyoid"}
    assert {"GGP_L", "GGP_R", "TRANS_L", "SL"} <= set(anatomy.muscles)
    figures = meshing.build(anatomy, tmp_path / "anna.msh", 8e-3)
    assert figures["muscles"]["GGP_L"]["volume_m3"] > 1e-6
    code, said = command(capsys, "subject", "init", folder, scan)
    assert (code, f"FOLDER {folder}: is there already; the name of a new folder is expected." in " ".join(said.split())) == (2, True)


def test_what_is_no_tongue_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A needle has no likeness, and leaves no folder."""
    needle = tmp_path / "needle.ply"
    pv.Box((0, 100, -1, 1, -1, 1)).triangulate().subdivide(2).save(needle)
    code, said = command(capsys, "subject", "init", tmp_path / "new", needle)
    assert code == 2
    assert f"{needle}: the surface resembles a tongue in no attitude" in " ".join(said.split())
    code, said = command(capsys, "subject", "init", tmp_path / "new", tmp_path / "needle.txt")
    assert code == 2
    assert "needle.txt: a file that ends in .stl, " in " ".join(said.split())
    for name, factor in (("turned", 0.35), ("two", 0.0)):
        mesh = drawn().surface.to_pyvista().rotate_z(np.degrees(factor), inplace=False)
        (mesh + pv.Sphere(radius=0.01, center=(0.0, 0.0, 0.1)) if name == "two" else mesh).save(tmp_path / f"{name}.ply")
        code, said = command(capsys, "subject", "init", tmp_path / "new", tmp_path / f"{name}.ply")
        assert code == 2
        assert {"turned": "mirrored at any plane across its axes", "two": "holds 2 bodies"}[name] in " ".join(said.split())
    for name, solid in (("ball", pv.Sphere(radius=30)), ("egg", pv.ParametricEllipsoid(35, 25, 28).triangulate())):
        solid.save(tmp_path / f"{name}.ply")
        code, said = command(capsys, "subject", "init", tmp_path / "new", tmp_path / f"{name}.ply")
        assert (code, "resembles a tongue as much in one attitude" in " ".join(said.split())) == (2, True), said
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / ("x" * 300)):
        code, said = command(capsys, "subject", "init", folder, _as_found(tmp_path))
        assert (code, said.startswith("error: ")) == (2, True), said
    assert not (tmp_path / "new").exists()


def test_units_are_told_by_size() -> None:
    """Of a tongue in any of them, and of one in none."""
    points = drawn().surface.points
    assert [likely_unit(points * factor) for factor in (1, 1e2, 1e3)] == ["m", "cm", "mm"]
    assert likely_unit(points / 4.8e-4) == pytest.approx(4.8e-4)


@needs_subject
def test_muscles_come_along_to_a_measured_tongue() -> None:
    """Of subject PB: fibres within 20° of the measured ones, volumes within a quarter."""
    measured = tf.read_subject(SUBJECT)
    carried = CarriedOver(measured.surface, measured.surface)
    anatomy = Anatomy("carried", carried.surface, carried.muscles, carried.genial_spine)
    np.testing.assert_allclose(carried.genial_spine, measured.genial_spine, atol=2e-3)
    pairs: dict[str, list[float]] = {}
    for name, agreement in compare(anatomy, measured, spacing=2.5e-3).items():
        assert agreement.angle < 20, name
        pairs.setdefault(name.split("_")[0], []).append(agreement.volume_ratio)
    assert len(pairs) == 11
    for name, ratios in pairs.items():
        assert np.mean(ratios) == pytest.approx(1, abs=0.25), name


@needs_surfaces
@pytest.mark.parametrize(
    ("file", "axes", "unit"),
    [
        ("ultrax/Speaker01_Phoneme09.ply", "LPS", "mm"),
        ("ultrax/Speaker02_Phoneme03.ply", "LPS", "mm"),
        ("lrquad/3dmodel_tongue_tuned_v3.obj", "PSL", 0.00048),
    ],
)
def test_surfaces_as_people_have_them(file: str, axes: str, unit: str | float) -> None:
    """Open, of unknown unit, in any attitude."""
    guess = guess_frame(read_surface(SURFACES / file), file)
    assert (guess.axes, guess.unit) == (axes, unit)
