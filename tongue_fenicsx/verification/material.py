# SPDX-License-Identifier: MIT
"""Tissue at finite strain: closed forms, patch test, manufactured solution, Cook's membrane, and the tangent."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, la
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI

from ..core.errors import SolveError
from ..core.types import Expr, Floats
from ..forms import jit
from ..forms.weak_form import WeakForm
from ..mechanics.contraction import Contraction
from ..mechanics.hyperelasticity import NeoHookean
from ..mechanics.model import Model
from ..mechanics.tissue import Rayleigh, Tissue
from ..simulation.probes import Probes
from ..solvers.equations import Equations
from ..solvers.newton import Newton
from ..solvers.time_integration import QuasiStatic
from ..solvers.tolerances import Tolerances
from ..testing import LoadedForm, Row, box, homogeneous, roller, solve, stress_at, with_fibres

C10, C20, KAPPA = 192.0, 90.0, 19.2e3
"""The chapter's tissue in Pa, κ for ν = 0.49, written here again so that the rows do not take them from what they check."""


def closed_form(F: Floats) -> Floats:
    """First Piola–Kirchhoff stress of that tissue, (3, 3) in Pa, by hand."""
    J, C = np.linalg.det(F), F.T @ F
    I1 = J ** (-2 / 3) * np.trace(C)
    inverse = np.linalg.inv(F).T
    slope = C10 + 2 * C20 * (I1 - 3)
    return np.asarray(2 * slope * (J ** (-2 / 3) * F - I1 / 3 * inverse) + KAPPA * (J - 1) * J * inverse)


def _boundary(weak: WeakForm, value: Callable[[Floats], Floats] | fem.Expression) -> list[fem.DirichletBC]:
    """A displacement given on the whole boundary."""
    tongue = weak.model.tongue
    given = fem.Function(weak.V)
    given.interpolate(value)
    return [fem.dirichletbc(given, fem.locate_dofs_topological(weak.V, 2, tongue.facet_tags.indices))]


def laws() -> Iterator[Row]:
    """Homogeneous deformations of Yeoh tissue, also turned by 40°: the stress that Rivlin's formulas give."""
    weak = WeakForm(Model(box((0.01, 0.01, 0.01), (1, 1, 1)), fixed=["wall"]), [])
    c, s = np.cos(np.radians(40)), np.sin(np.radians(40))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    cases = {
        "uniaxial stretch 1.5": np.diag([1.5, 1.5**-0.5, 1.5**-0.5]),
        "biaxial stretch 1.3": np.diag([1.3, 1.3, 1.3**-2]),
        "simple shear 0.8": np.array([[1, 0.8, 0], [0, 1, 0], [0, 0, 1.0]]),
        "stretch 1.5 turned by 40°": turn @ np.diag([1.5, 1.5**-0.5, 1.5**-0.5]),
    }
    for name, F in cases.items():
        homogeneous(weak, F)
        expected = closed_form(F)
        error = abs(stress_at(weak, weak.passive_stress(weak.u)) - expected).max() / abs(expected).max()
        yield Row(f"Yeoh, {name}", "closed form", float(error), 1e-9)


def patch() -> Iterator[Row]:
    """An affine boundary displacement gives the affine displacement and its stress everywhere, at finite strain."""
    weak = WeakForm(Model(box((0.01, 0.01, 0.01), (3, 3, 3)), fixed=["wall"]), [])
    A = np.array([[0.1, 0.2, 0.0], [-0.05, 0.1, 0.1], [0.0, 0.1, -0.1]])
    test = ufl.TestFunction(weak.V)
    solve(weak, ufl.inner(weak.passive_stress(weak.u), ufl.grad(test)) * weak.dx, _boundary(weak, lambda X: A @ X))
    exact = fem.Function(weak.V)
    exact.interpolate(lambda X: A @ X)
    expected = closed_form(np.eye(3) + A)
    error = abs(weak.u.x.array - exact.x.array).max(initial=0.0) / abs(exact.x.array).max(initial=0.0)
    gap = abs(stress_at(weak, weak.passive_stress(weak.u)) - expected).max() / abs(expected).max()
    comm = weak.V.mesh.comm
    yield Row(
        "patch test, 20 % strain", "affine displacement, its stress", comm.allreduce(max(float(error), float(gap)), op=MPI.MAX), 1e-12
    )


