# SPDX-License-Identifier: MIT
"""Generalized-alpha in the form of Arnold and Brüls (2007), and a sequence of equilibria for slow loads.

The weak form holds at the end of the step with the true acceleration ü; an auxiliary acceleration a carries the
averaging, (1−α_m) a₁ + α_m a₀ = (1−α_f) ü₁ + α_f ü₀. So pressure, contact and force–velocity are never blended between
times, and the state (u, v, ü, a, h) can be saved and restarted exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import default_scalar_type, fem

from ..core.errors import InputError
from ..core.types import Expr, Floats


@dataclass(frozen=True)
class State:
    """Everything that the next step needs (owned and ghost values of this rank, SI units).

    `average` is the mean velocity of the step that led here, `pressure` that of the mixed form, as the first component of a displacement
    at the vertices; otherwise nil; `gammas` how soft each obstacle is, in m/Pa (of obstacles as they are at rest, if empty).
    """

    t: float
    h: float
    u: Floats
    v: Floats
    acceleration: Floats
    auxiliary: Floats
    average: Floats
    pressure: Floats
    gammas: tuple[float, ...] = ()


class _Scheme:
    """What both schemes keep: the unknowns and the last state."""

    def __init__(self, u: fem.Function, pressure: fem.Function | None) -> None:
        self.u, self._pressure = u, pressure
        if pressure is not None:
            self._vertices = np.empty(pressure.x.array.size, dtype=np.int64)  # nodes of the displacement
            self._vertices[pressure.function_space.dofmap.list] = u.function_space.dofmap.list[:, :4]
        zeros = np.zeros_like(u.x.array)
        self.state = State(0.0, 0.0, u.x.array.copy(), zeros, zeros, zeros, zeros, zeros)

    def restore(self, state: State) -> None:
        """Go back to a state."""
        self.state = state
        self.u.x.array[:] = state.u
        if self._pressure is not None:
            self._pressure.x.array[:] = state.pressure[3 * self._vertices]

    def _pressures(self) -> Floats:
        """The present pressure as a state keeps it."""
        spread: Floats = np.zeros_like(self.u.x.array)
        if self._pressure is not None:
            spread[3 * self._vertices] = self._pressure.x.array
        return spread


class GeneralizedAlpha(_Scheme):
    """The time discretisation: velocity and acceleration as affine functions of the unknown displacement.

    Parameters
    ----------
    u : fem.Function
        Displacement, the unknown of each step.
    radius : float
        Spectral radius at infinite frequency, 0 (strong numerical damping) to 1 (none).
    pressure : fem.Function, optional
        Pressure of the mixed form, an unknown that has no rate.

    Attributes
    ----------
    v, acceleration : UFL expressions
        To stand in the weak form for velocity and acceleration at the end of the step.
    v_part, a_part : fem.Function
        What of them is known when the step begins.
    """

    def __init__(self, u: fem.Function, radius: float = 0.8, pressure: fem.Function | None = None) -> None:
        super().__init__(u, pressure)
        if not 0 <= radius <= 1:
            raise InputError(f"spectral_radius: {radius}; a number from 0 to 1 is expected.")
        self.alpha_m = (2 * radius - 1) / (radius + 1)
        self.alpha_f = radius / (radius + 1)
        self.gamma = 0.5 + self.alpha_f - self.alpha_m
        self.beta = 0.25 * (self.gamma + 0.5) ** 2
        V = u.function_space
        self.v_part, self.a_part = fem.Function(V), fem.Function(V)
        self._v_factor, self._a_factor = (fem.Constant(V.mesh, default_scalar_type(1.0)) for _ in range(2))
        self.v: Expr = self._v_factor * u + self.v_part
        self.acceleration: Expr = self._a_factor * u + self.a_part

    def begin(self, h: float) -> None:
        """Prepare a step of `h` seconds from the present state; `u` becomes the first guess, which goes on with the mean of the last
        velocity and that of the last step.

        (A guess that keeps the displacement would reverse the velocity, and the force–velocity law with it; one that keeps the velocity
        goes on with the jitter of a surface in contact.)
        """
        s = self.state
        a = self._rescale(h)
        m, f, g, b = self.alpha_m, self.alpha_f, self.gamma, self.beta
        known = -s.u - h * s.v - h**2 * (0.5 - b) * a  # h² β a₁ = u₁ + known
        v_factor, a_factor = g / (h * b), (1 - m) / ((1 - f) * h**2 * b)
        self._v_factor.value, self._a_factor.value = v_factor, a_factor
        self.v_part.x.array[:] = s.v + h * (1 - g) * a + v_factor * known
        self.a_part.x.array[:] = a_factor * known + (m * a - f * s.acceleration) / (1 - f)
        self._h = h
        self.u.x.array[:] = s.u + h * (s.v if s.h == 0.0 else (s.v + s.average) / 2)

    @property
    def rates(self) -> tuple[tuple[float, Floats], tuple[float, Floats]]:
        """Factor and known part of velocity and acceleration, affine functions of the unknown displacement."""
        velocity = float(self._v_factor.value), self.v_part.x.array
        return velocity, (float(self._a_factor.value), self.a_part.x.array)

    @property
    def mean_velocity(self) -> Floats:
        """Of the last step, in m/s."""
        return self.state.average

    def restore(self, state: State) -> None:
        """Go back to a state; `v` and `acceleration` are its own until a step begins."""
        super().restore(state)
        for factor, part, values in ((self._v_factor, self.v_part, state.v), (self._a_factor, self.a_part, state.acceleration)):
            factor.value = 0.0
            part.x.array[:] = values

    def accept(self, t: float, gammas: tuple[float, ...] = ()) -> None:
        """Make the solved displacement the new state, at time `t` (s)."""
        s, h = self.state, self._h
        a = self._rescale(h)
        u = self.u.x.array.copy()
        acceleration = self._a_factor.value * u + self.a_part.x.array
        auxiliary = ((1 - self.alpha_f) * acceleration + self.alpha_f * s.acceleration - self.alpha_m * a) / (1 - self.alpha_m)
        v = self._v_factor.value * u + self.v_part.x.array
        self.state = State(t, h, u, v, acceleration, auxiliary, (u - s.u) / h, self._pressures(), gammas)

    def error(self, before: State) -> Floats:
        """Estimated error in m of the displacement in the step that led here from `before`: against the Taylor series with a
        linear acceleration (Zienkiewicz and Xie 1991)."""
        s, h = self.state, self.state.h
        return np.asarray(s.u - before.u - h * before.v - h**2 * (before.acceleration / 3 + s.acceleration / 6))

    def _rescale(self, h: float) -> Floats:
        """The auxiliary acceleration for a step of another length: ü + (h′/h)(a − ü), which keeps the order at 2."""
        s = self.state
        if s.h == 0.0 or s.h == h:
            return s.auxiliary
        return s.acceleration + (h / s.h) * (s.auxiliary - s.acceleration)


class QuasiStatic(_Scheme):
    """Equilibrium without inertia and rates at every time, for loads that grow slowly; time only orders them.

    Parameters
    ----------
    u : fem.Function
        Displacement, the unknown of each step.
    pressure : fem.Function, optional
        Pressure of the mixed form.

    Attributes
    ----------
    v, acceleration : UFL expressions
        Zero.
    """

    def __init__(self, u: fem.Function, pressure: fem.Function | None = None) -> None:
        super().__init__(u, pressure)
        self._nil = fem.Function(u.function_space)
        self.v: Expr = self._nil
        self.acceleration: Expr = self._nil

    @property
    def rates(self) -> tuple[tuple[float, Floats], tuple[float, Floats]]:
        """As of `GeneralizedAlpha`: nil."""
        return (0.0, self._nil.x.array), (0.0, self._nil.x.array)

    @property
    def mean_velocity(self) -> Floats:
        """As of `GeneralizedAlpha`: nil."""
        return np.asarray(self._nil.x.array)

    def begin(self, h: float) -> None:
        """Prepare a step of `h`; the first guess goes on as the last step went."""
        self._h = h
        self.u.x.array[:] = self.state.u + h * self.state.average

    def accept(self, t: float, gammas: tuple[float, ...] = ()) -> None:
        """Make the solved displacement the new state, at time `t`."""
        u = self.u.x.array.copy()
        s = self.state
        self.state = State(t, self._h, u, s.v, s.acceleration, s.auxiliary, (u - s.u) / self._h, self._pressures(), gammas)

    def error(self, before: State) -> Floats:
        """None: an equilibrium does not know how the load came."""
        return np.zeros_like(before.u)
