# SPDX-License-Identifier: MIT
"""Equilibria without inertia, the cantilever demo, and the extra fields of a run."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import pyvista as pv

import tongue_fenicsx as tf
from tongue_fenicsx.cli.app import main
from tongue_fenicsx.geometry.obstacles import Plane
from tongue_fenicsx.mechanics.contact import Contact
from tongue_fenicsx.testing import with_fibres

DEMOS = Path(__file__).parents[1] / "demos"


def test_cantilever_demo(tmp_path: Path) -> None:
    """Little loaded, the tip of the demo sinks more than a beam without shear, ρ g A L⁴ / (8 E I), and less than Timoshenko's,
    whose clamp lets the section warp."""
    for name in ("cantilever.toml", "cantilever.msh"):
        shutil.copy(DEMOS / name, tmp_path)
    changes = ["gravity.acceleration=[0.0, 0.0, -0.02]", "time.quasi_static=true", "time.end=0.1", "tissue.nu=0.3", "time.step=0.05"]
    changes.append("probes.tip=[0.04, 0.005, 0.005]")
    options = ["--no-figures", *(part for change in changes for part in ("--set", change))]
    with pytest.raises(SystemExit) as leaving:
        main(["run", str(tmp_path / "cantilever.toml"), "-o", str(tmp_path / "run"), *options])
    assert leaving.value.code in (0, None)
    sag = -tf.Run(tmp_path / "run").summary["probes"]["tip"][2]
    mu, kappa = 2 * 1037.0, 2 * 1037.0 / (1 - 2 * 0.3)
    young = 9 * kappa * mu / (3 * kappa + mu)
    shear = 1040 * 0.02 * 0.04**2 / (2 * mu * 5 / 6)  # Timoshenko's
    beam = 1040 * 0.02 * 0.04**4 / (8 * young / 12 * 0.01**2)
    assert beam < sag < beam + shear


def test_equilibrium_is_where_motion_ends(block: tf.TongueMesh, scratch: Path) -> None:
    """The quasi-static sag of the block is the one that damped motion comes to rest at."""
    ends = []
    for quasi_static, end in ((True, 0.2), (False, 3.0)):
        model = tf.Model(
            block, tf.Tissue(tf.Tissue.buchaillard().law, 1000.0, tf.Rayleigh(20.0)), fixed=["left"], gravity=(0.0, 0.0, -9.81)
        )
        stepping = tf.Stepping(step_max=0.05, output_every=end, quasi_static=quasi_static)
        simulation = tf.Simulation(
            model, probes={"end": (0.02, 0.005, 0.005)}, stepping=stepping, tolerances=tf.Tolerances.of("tight", rtol=1e-8)
        )
        run = simulation.run({}, end, scratch / str(quasi_static))
        ends.append(run.probes["end"][-1])
        assert quasi_static == (run.summary["peak_speed_m_s"] == 0.0)
    assert abs(ends[0][2]) > 1e-4
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3 * abs(ends[0][2]))


def test_extra_fields(block: tf.TongueMesh, scratch: Path) -> None:
    """Tensors and fibre fields are stored, open as XDMF, and agree with what the run already stores."""
    stepping = tf.Stepping(output_every=0.02, fields=["hencky", "cauchy", "fibre_stretch", "fibre_rate", "active_stress"])
    tissue = replace(tf.Tissue.calka(), peak_stress={"GGP": 3e3})
    model = tf.Model(with_fibres(block), tissue, tf.Contraction("none", tendon_length=0.0), fixed=["left"])
    run = tf.Simulation(model, stepping=stepping).run({"GGP_L": lambda t: min(t, 0.02)}, 0.1, scratch)
    h, sigma = run.field("hencky"), run.field("cauchy")
    assert h.shape == sigma.shape == (len(run.field("jacobian")), 3, 3)
    np.testing.assert_allclose(h, np.swapaxes(h, 1, 2), atol=1e-6)
    np.testing.assert_allclose(sigma, np.swapaxes(sigma, 1, 2), atol=1e-2)
    np.testing.assert_allclose(np.trace(h, axis1=1, axis2=2), np.log(run.field("jacobian")), atol=5e-3)
    stretch, stress = run.field("fibre_stretch_GGP_L"), run.field("active_stress_GGP_L")
    assert stretch.max() < 1
    length = 1 - 4 * (1 - stretch) ** 2
    np.testing.assert_allclose(stress, 0.02 * 3e3 * length * stretch / run.field("jacobian"), rtol=2e-3)  # of means, nearly homogeneous
    assert run.field("fibre_rate_GGP_L", 0).max() == 0
    assert run.field("fibre_rate_GGP_L", 1).min() < 0
    reader = pv.get_reader(scratch / "fields.xdmf")
    assert {"hencky", "cauchy", "active_stress_GGP_L"} <= set(reader.cell_array_names)
    with h5py.File(scratch / "fields.h5") as file:
        assert len(file["cauchy"]) == 6
    with pytest.raises(tf.InputError, match="'strain' is not one of displacement, "):
        tf.Simulation(model, stepping=tf.Stepping(fields=["strain"])).run({}, 0.01, scratch / "other")


def test_function_as_activation(block: tf.TongueMesh, scratch: Path) -> None:
    """A function that leaves 0…1 stops the run with a sentence."""
    model = tf.Model(with_fibres(block), fixed=["left"])
    with pytest.raises(tf.InputError, match=r"the function returns 1\.01"):
        tf.Simulation(model).run({"GGP_L": lambda t: 1.01}, 0.01, scratch)


def test_descending_limb(block: tf.TongueMesh) -> None:
    """A bar that is stretched by 35 % before it contracts has no equilibrium nearby: the failure names the limb, and motion."""
    stretch = tf.RigidMotion(translation=[(0.1, (0, 0, 0), (7e-3, 0, 0))])
    tissue = replace(tf.Tissue.calka(), peak_stress={"GGP": 5e4})
    model = tf.Model(with_fibres(block), tissue, tf.Contraction("none", tendon_length=0.0), fixed=["left"], moving={"right": stretch})
    stepping = tf.Stepping(step_max=0.02, step_min=5e-3, output_every=0.1, quasi_static=True)
    with pytest.raises(tf.SolveError, match=r"Fibres of GGP_L \(stretch up to 1\.\d\d\) are on the descending limb .* time.quasi_static"):
        tf.Simulation(model, {}, stepping).run({"GGP_L": tf.Activation([(0.1, 0.0, 0.0), (0.1, 0.0, 1.0)])}, 0.2)


@pytest.mark.parallel
def test_nothing_holds_it(block: tf.TongueMesh) -> None:
    """A block that stands on a smooth floor may slide and turn, on any number of ranks; a wall and another hold it."""
    back, side, floor = (Contact(Plane((0.0, 0.0, 0.0), (float(x), float(y), float(z)))) for x, y, z in np.eye(3))
    still = tf.Stepping(quasi_static=True)
    with pytest.raises(tf.InputError, match=r"nothing holds .* 3 rigid motions are free \(along x and y, about z\)"):
        tf.Simulation(tf.Model(block, fixed=[], contacts={"floor": floor}), {}, still)
    tf.Simulation(tf.Model(block, fixed=[], contacts={"floor": floor, "back": back, "side": side}), {}, still)
