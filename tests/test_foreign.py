# SPDX-License-Identifier: MIT
"""Meshes made elsewhere: overlapping physical volumes, cell data, fibres by rule, by polylines and by vectors."""

from __future__ import annotations

import json
from pathlib import Path

import gmsh
import numpy as np
import pytest
from conftest import opened

import tongue_fenicsx as tf
from tongue_fenicsx.core.parallel import on_rank_zero
from tongue_fenicsx.forms.weak_form import WeakForm
from tongue_fenicsx.geometry.tetrahedron import volumes

from mpi4py import MPI  # isort: skip

LENGTH = 0.03


def write_bar(path: Path, volumes: dict[str, list[int]], data: dict[str, str] | None = None) -> None:
    """A bar of three cubes of 10 mm along x in the given physical volumes, fixed at x = 0; `data` asks for cell data."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        model = gmsh.model
        boxes = [(3, model.occ.addBox(0.01 * i, 0, 0, 0.01, 0.01, 0.01)) for i in range(3)]
        model.occ.fragment(boxes, [])
        model.occ.synchronize()
        order = sorted((tag for _, tag in model.getEntities(3)), key=lambda tag: model.occ.getCenterOfMass(3, tag)[0])
        outer = model.getBoundary([(3, tag) for tag in order], oriented=False)
        fixed = [tag for _, tag in outer if model.occ.getCenterOfMass(2, tag)[0] < 1e-9]
        model.addPhysicalGroup(2, fixed, name="mandible")
        model.addPhysicalGroup(2, [tag for _, tag in outer if tag not in fixed], name="free")
        for name, members in volumes.items():
            model.addPhysicalGroup(3, [order[i] for i in members], name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.006)
        model.mesh.generate(3)
        gmsh.write(str(path))
        tags = model.mesh.getElementsByType(4)[0]
        centres = model.mesh.getBarycenters(4, -1, False, True).reshape(-1, 3)
        gmsh.option.setNumber("PostProcessing.SaveMesh", 0)
        for name, kind in (data or {}).items():
            front = centres[:, 0] < 0.02
            values = front[:, None].astype(float) if kind == "share" else front[:, None] * np.array([0.0, 0.0, 2.0])
            view = gmsh.view.add(name)
            gmsh.view.addModelData(view, 0, gmsh.model.getCurrent(), "ElementData", tags, values.tolist())
            gmsh.view.write(view, str(path), append=True)
    finally:
        gmsh.finalize()


def _volume(tongue: tf.TongueMesh, name: str) -> float:
    corners = tongue.mesh.geometry.x[tongue.mesh.geometry.dofmaps[0]]
    volume = abs(volumes(corners))
    muscle = tongue.muscles[name]
    mine = muscle.cells < tongue.mesh.topology.index_map(3).size_local
    return float(tongue.comm.allreduce(float((muscle.weight.mean(axis=1) * volume[muscle.cells])[mine].sum())))


@pytest.mark.parallel
def test_overlapping_volumes_and_rules(scratch: Path) -> None:
    """Two muscles that share a cube: both have their whole volume, fibres straight, in a fan or along polylines."""
    path = scratch / "bar.msh"
    rules = {
        "GGP_L": {"direction": [2, 0, 0]},
        "TRANS_L": {"toward": [0.015, 0.005, -0.02]},
        "MH": [[[0.02, 0, 0.005], [0.03, 0.01, 0.005]]],
    }

    def write() -> None:
        write_bar(path, {"GGP_L": [0, 1], "TRANS_L": [1, 2], "MH": [2], "fat": [0]})
        path.with_suffix(".fibres.json").write_text(json.dumps(rules))

    on_rank_zero(MPI.COMM_WORLD, write)
    tongue = tf.TongueMesh.read(path)
    assert set(tongue.muscles) == {"GGP_L", "TRANS_L", "MH"}
    assert _volume(tongue, "GGP_L") == pytest.approx(2e-6)
    assert _volume(tongue, "TRANS_L") == pytest.approx(2e-6)
    assert _volume(tongue, "MH") == pytest.approx(1e-6)
    np.testing.assert_allclose(tongue.muscles["GGP_L"].direction, np.broadcast_to([1.0, 0, 0], tongue.muscles["GGP_L"].direction.shape))
    fan = tongue.muscles["TRANS_L"]
    toward = np.array([0.015, 0.005, -0.02]) - tongue.mesh.geometry.x[tongue.mesh.geometry.dofmaps[0][fan.cells]]
    np.testing.assert_allclose(np.cross(fan.direction, toward), 0, atol=1e-12)
    np.testing.assert_allclose(tongue.muscles["MH"].direction[..., :2], np.sqrt(0.5), atol=1e-9)


def test_cell_data(scratch: Path) -> None:
    """A cell set of vectors is region and fibres; a cell set of shares is a region for fibres from the file."""
    path = scratch / "bar.msh"
    write_bar(path, {"tissue": [0, 1, 2]}, {"GGP": "vector", "HG": "share"})
    path.with_suffix(".fibres.json").write_text('{"HG": {"direction": [0, 1, 0]}}')
    tongue = tf.TongueMesh.read(path)
    for name, direction in (("GGP", [0, 0, 1]), ("HG", [0, 1, 0])):
        assert _volume(tongue, name) == pytest.approx(2e-6)
        np.testing.assert_allclose(
            tongue.muscles[name].direction, np.broadcast_to(np.array(direction, float), tongue.muscles[name].direction.shape)
        )


@pytest.mark.parametrize("wobble", [0.0, 0.3])
def test_vectors_have_no_sense(scratch: Path, wobble: float) -> None:
    """Turning vectors of cells round at random, parallel or noisy, changes no direction at quadrature points; the error is known."""
    rng = np.random.default_rng(1)
    fields = []
    for turned in (False, True):
        path = scratch / f"{turned}.msh"
        write_bar(path, {"tissue": [0, 1, 2]})
        with opened(path):
            tags = gmsh.model.mesh.getElementsByType(4)[0]
            vectors = [1.0, 0.0, 0.0] + wobble * np.random.default_rng(0).normal(size=(len(tags), 3))
            if turned:
                vectors *= rng.choice([-1.0, 1.0], len(tags))[:, None]
            gmsh.option.setNumber("PostProcessing.SaveMesh", 0)
            view = gmsh.view.add("GGP")
            gmsh.view.addModelData(view, 0, gmsh.model.getCurrent(), "ElementData", tags, vectors.tolist())
            gmsh.view.write(view, str(path), append=True)
        tongue = tf.TongueMesh.read(path)
        error = tongue.muscles["GGP"].direction_error
        assert error is not None
        assert (error > 5) == (wobble > 0)
        fields.append((WeakForm(tf.Model(tongue, fixed=["mandible"]), ["GGP"]).slots.directions[0].x.array.reshape(-1, 3), error))
    (given, error), (turned_round, same) = fields
    assert same == pytest.approx(error, abs=1e-5)
    np.testing.assert_allclose(abs((given * turned_round).sum(axis=1)), 1, atol=1e-12)


def test_names_without_fibres_are_tissue(scratch: Path) -> None:
    """A mesh whose volumes are named like muscles, but without any fibres, is passive; asking for a muscle says what is missing."""
    path = scratch / "bar.msh"
    write_bar(path, {"GGP_L": [0, 1], "passive": [2]})
    tongue = tf.TongueMesh.read(path)
    assert tongue.muscles == {}
    with pytest.raises(tf.InputError, match="no muscle 'GGP' in the mesh; It has no muscles with fibres"):
        tf.Simulation(tf.Model(tongue, fixed=["mandible"])).run({"GGP": tf.ramp(0.1, 0.1)}, 0.1)


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        ('{"HG": {"direction": [0, 1, 0]}}', "no physical volume or cell data 'HG'"),
        ('{"GGP_L": {"direction": [0, 0, 0]}}', "cannot be read"),
        ('{"GGP_L": [[[0, 0, 0]]]}', "two or more finite points"),
        ('{"GGP_L": []}', "two or more finite points"),
        ('{"GGP_L": 3}', "cannot be read"),
        ('{"GGP_L": {"sideways": [0, 0, 1]}}', "direction or toward is expected"),
        ('{"GGP_L": {"toward": [0, 0, NaN]}}', "not three finite numbers"),
        ('{"GGP_L": {"direction": [1, 0, 0]}}', "muscle 'TRANS_L' has no fibres; give them in bar.fibres.json"),
        ("[", "cannot be read"),
    ],
)
def test_bad_fibre_files(scratch: Path, rules: str, expected: str) -> None:
    """Each fault of a fibre file is one sentence."""
    path = scratch / "bar.msh"
    write_bar(path, {"GGP_L": [0, 1], "TRANS_L": [1, 2]})
    path.with_suffix(".fibres.json").write_text(rules)
    with pytest.raises(tf.InputError, match=expected):
        tf.TongueMesh.read(path)


def test_foreign_muscle_contracts(scratch: Path) -> None:
    """A bar with straight fibres of a user's own shortens along them when they contract a little."""
    path = scratch / "bar.msh"
    write_bar(path, {"GGP_L": [0, 1, 2]})
    path.with_suffix(".fibres.json").write_text('{"GGP_L": {"direction": [1, 0, 0]}}')
    model = tf.Model(tf.TongueMesh.read(path), contraction=tf.Contraction("none"), fixed=["mandible"])
    run = tf.Simulation(model, probes={"end": [LENGTH, 0.005, 0.005]}).run({"GGP_L": tf.ramp(0.02, 0.02, 0.2)}, 0.04)
    assert run.probes["end"][-1, 0] < -1e-3
    assert abs(run.probes["end"][-1, 1:]).max() < 3e-4
