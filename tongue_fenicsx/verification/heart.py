# SPDX-License-Identifier: MIT
"""A fibrous law under a load that follows its surface: problem 1 of the cardiac mechanics benchmark, against the codes of that paper."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import ufl

from ..core.types import Expr
from ..mechanics.kinematics import Kinematics
from ..mechanics.loads import Pressure
from ..mechanics.model import Model
from ..mechanics.tissue import Tissue
from ..simulation.simulation import Simulation
from ..simulation.stepping import Stepping
from ..solvers.tolerances import Tolerances
from ..testing import Row, box

AGREED = 4.175
"""Deformed height in mm of the point (10, 0.5, 1) mm: middle of what the codes of Land et al. (2015), Proc. R. Soc. A 471: 20150641,
figure 6, agree on, 4.15 to 4.2."""


@dataclass(frozen=True)
class _Guccione:
    """C/2 (exp Q − 1), with Q = b_f E₁₁² + b_t (E₂₂² + E₃₃² + 2 E₂₃²) + 2 b_fs (E₁₂² + E₁₃²), fibres along x."""

    C: float = 2e3
    b_f: float = 8.0
    b_t: float = 2.0
    b_fs: float = 4.0
    nu: float = 0.5
    volumetric: str = "quadratic"

    @property
    def shear_modulus(self) -> float:
        """Across the fibres at rest, in Pa."""
        return self.C * self.b_t / 2

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Expr]) -> Expr:
        """In J/m³."""
        E, p = (k.C - ufl.Identity(3)) / 2, parameters
        transverse = E[1, 1] ** 2 + E[2, 2] ** 2 + 2 * E[1, 2] ** 2
        Q = p["b_f"] * E[0, 0] ** 2 + p["b_t"] * transverse + 2 * p["b_fs"] * (E[0, 1] ** 2 + E[0, 2] ** 2)
        return p["C"] / 2 * (ufl.exp(Q) - 1)


def land(n: int = 3) -> Iterator[Row]:
    """A beam of 10 × 1 × 1 mm, fixed at one end, bends under 4 Pa on its lower face; `n` boxes across."""
    beam = box((10e-3, 1e-3, 1e-3), (10 * n, n, n), surfaces={"lower": lambda X: X[2] < 1e-9})
    tissue = Tissue(_Guccione(), density=1000.0)
    model = Model(beam, tissue, loads={"lower": Pressure([(1.0, 0.0, 4.0)])}, fixed=["wall"], mixed=True)
    stepping = Stepping(step_max=0.1, output_every=1.0, quasi_static=True)
    tight = Tolerances.of("tight", rtol=1e-6, max_newton=30)
    simulation = Simulation(model, {"end": (10e-3, 0.5e-3, 1e-3)}, stepping, tight)
    height = 1 + 1e3 * float(simulation.run({}, t_end=1.0).probes["end"][-1, 2])
    simulation.close()
    yield Row("beam of heart muscle under a following pressure", "Land et al. 2015", abs(height / AGREED - 1), 0.01, f"{height:.3f} mm")
