# SPDX-License-Identifier: MIT
"""Runs with contact: what they keep, what they refuse, and scenarios that name obstacles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import pyvista as pv
from conftest import SUBJECT, needs_subject

import tongue_fenicsx as tf
from tongue_fenicsx.core.parallel import on_rank_zero
from tongue_fenicsx.forms.contact_terms import SOFTER
from tongue_fenicsx.forms.weak_form import WeakForm
from tongue_fenicsx.geometry.obstacles import Plane, Triangulated
from tongue_fenicsx.mechanics.contact import Contact
from tongue_fenicsx.meshing import build as meshing
from tongue_fenicsx.scenario.build import simulation_of
from tongue_fenicsx.scenario.files import dump, load
from tongue_fenicsx.solvers.equations import Equations
from tongue_fenicsx.solvers.newton import Newton, Outcome
from tongue_fenicsx.solvers.time_integration import GeneralizedAlpha
from tongue_fenicsx.solvers.tolerances import Tolerances
from tongue_fenicsx.testing import box

FLOOR = Plane((0.0, 0.0, -1e-3), (0.0, 0.0, 1.0))
END = {"end": (0.02, 0.005, 0.005)}


def sinking(block: tf.TongueMesh, contact: Contact | None, **options: Any) -> tf.Model:
    """A block that bends under its weight, onto a floor."""
    contacts = {} if contact is None else {"floor": contact}
    return tf.Model(
        block,
        tf.Tissue(tf.Tissue.buchaillard().law, 1000.0, tf.Rayleigh(40.0, 0.01)),
        fixed=["left"],
        gravity=(0, 0, -9.81),
        contacts=contacts,
        **options,
    )


@pytest.mark.parallel
@pytest.mark.parametrize(("form", "mixed"), [("nitsche", False), ("penalty", False), ("nitsche", True)])
def test_the_floor_carries(block: tf.TongueMesh, scratch: Path, form: str, mixed: bool) -> None:
    """The block comes to rest on the floor: floor and wall carry its weight, it stays out, and the energies balance."""
    model = sinking(block, Contact(FLOOR, form), mixed=mixed)
    run = tf.Simulation(model, END, tf.Stepping(output_every=0.1), tf.Tolerances.of("tight")).run({}, 0.3, scratch)
    static = tf.Stepping(step_max=0.02, output_every=0.1, quasi_static=True)
    free = tf.Simulation(sinking(block, None, mixed=mixed), END, static).run({}, 0.1)
    assert free.probes["end"][-1, 2] < -2e-3 < run.probes["end"][-1, 2] < -5e-4
    floor = run.contact["floor"]
    assert floor["force"][-1, 2] > 1e-3
    weight = 9.81 * 1000 * 2e-6
    assert floor["force"][-1, 2] + run.support["left"][-1, 2] == pytest.approx(weight, rel=1e-2)
    np.testing.assert_allclose(floor["force"][:, :2], 0.0, atol=1e-12)
    assert floor["penetration"].max() < 0.05e-3
    assert floor["area"][-1] > 1e-7
    assert floor["pressure"].max() < 1e4
    summary = run.summary["contact"]["floor"]
    assert summary["force_max_N"] == pytest.approx(np.linalg.norm(floor["force"], axis=1).max())
    assert run.summary["contact_force_max_N"] == summary["force_max_N"]
    assert summary["penetration_max_m"] == floor["penetration"].max()
    assert run.summary["energy_balance_error"] < 0.01
    pressure = run.field("contact_pressure")
    assert pressure.max() == pytest.approx(floor["pressure"][-1], rel=1e-5)
    assert np.count_nonzero(pressure) < 0.2 * len(pressure)


@pytest.mark.parallel
@pytest.mark.parametrize("squeeze", [0.0, 2.0])
def test_shortened_step(block: tf.TongueMesh, squeeze: float) -> None:
    """A step 3 mm down to a floor 1 mm below ends at the floor; one that turns the block inside out is cut."""
    weak = WeakForm(sinking(block, Contact(FLOOR)), [])
    scheme = GeneralizedAlpha(weak.u)
    equations = Equations(weak, scheme)
    newton = Newton(equations, Tolerances.of("tight"), print)
    equations.at(0.1, {})
    x, step, b = newton._x, newton._x.duplicate(), newton._b
    newton._evaluate(x, b)
    place = weak.V.tabulate_dof_coordinates()[: step.getLocalSize() // 3]
    step.array.reshape(-1, 3)[:] = np.column_stack([squeeze * place[:, 0], 0 * place[:, 0], np.full(len(place), 3e-3)])
    whole, first = step.max()[1], b.dot(step)
    assert newton._search is not None
    newton._search._shorten(x, step)
    share = step.max()[1] / whole
    x.axpy(-1.0, step)
    newton._evaluate(x, b)
    if squeeze:
        assert share < 0.25
        assert np.isfinite(b.norm())
    else:
        assert 0.25 <= share < 0.5
        assert -0.1 * share * first < b.dot(step)
    newton.destroy()


@pytest.mark.parallel
@pytest.mark.parametrize("form", ["penalty", "nitsche"])
def test_resume_in_contact(block: tf.TongueMesh, scratch: Path, form: str) -> None:
    """A run stopped while touching goes on as if it had not been (no λ is carried from step to step, γ is)."""

    def simulate(folder: Path, end: float, resume: bool = False) -> tf.Run:
        contact = Contact(FLOOR, form, stiffness=0.05, tolerance=0.02e-3 if form == "penalty" else 0.002e-3)
        return tf.Simulation(sinking(block, contact), probes=END).run({}, end, folder, resume=resume)

    whole = simulate(scratch / "whole", 0.2)
    simulate(scratch / "parts", 0.15)
    parts = simulate(scratch / "parts", 0.2, resume=True)
    assert np.linalg.norm(whole.contact["floor"]["force"], axis=1).max() > 1e-4
    round_off = 0.0 if block.comm.size == 1 and form == "penalty" else 1e-12  # GMRES is not reproducible to the last bit
    np.testing.assert_allclose(parts.probes["end"], whole.probes["end"], rtol=0, atol=round_off)
    np.testing.assert_allclose(parts.contact["floor"]["force"], whole.contact["floor"]["force"], rtol=0, atol=1e6 * round_off)


@pytest.mark.parametrize(("form", "stiffness", "tolerated"), [("penalty", 0.02, 0.01e-3), ("nitsche", 0.1, 0.002e-3)])
def test_augmentation(block: tf.TongueMesh, form: str, stiffness: float, tolerated: float) -> None:
    """A soft obstacle alone lets the block in; pressing harder until its tolerance it does not."""
    deep = []
    for tolerance in (1.0, tolerated):
        contact = Contact(FLOOR, form, stiffness=stiffness, tolerance=tolerance)
        stepping = tf.Stepping(step_max=0.02, output_every=0.1, quasi_static=True)
        run = tf.Simulation(sinking(block, contact), probes={}, stepping=stepping).run({}, 0.1)
        deep.append(run.contact["floor"]["penetration"][-1])
    assert deep[0] > 2 * tolerated
    assert deep[1] < tolerated


def test_two_stages(block: tf.TongueMesh, scratch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A step whose solve fails in contact is solved with soft obstacles first, and ends where it should."""

    def simulate(folder: Path) -> tf.Run:
        stepping = tf.Stepping(step_max=0.02, output_every=0.1, quasi_static=True)
        return tf.Simulation(sinking(block, Contact(FLOOR)), END, stepping, tf.Tolerances.of("tight")).run({}, 0.1, folder)

    expected = simulate(scratch / "expected")
    right = Newton.solve
    stiffness: list[float] = []

    def fails_at_first(self: Newton) -> Outcome:
        outcome = right(self)
        if len(stiffness) % 3 == 0 and not self._weak.contacts.touched:
            return outcome
        stiffness.append(1 / float(self._weak.contacts.terms["floor"].gamma.value))
        return replace(outcome, converged=len(stiffness) % 3 != 1)

    monkeypatch.setattr(Newton, "solve", fails_at_first)
    run = simulate(scratch / "staged")
    assert run.summary["n_rejected"] == 0
    np.testing.assert_allclose(stiffness[1::3], stiffness[0] / SOFTER)
    np.testing.assert_allclose(stiffness[2::3], stiffness[0])
    np.testing.assert_allclose(run.probes["end"][-1], expected.probes["end"][-1], atol=1e-6)


