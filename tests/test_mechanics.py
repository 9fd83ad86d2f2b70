# SPDX-License-Identifier: MIT
"""The weak form against closed forms, and its tangent against finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from math import factorial
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.fem import petsc as fem_petsc
from dolfinx.mesh import entities_to_geometry

import tongue_fenicsx as tf
from tongue_fenicsx.forms import jit, quadrature
from tongue_fenicsx.forms.fibre_slots import tendon_factor
from tongue_fenicsx.forms.weak_form import WeakForm
from tongue_fenicsx.mechanics.contraction import FORCE_VELOCITY
from tongue_fenicsx.mechanics.hyperelasticity import bulk_modulus
from tongue_fenicsx.meshing.tongue_mesh import MuscleEntry
from tongue_fenicsx.testing import homogeneous, stress_at, with_fibres

ANCHOR = np.array([0.05, 0.01, 0.02])


def with_entry(block: tf.TongueMesh, direction: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> tf.TongueMesh:
    """The block as one muscle, which comes from outside through 0.7 of its right face."""
    bar = with_fibres(block, direction)
    facets = block.facets(["right"])
    nodes = np.unique(entities_to_geometry(block.mesh, 2, facets))
    pull = MuscleEntry(facets, nodes, np.full(len(nodes), 0.7), ANCHOR)
    return replace(bar, muscles={"GGP_L": replace(bar.muscles["GGP_L"], entry=pull)})


def weak_form(tongue: tf.TongueMesh, active: list[str] | None = None, tissue: dict[str, Any] | None = None, **options: Any) -> WeakForm:
    """Of the chapter's tissue, but for what `tissue` changes."""
    return WeakForm(tf.Model(tongue, replace(tf.Tissue.calka(), **(tissue or {})), fixed=["left"], **options), active or [])


LAWS: dict[str, tuple[tf.Yeoh | tf.NeoHookean | tf.MooneyRivlin, Callable[[float], tuple[float, float]]]] = {
    "Yeoh": (tf.Yeoh(192.0, 90.0), lambda I1: (192.0 + 180.0 * (I1 - 3), 0.0)),
    "Yeoh of three terms": (tf.Yeoh(192.0, 90.0, c30=40.0), lambda I1: (192.0 + 180.0 * (I1 - 3) + 120.0 * (I1 - 3) ** 2, 0.0)),
    "neo-Hookean": (tf.NeoHookean(300.0), lambda I1: (300.0, 0.0)),
    "Mooney-Rivlin": (tf.MooneyRivlin(200.0, 70.0), lambda I1: (200.0, 70.0)),
}
"""Laws with W₁ = ∂Ψ/∂Ī₁ and W₂ = ∂Ψ/∂Ī₂ in Pa."""


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("stretch", [0.6, 0.9, 1.3, 1.8])
def test_laws_against_closed_forms(block: tf.TongueMesh, name: str, stretch: float) -> None:
    """Uniaxial and biaxial stretch and simple shear without change of volume: Rivlin's formulas for Cauchy stress differences."""
    law, slopes = LAWS[name]
    weak = weak_form(block, tissue={"law": law})
    s = stretch

    def cauchy(F: np.ndarray) -> np.ndarray:
        homogeneous(weak, F)
        return np.asarray(stress_at(weak, weak.passive_stress(weak.u)) @ F.T)

    sigma = cauchy(np.diag([s, s**-0.5, s**-0.5]))
    W1, W2 = slopes(s**2 + 2 / s)
    assert sigma[0, 0] - sigma[1, 1] == pytest.approx(2 * (s**2 - 1 / s) * (W1 + W2 / s), rel=1e-9)
    sigma = cauchy(np.diag([s, s, s**-2]))
    W1, W2 = slopes(2 * s**2 + s**-4)
    assert sigma[0, 0] - sigma[2, 2] == pytest.approx(2 * (s**2 - s**-4) * (W1 + W2 * s**2), rel=1e-9)
    shear = s - 0.5
    F = np.eye(3)
    F[0, 1] = shear
    sigma = cauchy(F)
    W1, W2 = slopes(3 + shear**2)
    assert sigma[0, 1] == pytest.approx(2 * shear * (W1 + W2), rel=1e-9)


@pytest.mark.parametrize(
    "wrong",
    [lambda: tf.Yeoh(0.0, 90.0), lambda: tf.Yeoh(1.0, -1.0), lambda: tf.NeoHookean(float("nan")), lambda: tf.MooneyRivlin(1.0, -1.0)],
)
def test_bad_stiffness(wrong: Callable[[], object]) -> None:
    """Zero, negative and NaN stiffness is refused with the unit that is expected."""
    with pytest.raises(tf.InputError, match=r"Pa; .*positive number is expected"):
        wrong()


