# SPDX-License-Identifier: MIT
"""Gradients of runs: by every level, with one at the start, and by knots; `tongue verify` has their order, on one rank and on two."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import tongue_fenicsx as tf
from tongue_fenicsx.core.types import Floats
from tongue_fenicsx.mechanics.tissue import number_of, with_number
from tongue_fenicsx.simulation.gradient import Gradient
from tongue_fenicsx.testing import box, with_fibres
from tongue_fenicsx.verification.gradient import bar_with

DOWN = {"gravity": (0.0, 0.0, -9.81), "gravity_rise": 0.0}


def sag(t: float, h: float, probes: Mapping[str, Floats]) -> tuple[float, Mapping[str, Floats]]:
    """How far the end is up at the end, in mm."""
    return (1e3 * float(probes["end"][2]), {"end": np.array([0.0, 0.0, 1e3])}) if t > 0.0199 else (0.0, {})


def test_every_level_of_every_step() -> None:
    """Also that at t = 0, which only makes the initial acceleration; by both sides of a muscle that are named once.

    The differences are small, as the run is not smooth in that: at 1e-3 they say 1.6 where the derivative is 0.45, and a step is cut."""
    block = with_fibres(box((0.02, 0.01, 0.01), (3, 2, 2)))
    block.muscles["GGP_R"] = block.muscles["GGP_L"]
    model = tf.Model(block, tf.Tissue.calka(), fixed=["wall"], **DOWN)  # type: ignore[arg-type]
    bar = tf.Simulation(
        model, {"end": (0.02, 0.005, 0.005)}, tf.Stepping(5e-3, output_every=0.02), tf.Tolerances.of("tight", rtol=1e-9, linear=1e-9)
    )
    levels = np.array([0.02, 0.1, 0.15, 0.3, 0.2])

    def course(change: Floats) -> dict[str, tf.Activation]:
        at = levels + change
        return {"GGP": tf.Activation(list(zip([5e-3] * 4, at[:-1], at[1:], strict=True)))}

    found = bar.gradient(sag, course(np.zeros(5)), 0.02)
    np.testing.assert_allclose(found.times, np.linspace(0, 0.02, 5), atol=1e-12)
    np.testing.assert_allclose(found.levels["GGP_L"], found.levels["GGP_R"], rtol=1e-6)
    step = 1e-5
    nearby = [[bar.run(course(sign * step * one), 0.02).probes["end"][-1, 2] for sign in (1, -1)] for one in np.eye(5)]
    expected = [1e3 * (up - down) / (2 * step) for up, down in nearby]
    assert abs(expected[0]) > 1e-3 * max(map(abs, expected))
    np.testing.assert_allclose(found.levels["GGP_L"] + found.levels["GGP_R"], expected, rtol=1e-3, atol=1e-6 * max(map(abs, expected)))


@pytest.mark.slow
@pytest.mark.parametrize("form", [None, "nitsche"])
def test_by_numbers_of_the_tissue(form: str | None) -> None:
    """Of law, compressibility, density, damping and strength, free and on a floor: what runs on both sides of each say."""
    bar = bar_with(form)
    model = bar.model
    courses = {"GGP_L": tf.ramp(0.02, 0.1, 0.5), "VERT_L": tf.ramp(0.01, 0.1, 0.3)}

    def high(t: float, h: float, probes: Mapping[str, Floats]) -> tuple[float, Mapping[str, Floats]]:
        return 1e3 * h * float(probes["end"][2]), {"end": np.array([0.0, 0.0, 1e3 * h])}

    names = ["c10", "c20", "nu", "density", "alpha", "beta", "GGP"]
    found = bar.gradient(high, courses, 0.04, tissue=names)
    assert list(found.tissue) == names
    for name in names:
        value = number_of(model.tissue, name)
        sides = []
        for sign in (1, -1):
            bar.model = replace(model, tissue=with_number(model.tissue, name, value * (1 + sign * 1e-5)))
            sides.append(bar.gradient(high, courses, 0.04).value)
        bar.model = model
        expected = (sides[0] - sides[1]) / (2e-5 * value)
        assert found.tissue[name] == pytest.approx(expected, rel=1e-3), name
    with pytest.raises(tf.InputError, match=r"no number 'young'; it has c10, c20, .*density"):
        bar.gradient(high, courses, 0.04, tissue=["young"])


@pytest.mark.parallel
@pytest.mark.parametrize("form", [None, "nitsche"])
def test_by_what_a_run_begins_with(form: str | None) -> None:
    """Slopes by displacement and velocity at t = 0, which is not rest, are what runs on both sides say; bones hold their nodes."""
    bar, courses = bar_with(form), {"GGP_L": tf.ramp(0.02, 0.1, 0.5), "VERT_L": tf.Activation([(0.05, 0.2, 0.3)])}
    points = bar.run(courses, 5e-3).mesh[0]
    x, y, z = 50 * points.T  # 0 to 1 along the bar
    bent = 1e-4 * np.column_stack([z * x**2, x**2 * y, 2 * x**2])
    swung = 2e-2 * np.column_stack([x, -(x**2), x**2])
    first = tf.Initial(bent, swung)

    def high(t: float, h: float, probes: Mapping[str, Floats]) -> tuple[float, Mapping[str, Floats]]:
        return 1e3 * h * float(probes["end"][2]), {"end": np.array([0.0, 0.0, 1e3 * h])}

    found = bar.gradient(high, courses, 0.03, initial=first)
    by_displacement, by_velocity = found.initial.displacement, found.initial.velocity
    assert by_displacement is not None
    assert by_velocity is not None
    for by, along, more in ((by_displacement, bent, (1, 0)), (by_velocity, swung, (0, 1))):
        nearby = [tf.Initial((1 + step * more[0]) * bent, (1 + step * more[1]) * swung) for step in (1e-4, -1e-4)]
        up, down = (bar.gradient(high, courses, 0.03, initial=initial).value for initial in nearby)
        assert (by * along).sum() == pytest.approx((up - down) / 2e-4, rel=1e-3)
        assert abs(by[x < 1e-9]).max() == 0.0
    assert bar.gradient(high, courses, 0.03).value != pytest.approx(found.value, rel=0.1)
    at_rest = bar.run(courses, 5e-3, initial=tf.Initial())
    assert at_rest.field("displacement")[x > 0.5] == pytest.approx(bar.run(courses, 5e-3).field("displacement")[x > 0.5])
    with pytest.raises(tf.InputError, match=r"initial.velocity: shape \(3, 3\)"):
        bar.run(courses, 0.03, initial=tf.Initial(velocity=np.zeros((3, 3))))
    with pytest.raises(tf.InputError, match="initial: a run in a folder begins at rest"):
        bar.run(courses, 0.03, output="nowhere", initial=first)


def test_by_knots() -> None:
    """Derivatives by the levels of steps are shared among the knots beside them."""
    of_steps = Gradient(0.0, np.array([0.0, 0.1, 0.2, 0.3]), {"GGP_L": np.array([1.0, 2.0, 4.0, 8.0])})
    np.testing.assert_allclose(of_steps.by_knots("GGP_L", np.array([0.0, 0.2])), [1.0 + 1.0, 1.0 + 4.0 + 8.0])


def test_of_equilibria() -> None:
    """Each depends on its own levels only; slopes by a level and by a number of the tissue are what equilibria on both sides say."""
    model = tf.Model(with_fibres(box((0.02, 0.01, 0.01), (3, 2, 2))), tf.Tissue.calka(), fixed=["wall"], **DOWN)  # type: ignore[arg-type]
    stepping = tf.Stepping(5e-3, output_every=0.02, quasi_static=True)
    bar = tf.Simulation(model, {"end": (0.02, 0.005, 0.005)}, stepping, tf.Tolerances.of("tight", rtol=1e-9, linear=1e-9))

    def at(level: float) -> dict[str, tf.Activation]:
        return {"GGP": tf.Activation([(0.01, 0.0, 0.5), (0.01, 0.5, level)])}

    found = bar.gradient(sag, at(0.3), 0.02, tissue=["c10"])
    np.testing.assert_array_equal(found.levels["GGP_L"][:-1], 0.0)
    up, down = (bar.run(at(0.3 + step), 0.02).probes["end"][-1, 2] for step in (1e-4, -1e-4))
    assert found.levels["GGP_L"][-1] == pytest.approx(1e3 * (up - down) / 2e-4, rel=1e-5)
    c10, heights = number_of(model.tissue, "c10"), []
    for share in (1 + 1e-5, 1 - 1e-5):
        bar.model = replace(model, tissue=with_number(model.tissue, "c10", share * c10))
        heights.append(bar.run(at(0.3), 0.02).probes["end"][-1, 2])
    assert found.tissue["c10"] == pytest.approx(1e3 * (heights[0] - heights[1]) / (2e-5 * c10), rel=1e-3)


def test_what_has_no_gradient_yet() -> None:
    """Is said before anything long."""
    model = tf.Model(with_fibres(box((0.02, 0.01, 0.01), (2, 1, 1))), fixed=["wall"], mixed=True, **DOWN)  # type: ignore[arg-type]
    bar = tf.Simulation(model, {"end": (0.02, 0.005, 0.005)}, tf.Stepping(5e-3, output_every=5e-3))
    with pytest.raises(tf.InputError, match=r"gradient: the displacement form"):
        bar.gradient(sag, {"GGP": tf.ramp(0.01, 0.1)}, 5e-3)