def test_short_steps_stay_stable(block: tf.TongueMesh) -> None:
    """In a step of 10 µs, in which damping makes a thousand times the stress of the tissue, contact does not take the tangent's sign."""
    simulation = tf.Simulation(sinking(block, Contact(Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))), probes={})
    engine = simulation._prepare([])
    engine.start({})
    engine.equations.at(1e-5, {})
    engine.weak.u.x.array.reshape(-1, 3)[:, 2] -= 1e-6
    engine.weak.update()
    tangent = engine._newton._tangent
    tangent.assemble()
    A = tangent.matrix.convert("dense").getDenseArray()
    free = np.setdiff1d(np.arange(len(A)), engine.weak.fixed_dofs)
    stiffness = np.linalg.eigvalsh((A + A.T)[np.ix_(free, free)])
    assert stiffness[0] > 0


def test_touching_at_rest(block: tf.TongueMesh) -> None:
    """0.1 mm inside at rest counts as touching, 0.3 mm is refused with depth and place; next to a bonded area nothing is asked."""
    for depth, refused in ((0.1e-3, False), (0.3e-3, True)):
        plane = Plane((0.0, 0.0, depth), (0.0, 0.0, 1.0))
        model = sinking(block, Contact(plane))
        if refused:
            with pytest.raises(tf.InputError, match=r"contact\.floor: at rest the tongue is 0\.30 mm inside it at \(.*, .*, 0\.0\) mm"):
                WeakForm(model, [])
        else:
            weak = WeakForm(model, [])
            term = weak.contacts.terms["floor"]
            assert term.gap.x.array.min() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"form": "glue"}, "'glue'; one of penalty, nitsche is expected"),
        ({"theta": 2}, "one of -1, 0, 1"),
        ({"stiffness": 0.0}, "contact.stiffness: 0.0"),
    ],
)
def test_bad_contact(wrong: dict[str, object], message: str) -> None:
    """Forms and numbers that are not accepted are named."""
    with pytest.raises(tf.InputError, match=message):
        Contact(FLOOR, **wrong)  # type: ignore[arg-type]