@pytest.mark.parametrize("volumetric", ["quadratic", "barrier"])
def test_volumetric_pressure(block: tf.TongueMesh, volumetric: str) -> None:
    """Pure dilatation: the mean stress is κ U′(J), κ = 2 C₁₀/(1 − 2ν)."""
    law = tf.Yeoh(192.0, 90.0, 0.49, volumetric)
    weak = weak_form(block, tissue={"law": law})
    F = 1.05 * np.eye(3)
    homogeneous(weak, F)
    J = 1.05**3
    sigma = stress_at(weak, weak.passive_stress(weak.u)) @ F.T / J
    slope = J - 1 if volumetric == "quadratic" else (J - 1 / J) / 2
    np.testing.assert_allclose(sigma, 2 * 192.0 / 0.02 * slope * np.eye(3), rtol=1e-10, atol=1e-8)


def test_rotation_is_free_of_stress(block: tf.TongueMesh) -> None:
    """A rigid rotation by 40° leaves no stress and no energy."""
    weak = weak_form(block)
    c, s = np.cos(0.7), np.sin(0.7)
    homogeneous(weak, np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]))
    assert abs(stress_at(weak, weak.passive_stress(weak.u))).max() < 1e-9


def test_patch(block: tf.TongueMesh) -> None:
    """A homogeneous deformation imposed on the boundary leaves no force inside (patch test, to round-off)."""
    weak = weak_form(block, tissue={"law": tf.Yeoh(192.0, 90.0, 0.4)})
    F = np.array([[1.1, 0.05, 0.0], [0.0, 0.95, 0.02], [0.03, 0.0, 1.02]])
    homogeneous(weak, F)
    w = ufl.TestFunction(weak.V)
    b = fem_petsc.assemble_vector(jit.compile_form(ufl.inner(weak.passive_stress(weak.u), ufl.grad(w)) * weak.dx, weak.V.mesh.comm))
    inside = fem.locate_dofs_geometrical(
        weak.V, lambda x: (x[0] > 1e-6) & (x[0] < 0.02 - 1e-6) & (np.minimum(x[1], x[2]) > 1e-6) & (np.maximum(x[1], x[2]) < 0.01 - 1e-6)
    )
    forces = b.array.reshape(-1, 3)
    assert len(inside) > 10
    assert abs(forces[inside]).max() < 1e-12 * abs(forces).max()


def blemker(x: float) -> float:
    """Active force–length of Blemker 2005."""
    if x <= 0.4 or x >= 1.6:
        return 0.0
    if x < 0.6:
        return 9 * (x - 0.4) ** 2
    return 1 - 4 * (1 - x) ** 2 if x <= 1.4 else 9 * (x - 1.6) ** 2


@pytest.mark.parametrize("stretch", [0.3, 0.5, 0.8, 1.0, 1.2, 1.5, 1.7])
@pytest.mark.parametrize("optimal", [1.0, 1.1])
def test_isometric_bar(block: tf.TongueMesh, stretch: float, optimal: float) -> None:
    """Held at a stretch, the fibre carries σ_max α f_L(λ̂) λ/λ_ofl more than its sides, with zero mean stress."""
    weak = weak_form(
        with_fibres(block),
        ["GGP_L"],
        contraction=tf.Contraction(force_velocity="none", tendon_length=0.0, optimal_stretch=optimal),
        tissue={"peak_stress": {"GGP": 5e3}},
    )
    weak.slots.activate({"GGP_L": 0.7})
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    homogeneous(weak, F)
    zero = fem.Function(weak.V)
    sigma = stress_at(weak, weak.active_stress(weak.u, zero)) @ F.T
    assert sigma[0, 0] - sigma[1, 1] == pytest.approx(0.7 * 5e3 * blemker(stretch / optimal) * stretch / optimal, rel=1e-10, abs=1e-9)
    assert np.trace(sigma) == pytest.approx(0.0, abs=1e-8)


GRENOBLE = {0.0: 1.0, -0.5: 0.84, -1.0: 0.67, -2.0: 0.34, -4.0: 0.0, 1.0: 1.26}
HILL = {0.0: 1.0, -7.5: 0.0, -9.0: 0.0, -1.5: 0.8 / 1.8, 100.0: 1.4963}