def manufactured(divisions: tuple[int, ...] = (2, 4, 8)) -> Iterator[Row]:
    """A smooth displacement and the body force that holds it: third order in L², second in H¹."""
    size, errors = 0.01, []
    for n in divisions:
        weak = WeakForm(Model(box((size, size, size), (n, n, n)), fixed=["wall"], quadrature_degree=4), [])
        mesh = weak.V.mesh
        X = ufl.SpatialCoordinate(mesh)
        k = np.pi / size
        exact = 0.05 * size * ufl.as_vector([ufl.sin(k * X[1]) * ufl.cos(k * X[2]), ufl.sin(k * X[2]) * X[0] / size, ufl.sin(k * X[0])])
        test = ufl.TestFunction(weak.V)
        load = -ufl.div(_hand_written_stress(exact))
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 6})
        bcs = _boundary(weak, jit.compile_expression(exact, weak.V.element.interpolation_points, mesh.comm))
        solve(weak, ufl.inner(weak.passive_stress(weak.u), ufl.grad(test)) * dx - ufl.inner(load, test) * dx, bcs)
        difference = weak.u - exact
        squares = [ufl.inner(difference, difference) * dx, ufl.inner(ufl.grad(difference), ufl.grad(difference)) * dx]
        errors.append([np.sqrt(mesh.comm.allreduce(float(fem.assemble_scalar(jit.compile_form(s, mesh.comm))))) for s in squares])
    table = np.array(errors)
    orders = np.log(table[-2] / table[-1]) / np.log(divisions[-1] / divisions[-2])
    for order, expected, norm in zip(orders, (3.0, 2.0), ("L²", "H¹"), strict=True):
        yield Row(f"manufactured solution, {norm}", f"order {expected:g}", abs(order - expected), 0.1, f"order {order:.2f}")


def _hand_written_stress(u: Expr) -> Expr:
    """`closed_form` in UFL."""
    F = ufl.Identity(3) + ufl.grad(u)
    J = ufl.det(F)
    I1 = J ** (-2 / 3) * ufl.tr(F.T * F)
    inverse = ufl.inv(F).T
    slope = C10 + 2 * C20 * (I1 - 3)
    return 2 * slope * (J ** (-2 / 3) * F - I1 / 3 * inverse) + KAPPA * (J - 1) * J * inverse


def cook(n: int = 16) -> Iterator[Row]:
    """Cook's membrane at large strain and ν = 0.4999, plane strain (de Souza Neto et al. 1996), in the mixed form.

    A panel of 48 mm with ends of 44 and 16 mm, G = 80.1938 MPa, K = 400 942 MPa, isochoric neo-Hookean with K (J−1)²/2,
    100 N per mm of thickness upward on the free end. Upper corner: 6.891 mm in the documentation of OpenGeoSys 6.5.4 (F-bar,
    30 by 30 elements, still growing by 0.3 % a refinement), along the curve of Elguedj et al. (2008).
    """
    length, wall, end, thickness = 48e-3, 44e-3, 16e-3, 48e-3 / n
    panel = box((length, wall, thickness), (n, n, 1))
    x = panel.mesh.geometry.x
    x[:, 1] = wall * x[:, 0] / length + x[:, 1] / wall * (wall + (end - wall) * x[:, 0] / length)
    model = Model(panel, Tissue(NeoHookean(80.1938e6 / 2, 0.4999), 1000.0), fixed=["wall"], mixed=True)
    weak = LoadedForm(model, [], lambda X: X[0] > length - 1e-9)
    weak.bcs.append(roller(weak, 2, 0.0, thickness))
    newton = Newton(Equations(weak, QuasiStatic(weak.u, weak.pressure)), Tolerances(rtol=1e-8, atol=1e-6, linear=1e-6), lambda line: None)
    for share in (0.25, 0.5, 0.75, 1.0):
        weak.traction.value[1] = share * 100e3 / end
        if not newton.solve().converged:
            raise SolveError(f"Cook's membrane did not converge at {100 * share:g} % of the load.")
    newton.destroy()
    up = Probes(panel, {"corner": (length, wall + end, 0.0)}).values(weak.u)[0, 1]
    error = abs(1e3 * float(up) / 6.891 - 1)
    yield Row("Cook's membrane, ν = 0.4999, large strain", "OpenGeoSys; de Souza Neto 1996", error, 0.01, f"{1e3 * up:.2f} mm of 6.89")


