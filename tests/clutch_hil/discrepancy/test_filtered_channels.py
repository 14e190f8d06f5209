"""Recordings whose channels were filtered, as by every data acquisition with an anti-alias filter."""

from dataclasses import replace
from math import exp

import numpy as np
import pytest
from scipy.signal import butter, lfilter, lfilter_zi

import clutch_hil as ch
from protocols.files.run import Run

PROFILES = ("engagement", "multisine", "stribeck_staircase")
ANALOG = ("cylinder_pressure_bar", "clutch_torque_nm", "motor_torque_nm")
SLIP, MOTOR = "slip_speed_rad_s", "motor_torque_nm"
LAG, TIME_STEP = 5e-3, 1e-3  # s
GAIN = 0.95
NOISE = 0.01  # rad/s
CORNER = 100.0  # Hz
CLOSE = 0.1  # of the corner: 6 % measured, as the noise of the converters is filtered here, too


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    return [ch.simulate(profile=name, seconds=14.0, seed=10 + k) for k, name in enumerate(PROFILES)]


def filter_channels(run: Run, columns: tuple[str, ...]) -> Run:
    """Return a run whose `columns` went through a Butterworth filter of second order."""
    b, a = butter(2, CORNER, fs=1000.0)
    filtered = {c: lfilter(b, a, run[c], zi=lfilter_zi(b, a) * run[c][0])[0] for c in columns}
    return replace(run, columns={**run.columns, **filtered})


def add_noise(run: Run) -> Run:
    noise = NOISE * np.random.default_rng(1).standard_normal(len(run[SLIP]))
    return replace(run, columns={**run.columns, SLIP: run[SLIP] + noise})


@pytest.mark.parametrize("columns", [ANALOG, (*ANALOG, SLIP)])
def test_filtered_channels_are_named_as_such(runs: list[Run], columns: tuple[str, ...]) -> None:
    """Without this effect, a slower valve and an elastic shaft were named together."""
    result = ch.find_discrepancy([filter_channels(add_noise(run), columns) for run in runs]).result
    assert (result.verdict, result.effects) == ("named", ["anti_alias_filter"])
    values = {one.name: one.value for one in result.parameters}
    assert values["anti_alias_filter.corner"] == pytest.approx(CORNER, rel=CLOSE)


def test_the_gain_of_the_motors_torque_is_named(runs: list[Run]) -> None:
    """Without this effect, the gain of the other torque sensor and an asymmetry of the friction were named together."""
    scaled = [replace(run, columns={**run.columns, MOTOR: GAIN * run[MOTOR]}) for run in runs]
    result = ch.find_discrepancy(scaled).result
    assert (result.verdict, result.effects) == ("named", ["motor_torque_sensor_gain"])
    (value,) = (one.value for one in result.parameters)
    assert value == pytest.approx(GAIN, abs=0.005)


def test_a_filter_of_the_motors_torque_alone_is_named(runs: list[Run]) -> None:
    """Without this effect, no candidate explained it. The filter is that of a drive, behind its converters."""
    keep = exp(-TIME_STEP / LAG)
    filtered = [lfilter([1.0 - keep], [1.0, -keep], run[MOTOR], zi=[keep * run[MOTOR][0]])[0] for run in runs]
    pairs = zip(runs, filtered, strict=True)
    result = ch.find_discrepancy([replace(run, columns={**run.columns, MOTOR: y}) for run, y in pairs]).result
    assert (result.verdict, result.effects) == ("named", ["motor_torque_sensor_lag"])
    (value,) = (one.value for one in result.parameters)
    assert value == pytest.approx(1e3 * (LAG - 0.5 * TIME_STEP), rel=0.1)  # a filter of samples is half a sample faster


def test_the_zero_of_the_motors_torque_is_named() -> None:
    """Without this effect, the zero of the other torque sensor and a drag were named together."""
    zero = {"motor_torque_sensor_offset.offset": 0.8}
    runs = [ch.simulate(profile=name, seconds=14.0, seed=10 + k, plant=zero) for k, name in enumerate(PROFILES)]
    result = ch.find_discrepancy(runs).result
    assert (result.verdict, result.effects) == ("named", ["motor_torque_sensor_offset"])
