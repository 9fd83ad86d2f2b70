# SPDX-License-Identifier: MIT
"""Shape, muscles and meshes, of the parametric tongue and of a real subject."""

from __future__ import annotations

import itertools
import json
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import gmsh
import numpy as np
import pytest
import pyvista as pv
from conftest import EXAMPLE, SUBJECT, needs_subject, opened

import tongue_fenicsx as tf
from tongue_fenicsx.anatomy.anatomy import gaps, measure
from tongue_fenicsx.anatomy.catalogue import CATALOGUE, PEAK_STRESS
from tongue_fenicsx.anatomy.comparison import compare
from tongue_fenicsx.anatomy.parametric.size import PRESETS, TongueShape
from tongue_fenicsx.geometry.tetrahedron import volumes
from tongue_fenicsx.meshing import build as meshing
from tongue_fenicsx.meshing.muscle_fields import MuscleField, project_muscles
from tongue_fenicsx.meshing.tetrahedra import Tetrahedra, tetrahedralise
from tongue_fenicsx.plotting import anatomy_figures as portraits

TABLE_VOLUME = {
    "GGP": 16.0, "GGM": 4.4, "GGA": 5.2, "SG": 3.5, "HG": 7.8, "IL": 3.0, "SL": 18.8, "VERT": 22.8, "TRANS": 40.6, "GH": 1.9, "MH": 5.1,
}  # fmt: skip
"""Region volumes in cm³, both sides, of the Grenoble tongue."""


@pytest.fixture(scope="module")
def parametric() -> tf.Anatomy:
    """The built-in tongue."""
    return tf.parametric_tongue()


@cache
def meshed(size: float) -> tuple[Tetrahedra, dict[str, MuscleField]]:
    """Tetrahedra of the built-in tongue and its muscles on them."""
    anatomy = tf.parametric_tongue()
    mesh = tetrahedralise(anatomy, size)
    return mesh, project_muscles(anatomy, mesh)


def test_parametric_shape(parametric: tf.Anatomy) -> None:
    """The figures of the anatomy card: volumes, dorsal arc, chord, oral width, mid-sagittal area; closed and symmetric."""
    shape = measure(parametric.surface, parametric.genial_spine)
    assert 85e-6 < shape.volume < 105e-6
    assert 60e-6 < shape.proper_volume < 80e-6
    assert shape.arc_length == pytest.approx(0.100, abs=0.005)
    assert shape.chord == pytest.approx(0.070, abs=0.002)
    assert shape.width == pytest.approx(0.050, abs=0.002)
    assert 21e-4 < shape.midsagittal_area < 30e-4
    assert set(parametric.surface.edge_sharing()) == {2}
    assert {name.split("_")[0] for name in parametric.muscles} == set(CATALOGUE) - {"GGH"}
    assert set(np.unique(parametric.surface.labels)) == {"free", "mandible", "hyoid"}
    assert list(shape.landmarks) == ["tip", "dorsum", "root", "edge_left", "edge_right"]


def test_surface_is_smooth(parametric: tf.Anatomy) -> None:
    """Neighbouring triangles of a millimetre turn by at most 25°, at the tip and the edges too."""
    mesh = parametric.surface.to_pyvista()
    edges = mesh.extract_feature_edges(feature_angle=25, boundary_edges=False, manifold_edges=False, non_manifold_edges=False)
    assert edges.n_cells == 0


