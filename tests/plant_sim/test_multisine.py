"""The multisine excites what it says; its estimate finds a known system, and separates noise from non-linear distortion."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from plant_sim.rigs.multisine import Multisine, compute_coherence, estimate_response
from protocols.errors import InputError

DT = 1e-3  # s
SOURCE = Multisine(np.arange(1, 200), amplitude=0.1, samples=500)
NUMERATOR, DENOMINATOR = [0.0, 0.2, 0.1], [1.0, -1.2, 0.5]
M, P = 4, 10  # realisations and periods of sec. 3.10


def make_excitations(source: Multisine = SOURCE, realisations: int = M, seed: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.array([source.draw_period(random) for _ in range(realisations)])


def filter_period(period: np.ndarray, periods: int = P) -> np.ndarray:
    """Steady answer (periods, samples) of the known system."""
    y = lfilter(NUMERATOR, DENOMINATOR, np.tile(period, periods + 2))
    return y[2 * period.size :].reshape(periods, -1)


def repeat_periods(periods_of: np.ndarray) -> np.ndarray:
    return np.repeat(periods_of[:, None, :], P, axis=1)


def compute_truth() -> np.ndarray:
    return freqz(NUMERATOR, DENOMINATOR, worN=2 * np.pi * SOURCE.lines / SOURCE.samples)[1]


def test_every_line_has_the_amplitude_and_no_other_line_is_there() -> None:
    spectrum = 2.0 * np.abs(np.fft.rfft(make_excitations()[0])) / SOURCE.samples
    np.testing.assert_allclose(spectrum[SOURCE.lines], 0.1, rtol=1e-12)
    others = np.delete(spectrum, SOURCE.lines)
    assert others.max() < 1e-15
    np.testing.assert_allclose(SOURCE.frequency(DT)[[0, -1]], [2.0, 398.0])


def test_realisations_differ_in_phase_only_and_the_seed_repeats_them() -> None:
    first, second = make_excitations()[:2]
    assert np.abs(first - second).max() > 0.1
    np.testing.assert_allclose(np.abs(np.fft.rfft(first)), np.abs(np.fft.rfft(second)), atol=1e-12)
    np.testing.assert_array_equal(make_excitations(), make_excitations())


def test_a_linear_system_without_noise_is_found_exactly() -> None:
    u = make_excitations()
    result = estimate_response(SOURCE, DT, repeat_periods(u), np.array([filter_period(one) for one in u]))
    np.testing.assert_allclose(result.response, compute_truth(), rtol=1e-9)
    assert (result.deviation / np.abs(result.response)).max() < 1e-9


def test_noise_is_told_as_noise_and_its_size_is_right() -> None:
    u = make_excitations(realisations=20)
    sigma = 0.05
    noise = sigma * np.random.default_rng(2).standard_normal((20, P, SOURCE.samples))
    result = estimate_response(SOURCE, DT, repeat_periods(u), np.array([filter_period(one) for one in u]) + noise)
    # a line of white noise has variance sigma^2/N, the input's line is A/2
    expected = sigma / np.sqrt(SOURCE.samples) / (0.5 * SOURCE.amplitude) / np.sqrt(20 * P)
    assert np.sqrt(np.mean(result.noise**2)) == pytest.approx(expected, rel=0.03)
    assert np.sqrt(np.mean(result.deviation**2)) == pytest.approx(expected, rel=0.06)
    errors = np.abs(result.response - compute_truth())
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(expected, rel=0.06)  # measured 2 %


def test_the_coherence_is_one_of_a_linear_system_and_falls_with_noise_as_it_should() -> None:
    inputs = make_excitations(realisations=40)
    outputs = np.array([filter_period(period) for period in inputs])
    np.testing.assert_allclose(compute_coherence(SOURCE, repeat_periods(inputs), outputs), 1.0, atol=1e-12)
    power = 0.5 * (0.1 * np.abs(compute_truth())) ** 2  # of each line of the output
    deviation = 0.3
    noisy = outputs + np.random.default_rng(3).normal(0.0, deviation, outputs.shape)
    expected = power / (power + 2.0 * deviation**2 / SOURCE.samples)  # white noise: its variance is over all lines
    result = compute_coherence(SOURCE, repeat_periods(inputs), noisy)
    assert expected.min() < 0.5 < 0.9 < expected.max()
    np.testing.assert_allclose(result, expected, atol=0.1)


def test_a_cubic_is_told_as_distortion_and_its_gain_is_that_of_a_gaussian_input() -> None:
    lines = np.arange(1, 200)
    u = make_excitations(realisations=40)
    result = estimate_response(SOURCE, DT, repeat_periods(u), repeat_periods(u + 0.5 * u**3))
    power = 0.5 * SOURCE.amplitude**2 * lines.size  # variance of the multisine
    # Bussgang: 1 + 3 c sigma^2 for a Gaussian input; a multisine of 199 lines is one within 1/lines
    assert np.mean(result.response.real) == pytest.approx(1.0 + 3.0 * 0.5 * power, rel=0.01)
    assert result.noise.max() < 1e-12
    assert np.mean(result.distortion) > 0.1


def test_feedback_from_a_noisy_output_biases_the_plain_estimate_and_not_the_one_with_reference() -> None:
    u = make_excitations(realisations=8, seed=3)
    noise = 2.0 * np.random.default_rng(4).standard_normal((8, P, SOURCE.samples))
    gain = 3.0  # system y = gain u + noise under feedback u = r - y
    y = (gain * u[:, None, :] + noise) / (1.0 + gain)
    inputs = u[:, None, :] - y
    plain, with_reference = (
        estimate_response(SOURCE, DT, inputs, y),
        estimate_response(SOURCE, DT, inputs, y, reference=u),
    )
    assert abs(np.mean(with_reference.response) - gain) < 0.35 * abs(np.mean(plain.response) - gain)


@pytest.mark.parametrize(
    ("lines", "samples", "message"),
    [
        (np.arange(0, 10), 100, "run from 0 to 9"),
        (np.arange(1, 51), 100, "run from 1 to 50"),
        (np.array([1.5]), 100, "whole numbers"),
    ],
)
def test_lines_that_a_period_does_not_have_are_refused(lines: np.ndarray, samples: int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Multisine(lines, 1.0, samples)


@pytest.mark.parametrize("samples", [100.0, "a", None])
def test_samples_that_are_no_count_are_refused(samples: object) -> None:
    with pytest.raises(InputError, match=r"samples of a period is .*; allowed is a whole number"):
        Multisine(np.arange(1, 10), 1.0, samples)  # type: ignore[arg-type]


def test_one_realisation_or_a_wrong_shape_is_refused() -> None:
    u = make_excitations()
    with pytest.raises(InputError, match="1 realisations"):
        estimate_response(SOURCE, DT, repeat_periods(u[:1]), repeat_periods(u[:1]))
    with pytest.raises(InputError, match="realisations, periods"):
        estimate_response(SOURCE, DT, u, u)
