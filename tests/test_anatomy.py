# SPDX-License-Identifier: MIT
"""Shape, muscles and meshes, of the parametric tongue and of a real subject."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import gmsh
import numpy as np
import pytest
import pyvista as pv
from conftest import SUBJECT, needs_subject

import tongue_fenicsx as tf
from tongue_fenicsx import meshing
from tongue_fenicsx.anatomy import measure
from tongue_fenicsx.muscles import CATALOGUE

TABLE_VOLUME = {
    "GGP": 16.0, "GGM": 4.4, "GGA": 5.2, "SG": 3.5, "HG": 7.8, "IL": 3.0, "SL": 18.8, "VERT": 22.8, "TRANS": 40.6, "GH": 1.9, "MH": 5.1,
}  # fmt: skip
"""Region volumes in cm³, both sides, of the Grenoble tongue."""


def test_parametric_shape() -> None:
    """The figures of the anatomy card: volume, dorsal arc, chord, oral width, mid-sagittal area; closed and symmetric."""
    anatomy = tf.parametric_tongue()
    shape = measure(anatomy.surface, anatomy.genial_spine)
    assert 85e-6 < shape.volume < 105e-6
    assert shape.arc_length == pytest.approx(0.100, abs=0.005)
    assert shape.chord == pytest.approx(0.070, abs=0.002)
    assert shape.width == pytest.approx(0.050, abs=0.002)
    assert 21e-4 < shape.midsagittal_area < 30e-4
    assert set(anatomy.surface.edge_sharing()) == {2}
    assert {name.split("_")[0] for name in anatomy.muscles} == set(CATALOGUE)
    assert set(np.unique(anatomy.surface.labels)) == {"free", "mandible", "hyoid"}


def test_mesh_is_a_mirrored_half(tongue_file: Path) -> None:
    """Every vertex has its mirror image, and so has every figure of a left and a right muscle."""
    figures = json.loads(tongue_file.with_suffix(".json").read_text())
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tongue_file))
        points = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
    finally:
        gmsh.finalize()
    mirrored = {tuple(p) for p in np.round(points * (1, -1, 1) * 1e6).astype(int)}
    assert mirrored == {tuple(p) for p in np.round(points * 1e6).astype(int)}
    for name, muscle in figures["muscles"].items():
        if name.endswith("_L"):
            twin = figures["muscles"][name[:-1] + "R"]
            assert muscle["volume_m3"] == pytest.approx(twin["volume_m3"], rel=1e-9)
            assert muscle["n_cells"] == twin["n_cells"]
    assert figures["min_sicn"] > 0.15


def test_muscle_volumes(tongue_file: Path) -> None:
    """Both sides together are within 15 % of the Grenoble tongue's regions, even at 8 mm."""
    figures = json.loads(tongue_file.with_suffix(".json").read_text())["muscles"]
    for name, volume in TABLE_VOLUME.items():
        found = sum(m["volume_m3"] for key, m in figures.items() if key.split("_")[0] == name)
        assert found == pytest.approx(1e-6 * volume, rel=0.15), name


def test_msh_carries_overlapping_muscles(tongue_file: Path) -> None:
    """Any Gmsh user finds the muscles by name: one physical volume per combination, every cell in exactly one."""
    figures = json.loads(tongue_file.with_suffix(".json").read_text())
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tongue_file))
        count: dict[str, int] = {}
        total = 0
        for dim, tag in gmsh.model.getPhysicalGroups(3):
            cells = sum(len(gmsh.model.mesh.getElementsByType(4, e)[0]) for e in gmsh.model.getEntitiesForPhysicalGroup(dim, tag))
            total += cells
            for muscle in gmsh.model.getPhysicalName(dim, tag).split("+"):
                count[muscle] = count.get(muscle, 0) + cells
        surfaces = {gmsh.model.getPhysicalName(2, tag) for _, tag in gmsh.model.getPhysicalGroups(2)}
    finally:
        gmsh.finalize()
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
    volume = abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
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
    anatomy = tf.parametric_tongue()
    volumes = []
    for size in (8e-3, 5e-3):
        mesh = meshing.tetrahedralise(anatomy, size)
        fields = meshing.project_muscles(anatomy, mesh)
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
    """Subject PB: the two bad edges are mended and said, the figures of its README come out, muscles are all there."""
    anatomy = tf.read_subject(SUBJECT)
    assert any("pymeshfix" in note and "2 edges" in note for note in anatomy.notes)
    figures = meshing.build(anatomy, scratch / "pb.msh", 6e-3)
    assert figures["volume_m3"] == pytest.approx(102.3e-6, rel=0.02)
    assert figures["arc_length_m"] == pytest.approx(0.1036, abs=0.001)
    assert figures["chord_m"] == pytest.approx(0.0708, abs=0.0005)
    assert figures["width_m"] == pytest.approx(0.0483, abs=0.0005)
    assert len(figures["muscles"]) == 21
    for name, volume in TABLE_VOLUME.items():
        found = sum(m["volume_m3"] for key, m in figures["muscles"].items() if key.split("_")[0] == name)
        assert found == pytest.approx(1e-6 * volume, rel=0.1), name
    assert figures["min_sicn"] > 0.1
    surface = tf.TongueMesh.read(scratch / "pb.msh")
    assert set(surface.surfaces) == {"free", "mandible", "hyoid"}


