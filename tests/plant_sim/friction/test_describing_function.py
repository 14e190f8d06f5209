"""Friction as a spring and a damper: closed forms, energy, Masing's rule, and limits of the amplitude."""

import numpy as np
import pytest

from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.describing_function import describing_function
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.stribeck import Stribeck
from protocols.errors import InputError
from tests.plant_sim.friction.models import (
    CASES,
    F_S,
    LOAD,
    SLOW,
    SPAN,
    V_S,
    Case,
    K,
    every_model,
    play_position,
    split,
)

FREQUENCY = 2.0  # Hz
ACCURACY = 1e-6  # of sums over 4000 samples of a smooth curve with two kinks
AMPLITUDES = SPAN * np.array([0.2, 0.5, 1.01, 2.0, 10.0, 100.0])


def test_one_element_is_its_closed_form() -> None:
    """Below the break point a spring without loss; above, the describing function of an elastic-plastic element."""
    found = describing_function(MaxwellSlip([K], [F_S]), AMPLITUDES, FREQUENCY)
    theta = np.arccos(np.maximum(1.0 - 2.0 * SPAN / AMPLITUDES, -1.0))
    np.testing.assert_allclose(found.stiffness, K / np.pi * (theta - 0.5 * np.sin(2.0 * theta)), rtol=20.0 * ACCURACY)
    loss = 4.0 * F_S * np.maximum(AMPLITUDES - SPAN, 0.0)
    np.testing.assert_allclose(found.loss, loss, rtol=20.0 * ACCURACY, atol=1e-12 * F_S * SPAN)


@every_model
def test_the_loss_is_the_area_of_the_loop(case: Case) -> None:
    """And by Masing's rule 8 int f - 4 A f(A) of the virgin curve f, in slow motion."""
    amplitude = 1.7 * SPAN
    slow = SLOW / (2.0 * np.pi * amplitude)  # Hz; the highest speed is SLOW
    found = describing_function(case.model, amplitude, slow, LOAD)
    if "masing" in case.fails or case.viscous:
        assert found.loss[0] > 0.0
        return
    x = np.linspace(0.0, amplitude, 4001)
    virgin = play_position(case, x, x[1] / SLOW)
    expected = 8.0 * np.trapezoid(virgin, x) - 4.0 * amplitude * virgin[-1]
    if case.name == "coulomb":
        expected = 4.0 * F_S * amplitude
    assert found.loss[0] == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("name", ["maxwell-slip-4", "gms-4", "xgms-4", "passive-xgms-4", "elasto-plastic", "lugre"])
def test_stiffness_falls_and_loss_grows_with_the_amplitude(name: str) -> None:
    """From a spring towards a slider: what the amplitude does to the responses of sec. 3.10."""
    model = next(case.model for case in CASES if case.name == name)
    found = describing_function(model, AMPLITUDES, 1e-3, LOAD)
    assert np.all(np.diff(found.stiffness) < 0.0)
    assert np.all(np.diff(found.loss) > 0.0)
    assert found.stiffness[0] <= K * (1.0 + ACCURACY)
    assert found.stiffness[-1] < 0.02 * K


def test_gross_sliding_is_the_damper_of_coulomb_friction() -> None:
    """c = 4 F_S/(pi A omega), k = 0."""
    found = describing_function(Coulomb(Stribeck(F_S)), [1e-3, 1e-2], FREQUENCY)
    omega = 2.0 * np.pi * FREQUENCY
    np.testing.assert_allclose(found.damping, 4.0 * F_S / (np.pi * found.amplitude * omega), rtol=1e-3)
    assert np.abs(found.stiffness / (omega * found.damping)).max() < 1e-3
    np.testing.assert_array_equal(found.complex_stiffness, found.stiffness + 1j * omega * found.damping)


def test_a_damper_is_a_damper_at_any_amplitude() -> None:
    """Linear viscous friction of 8 Ns/m adds 8 Ns/m."""
    plain, viscous = (describing_function(Coulomb(Stribeck(F_S, viscous=c)), AMPLITUDES, FREQUENCY) for c in (0.0, 8.0))
    np.testing.assert_allclose(viscous.damping - plain.damping, 8.0, rtol=1e-6)


def test_the_period_is_settled() -> None:
    """Bristles creep from the first stroke for many periods; the result does not depend on where the contact began."""
    model = LuGre(Stribeck(F_S), K)
    found = describing_function(model, 0.05 * SPAN, FREQUENCY)
    position = 0.05 * SPAN * np.sin(2.0 * np.pi * np.arange(400 * 500 + 1) / 500)
    force = model.trace(position, 1.0 / 500 / FREQUENCY).force
    loss = np.trapezoid(force[-501:], position[-501:])
    assert found.loss[0] == pytest.approx(loss, rel=1e-3)


def test_friction_that_does_not_repeat_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bristles need 65 periods at this amplitude; before, the fiftieth was taken without a word."""
    model, amplitude = LuGre(Stribeck(F_S), K), 0.01 * SPAN
    settled = describing_function(model, amplitude, FREQUENCY)
    assert settled.stiffness[0] == pytest.approx(K, rel=1e-2)
    monkeypatch.setattr("plant_sim.friction.describing_function.MOST_PERIODS", 50)
    with pytest.raises(InputError, match="does not repeat after 50 periods"):
        describing_function(model, amplitude, FREQUENCY)


def test_the_rate_counts_for_friction_with_memory_of_time_only() -> None:
    stiffness, weights = split(4)
    model = MaxwellSlip(stiffness, F_S * weights)
    slow, quick = (describing_function(model, AMPLITUDES, f) for f in (1e-3, 1e3))
    np.testing.assert_allclose(slow.stiffness, quick.stiffness, rtol=1e-12)
    np.testing.assert_allclose(slow.loss, quick.loss, rtol=1e-9, atol=1e-20)
    lagging = next(case.model for case in CASES if case.name == "gms-4")
    slow, quick = (describing_function(lagging, 5.0 * SPAN, f, LOAD) for f in (0.01 * V_S / SPAN, 10.0 * V_S / SPAN))
    assert slow.loss[0] > 1.05 * quick.loss[0]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((0.0, 1.0), "least amplitude is 0 m; allowed is a number above 0"),
        (([1.0, -1.0], 1.0), "least amplitude is -1 m"),
        ((float("nan"), 1.0), "amplitude holds nan"),
        ((1.0, 0.0), "frequency is 0 Hz"),
        ((1.0, 1.0, -1.0), "load is -1 N"),
        (([], 1.0), "amplitude has shape (0,)"),
        (("wide", 1.0), "amplitude is 'wide'; allowed are numbers"),
    ],
)
def test_bad_input_is_refused(arguments: tuple, sentence: str) -> None:
    with pytest.raises(InputError) as refused:
        describing_function(MaxwellSlip([1.0], [1.0]), *arguments)
    assert sentence in str(refused.value)
