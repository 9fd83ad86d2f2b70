# SPDX-License-Identifier: MIT
"""Where the package can be extended from outside: laws, regions, loads, control, call-backs, and what a run leaves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import ufl
from conftest import write_block
from scipy.optimize import brentq

import tongue_fenicsx as tf
from tongue_fenicsx.core.types import Expr, Floats
from tongue_fenicsx.geometry.obstacles import Plane
from tongue_fenicsx.mechanics.contact import Contact, Touch
from tongue_fenicsx.mechanics.kinematics import Kinematics
from tongue_fenicsx.scenario.build import simulation_of
from tongue_fenicsx.scenario.files import load
from tongue_fenicsx.simulation import quantities
from tongue_fenicsx.simulation.snapshot import Snapshot
from tongue_fenicsx.simulation.summary import Ending
from tongue_fenicsx.testing import box, with_fibres

SHORT = tf.Stepping(step_max=5e-3, output_every=0.01)
STATIC = tf.Stepping(step_max=0.05, output_every=1.0, quasi_static=True)
LIVING = tf.Tissue.buchaillard()


@dataclass(frozen=True)
class Fibrous:
    """A law of the user's own: neo-Hookean with straight fibres, c (I₁ − 3)/2 + k (I₄ − 1)²/2."""

    c: float
    k: float
    nu: float = 0.45
    volumetric: str = "quadratic"

    @property
    def shear_modulus(self) -> float:
        """At rest, in Pa."""
        return self.c

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """In J/m³."""
        I4 = ufl.dot(k.fibre, k.C * k.fibre)
        return parameters["c"] * (k.I1 - 3) / 2 + parameters["k"] * (I4 - 1) ** 2 / 2


def stretched(law: object, fibre: object, block: tf.TongueMesh, regions: Mapping[str, object] | None = None, by: float = 4e-3) -> tf.Run:
    """A block whose right end is pulled away."""
    model = tf.Model(
        block,
        tissue=tf.Tissue(law, density=1000.0),  # type: ignore[arg-type]
        fibre=fibre,  # type: ignore[arg-type]
        regions=regions or {},  # type: ignore[arg-type]
        fixed=["left"],
        moving={"right": tf.RigidMotion(translation=[(1.0, (0, 0, 0), (by, 0, 0))])},
    )
    return tf.Simulation(model, probes={}, stepping=STATIC).run({}, t_end=1.0)


def test_a_law_of_ones_own_sees_fibres(block: tf.TongueMesh) -> None:
    """Fibres along the pull stiffen, across they do not; a direction may be a function of the place."""
    along, across, curved = (
        float(stretched(Fibrous(500.0, 2000.0), fibre, block).support["right"][-1, 0])
        for fibre in ((1.0, 0, 0), (0, 1.0, 0), lambda X: np.tile([2.0, 0.0, 0.0], (len(X), 1)))
    )
    without = float(stretched(tf.NeoHookean(250.0, 0.45), None, block).support["right"][-1, 0])
    assert along > 2 * across
    assert across == pytest.approx(without, rel=0.5)
    assert curved == pytest.approx(along, rel=1e-9)


@pytest.mark.parametrize("fibre", [(0.0, 0, 0), (1.0, 0, np.nan), lambda X: np.where(X[:, :1] < 5e-3, 0.0, X), lambda X: X[0]])
def test_a_fibre_without_direction(block: tf.TongueMesh, fibre: object) -> None:
    """It is said before anything is solved."""
    with pytest.raises(tf.InputError, match=r"model\.fibre: a direction"):
        stretched(Fibrous(500.0, 2000.0), fibre, block)


def halves() -> tf.TongueMesh:
    """A bar of 48 × 4 × 4 mm with a soft and a stiff half."""
    ends = {"left": lambda X: X[0] < 1e-9, "right": lambda X: X[0] > 48e-3 - 1e-9}
    parts = {"soft": lambda X: X[0] < 24e-3 + 1e-9, "stiff": lambda X: X[0] > 24e-3 - 1e-9}
    return box((48e-3, 4e-3, 4e-3), (24, 2, 2), ends, parts)


def nominal_stress(c10: float, nu: float, stretch: float) -> float:
    """In Pa, of isochoric neo-Hookean tissue pulled freely."""
    kappa = 2 * c10 / (1 - 2 * nu)

    def stresses(side: float) -> tuple[float, float]:
        J = stretch * side**2
        I1 = J ** (-2 / 3) * (stretch**2 + 2 * side**2)
        return tuple(2 * c10 * (J ** (-2 / 3) * s - I1 / 3 / s) + kappa * (J - 1) * J / s for s in (stretch, side))  # type: ignore[return-value]

    return stresses(brentq(lambda side: stresses(side)[1], 0.3, 1.2))[0]