SCENARIO = """
units = "mm"
[mesh]
file = "tongue.msh"
[time]
end = 0.02
[boundary.moving.mandible]
angle = [[0.1, 0, 5]]
[contact.palate]
tolerance = 0.02
[contact.lower_teeth]
form = "penalty"
stiffness = 2.0
moves_with = "mandible"
[contact.screen]
plane = {point = [0, 0, 80], normal = [0, 0, -1]}
[contact.ball]
sphere = {centre = [0, 0, 120], radius = 10}
[contact.file]
surface = "ball.stl"
"""


def written(folder: Path) -> Path:
    """The scenario and its ball, in a folder."""
    path = folder / "contact.toml"
    path.write_text(SCENARIO)
    pv.Sphere(radius=0.01, center=(0.0, 0.0, 0.15)).save(folder / "ball.stl")
    return path


def test_scenario(tongue: tf.TongueMesh, tongue_file: Path) -> None:
    """Bones of the mesh, files, planes and balls become obstacles in m, and the resolved scenario says the same again."""
    path = tongue_file.parent / "contact.toml"
    on_rank_zero(tongue.comm, lambda: written(tongue_file.parent))
    scenario = load(path)
    contacts = simulation_of(scenario, path.parent).model.contacts
    assert list(contacts) == ["palate", "lower_teeth", "screen", "ball", "file"]
    assert contacts["palate"].tolerance == pytest.approx(2e-5)
    assert contacts["palate"].form == "nitsche"
    assert contacts["lower_teeth"].motion is not None
    assert list(contacts["lower_teeth"].motion.angle) == [(0.1, 0.0, 5.0)]
    dorsum = tongue.landmarks["dorsum"][None]
    above = dorsum + np.array([0, 0, 5e-3])
    gaps = {name: contact.obstacle.evaluate(above)[0][0] for name, contact in contacts.items()}
    assert 1e-3 < gaps["palate"] < 4e-3
    assert gaps["screen"] == pytest.approx(0.08 - dorsum[0, 2] - 5e-3)
    assert gaps["ball"] > 0.03
    assert isinstance(contacts["file"].obstacle, Triangulated)
    again = path.with_name("again.toml")
    on_rank_zero(tongue.comm, lambda: again.write_text(dump(scenario)))
    np.testing.assert_allclose(simulation_of(load(again), path.parent).model.contacts["ball"].obstacle.evaluate(above)[0], gaps["ball"])
    with h5py.File(tongue_file.with_suffix(".h5")) as file:
        assert {"palate", "velum", "mandible", "lower_teeth"} <= set(file["bones"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("contact.palat={}", r"contact\.palat\.surface: the mesh has no bone 'palat' \(it has .*palate"),
        ("contact.palate.surface='no.stl'", "no.stl"),
        ("contact.palate.moves_with='hyoid'", "'hyoid' does not move; moving in boundary.moving: mandible"),
        ("contact.palate.form='glue'", "'glue'; one of penalty, nitsche is expected"),
        ("contact.palate.stifness=2.0", "did you mean 'stiffness'"),
        ("contact.screen.sphere={centre=[0.0,0.0,0.0],radius=1.0}", "one of surface, plane and sphere"),
        ("contact.ball.sphere.radius=-1.0", "a positive length is expected"),
        ("contact.screen.plane.normal=[0.0,0.0,0.0]", "has no direction"),
    ],
)
def test_bad_scenario(tongue_file: Path, change: str, message: str) -> None:
    """One sentence names key and fault."""
    path = written(tongue_file.parent)
    with pytest.raises(tf.InputError, match=message):
        simulation_of(load(path, [change]), path.parent)


