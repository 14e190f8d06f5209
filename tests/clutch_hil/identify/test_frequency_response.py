"""Frequency response of the pressure loop: known filters, a rig of the battery, and what runs do not show."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from benchmarks.identification import draw, list_true_values, play
from benchmarks.pressure_loop import find_bandwidth
from clutch_hil.identify.frequency_response import (
    DEMAND,
    HALF_POWER,
    LoopResponse,
    find_fall,
    measure_response,
)

PERIOD = 1e-3  # s
POLE = 0.95  # of the filter that stands for the loop: 3 dB down at 8.2 Hz
CONTACT, MIDDLE, HIGHEST = 2.35, 3.4, 10.0  # bar, bar, V
BANDWIDTH = 0.3  # Hz, of the issue
Columns = dict[str, np.ndarray]


def make_filtered_run(wave: np.ndarray, noise: float, seed: int = 1) -> Columns:
    """A run in which the pressure is the filtered demand, and the torque 14 Nm/bar of it."""
    random = np.random.default_rng(seed)
    n = len(wave)
    answer = lfilter([1.0 - POLE], [1.0, -POLE], wave)
    return {
        "time_s": PERIOD * np.arange(n), DEMAND: MIDDLE + wave,
        "cylinder_pressure_bar": MIDDLE + answer + noise * random.standard_normal(n),
        "clutch_torque_nm": 14.0 * (MIDDLE - CONTACT + answer) + 10.0 * noise * random.standard_normal(n),
        "slip_speed_rad_s": np.full(n, 20.0), "valve_voltage_v": np.full(n, 1.4), "oil_temperature_degc": np.full(n, 70.0),
    }  # fmt: skip


def make_multisine(periods: int, seed: int = 3) -> np.ndarray:
    """Lines of 1 to 25 Hz."""
    time = PERIOD * np.arange(1000)
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 25)
    wave = sum(0.05 * np.sin(2.0 * np.pi * k * time + phase) for k, phase in enumerate(phases, 1))
    return np.tile(np.asarray(wave), periods)


def measure(run: Columns) -> tuple[LoopResponse | None, list[str]]:
    return measure_response({"run": run}, CONTACT, HIGHEST, lambda pressure, slip, celsius: 14.0)


def compute_true_response(frequency: np.ndarray) -> np.ndarray:
    return np.asarray(freqz([1.0 - POLE], [1.0, -POLE], frequency, fs=1.0 / PERIOD)[1])


def test_a_multisine_shows_a_filter_line_by_line() -> None:
    response, sentence = measure(make_filtered_run(make_multisine(9), 1e-4))
    assert response is not None
    assert sentence == []
    assert response.periodic
    assert response.pressure.frequency == pytest.approx(np.arange(1.0, 26.0))
    true = compute_true_response(response.pressure.frequency)
    assert response.pressure.response == pytest.approx(true, rel=2e-3)
    assert response.torque.response == pytest.approx(14.0 * true, rel=5e-3)
    assert response.pressure.phase == pytest.approx(np.degrees(np.unwrap(np.angle(true))), abs=0.2)


def test_set_points_in_steps_of_can_repeat_where_some_samples_are_a_step_off() -> None:
    """A set-point near the middle of two steps is rounded up in one period and down in another."""
    step = 0.005  # bar, of PRESSURE_SETPOINT
    off = np.repeat(np.random.default_rng(5).uniform(-0.1, 0.1, 9), 1000)
    wave = step * np.round(make_multisine(9) / step + off)
    assert 0.02 < np.mean(wave[:-1000] != wave[1000:]) < 0.1
    response, sentence = measure(make_filtered_run(wave, 1e-4))
    assert response is not None
    assert sentence == []
    assert response.periodic
    true = compute_true_response(response.pressure.frequency)
    assert response.pressure.response == pytest.approx(true, rel=2e-3)


def test_periods_that_differ_are_no_periods() -> None:
    wave = make_multisine(9)
    drifting = wave * np.linspace(1.0, 1.3, len(wave))  # by 3.7 % from one period to the next
    response, sentence = measure(make_filtered_run(drifting, 1e-4))
    assert response is not None
    assert not response.periodic
    assert "does not repeat" in sentence[0]


@pytest.mark.parametrize("periodic", [True, False])
def test_bands_of_95_percent_hold_the_truth_in_95_percent(periodic: bool) -> None:
    inside: list[np.ndarray] = []
    for seed in range(40):
        wave = make_multisine(9) if periodic else 0.2 * np.random.default_rng(1000 + seed).standard_normal(20_000)
        response, _ = measure(make_filtered_run(wave, 0.02, seed))
        assert response is not None
        assert response.periodic is periodic
        true = compute_true_response(response.pressure.frequency)
        low, high = response.pressure.decibel_band
        decibel = 20.0 * np.log10(np.abs(true))
        off = np.degrees(np.angle(response.pressure.response / true))
        inside += [(low <= decibel) & (decibel <= high), np.abs(off) <= response.pressure.phase_half]
    assert 0.93 <= np.mean(np.concatenate(inside)) <= 0.98


def test_the_bandwidth_lies_between_lines() -> None:
    fine = np.arange(0.1, 40.0, 0.01)
    true = find_fall(fine, 20.0 * np.log10(np.abs(compute_true_response(fine))))
    coarse = np.arange(1.0, 26.0)
    assert find_fall(coarse, 20.0 * np.log10(np.abs(compute_true_response(coarse)))) == pytest.approx(true, abs=0.01)


def test_a_magnitude_that_does_not_fall_has_no_bandwidth() -> None:
    assert find_fall(np.arange(1.0, 5.0), np.zeros(4)) is None
    assert find_fall(np.arange(1.0, 5.0), np.full(4, 2.0 * HALF_POWER)) is None


@pytest.mark.parametrize("seed", [2, 28])
def test_the_bandwidth_of_a_rig_is_that_of_its_linear_analysis(seed: int) -> None:
    rig = draw(seed)
    runs = {str(k): run.columns for k, run in enumerate(play(rig, seed))}
    response, sentence = measure_response(
        runs, list_true_values(rig)["piston.contact_pressure"], HIGHEST, lambda pressure, slip, celsius: 14.0
    )
    assert response is not None
    assert response.pressure.bandwidth is not None
    assert response.pressure.bandwidth == pytest.approx(find_bandwidth(rig), abs=BANDWIDTH)
    assert response.run == "2"  # the multisine
    assert not any("p_cyl" in text for text in sentence)


def drop_demand(run: Columns) -> Columns:
    return {name: values for name, values in run.items() if name != DEMAND}


QUIET = make_filtered_run(make_multisine(9), 1e-4)
SHORT = {name: values[:2000] for name, values in QUIET.items()}
STILL = make_filtered_run(np.zeros(9000), 1e-4)
OPEN = {**QUIET, "cylinder_pressure_bar": QUIET["cylinder_pressure_bar"] - 2.0}
NOISY = make_filtered_run(0.1 * make_multisine(9), 0.1)
LIMITED = {**QUIET, "valve_voltage_v": np.where(np.arange(9000) % 100 == 0, 0.0, 1.4)}
SLOW = make_filtered_run(0.3 * np.sin(2.0 * np.pi * PERIOD * np.arange(9000)), 1e-4)
RANDOM = make_filtered_run(0.2 * np.random.default_rng(7).standard_normal(9000), 1e-4)
OFF = {**QUIET, "cylinder_pressure_bar": QUIET["cylinder_pressure_bar"] - 0.1}


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (drop_demand(QUIET), "needs the column controller_pressure_demand_bar"),
        (SHORT, "moves for 3 s in contact"),
        (STILL, "moves for 3 s in contact, by 0.01 bar at least"),
        (OPEN, "moves for 3 s in contact"),
        (NOISY, "coherence"),
        (LIMITED, "the valve is at a limit in 1.0%"),
        (SLOW, "does not cross -3 dB from 0.5 to 1.5 Hz"),
        (OFF, "off its demand"),
        (RANDOM, "does not repeat"),
    ],
)
def test_what_the_runs_do_not_show_is_one_sentence(run: Columns, words: str) -> None:
    _, sentence = measure(run)
    assert any(words in text for text in sentence), sentence


def test_the_document_has_the_operating_point() -> None:
    response, _ = measure(QUIET)
    assert response is not None
    document = response.make_document()
    assert document["operating_point"]["pressure_bar"] == pytest.approx(MIDDLE, abs=0.01)
    assert document["p_cyl_over_p_d"]["bandwidth_hz"] == response.pressure.bandwidth
    low, high = document["p_cyl_over_p_d"]["bandwidth_hz_ci95"]
    assert low < document["p_cyl_over_p_d"]["bandwidth_hz"] < high