def test_two_halves_as_two_springs() -> None:
    """Stiffness 1 : 100, stretched by half: no step is cut, and both middles are as far stretched as the same force stretches a spring."""
    soft, stiff = tf.NeoHookean(200.0, 0.45), tf.NeoHookean(20e3, 0.45)
    model = tf.Model(
        halves(),
        tissue=tf.Tissue(soft, density=1000.0),
        regions={"stiff": stiff},
        fixed=["left"],
        moving={"right": tf.RigidMotion(translation=[(1.0, (0, 0, 0), (24e-3, 0, 0))])},
    )
    probes = {f"{x:g}": (1e-3 * x, 2e-3, 2e-3) for x in (10, 14, 34, 38)}
    run = tf.Simulation(model, probes=probes, stepping=STATIC).run({}, t_end=1.0)
    force = float(run.support["right"][-1, 0]) / 16e-6
    assert run.summary["n_rejected"] == 0
    u = {name: float(path[-1, 0]) for name, path in run.probes.items()}
    for law, (a, b) in ((soft, ("10", "14")), (stiff, ("34", "38"))):
        stretch = 1 + (u[b] - u[a]) / 4e-3
        expected = brentq(lambda s, law=law: nominal_stress(law.c10, 0.45, s) - force, 1.0, 4.0)  # type: ignore[misc]
        assert stretch - 1 == pytest.approx(expected - 1, rel=0.01)


def test_a_region_that_is_not_there(block: tf.TongueMesh) -> None:
    """It is named."""
    with pytest.raises(tf.InputError, match="no volume 'fat'; it has passive"):
        stretched(tf.NeoHookean(200.0), None, block, {"fat": tf.NeoHookean(100.0)})


def test_pressure_balances(block: tf.TongueMesh) -> None:
    """A pressure on the right end is borne by the left one and does work that the tissue stores."""
    model = tf.Model(
        block,
        tissue=replace(LIVING, damping=tf.Rayleigh()),
        fixed=["left"],
        loads={"right": tf.Pressure([(0.05, 0.0, 100.0), (0.05, 100.0, 100.0)])},
    )
    run = tf.Simulation(model, probes={}, stepping=replace(SHORT, quasi_static=True)).run({}, t_end=0.1)
    assert run.energy["load_work"][-1] == pytest.approx(run.energy["elastic"][-1], rel=0.02)
    assert run.support["left"][-1, 0] == pytest.approx(100.0 * 1e-4, rel=0.05)
    with pytest.raises(tf.InputError, match="no surface 'wrong'"):
        replace(model, loads={"wrong": tf.Pressure([(1.0, 0.0, 1.0)])})


def muscle(block: tf.TongueMesh) -> tf.Model:
    """The block as one muscle that is pulled longer, and kept so."""
    return tf.Model(
        with_fibres(block),
        tissue=replace(LIVING, peak_stress={"GGP": 5e3}),
        fixed=["left"],
        moving={"right": tf.RigidMotion(translation=[(0.05, (0, 0, 0), (4e-3, 0, 0))])},
    )


def test_feedback_from_length(block: tf.TongueMesh) -> None:
    """A reflex is silent up to its threshold and then follows the length."""
    seen = []
    reflex = tf.StretchReflex({"GGP_L": 1.1}, gain=2.0)
    run = tf.Simulation(muscle(block), probes={}, stepping=SHORT).run(
        reflex, t_end=0.06, after_step=lambda now: seen.append(now.length("GGP_L"))
    )
    levels = np.array(read(run, "activation/GGP_L"))
    lengths = np.array([1.0, *seen])
    assert lengths[-1] == pytest.approx(1.2, abs=0.02)
    assert np.allclose(levels[1:], np.clip(2.0 * (lengths[:-1] - 1.1), 0, 1))
    assert levels[3] == 0 < levels[-1]


def read(run: tf.Run, name: str) -> Floats:
    """A quantity of the history of a run in memory."""
    with run.store.open("history.h5") as file:
        return np.asarray(file[name])