@needs_subject
def test_demo_of_a_subject(scratch: Path) -> None:
    """At rest subject PB's tongue fits its palate, velum, pharynx and jaw as the demo takes them, and not more tightly."""
    mesh = scratch / "pb.msh"
    meshing.build(tf.read_subject(SUBJECT), mesh, 5e-3)
    demo = Path(__file__).parents[1] / "demos" / "subject_palate.toml"
    changes = [f"mesh.file='{mesh}'"]
    weak = WeakForm(simulation_of(load(demo, changes), scratch).model, [])
    assert set(weak.contacts.terms) == {"palate_hard", "velum", "pharynx_wall", "mandible"}
    assert all(term.gap.x.array.min() >= -1e-12 for term in weak.contacts.terms.values())
    model = simulation_of(load(demo, [*changes, "contact.velum.touching=0.0002"]), scratch).model
    with pytest.raises(tf.InputError, match=r"contact\.velum: at rest the tongue is 0\.\d\d mm inside it"):
        WeakForm(model, [])


@pytest.mark.slow
def test_much_stretched_tissue_slides() -> None:
    """A block on a floor is drawn to five times its length: there Nitsche's parameter, measured by tissue at rest, is too small for any
    step, so it grows."""
    block = box((0.02, 0.01, 0.01), (4, 2, 2), surfaces={"end": lambda X: X[0] > 0.02 - 1e-9})
    drawn = tf.RigidMotion(translation=[(0.1, (0, 0, 0), (0.08, 0, 0))])
    model = tf.Model(
        block, tf.Tissue.buchaillard(), fixed=["wall"], moving={"end": drawn}, gravity=(0.0, 0.0, -3000.0), gravity_rise=0.02,
        contacts={"floor": Contact(Plane((0.0, 0.0, -1e-4), (0.0, 0.0, 1.0)), "nitsche")},
    )  # fmt: skip
    run = tf.Simulation(model, {}, tf.Stepping(5e-3, output_every=0.05)).run({}, 0.1)
    assert run.time[-1] == pytest.approx(0.1)
    assert run.contact["floor"]["force"][-1, 2] > 1
    assert run.contact["floor"]["penetration"].max() <= 1e-4 + 1e-9
