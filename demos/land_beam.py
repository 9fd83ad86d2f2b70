# SPDX-License-Identifier: MIT
"""A beam of heart muscle bends under a pressure: problem 1 of Land et al. (2015), Proc. R. Soc. A 471: 20150641.

Shows how to give a law of one's own, fibres, a load that follows its surface, and a mesh made in the script. The beam of 10 × 1 × 1 mm is
fixed at x = 0; 4 Pa push on its lower face. The eleven codes of the paper agree on a deformed height of the point (10, 0.5, 1) mm of
4.15 to 4.2 mm.
"""

from dataclasses import dataclass

import numpy as np

import tongue_fenicsx as tf
from tongue_fenicsx.testing import box

import ufl  # isort: skip


@dataclass(frozen=True)
class Guccione:
    """W = C/2 (exp Q − 1), Q = b_f E_ff² + b_t (E_ss² + E_nn² + 2 E_sn²) + 2 b_fs (E_fs² + E_fn²), transversely isotropic about the fibres.

    Any dataclass with these members is a law: its numbers become constants of the form.
    """

    C: float = 2e3
    b_f: float = 8.0
    b_t: float = 2.0
    b_fs: float = 4.0
    nu: float = 0.5
    volumetric: str = "quadratic"

    @property
    def shear_modulus(self) -> float:
        """Of shear across the fibres at rest, in Pa."""
        return self.C * self.b_t / 2

    def isochoric_energy(self, k, p):
        """In J/m³, by invariants of E and the fibre direction f: E_ff = f·Ef, E_fs² + E_fn² = |Ef|² − E_ff², and the rest of E:E."""
        E, f = (k.C - ufl.Identity(3)) / 2, k.fibre
        along = ufl.dot(f, E * f)
        across = ufl.dot(E * f, E * f) - along**2
        plane = ufl.inner(E, E) - along**2 - 2 * across
        Q = p["b_f"] * along**2 + p["b_t"] * plane + 2 * p["b_fs"] * across
        return p["C"] / 2 * (ufl.exp(Q) - 1)


def deformed_height(divisions: tuple[int, int, int]) -> float:
    """Height in mm of the point (10, 0.5, 1) mm under the full pressure, with the beam in so many boxes of six tetrahedra."""
    beam = box((10e-3, 1e-3, 1e-3), divisions, surfaces={"lower": lambda X: X[2] < 1e-9})
    model = tf.Model(
        beam,
        tissue=tf.Tissue(Guccione(), density=1000.0, source="Land et al. 2015"),
        fibre=(1.0, 0.0, 0.0),
        loads={"lower": tf.Pressure([(1.0, 0.0, 4.0)])},
        fixed=["wall"],
        mixed=True,
    )
    stepping = tf.Stepping(step_max=0.1, output_every=1.0, quasi_static=True)
    simulation = tf.Simulation(
        model, probes={"tip": (10e-3, 0.5e-3, 1e-3)}, stepping=stepping, tolerances=tf.Tolerances.of("tight", rtol=1e-6, max_newton=30)
    )
    run = simulation.run({}, t_end=1.0)
    simulation.close()
    return 1.0 + 1e3 * float(run.probes["tip"][-1, 2])


if __name__ == "__main__":
    heights = [deformed_height(divisions) for divisions in ((10, 1, 1), (20, 2, 2), (40, 4, 4))]
    print("deformed height in mm:", ", ".join(f"{height:.3f}" for height in heights))
    assert np.isclose(heights[-1], 4.17, atol=0.03)
