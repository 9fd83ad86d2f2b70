# SPDX-License-Identifier: MIT
"""The virtual electropalatogram: where the electrodes lie, and which are on when the tongue rises to the palate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from conftest import LIVING, SUBJECT, needs_subject

import tongue_fenicsx as tf
from tongue_fenicsx.analysis.electropalatogram import ELECTRODES, REACH, electrodes, electropalatogram
from tongue_fenicsx.analysis.tongue_grid import grids, skin
from tongue_fenicsx.geometry.surface import Surface, read_surface
from tongue_fenicsx.scenario.build import activation_of, simulation_of
from tongue_fenicsx.scenario.files import load


def check(places: np.ndarray, palate: Surface) -> None:
    """62 electrodes on the palate, symmetric, the rows apart as 1 to 2 and the columns in order."""
    assert places.shape == (62, 3)
    assert abs(palate.signed_distance(places)).max() < 0.3e-3
    rows = [places[[r == row for r, _ in ELECTRODES]] for row in range(8)]
    assert [len(row) for row in rows] == [6] + 7 * [8]
    for row in rows:
        np.testing.assert_allclose(row[:, 1], -row[::-1, 1], atol=1e-6)
        assert (np.diff(row[:, 1]) > 1e-3).all()
    front = np.array([row[0, 0] for row in rows])
    assert (np.diff(front) > 0).all()
    assert np.diff(front)[4:].mean() > 1.3 * np.diff(front)[:3].mean()
    assert 0.015 < np.ptp(rows[6][:, 1]) < 0.05


def test_electrodes_of_the_built_in_palate() -> None:
    """Rows from the alveolar ridge to the velum."""
    palate = tf.parametric_tongue().bones["palate"]
    check(electrodes(palate), palate)


@needs_subject
def test_electrodes_of_a_subject() -> None:
    """Rows from the incisors to the ragged end of a real hard palate."""
    palate = read_surface(SUBJECT / "palate_hard.stl")
    check(electrodes(palate), palate)


def test_no_vault() -> None:
    """A surface beside the mid-plane is refused."""
    aside = Surface.from_pyvista(pv.Plane(center=(0.0, 0.05, 0.0), i_size=0.02, j_size=0.02).triangulate())
    with pytest.raises(tf.InputError, match="no vault over the mid-sagittal plane"):
        electrodes(aside)


def test_of_a_run(tongue_file: Path) -> None:
    """The rising tongue touches the margins of the palate; table, picture and obstacle stand in the run folder."""
    path = tongue_file.parent / "rise.toml"
    path.write_text(LIVING)
    run = simulation_of(load(path), path.parent).run(activation_of(load(path)), 0.12, path.parent / "rise")
    assert np.linalg.norm(run.contact["palate"]["force"][-1]) > 0.01
    assert run.contact["palate"]["penetration"].max() < 0.05e-3
    record = electropalatogram(run)
    np.testing.assert_allclose(record.time, [0.0, 0.06, 0.12])
    assert not record.on[0].any()
    assert record.on[-1].sum() >= 2
    assert record.grid(-1).sum() == record.on[-1].sum()
    assert not electropalatogram(run, reach=-1e-3).on.any()
    far = pv.PolyData(1e3 * record.places).compute_implicit_distance(skin(grids(run)[1], 2).triangulate())["implicit_distance"]
    np.testing.assert_array_equal(record.on[-1], np.asarray(far) <= 1e3 * REACH)
    assert [picture.name for picture in (*run.plot("epg"), *run.plot("contact"))] == ["epg.png", "contact.png"]
    table = np.loadtxt(run.folder / "epg.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 1:], record.on)
    assert (run.folder / "epg.csv").read_text().startswith("time_s,r1c2,")
    palate = simulation_of(load(path), path.parent).model.tongue.bones["palate"]
    np.testing.assert_allclose(run.obstacles()["palate"].points, palate.points)
    run.contact.clear()
    with pytest.raises(tf.InputError, match="has no contact with a palate"):
        electropalatogram(run)