@needs_subject
def test_fibres_agree_with_measured_ones() -> None:
    """Along the polylines of subject PB, aligned by genial spine, tip and root, directions differ by 15° or less on average."""
    parametric, subject = tf.parametric_tongue(), tf.read_subject(SUBJECT)

    def frame(anatomy: tf.Anatomy) -> np.ndarray:
        landmarks = measure(anatomy.surface, anatomy.genial_spine).landmarks
        return np.array([anatomy.genial_spine, landmarks["tip"], landmarks["root"]])[:, [0, 2]]

    source, target = frame(subject), frame(parametric)
    u, s, vt = np.linalg.svd((source - source.mean(axis=0)).T @ (target - target.mean(axis=0)))
    rotation, scale = u @ vt, s.sum() / ((source - source.mean(axis=0)) ** 2).sum()

    def aligned(line: np.ndarray) -> np.ndarray:
        xz = (line[:, [0, 2]] - source.mean(axis=0)) @ rotation * scale + target.mean(axis=0)
        return np.column_stack([xz[:, 0], scale * line[:, 1], xz[:, 1]])

    for name, muscle in subject.muscles.items():
        lines = [aligned(line) for line in muscle.fibres.lines]
        middle = np.vstack([(line[1:] + line[:-1]) / 2 for line in lines])
        step = np.vstack([np.diff(line, axis=0) for line in lines])
        inside = np.asarray(pv.PolyData(middle).select_interior_points(parametric.surface.to_pyvista())["selected_points"], dtype=bool)
        length = np.linalg.norm(step, axis=1)
        cosine = abs((parametric.muscles[name].fibres.direction(middle) * step).sum(axis=1) / length)
        angle = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
        assert np.average(angle[inside], weights=length[inside]) < 15, name


@needs_subject
@pytest.mark.parametrize("fault", ["open", "attachment", "no fibres", "millimetres", "json"])
def test_bad_subjects(scratch: Path, fault: str) -> None:
    """An open surface, an attachment off the surface, a muscle without fibres, the wrong unit, broken JSON: one sentence each."""
    folder = scratch / "subject"
    shutil.copytree(SUBJECT, folder)
    for path in folder.iterdir():
        path.chmod(0o644)
    surface = pv.read(folder / "tongue_surface.stl")
    if fault == "open":
        surface.extract_cells(np.arange(surface.n_cells - 3)).extract_surface(algorithm=None).save(folder / "tongue_surface.stl")
        expected = "tongue_surface.stl: the surface is open"
    elif fault == "attachment":
        (folder / "attachments.json").write_text('{"mandible": [[0.1, 0.0, 0.2]]}')
        expected = "'mandible', entry 0, lies .* mm from the tongue surface"
    elif fault == "no fibres":
        (folder / "fibres.json").write_text('{"GGP_L": []}')
        expected = "'GGP_L' has no polyline"
    elif fault == "millimetres":
        surface.points *= 1e3
        surface.save(folder / "tongue_surface.stl")
        expected = "a tongue in metres"
    else:
        (folder / "fibres.json").write_text("{")
        expected = "fibres.json: cannot be read"
    with pytest.raises(tf.InputError, match=expected):
        tf.read_subject(folder)
