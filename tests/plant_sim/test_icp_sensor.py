"""Piezo force sensor and DC restoration of appendix C: exact discretisation, their pair, drift and its zeroing."""

from math import exp, expm1, log
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete, lfilter, lsim

from plant_sim.blocks.adc import counts
from plant_sim.blocks.dc_restoration import DcRestoration
from plant_sim.blocks.icp_sensor import IcpSensor
from protocols.errors import InputError

STEP = 1e-3  # s, the rate of the bench
ROUNDING = 1e-12  # of values of order 1


def make_rough_load(n: int, seed: int = 1) -> np.ndarray:
    """A load with steps, noise and slow parts [N]."""
    draw = np.random.default_rng(seed)
    steps = np.repeat(draw.uniform(-30.0, 30.0, n // 50 + 1), 50)[:n]
    return steps + np.cumsum(draw.standard_normal(n)) * 0.1 + draw.standard_normal(n)


@pytest.mark.parametrize("step", [1e-4, 1e-3, 0.1, 5.0])
def test_the_leak_is_scipys_high_pass_under_a_zero_order_hold(step: float) -> None:
    sensor, force = IcpSensor(time_constant=2.5, limit=1e3), make_rough_load(500)
    numerator, denominator, _ = cont2discrete(([2.5, 0.0], [2.5, 1.0]), step, method="zoh")
    expected = sensor.scale * lfilter(numerator.ravel(), denominator, force)
    assert np.abs(sensor.measure(force, step)[0] - expected).max() < ROUNDING * 10.0


def test_a_constant_load_fades_exponentially_from_its_whole_value() -> None:
    sensor = IcpSensor(time_constant=3.0)
    time = np.arange(10_000) * STEP
    voltage, leaked = sensor.measure(np.full(time.size, 10.0), STEP)
    assert np.abs(voltage - sensor.scale * 10.0 * np.exp(-time / 3.0)).max() < ROUNDING
    assert leaked == pytest.approx(10.0 * (1.0 - exp(-10.0 / 3.0)), rel=ROUNDING)


def test_warming_acts_as_a_load_and_fades_like_one() -> None:
    sensor = IcpSensor(warming_load=2.0)
    idle = np.zeros(300)
    warmed, _ = sensor.measure(idle, 0.01, warming=np.full(300, 5.0))
    assert np.array_equal(warmed, sensor.measure(idle + 10.0, 0.01)[0])


@settings(max_examples=60)
@given(
    force=st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=200),
    step=st.floats(1e-5, 20.0),
    tau=st.floats(0.05, 2000.0),
)
def test_sensor_and_matched_restoration_are_the_identity(force: list[float], step: float, tau: float) -> None:
    sensor = IcpSensor(sensitivity=1.0, gain=1.0, time_constant=tau, limit=1e6)
    load = np.array(force)
    back, _ = DcRestoration(sensor.decay_rate).restore(sensor.measure(load, step)[0], step)
    assert np.abs(back - load).max() <= ROUNDING * max(1.0, np.abs(load).max())


def test_the_pair_holds_dc_for_ten_minutes() -> None:
    sensor, load = IcpSensor(limit=1e3), np.full(600_000, 20.0)
    back, _ = DcRestoration(sensor.decay_rate).restore(sensor.measure(load, STEP)[0], STEP)
    assert np.abs(back / sensor.scale - 20.0).max() < 20.0 * ROUNDING


def test_restoration_is_the_continuous_inverse_filter_on_a_fading_voltage() -> None:
    a, step = 0.4, 0.01
    time = np.arange(1000) * step
    voltage = np.exp(-a * time)
    _, continuous, _ = lsim(
        ([1.0, a], [1.0, 0.0]), voltage, time
    )  # joins the samples by straight lines: error a h^2/12
    assert np.abs(DcRestoration(a).restore(voltage, step)[0] - continuous).max() < (a * step) ** 2 / 6.0


def test_runs_in_pieces_are_the_run_in_one_piece() -> None:
    sensor, force = IcpSensor(), make_rough_load(400)
    filter_ = DcRestoration(0.3)
    whole = sensor.measure(force, STEP)[0]
    first, leaked = sensor.measure(force[:150], STEP)
    second, _ = sensor.measure(force[150:], STEP, leaked=leaked)
    assert np.array_equal(np.concatenate([first, second]), whole)
    head, integral = filter_.restore(whole[:150], STEP)
    tail, _ = filter_.restore(whole[150:], STEP, integral=integral)
    assert np.array_equal(np.concatenate([head, tail]), filter_.restore(whole, STEP)[0])


@pytest.mark.parametrize("offset", [0.5e-3, -0.02])
def test_an_offset_becomes_a_ramp_of_slope_offset_times_a(offset: float) -> None:
    sensor = IcpSensor(offset=offset)
    a, n = sensor.decay_rate, 20_000
    drift, _ = DcRestoration(a).restore(sensor.measure(np.zeros(n), STEP)[0], STEP)
    k = np.arange(n)
    assert np.abs(drift - offset * (1.0 - k * expm1(-a * STEP))).max() < ROUNDING
    slope = (drift[-1] - drift[0]) / ((n - 1) * STEP)
    assert slope == pytest.approx(offset * a, rel=a * STEP)  # the discrete filter integrates 1 - exp(-a h), not a h


def test_zeroing_removes_the_ramp() -> None:
    sensor = IcpSensor(offset=0.02)
    idle, _ = sensor.measure(np.zeros(1000), STEP)
    filter_ = DcRestoration(sensor.decay_rate).with_zero_from(idle)
    load = np.concatenate([np.zeros(1000), np.full(19_000, 5.0)])
    back, _ = filter_.restore(sensor.measure(load, STEP)[0], STEP)
    assert np.abs(back / sensor.scale - load).max() < 1e-10  # 0.02 V of offset cancels to rounding


def test_a_wrong_decay_rate_ends_at_its_ratio_to_the_right_one() -> None:
    sensor = IcpSensor(time_constant=2.0)
    back, _ = DcRestoration(0.55).restore(sensor.measure(np.full(40_000, 10.0), STEP)[0], STEP)
    assert back[0] / sensor.scale == pytest.approx(10.0)
    # final value of (tau s/(tau s + 1)) ((s + a)/s) on a step: a tau
    assert back[-1] / sensor.scale == pytest.approx(10.0 * 0.55 * 2.0, rel=1e-3)


def test_decay_rate_from_the_98_percent_time() -> None:
    filter_ = DcRestoration.from_decay_time(10.0)
    assert filter_.decay_rate == pytest.approx(-log(0.02) / 10.0)
    assert exp(-10.0 * filter_.decay_rate) == pytest.approx(0.02)


@pytest.mark.parametrize("gain", [10.0, 100.0])
def test_a_larger_gain_drifts_less_for_the_same_zero_error(gain: float) -> None:
    sensor = IcpSensor(gain=gain, offset=0.5e-3)
    load = np.full(65_000, 20.0)
    back, _ = DcRestoration(sensor.decay_rate).restore(sensor.measure(load, STEP)[0], STEP)
    drift = (back[-1] - back[0]) / sensor.scale  # N
    assert drift == pytest.approx(0.5e-3 * sensor.decay_rate * 65.0 / sensor.scale, rel=1e-3)


def test_output_saturates_and_what_was_cut_is_lost() -> None:
    sensor = IcpSensor(gain=100.0, limit=10.0)
    load = np.repeat([0.0, 100.0, 0.0], 1000)  # N: 22.5 V asked for
    voltage, _ = sensor.measure(load, STEP)
    assert voltage.max() == 10.0
    back, _ = DcRestoration(sensor.decay_rate).restore(voltage, STEP)
    assert (back[1000:2000] / sensor.scale < 90.0).all()
    assert back[-1] < -0.5


def test_the_converter_turns_a_zero_error_into_whole_steps_and_zeroing_takes_them_off() -> None:
    sensor = IcpSensor(gain=10.0, offset=0.4e-3)  # 1.3 steps of a 16-bit converter
    step_16 = 10.0 / 2**15  # V
    voltage, _ = sensor.measure(np.zeros(60_000), STEP)
    taken = np.array([counts(v, 10.0, 16, 16) for v in voltage]) * step_16
    filter_ = DcRestoration(sensor.decay_rate)
    raw, _ = filter_.restore(taken, STEP)
    assert raw[-1] == pytest.approx(
        step_16 * (1.0 + 60.0 * sensor.decay_rate), rel=1e-3
    )  # 0.4 mV are taken as one step
    assert np.abs(filter_.with_zero_from(taken[:1000]).restore(taken, STEP)[0]).max() == 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gain": 50.0}, "gain is 50; allowed are 1, 10 and 100"),
        ({"time_constant": 0.0}, "time_constant is 0; it must be above 0"),
        ({"sensitivity": float("nan")}, "sensitivity is nan"),
        ({"limit": -1.0}, "limit is -1"),
        ({"offset": float("inf")}, "offset is inf; it must be finite"),
        ({"warming_load": float("nan")}, "warming_load is nan"),
    ],
)
def test_impossible_sensors_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        IcpSensor(**arguments)


