# SPDX-License-Identifier: MIT
"""The kernels made for the stresses against the same weak form compiled by FFCx, and operations in lanes against UFL's own values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pytest
import ufl
from dolfinx import fem, la
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

import tongue_fenicsx as tf
from tongue_fenicsx.core.types import Expr
from tongue_fenicsx.forms.lanes import Statements
from tongue_fenicsx.forms.weak_form import WeakForm
from tongue_fenicsx.geometry.obstacles import Plane
from tongue_fenicsx.mechanics.contact import Contact
from tongue_fenicsx.mechanics.contraction import Contraction
from tongue_fenicsx.mechanics.kinematics import Kinematics
from tongue_fenicsx.solvers.equations import Equations
from tongue_fenicsx.solvers.linear import constrained_interpolation
from tongue_fenicsx.solvers.tangent import Tangent
from tongue_fenicsx.solvers.time_integration import GeneralizedAlpha
from tongue_fenicsx.testing import box, with_fibres


@dataclass(frozen=True)
class Everything:
    """A law with every operation that UFL and C have in common; no tissue."""

    c: float = 500.0
    nu: float = 0.45
    volumetric: str = "barrier"

    @property
    def shear_modulus(self) -> float:
        """In Pa."""
        return self.c

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """In J/m³."""
        x, c = k.I1 - 3, parameters["c"]
        bent = ufl.conditional(ufl.And(ufl.gt(x, 0.01), ufl.Not(ufl.lt(k.J, 0.9))), ufl.exp(x), 1 + x)
        other = ufl.conditional(ufl.Or(ufl.le(x, 0.02), ufl.ge(k.J, 1.1)), ufl.cos(x), ufl.tanh(x))
        powers = k.I1**2.5 + k.J**-4 + k.J ** (5 / 3) + k.I2 ** (-2 / 3) + ufl.sqrt(k.I2) + k.I1**k.J
        bounded = ufl.max_value(ufl.min_value(x, 0.03), 0.005) ** 2
        stiff = ufl.dot(k.fibre, k.C * k.fibre) ** 2
        return c * (x + bent + other + powers / 10 + bounded + ufl.ln(k.I1) + ufl.sin(x) + ufl.atan(x) + abs(x) * x + stiff)


MODELS: dict[str, dict[str, object]] = {
    "chapter's": {},
    "living": {"tissue": tf.Tissue.buchaillard()},
    "whole contraction": {"contraction": Contraction(force_velocity="hill", passive_fibres=True, stiffening=True, deviatoric=False)},
    "own law": {"tissue": tf.Tissue(Everything(), density=1000.0, peak_stress={"GGP": 3e3, "VERT": 2e3}), "fibre": [1.0, 2.0, 0.5]},
    "finer quadrature": {"quadrature_degree": 5},
    "contact": {"contacts": {"floor": Contact(Plane([0.0, 0.0, -1e-6], [0.0, 0.0, 1.0]))}},
}


@pytest.mark.parallel
@pytest.mark.parametrize("name", MODELS)
def test_same_as_ffcx(name: str) -> None:
    """Forces, tangent and the tangent in linear displacements, within rounding."""
    block = with_fibres(box((0.02, 0.01, 0.01), (3, 2, 2)))
    across = with_fibres(block, (0.0, 1.0, 2.0)).muscles["GGP_L"]
    block.muscles["VERT_L"] = across
    model = tf.Model(block, fixed=["wall"], **MODELS[name])  # type: ignore[arg-type]
    weak = WeakForm(model, list(block.muscles))
    scheme = GeneralizedAlpha(weak.u)
    equations = Equations(weak, scheme)
    equations.at(0.01, dict.fromkeys(block.muscles, 0.6))
    weak.u.interpolate(lambda X: 1e-3 * np.array([np.sin(200 * X[1]), 0.7 * np.sin(180 * X[0]), -0.4 + np.sin(160 * X[0])]))
    scheme.v_part.interpolate(lambda X: 0.02 * np.array([np.sin(300 * X[0]), np.sin(250 * X[2]), X[1] * 100]))
    weak.update()
    equations.forces.repack()
    tangent = Tangent(equations)
    expected = fem_petsc.assemble_matrix(weak.compile(weak.equations(scheme.v, scheme.acceleration)[1]), bcs=weak.bcs)
    expected.assemble()
    P = constrained_interpolation(fem.functionspace(block.mesh, ("P", 1, (3,))), weak.V, weak.fixed_dofs, None)
    for _ in range(2):  # by DOLFINx, then at the places that it found
        tangent.assemble()
        assert tangent.coarse is not None
        assert difference(tangent.matrix, expected) < 1e-12
        assert difference(tangent.coarse, expected.ptap(P)) < 1e-12
    forces = fem.assemble_vector(weak.compile(weak.inner_work(weak.u, scheme.v, ufl.TestFunction(weak.V))))
    forces.scatter_reverse(la.InsertMode.add)
    ours = equations.forces.inner.assemble()
    np.testing.assert_allclose(ours, forces.array[: len(ours)], atol=1e-12 * abs(forces.array).max())


def test_the_coarse_level_is_of_the_first_guess(monkeypatch: pytest.MonkeyPatch) -> None:
    """It stays for all iterations of a solve."""
    done: Counter[bool] = Counter()
    assemble = Tangent.assemble

    def counted(tangent: Tangent, coarse: bool = True) -> None:
        assert tangent.coarse is not None
        before = tangent.coarse.norm() if done else 0.0
        assemble(tangent, coarse)
        done[coarse] += 1
        assert (tangent.coarse.norm() == before) is not coarse

    monkeypatch.setattr(Tangent, "assemble", counted)
    model = tf.Model(with_fibres(box((0.02, 0.01, 0.01), (3, 2, 2))), fixed=["wall"])
    run = tf.Simulation(model, {}, tf.Stepping(5e-3, output_every=5e-3)).run({"GGP_L": tf.ramp(0.01, 0.1)}, 0.02)
    steps, newton = (run.summary[name] for name in ("n_steps", "newton_iterations"))
    assert newton > steps
    assert done == {True: 1 + steps, False: newton - steps}


@pytest.mark.parametrize("beyond", [lambda k, field: ufl.bessel_J(0, k.I1 - 3), lambda k, field: field * (k.I1 - 3)])
def test_what_kernels_cannot(beyond: Callable[[Kinematics, Expr], Expr]) -> None:
    """A law with an operation that C lacks, or with a field of vertices of its own, moves the block by FFCx's forms."""
    block = box((0.02, 0.01, 0.01), (2, 1, 1))
    field = fem.Function(fem.functionspace(block.mesh, ("P", 1)))
    field.x.array[:] = 500.0

    @dataclass(frozen=True)
    class Beyond(Everything):
        def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
            return parameters["c"] * (k.I1 - 3 + beyond(k, field) / 1e3)

    model = tf.Model(block, tissue=tf.Tissue(Beyond(), density=1000.0), fixed=["wall"], gravity=(0.0, 0.0, -9.81), gravity_rise=0.0)
    simulation = tf.Simulation(model, {"end": (0.02, 0.005, 0.005)}, tf.Stepping(step_max=1e-3, output_every=2e-3))
    run = simulation.run({}, 2e-3)
    assert simulation._engine is not None
    assert simulation._engine.equations.forces.kernels is None
    assert run.probes["end"][-1, 2] < 0


def difference(A: PETSc.Mat, B: PETSc.Mat) -> float:
    """Of two matrices on a random vector, over its product."""
    x = B.createVecRight()
    random = PETSc.Random().create(B.comm)
    random.setSeed(1)
    x.setRandom(random)
    return float((A * x - B * x).norm() / (B * x).norm())


def test_an_operation_that_c_does_not_have() -> None:
    """Is named."""
    block = box((0.01, 0.01, 0.01), (1, 1, 1))
    x = ufl.Constant(block.mesh)
    with pytest.raises(NotImplementedError, match="Bessel"):
        Statements(lambda symbol, component: ("x", True)).compute([ufl.bessel_J(1, x)])