@pytest.mark.parametrize(
    ("change", "figure", "by"),
    [
        ({"length": 0.078}, "chord", 0.008), ({"width": 0.057}, "width", 0.007), ({"height": 0.0444}, "dorsum", 0.005),
        ({"root": 0.006}, "root", 0.006), ({"tip": 0.006}, "tip", -0.006), ({"tip": -0.004}, "tip", 0.004),
    ],
)  # fmt: skip
def test_shape_parameters(parametric: tf.Anatomy, change: dict[str, float], figure: str, by: float) -> None:
    """Each length moves the figure that it is named after; the surface stays closed, muscles and bones follow."""
    other = tf.parametric_tongue(TongueShape(**change))

    def value(anatomy: tf.Anatomy) -> float:
        shape = measure(anatomy.surface, anatomy.genial_spine)
        point = shape.landmarks.get(figure)
        return float(getattr(shape, figure)) if point is None else float(point[2 if figure == "dorsum" else 0])

    assert value(other) - value(parametric) == pytest.approx(by, abs=0.0012)
    assert set(other.surface.edge_sharing()) == {2}
    for name, bone in other.bones.items():
        assert bone.signed_distance(other.surface.points[::4]).min() > 0, name
    for muscle in other.muscles.values():
        middle = np.array([line[len(line) // 2] for line in muscle.fibres.lines])
        assert muscle.region(middle).mean() > 0.8, muscle.name


def test_size_of_a_person(parametric: tf.Anatomy) -> None:
    """Adult men and women have the mean volumes of Liégeois 2010; a newborn's tongue is half as long; ranges hold."""
    for sex, volume in (("male", 89.9e-6), ("female", 68.9e-6)):
        tongue = tf.parametric_tongue(TongueShape.of_person(sex))
        assert measure(tongue.surface, tongue.genial_spine).proper_volume == pytest.approx(volume, rel=0.01)
    assert TongueShape.of_person("male", 0).scale < 0.5 * TongueShape.of_person("male", 20).scale
    assert TongueShape.of_person("female", 40) == TongueShape.of_person("female", 18)
    for wrong in ({"width": 0.1}, {"length": float("nan")}, {"scale": 0.0}):
        with pytest.raises(tf.InputError, match=f"shape.{next(iter(wrong))}: .* is expected"):
            TongueShape(**wrong)
    for arguments in (("robot", 30.0), ("male", -1.0), ("male", float("nan"))):
        with pytest.raises(tf.InputError):
            TongueShape.of_person(*arguments)


def test_a_small_tongue_is_measured(parametric: tf.Anatomy) -> None:
    """The smallest tongue of all, 0.4 of the drawing and low, has an oral part, and every figure of it is one."""
    squeeze = np.array([0.4 * 58 / 70, 0.4 * 40 / 50, 0.4 * 32 / 39.4])
    grown = measure(parametric.surface, parametric.genial_spine)
    small = measure(parametric.surface.transform(lambda X: squeeze * X), squeeze * parametric.genial_spine)
    assert 0.8 * grown.width < small.width / squeeze[1] <= 1.01 * grown.width
    assert small.proper_volume == pytest.approx(np.prod(squeeze) * grown.proper_volume, rel=0.05)
    assert 0.01 < small.arc_length < 0.4 * grown.arc_length


def test_bones(parametric: tf.Anatomy) -> None:
    """Vault 17 mm deep and 21 mm half-wide, rest gaps of the table, the mandible's inner width, the hyoid's place; none in the tongue."""
    bones = parametric.bones
    for name in ("upper_teeth", "lower_teeth", "mandible", "hyoid"):
        assert set(bones[name].edge_sharing()) == {2}, name
        assert bones[name].volume > 0, name
    for name, bone in bones.items():
        assert bone.signed_distance(parametric.surface.points).min() > 0.2e-3, name
    section = 1e3 * bones["palate"].to_pyvista().slice(normal="x", origin=(0.0135, 0, 0)).points
    assert np.ptp(section[:, 2]) == pytest.approx(17.0, abs=0.5)
    assert section[:, 1].max() == pytest.approx(21.0, abs=0.3)
    found = gaps(parametric, measure(parametric.surface, parametric.genial_spine))
    assert found["dorsum_palate"] == pytest.approx(0.008, abs=0.0005)
    assert found["tip_palate"] == pytest.approx(0.008, abs=0.0005)
    assert 0.008 <= found["root_pharynx"] <= 0.009
    for x, inner in ((7.5, 8.6), (19.5, 14.8), (31.5, 21.5)):  # the table's, or wider where the bone makes way for our wider tongue
        section = bones["mandible"].to_pyvista().slice(normal="x", origin=(1e-3 * x, 0, 0)).points
        nearest = section[np.argmin(abs(section[:, 1]))]
        assert abs(nearest[1]) > 1e-3 * inner - 1e-3
        assert abs(nearest[1]) < 1e-3 * inner + 1e-3 or parametric.surface.signed_distance(nearest[None])[0] < 2e-3
    hyoid = 1e3 * bones["hyoid"].points
    assert hyoid[:, 0].max() == pytest.approx(62.5, abs=3)
    assert -20 < hyoid[hyoid[:, 0] > 58][:, 2].mean() < -4


def test_split_muscles(parametric: tf.Anatomy) -> None:
    """GGP and GGH share the region of GGP, and its cross-section; the halves of SL share that of SL."""
    other = tf.parametric_tongue(split=("GGP", "SL"))
    points = np.random.default_rng(1).uniform(parametric.surface.points.min(axis=0), parametric.surface.points.max(axis=0), (200_000, 3))
    for whole, parts in (("GGP_L", ("GGP_L", "GGH_L")), ("GGP_R", ("GGP_R", "GGH_R")), ("SL", ("SL_L", "SL_R"))):
        regions = np.array([other.muscles[part].region(points) for part in parts])
        np.testing.assert_array_equal(regions.any(axis=0), parametric.muscles[whole].region(points))
        assert regions.all(axis=0).sum() == 0
        assert regions.any(axis=1).all()
        assert sum(other.muscles[part].pcsa or 0.0 for part in parts) == pytest.approx(parametric.muscles[whole].pcsa)
    for line in other.muscles["GGH_R"].fibres.lines:
        chord = line[-1] - line[0]
        assert -8 < np.degrees(np.arctan2(chord[2], chord[0])) < 6
    with pytest.raises(tf.InputError, match="split: 'HG' is not one of GGP, SL"):
        tf.parametric_tongue(split=["HG"])


def test_fibre_fields(parametric: tf.Anatomy) -> None:
    """Directions are of unit length everywhere in the tongue, and mirror images of each other on the two sides."""
    points = np.random.default_rng(2).uniform(parametric.surface.points.min(axis=0), parametric.surface.points.max(axis=0), (4000, 3))
    points = points[parametric.surface.contains(points)]
    for name, muscle in parametric.muscles.items():
        direction = muscle.fibres.direction(points)
        np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, atol=1e-12)
        if name.endswith("_R"):
            twin = parametric.muscles[name[:-1] + "L"].fibres.direction(points * (1, -1, 1)) * (1, -1, 1)
            np.testing.assert_allclose(direction, twin, atol=1e-9)


def test_interdigitation(parametric: tf.Anatomy) -> None:
    """Transversus crosses genioglossus and verticalis: it fills a good part of both, at right angles."""
    axes = [
        np.arange(low, high, 1.5e-3)
        for low, high in zip(parametric.surface.points.min(axis=0), parametric.surface.points.max(axis=0), strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    across = parametric.muscles["TRANS_R"]
    for name, least in (("GGP_R", 0.3), ("GGM_R", 0.3), ("GGA_R", 0.3), ("VERT_R", 0.5)):
        other = parametric.muscles[name]
        inside = points[other.region(points)]
        shared = inside[across.region(inside)]
        assert len(shared) > least * len(inside), name
        cosine = (other.fibres.direction(shared) * across.fibres.direction(shared)).sum(axis=1)
        assert np.degrees(np.arccos(abs(cosine))).mean() > 60, name


def test_muscles_know_their_facts(tongue_file: Path) -> None:
    """PCSA, peak stress by tissue and source stand beside the mesh; cross-sections of the two sides add up."""
    figures = json.loads(tongue_file.with_suffix(".json").read_text())["muscles"]
    for name, facts in CATALOGUE.items():
        sides = [m for key, m in figures.items() if key.split("_")[0] == name]
        assert name == "GGH" or sum(m["pcsa_m2"] for m in sides) == pytest.approx(facts.pcsa)
        for m in sides:
            assert m["peak_stress_pa"] == {tissue: table[name] for tissue, table in PEAK_STRESS.items()}
            assert m["source"]
            assert m["full_name"] == facts.full_name


def test_directions_survive_meshing(tongue_file: Path) -> None:
    """Along the fibres the field of an 8 mm mesh differs by less than 10° from them."""
    figures = json.loads(tongue_file.with_suffix(".json").read_text())["muscles"]
    for name, muscle in figures.items():
        assert muscle["direction_error_deg"] < 10, name


@pytest.mark.parametrize("size", [8e-3, 5e-3])
def test_entry_of_styloglossus(size: float) -> None:
    """SG enters with the cross-section of its flat band, five tubes of 1.8 mm radius side by side over 11.3 mm, left as right."""
    mesh, fields = meshed(size)
    assert [name for name, field in fields.items() if field.entry is not None] == ["SG_L", "SG_R"]
    for name, side in (("SG_L", -1), ("SG_R", 1)):
        entry = fields[name].entry
        assert entry is not None
        corners = mesh.points[entry.facets]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        assert (area * entry.share.mean(axis=1)).sum() == pytest.approx(1e-6 * (np.pi * 1.8**2 + 3.6 * 11.3), rel=0.1)
        np.testing.assert_allclose(entry.anchor, [0.0735, side * 0.036, 0.052])


def test_mesh_is_a_mirrored_half(tongue_file: Path) -> None:
    """Every vertex has its mirror image, and so has every figure of a left and a right muscle."""
    figures = json.loads(tongue_file.with_suffix(".json").read_text())
    with opened(tongue_file):
        points = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
    mirrored = {tuple(p) for p in np.round(points * (1, -1, 1) * 1e6).astype(int)}
    assert mirrored == {tuple(p) for p in np.round(points * 1e6).astype(int)}
    for name, muscle in figures["muscles"].items():
        if name.endswith("_L"):
            twin = figures["muscles"][name[:-1] + "R"]
            assert muscle["volume_m3"] == pytest.approx(twin["volume_m3"], rel=1e-9)
            assert muscle["n_cells"] == twin["n_cells"]
    assert figures["min_sicn"] > 0.2


def test_muscle_volumes(tongue_file: Path) -> None:
    """Both sides together are within 15 % of the Grenoble tongue's regions, even at 8 mm."""
    figures = json.loads(tongue_file.with_suffix(".json").read_text())["muscles"]
    for name, volume in TABLE_VOLUME.items():
        found = sum(m["volume_m3"] for key, m in figures.items() if key.split("_")[0] == name)
        assert found == pytest.approx(1e-6 * volume, rel=0.15), name


def test_msh_carries_overlapping_muscles(tongue_file: Path) -> None:
    """Any Gmsh user finds the muscles by name: one physical volume per combination, every cell in exactly one."""
    figures = json.loads(tongue_file.with_suffix(".json").read_text())
    with opened(tongue_file):
        count: dict[str, int] = {}
        total = 0
        for dim, tag in gmsh.model.getPhysicalGroups(3):
            cells = sum(len(gmsh.model.mesh.getElementsByType(4, e)[0]) for e in gmsh.model.getEntitiesForPhysicalGroup(dim, tag))
            total += cells
            for muscle in gmsh.model.getPhysicalName(dim, tag).split("+"):
                count[muscle] = count.get(muscle, 0) + cells
        surfaces = {gmsh.model.getPhysicalName(2, tag) for _, tag in gmsh.model.getPhysicalGroups(2)}
    assert total == figures["n_cells"]
    assert surfaces == {"free", "mandible", "hyoid"}
    assert {name: m["n_cells"] for name, m in figures["muscles"].items()} == {m: n for m, n in count.items() if m != "passive"}


@pytest.mark.parallel
def test_reads_back_the_same(tongue: tf.TongueMesh, tongue_file: Path) -> None:
    """Tags, muscle weights and unit directions come back, on any number of ranks."""
    figures = json.loads(tongue_file.with_suffix(".json").read_text())
    comm = tongue.comm
    owned = tongue.mesh.topology.index_map(3).size_local
    assert tongue.mesh.topology.index_map(3).size_global == figures["n_cells"]
    assert set(tongue.surfaces) == {"free", "mandible", "hyoid"}
    corners = tongue.mesh.geometry.x[tongue.mesh.geometry.dofmaps[0][:owned]]
    volume = abs(volumes(corners))
    assert comm.allreduce(volume.sum()) == pytest.approx(figures["volume_m3"], rel=1e-9)
    for name, muscle in tongue.muscles.items():
        mine = muscle.cells < owned
        integral = comm.allreduce((muscle.weight[mine].mean(axis=1) * volume[muscle.cells[mine]]).sum())
        assert integral == pytest.approx(figures["muscles"][name]["volume_m3"], rel=1e-6), name
        np.testing.assert_allclose(np.linalg.norm(muscle.direction, axis=2), 1.0, atol=1e-9)
    for name, point in tongue.landmarks.items():
        np.testing.assert_allclose(point, figures["landmarks"][name])


def test_volume_converges_with_refinement() -> None:
    """The same rule at 8 and at 5 mm gives muscle volumes that agree."""
    volumes = []
    for size in (8e-3, 5e-3):
        _, fields = meshed(size)
        volumes.append({name: field.volume for name, field in fields.items()})
        for field in fields.values():
            assert field.weight.min() >= 0
            assert field.weight.max() <= 1 + 1e-12
    for name in volumes[0]:
        assert volumes[0][name] == pytest.approx(volumes[1][name], rel=0.15), name


@pytest.mark.parametrize("name", ["GGP_R", "GGM_R", "GGA_R", "HG_R", "SL"])
def test_fibres_run_as_anatomy_says(name: str) -> None:
    """Genioglossus fans from backward to upward, hyoglossus rises, superior longitudinal follows the dorsum."""
    low, high = {"GGP_R": (-12, 50), "GGM_R": (40, 70), "GGA_R": (60, 125), "HG_R": (60, 130), "SL": (-180, 180)}[name]
    for line in tf.parametric_tongue().muscles[name].fibres.lines:
        chord = line[-1] - line[0]
        assert low <= np.degrees(np.arctan2(chord[2], chord[0])) <= high


@needs_subject
def test_subject_is_repaired_and_measured(scratch: Path) -> None:
    """Subject PB: mended and said; the figures of its README; muscle volumes within 10 % of its cells, directions within 10°."""
    anatomy = tf.read_subject(SUBJECT)
    assert any("pymeshfix" in note and "2 edges" in note for note in anatomy.notes)
    figures = meshing.build(anatomy, scratch / "pb.msh", 4e-3)
    assert figures["volume_m3"] == pytest.approx(102.3e-6, rel=0.02)
    above = pv.read(SUBJECT / "tongue_hex.vtu").clip("z", origin=(0, 0, anatomy.genial_spine[2] + 2e-3), invert=False)
    assert figures["proper_volume_m3"] == pytest.approx(above.volume, rel=0.01)
    assert figures["arc_length_m"] == pytest.approx(0.1036, abs=0.001)
    assert figures["chord_m"] == pytest.approx(0.0708, abs=0.0005)
    assert figures["width_m"] == pytest.approx(0.0483, abs=0.0005)
    assert figures["gaps_m"]["dorsum_palate"] == pytest.approx(0.0082, abs=0.0003)
    assert len(figures["muscles"]) == 21
    for name, muscle in figures["muscles"].items():
        assert muscle["volume_m3"] == pytest.approx(muscle["measured_volume_m3"], rel=0.1), name
        assert muscle["direction_error_deg"] < 10, name
    for name, volume in TABLE_VOLUME.items():
        found = sum(m["measured_volume_m3"] for key, m in figures["muscles"].items() if key.split("_")[0] == name)
        assert found == pytest.approx(1e-6 * volume, rel=0.02), name
    assert figures["min_sicn"] > 0.1
    tongue = tf.TongueMesh.read(scratch / "pb.msh")
    assert set(tongue.surfaces) == {"free", "mandible", "hyoid"}
    entry = tongue.muscles["SG_R"].entry
    assert entry is not None
    np.testing.assert_allclose(entry.anchor, [0.14984, 0.035891, 0.125], atol=1e-5)


def test_reference_mesh(parametric: tf.Anatomy, scratch: Path) -> None:
    """The reference preset is at least as large as the chapter's mesh, and of good quality."""
    figures = meshing.build(parametric, scratch / "reference.msh", PRESETS["reference"])
    assert figures["n_nodes"] >= 58_526
    assert figures["n_cells"] >= 40_102
    assert figures["min_sicn"] >= 0.2
    for name, volume in TABLE_VOLUME.items():
        found = sum(m["volume_m3"] for key, m in figures["muscles"].items() if key.split("_")[0] == name)
        assert found == pytest.approx(1e-6 * volume, rel=0.15), name


@needs_subject
def test_agrees_with_a_measured_tongue(parametric: tf.Anatomy) -> None:
    """Aligned with subject PB, each muscle overlaps its region, runs within 15° of its fibres and is as long within 15 %."""
    found = compare(parametric, tf.read_subject(SUBJECT), spacing=2e-3)
    assert len(found) == 21
    for name, agreement in found.items():
        assert agreement.angle < 15, name
        assert agreement.length_ratio == pytest.approx(1, abs=0.15), name
        assert agreement.dice > 0.45, name


def test_comparison_with_itself(parametric: tf.Anatomy) -> None:
    """A tongue agrees with itself, and with its own enlargement."""
    for other in (parametric, tf.parametric_tongue(TongueShape(scale=1.2))):
        for name, agreement in compare(other, parametric, spacing=6e-3).items():
            assert agreement.dice > 0.99, name
            assert agreement.angle < 7, name  # the smoothing of the field on curved fibres
            assert agreement.length_ratio == pytest.approx(1, abs=0.01), name


def test_example_subject(scratch: Path) -> None:
    """The tiny example in millimetres and LPS axes: placed, bonded, meshed, drawn."""
    anatomy = tf.read_subject(EXAMPLE)
    np.testing.assert_allclose(anatomy.genial_spine, [0.0, 0.0, 0.012])
    assert anatomy.surface.volume > 0
    np.testing.assert_allclose(anatomy.surface.points[:, 0].min(), 0.0, atol=1e-4)
    assert np.all(anatomy.muscles["GGP_L"].fibres.segments[0][:, 1] < 0)
    figures = meshing.build(anatomy, scratch / "example.msh", 10e-3)
    assert set(figures["muscles"]) == {"GGP_L", "GGP_R", "TRANS_L", "TRANS_R"}
    tongue = tf.TongueMesh.read(scratch / "example.msh")
    assert set(tongue.surfaces) == {"free", "mandible", "hyoid"}
    for draw in (portraits.draw_muscles, portraits.draw_surroundings):
        picture = pv.read(draw(anatomy, scratch / f"{draw.__name__}.png"))
        assert len(np.unique(picture.active_scalars, axis=0)) > 500


def _subject(folder: Path, axes: str, unit: float) -> None:
    """The example in other axes and another unit, with VTP fibres and a VTU surface."""
    anatomy = tf.read_subject(EXAMPLE)
    column = {"P": (0, 1), "A": (0, -1), "R": (1, 1), "L": (1, -1), "S": (2, 1), "I": (2, -1)}

    def given(points: np.ndarray) -> np.ndarray:
        return np.column_stack([column[letter][1] * points[:, column[letter][0]] for letter in axes]) / unit

    surface = anatomy.surface.transform(given).to_pyvista()
    surface.cast_to_unstructured_grid().save(folder / "tongue_surface.vtu")
    (folder / "fibres").mkdir()
    for name, muscle in anatomy.muscles.items():
        points = [given(line) for line in muscle.fibres.lines]
        start = np.cumsum([0, *map(len, points)])
        cells = [entry for first, last in itertools.pairwise(start) for entry in (last - first, *range(first, last))]
        pv.PolyData(np.vstack(points), lines=cells).save(folder / "fibres" / f"{name}.vtp")
    bonded = {bone: np.unique(anatomy.surface.triangles[anatomy.surface.labels == bone]) for bone in ("mandible", "hyoid")}
    lists = {bone: given(anatomy.surface.points[nodes]).tolist() for bone, nodes in bonded.items()}
    (folder / "attachments.json").write_text(json.dumps(lists))
    names = {1.0: "m", 1e-2: "cm", 1e-3: "mm"}
    (folder / "frame.toml").write_text(f'axes = "{axes}"\nunit = "{names[unit]}"\n')


@pytest.mark.parametrize(("axes", "unit"), [("PRS", 1.0), ("RAS", 1e-3), ("SAL", 1e-2)])
def test_frames_and_formats(scratch: Path, axes: str, unit: float) -> None:
    """The same tongue from a VTU surface and VTP fibres in any axes and unit."""
    _subject(scratch, axes, unit)
    one, other = tf.read_subject(EXAMPLE), tf.read_subject(scratch)
    assert other.surface.volume == pytest.approx(one.surface.volume, rel=1e-5)
    np.testing.assert_allclose(np.sort(other.surface.points, axis=0), np.sort(one.surface.points, axis=0), atol=1e-6)
    assert (other.surface.labels == "mandible").sum() == (one.surface.labels == "mandible").sum()
    for name, muscle in one.muscles.items():
        for line, same in zip(muscle.fibres.lines, other.muscles[name].fibres.lines, strict=True):
            np.testing.assert_allclose(same, line, atol=1e-6)


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("open", "tongue_surface.obj: the surface is open"),
        ("attachment", "'mandible', entry 0, lies .* mm from the tongue surface"),
        ("no fibres", "'GGP_L' has no polyline"),
        (
            "unit",
            r"0.03 to 0.3 m and 5 to 400 cm³ is expected, so state its unit in frame.toml \(unit = 'mm', not 'm', would make it one",
        ),
        ("json", "fibres.json: cannot be read"),
        ("outside", "only 0 % of the fibre length of 'GGP_L' lies inside the tongue surface"),
        ("axes", "frame.toml: axes: 'LPP'; three letters are expected"),
        ("key", "frame.toml: unknown key 'axis'; known are unit, axes, mid_plane, genial_spine"),
        ("patch", "missing.obj: the file does not exist"),
    ],
)
def test_bad_subjects(scratch: Path, fault: str, expected: str) -> None:
    """Each fault of a subject's folder is one sentence that names the file and what to mend."""
    folder = scratch / "subject"
    shutil.copytree(EXAMPLE, folder)
    fibres = json.loads((folder / "fibres.json").read_text())
    frame = (folder / "frame.toml").read_text()
    surface = pv.read(folder / "tongue_surface.obj")
    if fault == "open":
        surface.extract_cells(np.arange(surface.n_cells - 3)).extract_surface(algorithm=None).save(folder / "tongue_surface.obj")
    elif fault == "attachment":
        (folder / "attachments.json").write_text('{"mandible": [[100.0, 0.0, 200.0]]}')
    elif fault == "no fibres":
        (folder / "fibres.json").write_text('{"GGP_L": []}')
    elif fault == "unit":
        (folder / "frame.toml").write_text(frame.replace('"mm"', '"m"'))
    elif fault == "json":
        (folder / "fibres.json").write_text("{")
    elif fault == "outside":
        fibres["GGP_L"] = (np.array(fibres["GGP_L"]) + 100).tolist()
        (folder / "fibres.json").write_text(json.dumps(fibres))
    elif fault == "axes":
        (folder / "frame.toml").write_text(frame.replace("LPS", "LPP"))
    elif fault == "key":
        (folder / "frame.toml").write_text(frame.replace("axes", "axis"))
    else:
        (folder / "attachments.json").write_text('{"hyoid": "missing.obj"}')
    with pytest.raises(tf.InputError, match=expected):
        tf.read_subject(folder)


def test_inside_out_surface_is_turned(scratch: Path) -> None:
    """Normals that point inward are turned, and the user is told."""
    folder = scratch / "subject"
    shutil.copytree(EXAMPLE, folder)
    text = (folder / "tongue_surface.obj").read_text().splitlines()
    turned = [f"f {' '.join(reversed(line.split()[1:]))}" if line.startswith("f ") else line for line in text]
    (folder / "tongue_surface.obj").write_text("\n".join(turned))
    anatomy = tf.read_subject(folder)
    assert anatomy.surface.volume > 0
    assert any("the normals pointed inward and were turned" in note for note in anatomy.notes)


def test_names_cost_no_libraries() -> None:
    """What a scenario needs to be checked is imported without the libraries that draw, mesh and repair."""
    code = """if True:
        import sys
        from tongue_fenicsx.anatomy.parametric.size import SPLITTABLE, TongueShape
        from tongue_fenicsx.geometry.rigid_motion import RigidMotion
        from tongue_fenicsx.geometry.surface import SUFFIXES
        from tongue_fenicsx.anatomy.parametric.size import PRESETS
        print(sorted({"dolfinx", "gmsh", "h5py", "matplotlib", "pymeshfix", "pyvista", "scipy"} & set(sys.modules)))
    """
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