@pytest.mark.parametrize(("law", "rate", "factor"), [*(("grenoble", *p) for p in GRENOBLE.items()), *(("hill", *p) for p in HILL.items())])
def test_isokinetic_bar(block: tf.TongueMesh, law: str, rate: float, factor: float) -> None:
    """At optimal length the force follows f_V of the isochoric stretch rate; values of Perrier 2003 and of Hill's hyperbola."""
    weak = weak_form(
        with_fibres(block),
        ["GGP_L"],
        contraction=tf.Contraction(force_velocity=law, tendon_length=0.0),
        tissue={"peak_stress": {"GGP": 1e3}},
    )
    weak.slots.activate({"GGP_L": 1.0})
    homogeneous(weak, np.eye(3))
    v = fem.Function(weak.V)
    v.interpolate(lambda X: np.diag([rate, -rate / 2, -rate / 2]) @ X)
    P = stress_at(weak, weak.active_stress(weak.u, v))
    assert (P[0, 0] - P[1, 1]) / 1e3 == pytest.approx(factor, abs=6e-3)


def assembled(form: fem.Form) -> np.ndarray:
    b = fem_petsc.assemble_vector(form)
    values = np.array(b.array)
    b.destroy()
    return values


@pytest.mark.parametrize("nu", [0.49, 0.499])
@pytest.mark.parametrize(("volumetric", "force_velocity"), [("quadratic", "grenoble"), ("barrier", "hill"), ("quadratic", "none")])
def test_tangent_against_finite_differences(block: tf.TongueMesh, nu: float, volumetric: str, force_velocity: str) -> None:
    """The tangent matches central differences of the residual whose stretch rate is measured with fixed ∂λ̄/∂F."""
    check_tangent(block, tf.Yeoh(192.0, 90.0, nu, volumetric), tf.Contraction(force_velocity=force_velocity, tendon_length=0.0))


@pytest.mark.parametrize("law", [tf.Yeoh(192.0, 90.0, c30=40.0), tf.NeoHookean(300.0), tf.MooneyRivlin(200.0, 70.0)])
def test_tangent_of_other_laws(block: tf.TongueMesh, law: object) -> None:
    """The same with the other passive laws and every option of the contraction, on fibres and tendon."""
    check_tangent(block, law, tf.Contraction(tendon_length=6e-3, deviatoric=False, passive_fibres=True, stiffening=True))


def check_tangent(block: tf.TongueMesh, law: object, contraction: tf.Contraction) -> None:
    """Compare the tangent with central differences, and with its transpose."""
    weak = weak_form(
        with_entry(block, (1.0, 0.4, -0.2)),
        ["GGP_L"],
        {"law": law, "damping": tf.Rayleigh(20.0, 0.01), "peak_stress": {"GGP": 3e3}},
        contraction=contraction,
    )
    weak.load(1.0, {"GGP_L": 0.6})
    rng = np.random.default_rng(1)
    F = np.eye(3) + 0.1 * rng.standard_normal((3, 3))
    homogeneous(weak, F)
    weak.u.x.array[:] += 2e-5 * rng.standard_normal(len(weak.u.x.array))
    weak.frozen.x.array[:] = weak.u.x.array
    rest = fem.Function(weak.V)
    rest.x.array[:] = 1e-3 * rng.standard_normal(len(rest.x.array))
    velocity_factor, acceleration_factor = (fem.Constant(weak.V.mesh, default_scalar_type(c)) for c in (40.0, 1600.0))
    w, du = ufl.TestFunction(weak.V), ufl.TrialFunction(weak.V)
    residual = weak.balance(weak.u, velocity_factor * (weak.u - weak.frozen) + rest, acceleration_factor * weak.u, w)
    tangent = jit.compile_form(ufl.derivative(residual, weak.u, du), weak.V.mesh.comm)
    form = jit.compile_form(residual, weak.V.mesh.comm)
    A = fem_petsc.assemble_matrix(tangent)
    A.assemble()
    direction = fem.Function(weak.V)
    direction.x.array[:] = rng.standard_normal(len(direction.x.array))
    product = A.createVecLeft()
    A.mult(direction.x.petsc_vec, product)
    start, h = weak.u.x.array.copy(), 1e-8
    weak.u.x.array[:] = start + h * direction.x.array
    ahead = assembled(form)
    weak.u.x.array[:] = start - h * direction.x.array
    behind = assembled(form)
    difference = (ahead - behind) / (2 * h)
    assert np.linalg.norm(product.array - difference) < 1e-6 * np.linalg.norm(difference)
    transposed = A.copy()
    transposed.transpose()
    transposed.axpy(-1.0, A)
    assert transposed.norm() < 1e-12 * A.norm()


