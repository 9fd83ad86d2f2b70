# SPDX-License-Identifier: MIT
"""Tissue as one value, and a law of one's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import tongue_fenicsx as tf
from tongue_fenicsx.forms.weak_form import WeakForm
from tongue_fenicsx.mechanics.kinematics import Kinematics
from tongue_fenicsx.mechanics.tissue import TISSUES
from tongue_fenicsx.testing import homogeneous, stress_at, with_fibres


@dataclass(frozen=True)
class Own:
    """Neo-Hookean, written in a user's script without anything of the package."""

    stiffness: float
    nu: float = 0.49
    volumetric: str = "quadratic"

    @property
    def shear_modulus(self) -> float:
        return 2 * self.stiffness

    def isochoric_energy(self, k: Kinematics, parameters: Mapping[str, Any]) -> Any:
        return parameters["stiffness"] * (k.I1 - 3)


def test_own_law(block: tf.TongueMesh) -> None:
    """A class that only keeps the protocol gives the stress of the same law in the package."""
    stresses = []
    for law in (Own(300.0), tf.NeoHookean(300.0)):
        weak = WeakForm(tf.Model(block, tf.Tissue(law, 1000.0), fixed=["left"]), [])
        homogeneous(weak, np.array([[1.1, 0.05, 0.0], [0.0, 0.95, 0.02], [0.03, 0.0, 1.02]]))
        stresses.append(stress_at(weak, weak.passive_stress(weak.u)))
    np.testing.assert_allclose(stresses[0], stresses[1], rtol=1e-14)


def test_presets() -> None:
    """What belongs together stands together; the class methods are the registry's."""
    assert tf.Tissue.calka() is TISSUES["calka"]
    living = tf.Tissue.buchaillard()
    assert (living.density, living.damping, living.law) == (1040.0, tf.Rayleigh(40.0, 0.03), tf.Yeoh(1037.0, 486.0))
    assert living.peak_stress["HG"] == 245e3
    assert all(tissue.source for tissue in TISSUES.values())


def test_no_stress_is_not_taken_from_another_tissue(block: tf.TongueMesh) -> None:
    """Tissue without peak stresses stays so."""
    model = tf.Model(with_fibres(block), tf.Tissue(tf.Yeoh(1037.0, 486.0), 1040.0), fixed=["left"])
    with pytest.raises(tf.InputError, match="no peak stress for muscle 'GGP_L'"):
        WeakForm(model, ["GGP_L"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"density": 0.0}, "tissue.density: 0.0 kg/m³; a positive number is expected"),
        ({"peak_stress": {"GGP": -1.0}}, "tissue.peak_stress.GGP: -1.0 Pa; zero or a positive number is expected"),
    ],
)
def test_numbers_out_of_range(change: dict[str, Any], message: str) -> None:
    """Each in one sentence."""
    with pytest.raises(tf.InputError, match=message):
        replace(tf.Tissue.calka(), **change)
