# SPDX-License-Identifier: MIT
"""A bar of one fibre direction, incompressible, against the closed curves of force, length and velocity."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from dolfinx import default_scalar_type, fem
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ..core.errors import SolveError
from ..core.types import Floats
from ..mechanics.contraction import Contraction
from ..mechanics.hyperelasticity import Yeoh
from ..mechanics.model import Model
from ..mechanics.tissue import Tissue
from ..solvers.equations import Equations
from ..solvers.newton import Newton
from ..solvers.time_integration import GeneralizedAlpha
from ..solvers.tolerances import Tolerances
from ..testing import LoadedForm, Row, box, homogeneous, roller, with_fibres

SIZE, PEAK, C10, C20 = 0.01, 3e3, 192.0, 90.0


def _tissue(stretch: float) -> float:
    """Nominal stress in Pa of incompressible Yeoh tissue in uniaxial stretch."""
    I1 = stretch**2 + 2 / stretch
    return 2 * (stretch - stretch**-2) * (C10 + 2 * C20 * (I1 - 3))


def _length(stretch: float) -> float:
    """Blemker's force–length factor between 0.6 and 1.4."""
    return 1 - 4 * (1 - stretch) ** 2


def _velocity(rate: float) -> float:
    """Grenoble's force–velocity factor."""
    return float(0.7109 + 0.712 * np.arctan(0.43 + 0.4444 * rate) + 0.0329 * rate)


class _Bar(LoadedForm):
    """A cube between frictionless symmetry planes; its end carries a dead load or is moved."""

    def __init__(self, force_velocity: str, load: float, course: Callable[[float], float] | None) -> None:
        cube = with_fibres(box((SIZE, SIZE, SIZE), (1, 1, 1)))
        contraction = Contraction(force_velocity, tendon_length=0.0)
        model = Model(cube, Tissue(Yeoh(C10, C20, 0.5), 1e-3, peak_stress={"GGP": PEAK}), contraction, fixed=["wall"], mixed=True)
        super().__init__(model, ["GGP_L"], lambda X: X[0] > SIZE * (1 - 1e-9))
        self.traction.value[0] = load
        self.slots.activate({"GGP_L": 1.0})
        self.bcs[:] = [roller(self, axis) for axis in range(3)]
        self._course, self._place = course, fem.Constant(cube.mesh, default_scalar_type(0.0))
        if course is not None:
            dofs = fem.locate_dofs_topological(self.V.sub(0), 2, self.facets)
            self.bcs.append(fem.dirichletbc(self._place, dofs, self.V.sub(0)))

    def follow(self, stretch: float, rate: float, end: float, steps: int) -> Floats:
        """Time, stretch and nominal stress in Pa after each step, (steps, 3), from a stretch and its rate in 1/s."""
        scheme = GeneralizedAlpha(self.u, 0.8, self.pressure)
        equations = Equations(self, scheme)
        newton = Newton(equations, Tolerances(rtol=1e-10, atol=1e-14, linear=1e-8), lambda line: None)
        velocity = fem.Function(self.V)
        sides = stretch**-0.5
        velocity.interpolate(lambda X: np.diag([rate, -rate * sides**3 / 2, -rate * sides**3 / 2]) @ X)
        homogeneous(self, np.diag([stretch, sides, sides]))
        equations.restore(replace(scheme.state, u=self.u.x.array.copy(), v=velocity.x.array.copy()))
        path = []
        for i in range(1, steps + 1):
            t = i * end / steps
            if self._course is not None:
                self._place.value = SIZE * (self._course(t) - 1)
            equations.at(t, {"GGP_L": 1.0})
            if not newton.solve().converged:
                raise SolveError(f"the bar did not converge at t = {t:g} s.")
            equations.accept(t)
            force = equations.forces.unbalanced()[self.nodes, 0].sum()
            path.append([t, 1 + self.u.x.array.reshape(-1, 3)[self.nodes, 0].mean() / SIZE, force / SIZE**2])
        newton.destroy()
        return np.array(path)


def fibres() -> Iterator[Row]:
    """Isometric force, force while shortening at a given rate, and shortening under a given load."""
    errors = []
    for stretch in (0.7, 1.0, 1.3):
        bar = _Bar("grenoble", 0.0, lambda t, stretch=stretch: stretch)  # type: ignore[misc]
        stress = bar.follow(stretch, 0.0, 0.01, 1)[-1, 2]
        errors.append(abs(stress - _tissue(stretch) - PEAK * _length(stretch)) / PEAK)
    yield Row("isometric bar, stretch 0.7, 1, 1.3", "force–length curve and Yeoh", float(max(errors)), 1e-3, "of the peak stress")
    rate = -1.5
    path = _Bar("grenoble", 0.0, lambda t: 1.15 + rate * t).follow(1.15, rate, 0.2, 40)[2:]
    expected = np.array([_tissue(s) + PEAK * _length(s) * _velocity(rate) for s in path[:, 1]])
    error = float(abs(path[:, 2] - expected).max() / PEAK)
    yield Row("isokinetic bar, 1.5/s from stretch 1.15 to 0.85", "force–length–velocity and Yeoh", error, 5e-3, "of the peak stress")
    load, end = 0.4 * PEAK, 0.15

    def speed(_: float, state: Floats) -> list[float]:
        factor = (load - _tissue(state[0])) / (PEAK * _length(state[0]))
        return [float(brentq(lambda v: _velocity(v) - factor, -3.4, 3.0))]

    path = _Bar("grenoble", load, None).follow(1.0, speed(0.0, np.ones(1))[0], end, 60)
    exact = solve_ivp(speed, (0.0, end), [1.0], t_eval=path[:, 0], rtol=1e-9, atol=1e-12).y[0]
    error = float(abs(path[:, 1] - exact).max() / (1 - exact[-1]))
    note = f"shortens by {100 * (1 - exact[-1]):.0f} %"
    yield Row("isotonic bar under 0.4 of the peak stress", "force–length–velocity and Yeoh, integrated", error, 5e-3, note)