def taylor() -> Iterator[Row]:
    """What the tangent leaves of the residual's change shrinks with the square of the step, with every term on.

    The tangent that solves leaves out a part in proportion to the stretch rate, so it is tested where fibres are at rest; the
    residual's whole derivative is tested while they shorten.
    """
    for mixed in (False, True):
        for shortening in (False, True):
            contraction = Contraction(passive_fibres=True, stiffening=True, tendon_length=6e-3)
            weak = WeakForm(Model(
                with_fibres(box((0.02, 0.01, 0.01), (3, 2, 2)), (1.0, 0.4, -0.2)),
                replace(Tissue.calka(), damping=Rayleigh(20.0, 0.01), peak_stress={"GGP": 3e3}), contraction,
                fixed=["wall"], gravity=(0.0, 0.0, -9.81), mixed=mixed,
            ), ["GGP_L"])  # fmt: skip
            weak.load(1.0, {"GGP_L": 0.6})
            homogeneous(weak, np.array([[1.1, 0.05, 0.0], [0.0, 0.95, 0.04], [0.03, 0.0, 1.02]]))
            name = "tangent, every term" + (", shortening" if shortening else "") + (", mixed" if mixed else "")
            if shortening:
                weak.frozen = weak.u
            yield Row(name, "order 2", *remainder(weak, -1.0 if shortening else 0.0))


def remainder(weak: WeakForm, rate: float = 0.0) -> tuple[float, float, str]:
    """Of the tangent's Taylor test in a step of 50 ms from a velocity of `rate` (1/s) times the place: deviation of the order from 2,
    its limit, and a note."""
    begun, moving = fem.Function(weak.V), fem.Function(weak.V)
    begun.x.array[:] = weak.u.x.array
    moving.interpolate(lambda X: rate * X)
    velocity, acceleration = (fem.Constant(weak.V.mesh, default_scalar_type(c)) for c in (40.0, 1600.0))
    residual, tangent = weak.equations(velocity * (weak.u - begun) + moving, acceleration * (weak.u - begun))
    unknowns = [weak.u] if weak.pressure is None else [weak.u, weak.pressure]
    forms = weak.compile([residual] if weak.pressure is None else residual)
    A = fem_petsc.assemble_matrix(weak.compile(tangent))
    A.assemble()
    owned = [f.function_space.dofmap.index_map.size_local * f.function_space.dofmap.index_map_bs for f in unknowns]
    start = [f.x.array.copy() for f in unknowns]
    directions = []
    for function in unknowns:  # smooth, and the same on any number of ranks
        function.interpolate(
            lambda X, n=function.function_space.value_size: 1e-3 * np.array([np.sin(300 * X[i] + X.sum(axis=0) * 100) for i in range(n)])
        )
        directions.append(function.x.array.copy())

    def at(step: float) -> Floats:
        parts = []
        for function, begin, direction in zip(unknowns, start, directions, strict=True):
            function.x.array[:] = begin + step * direction
        weak.update()
        for form, n in zip(forms, owned, strict=True):
            vector = fem.assemble_vector(form)
            vector.scatter_reverse(la.InsertMode.add)
            parts.append(vector.array[:n].copy())
        return np.concatenate(parts)

    x, y = A.createVecs()
    x.array[:] = np.concatenate([d[:n] for d, n in zip(directions, owned, strict=True)])
    A.mult(x, y)
    rest = at(0.0)
    steps = (2e-3, 1e-3)
    left = [np.sqrt(weak.V.mesh.comm.allreduce(float(((at(h) - rest - h * y.array) ** 2).sum()))) for h in steps]
    order = float(np.log2(left[0] / left[1]))
    return abs(order - 2), 0.1, f"order {order:.2f}"