def test_overlapping_muscles_add(block: tf.TongueMesh) -> None:
    """Two muscles in the same cells give the sum of their stresses."""
    along, across = (with_fibres(block, d).muscles["GGP_L"] for d in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    both = tf.TongueMesh(block.mesh, block.facet_tags, block.surfaces, {"GGP_L": along, "TRANS_L": across}, {}, "bar")
    P = {}
    for active in (["GGP_L"], ["TRANS_L"], ["GGP_L", "TRANS_L"]):
        weak = weak_form(both, active, contraction=tf.Contraction(tendon_length=0.0), tissue={"peak_stress": {"GGP": 2e3, "TRANS": 1e3}})
        weak.slots.activate(dict.fromkeys(active, 1.0))
        homogeneous(weak, np.diag([0.9, 1.05, 1.0]))
        P["+".join(active)] = stress_at(weak, weak.active_stress(weak.u, fem.Function(weak.V)))
    np.testing.assert_allclose(P["GGP_L+TRANS_L"], P["GGP_L"] + P["TRANS_L"], rtol=1e-12)
    assert abs(P["GGP_L"]).max() > 100


def test_tendon_zone(block: tf.TongueMesh) -> None:
    """The active stress is nil at the bonded face and whole beyond the tendon."""
    model = tf.Model(block, fixed=["left"], contraction=tf.Contraction(tendon_length=6e-3))
    x = np.array([0.0, 3e-3, 6e-3, 12e-3])
    factor = tendon_factor(model)(np.column_stack([x, np.full(4, 5e-3), np.full(4, 5e-3)]))
    np.testing.assert_allclose(factor, [0, 0.5, 1, 1], atol=1e-9)


@pytest.mark.parametrize(("stretch", "tension"), [(0.9, 0.0), (1.02, 0.17737), (1.06, 1.0), (1.2, 4.03067)])
def test_tendon_carries_tension(block: tf.TongueMesh, stretch: float, tension: float) -> None:
    """Blemker's tendon: exp(46.4 (λ − 1)) − 1 to λ = 1.03, then its tangent, over its value at 1.06; from a sheet of numbers."""
    law = tf.Contraction(force_velocity="none")
    weak = weak_form(with_fibres(block), ["GGP_L"])
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    homogeneous(weak, F)
    I = ufl.Identity(3)  # noqa: E741
    G = I + ufl.grad(weak.u)
    P = stress_at(weak, law.stress(G, 0 * G, G, ufl.as_vector([1.0, 0.0, 0.0]), 0.0, 1.0))
    assert P[0, 0] == pytest.approx(tension * 2 / 3, abs=1e-4)


def test_pull_from_outside(block: tf.TongueMesh) -> None:
    """At rest the pull is 0.7 × peak stress × activation × area, toward the anchor; nearer by 5 % it follows force–length."""
    weak = weak_form(with_entry(block), ["GGP_L"], tissue={"peak_stress": {"GGP": 3e3}}, contraction=tf.Contraction("none"))
    weak.load(1.0, {"GGP_L": 0.4})
    form = fem.form(sum(weak.outer_work(weak.u, 0 * weak.u, ufl.TestFunction(weak.V))))

    def force() -> np.ndarray:
        return assembled(form).reshape(-1, 3).sum(axis=0)

    centre = np.array([0.02, 0.005, 0.005])
    toward = (ANCHOR - centre) / np.linalg.norm(ANCHOR - centre)
    expected = 0.7 * 3e3 * 0.4 * 1e-4 * toward
    np.testing.assert_allclose(force(), expected, rtol=2e-2)
    weak.u.interpolate(lambda X: 0.05 * (ANCHOR[:, None] - X))
    np.testing.assert_allclose(force(), 0.99 * expected, rtol=2e-2)


@pytest.mark.parametrize(("stretch", "tension"), [(0.9, 0.0), (1.2, 0.05 * (np.exp(1.32) - 1)), (1.5, 0.05 * (1.66 * np.exp(2.64) - 1))])
def test_passive_fibres(block: tf.TongueMesh, stretch: float, tension: float) -> None:
    """Blemker's passive curve, 0.05 (exp(6.6 (λ − 1)) − 1) to λ = 1.4, then its tangent, in fibres at rest too."""
    options: dict[str, Any] = {"force_velocity": "none", "tendon_length": 0.0}
    weak = weak_form(
        with_fibres(block), [], tissue={"peak_stress": {"GGP": 3e3}}, contraction=tf.Contraction(passive_fibres=True, **options)
    )
    weak.load(0.0, {})
    homogeneous(weak, np.diag([stretch, stretch**-0.5, stretch**-0.5]))
    P = stress_at(weak, weak.active_stress(weak.u, fem.Function(weak.V)))
    assert P[0, 0] == pytest.approx(3e3 * tension * 2 / 3, abs=1e-6)
    without = weak_form(with_fibres(block), [], tissue={"peak_stress": {"GGP": 3e3}}, contraction=tf.Contraction(**options))
    assert without.slots.names == []


def test_passive_fibres_of_an_idle_muscle_from_outside(block: tf.TongueMesh) -> None:
    """With passive fibres a muscle from outside that is not activated is in the equations too, and its outer part rests."""
    weak = weak_form(with_entry(block), [], tissue={"peak_stress": {"GGP": 3e3}}, contraction=tf.Contraction("none", passive_fibres=True))
    weak.load(0.0, {"MH": 1.0})
    forces = assembled(fem.form(sum(weak.outer_work(weak.u, 0 * weak.u, ufl.TestFunction(weak.V)))))
    assert not forces.any()


def test_plain_fibre_stress(block: tf.TongueMesh) -> None:
    """Without the isochoric split the fibre stress is uniaxial, T f_L(λ) F a₀ ⊗ a₀/λ with the plain stretch."""
    contraction = tf.Contraction("none", tendon_length=0.0, deviatoric=False)
    weak = weak_form(with_fibres(block), ["GGP_L"], tissue={"peak_stress": {"GGP": 3e3}}, contraction=contraction)
    weak.load(0.0, {"GGP_L": 0.5})
    homogeneous(weak, np.diag([1.1, 1.2, 0.8]))
    P = stress_at(weak, weak.active_stress(weak.u, fem.Function(weak.V)))
    np.testing.assert_allclose(P, np.diag([1500.0 * (1 - 4 * 0.1**2), 0, 0]), atol=1e-9)


@pytest.mark.parametrize("level", [0.0, 0.3, 1.0])
def test_stiffening(block: tf.TongueMesh, level: float) -> None:
    """Active tissue is 1 + 9a times as stiff."""
    F = np.diag([1.1, 1.0, 0.95])
    energies = []
    for stiffening in (False, True):
        contraction = tf.Contraction(stiffening=stiffening, tendon_length=0.0)
        weak = weak_form(with_fibres(block), ["GGP_L"], contraction=contraction)
        weak.load(0.0, {"GGP_L": level})
        homogeneous(weak, F)
        energies.append(stress_at(weak, weak.passive_stress(weak.u)))
    np.testing.assert_allclose(energies[1], (1 + 9 * level) * energies[0], rtol=1e-12)


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_quadrature_is_positive_and_exact(degree: int) -> None:
    """Every weight is positive, and x^a y^b z^c integrates to a! b! c! / (a + b + c + 3)!."""
    points, weights = quadrature.points_and_weights(degree)
    assert weights.min() > 0
    for a, b, c in product(range(degree + 1), repeat=3):
        if a + b + c <= degree:
            exact = factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 3)
            assert weights @ (points ** [a, b, c]).prod(axis=1) == pytest.approx(exact, rel=1e-12)


def test_bulk_modulus() -> None:
    """The chapter's κ: 19.2 kPa for its tissue."""
    assert bulk_modulus(tf.Tissue.calka().law) == pytest.approx(19.2e3)


@pytest.mark.parametrize("law", ["grenoble", "hill"])
def test_force_velocity_has_no_corner(law: str) -> None:
    """Where the factor reaches 0 its slope changes gradually, and from 0.03 on it is the published curve."""
    rates = np.linspace(-9.0, -2.0, 701)
    factor = np.array([FORCE_VELOCITY[law](ufl.as_ufl(float(rate)))(()) for rate in rates])
    bend = np.diff(factor, 2) / np.diff(rates)[0] ** 2
    assert factor.min() == 0
    assert abs(bend).max() < 1  # a corner has 2.7 (hill) or 16 (grenoble) at this spacing
    assert abs(np.diff(bend)).max() < 0.3
    if law == "hill":
        v = rates / 7.5
        curve = (1 + v) / (1 - 4 * v)
        np.testing.assert_allclose(factor[curve > 0.03], curve[curve > 0.03], atol=1e-15)