def test_impossible_restorations_and_signals_are_refused() -> None:
    with pytest.raises(InputError, match="decay_rate is 0 1/s"):
        DcRestoration(0.0)
    with pytest.raises(InputError, match="zero is nan V"):
        DcRestoration(1.0, float("nan"))
    with pytest.raises(InputError, match="t_98 is -1 s"):
        DcRestoration.from_decay_time(-1.0)
    with pytest.raises(InputError, match="at least one voltage"):
        DcRestoration(1.0).with_zero_from(np.empty(0))
    for step in (0.0, float("nan")):
        with pytest.raises(InputError, match="step is"):
            DcRestoration(1.0).restore(np.zeros(3), step)
        with pytest.raises(InputError, match="step is"):
            IcpSensor().measure(np.zeros(3), step)
    for bad in (np.zeros((2, 2)), np.array([0.0, np.nan])):
        with pytest.raises(InputError, match="must be"):
            IcpSensor().measure(bad, STEP)
        with pytest.raises(InputError, match="vector of finite"):
            DcRestoration(1.0).restore(bad, STEP)
    with pytest.raises(InputError, match=r"warming \(2,\)"):
        IcpSensor().measure(np.zeros(3), STEP, warming=np.zeros(2))


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_start_that_is_not_finite_is_refused(value: float) -> None:
    """It made every later voltage NaN."""
    with pytest.raises(InputError, match=f"leaked is {value:g} N; it must be finite"):
        IcpSensor().measure(np.zeros(3), STEP, leaked=value)
    with pytest.raises(InputError, match=f"integral is {value:g} V; it must be finite"):
        DcRestoration(1.0).restore(np.zeros(3), STEP, value)