def test_call_back_sees_the_state(block: tf.TongueMesh) -> None:
    """Time, fields by name and probes; not when the state is past."""
    states: list[Snapshot] = []
    depths: list[float] = []
    touched: list[tuple[dict[str, Touch], float]] = []

    def look(now: Snapshot) -> None:
        states.append(now)
        touched.append((now.touches, float(now.touches["floor"].force[2])))
        depths.append(float(now.field("jacobian").min()))
        assert now.field("displacement").shape[1] == 3
        assert now.probes["end"].shape == (3,)

    floor = Contact(Plane((0, 0, 0), (0, 0, 1)), motion=tf.RigidMotion(translation=[(0.05, (0, 0, 0), (0, 0, 2e-3))]))
    model = replace(muscle(block), contacts={"floor": floor})
    run = tf.Simulation(model, probes={"end": (0.02, 0.005, 0.005)}, stepping=SHORT).run({}, t_end=0.02, after_step=look)
    assert [now.t for now in states] == pytest.approx(run.time[1:])
    assert len(set(depths)) == len(depths)
    assert len({force for _, force in touched}) == len(touched)
    assert all(now.touches is kept and kept["floor"].force[2] == force for now, (kept, force) in zip(states, touched, strict=True))
    with pytest.raises(tf.InputError, match="is past"):
        states[0].field("cauchy")
    with pytest.raises(tf.InputError, match="'depth' is not one of displacement"):
        states[-1].field("depth")


def test_one_registration_each(block: tf.TongueMesh, tmp_path: Path) -> None:
    """A field, a quantity of the history and a key of the summary of the user's own."""
    added = {"FIELDS": "stored_energy", "HISTORY": "height", "SUMMARY": "highest"}
    try:

        @tf.field("stored_energy", unit="J/m³", label="elastic energy density")
        def stored_energy(now: Snapshot) -> Floats:
            return now.mean(
                now.evaluate("stored_energy", lambda weak, u, v: ufl.as_vector([weak.energy_density(ufl.Identity(3) + ufl.grad(u))]))
            )[:, 0]

        @tf.history("height", unit="m", label="height of the end")
        def height(now: Snapshot) -> float:
            return float(now.probes["end"][2])

        @tf.summary("highest", unit="m", label="largest height of the end")
        def highest(end: Ending) -> float:
            return float(end.history.column("height").max())

        with pytest.raises(tf.InputError, match="registered already"):
            tf.field("stored_energy", unit="J/m³", label="twice")(stored_energy)
        stepping = replace(SHORT, fields=["stored_energy"])
        run = tf.Simulation(muscle(block), probes={"end": (0.02, 0.005, 0.005)}, stepping=stepping).run(
            {}, t_end=0.02, output=tmp_path / "run"
        )
        assert run.field("stored_energy").min() > 0
        assert run.summary["highest"] == run.probes["end"][:, 2].max()
        with h5py.File(tmp_path / "run" / "history.h5") as file:
            assert np.array_equal(file["height"], run.probes["end"][:, 2])
    finally:
        for table, name in added.items():
            getattr(quantities, table).pop(name, None)


def test_regions_and_loads_of_a_scenario(tmp_path: Path) -> None:
    """Tables of a scenario: laws by physical volume, a pressure on a tagged surface; bad ones are one sentence."""
    write_block(tmp_path / "block.msh", (0.02, 0.01, 0.01), (4, 2, 2))
    path = tmp_path / "block.toml"
    path.write_text(
        '[mesh]\nfile = "block.msh"\n[boundary]\nfixed = ["left"]\n[time]\nend = 0.01\n'
        '[region.passive]\nlaw = "neo_hookean"\nc10 = 800.0\nnu = 0.45\n[load.right.pressure]\npieces = [[0.01, 0.0, 50.0]]\n'
    )
    model = simulation_of(load(path), tmp_path).model
    assert model.regions == {"passive": tf.NeoHookean(800.0, 0.45)}
    assert model.loads == {"right": tf.Pressure([(0.01, 0.0, 50.0)])}
    for change, sentence in (
        ('region.passive.law="jelly"', "region.passive.law: 'jelly'; one of yeoh"),
        ("region.passive.c20=1.0", "c20 is no number of the law neo_hookean"),
        ("load.right.pressure.pieces=[[0.0, 0.0, 1.0]]", "load.right.pressure.pieces"),
        ("load.top.pressure.pieces=[[1.0, 0.0, 1.0]]", "no surface 'top'"),
        ("region.fat={law='neo_hookean', c10=1.0}", "no volume 'fat'"),
    ):
        with pytest.raises(tf.InputError, match=sentence):
            simulation_of(load(path, [change]), tmp_path)
