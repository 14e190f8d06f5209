"""Effects in the sensors: each one's law against its closed solution, and each on the rig's own signals."""

from math import log, pi, sqrt

import numpy as np
import pytest

from plant_sim.effects.catalogue import load_effects
from plant_sim.rigs import wet_clutch
from protocols.files.units import BAR
from tests.plant_sim.effects.sensing import CLUTCH, MOTOR, PRESSURE, STEP, TEMPERATURE, Signal, simulate_sensor

KELVIN = 273.15
EXACT = 1e-12  # relative: ten thousand roundings of doubles; measured 3e-13
COARSE = 5e-5  # s: the shortest step of the shipped rates
SENSOR_EFFECTS = [name for name, effect in load_effects().items() if effect.block in ("sensors", "fault")]

CORNER = 200.0  # Hz
LAG = sqrt(2.0) / (2 * pi * CORNER)  # s
FILTER = {"anti_alias_filter.inserted": 1.0, "anti_alias_filter.corner": CORNER}
CHANNELS = {"pressure": PRESSURE, "temperature": TEMPERATURE, "motor_torque": MOTOR, "clutch_torque": CLUTCH}


def make_constant(value: float) -> Signal:
    return lambda time: np.full(time.shape, value)


def make_ramp(start: float, slope: float) -> Signal:
    return lambda time: start + slope * time


def make_sine(hertz: float) -> Signal:
    return lambda time: np.sin(2 * pi * hertz * time)


def compute_amplitude(time: np.ndarray, values: np.ndarray, hertz: float) -> complex:
    """Of the last half, over whole periods, against a sine."""
    periods = int(time[-1] / 2 * hertz)
    n = round(periods / hertz / (time[1] - time[0]))
    return 2j * complex(np.mean(values[-n:] * np.exp(-2j * pi * hertz * time[-n:])))


# --- gains and offsets ------------------------------------------------------------------------------------------------

GAINS = {"pressure_sensor_gain": PRESSURE, "torque_sensor_gain": CLUTCH, "motor_torque_sensor_gain": MOTOR}
OFFSETS = {
    "pressure_sensor_offset": (PRESSURE, BAR),
    "torque_sensor_offset": (CLUTCH, 1.0),
    "motor_torque_sensor_offset": (MOTOR, 1.0),
    "temperature_sensor_offset": (TEMPERATURE, 1.0),
}


@pytest.mark.parametrize("name", GAINS)
def test_a_gain_multiplies_its_channel_alone(name: str) -> None:
    time, shown = simulate_sensor({f"{name}.gain": 1.25}, make_ramp(3.0, 2.0), 0.01)
    for column in range(4):
        gain = 1.25 if column == GAINS[name] else 1.0
        assert np.array_equal(shown[:, column], gain * (3.0 + 2.0 * time)), column


@pytest.mark.parametrize("name", OFFSETS)
def test_an_offset_is_added_to_its_channel_alone(name: str) -> None:
    time, shown = simulate_sensor({f"{name}.offset": 0.75}, make_ramp(3.0, 2.0), 0.01)
    own, unit = OFFSETS[name]
    for column in range(4):
        offset = 0.75 * unit if column == own else 0.0
        assert np.array_equal(shown[:, column], 3.0 + 2.0 * time + offset), column


def test_an_offset_comes_after_the_gain() -> None:
    _, shown = simulate_sensor(
        {"torque_sensor_gain.gain": 2.0, "torque_sensor_offset.offset": 0.5}, make_constant(3.0), 0.0
    )
    assert shown[0, CLUTCH] == 6.5


def test_row_0_of_a_run_shows_gains_and_offsets() -> None:
    changed = {"temperature_sensor_offset.offset": 2.0, "pressure_sensor_offset.offset": 0.5}
    changed |= {"torque_sensor_offset.offset": -1.0, "torque_sensor_gain.gain": 1.1}
    y = wet_clutch.Rig(wet_clutch.load_nominal().with_values(changed)).make_rest_state(20.0, 343.15).read()
    assert (y.sensed_pressure, y.sensed_temperature, y.sensed_clutch_torque) == (0.5 * BAR, 345.15, -1.0)
    assert (y.pressure, y.temperature, y.clutch_torque) == (0.0, 343.15, 0.0)


# --- delays -----------------------------------------------------------------------------------------------------------

DELAYS = {
    "pressure_time_offset.delay": (1e-3, {PRESSURE: 1}),
    "torque_time_offset.delay": (1e-3, {CLUTCH: 1}),
    "sampling_instant.lead": (1e-6, {PRESSURE: 1, TEMPERATURE: 1, MOTOR: 1, CLUTCH: 1}),
    "channel_skew.interval": (1e-6, {PRESSURE: 3, TEMPERATURE: 2, MOTOR: 1}),
}
BOUNDS = {f"{name}.{s.name}": s.bounds[1] for name, effect in load_effects().items() for s in effect.strengths}


@pytest.mark.parametrize("step", [STEP, 1 / 12_000, COARSE])
@pytest.mark.parametrize("share", [1e-3, 0.1, 0.37, 1.0])
@pytest.mark.parametrize("parameter", DELAYS)
def test_a_delay_is_exact_for_ramps_at_any_step(parameter: str, share: float, step: float) -> None:
    unit, times = DELAYS[parameter]
    delay = share * BOUNDS[parameter]
    time, shown = simulate_sensor({parameter: delay}, make_ramp(300.0, 50.0), 0.08, step)
    for column in range(4):
        late = times.get(column, 0) * delay * unit
        begun = time >= late + step  # before that it shows what it was when the run began
        assert shown[begun, column] == pytest.approx(300.0 + 50.0 * (time - late)[begun], rel=EXACT), column


@pytest.mark.parametrize("parameter", DELAYS)
def test_before_the_delay_has_passed_the_first_value_is_shown(parameter: str) -> None:
    unit, times = DELAYS[parameter]
    time, shown = simulate_sensor({parameter: BOUNDS[parameter]}, make_ramp(300.0, 50.0), 0.08)
    for column, factor in times.items():
        late = factor * BOUNDS[parameter] * unit
        first = shown[(time > 0) & (time < late - STEP), column]
        assert np.ptp(first) == 0.0
        assert abs(first[0] - 300.0) <= 50.0 * STEP  # the value of the first step


def test_what_is_younger_than_the_last_mid_step_lies_between_it_and_now() -> None:
    delay = 0.2 * STEP
    time, shown = simulate_sensor({"torque_time_offset.delay": 1e3 * delay}, np.square, 0.01)
    now, mid_step = time[1:] ** 2, (time[1:] - 0.5 * STEP) ** 2
    assert shown[1:, CLUTCH] == pytest.approx(now + 0.4 * (mid_step - now), rel=EXACT)


ADDED = {"pressure": 3.37e-3 + 0.15e-3, "temperature": 0.1e-3, "motor_torque": 0.05e-3, "clutch_torque": 1.21e-3}  # s


@pytest.mark.parametrize("name", CHANNELS)
def test_filter_delay_skew_and_sampling_instant_add_up(name: str) -> None:
    """A filter of second order trails a ramp by sqrt(2)/w."""
    changed = {"pressure_time_offset.delay": 3.37, "torque_time_offset.delay": 1.21, "channel_skew.interval": 50.0}
    time, shown = simulate_sensor(changed | FILTER | {"sampling_instant.lead": 130.0}, make_ramp(300.0, 50.0), 0.1)
    late = LAG + 0.13e-3 + ADDED[name]
    assert time[-1] - (shown[-1, CHANNELS[name]] - 300.0) / 50.0 == pytest.approx(late, abs=1e-3 * STEP)


def test_a_delay_that_grows_shows_what_was_that_long_ago() -> None:
    """Live injection ramps a parameter from sample to sample."""

    def rig(delay: float) -> wet_clutch.Rig:
        nominal = wet_clutch.load_nominal().with_values({"pressure_time_offset.delay": delay})
        return wet_clutch.Rig(nominal, ("pressure_time_offset",))

    prompt = rig(0.0)
    state = fine = prompt.make_rest_state(20.0, 343.15)
    truth, times = [0.0], np.arange(101) * 1e-3
    for delay in 0.1e3 * times[1:]:  # ms: a tenth of the time that has passed
        state = rig(delay).advance(state, 1.4, 20.0, 40.0, 1e-3, 10)
        for _ in range(10):
            fine = prompt.advance(fine, 1.4, 20.0, 40.0, 1e-4, 1)
            truth.append(fine.read().pressure)
        now = state.read()
        expected = np.interp(now.time - 1e-3 * delay, np.arange(len(truth)) * STEP, truth)
        assert now.sensed_pressure == pytest.approx(expected, rel=1e-6, abs=1e-3)  # Pa; times of rows are rounded


@pytest.mark.parametrize(("name", "column"), [("pressure", PRESSURE), ("torque", CLUTCH)])
def test_the_rig_shows_a_channel_as_it_was_three_samples_before(name: str, column: int) -> None:
    rig = wet_clutch.Rig(wet_clutch.load_nominal().with_values({f"{name}_time_offset.delay": 3.0}))
    state, truth, shown = rig.make_rest_state(20.0, 343.15), [], []
    for k in range(400):
        state = rig.advance(state, 1.36 + 0.2 * (k % 50 < 25), 20.0, 40.0, 1e-3, 10)
        y = state.read()
        truth.append((y.pressure, y.temperature, y.motor_torque, y.clutch_torque)[column])
        shown.append((y.sensed_pressure, y.sensed_temperature, y.sensed_motor_torque, y.sensed_clutch_torque)[column])
    late, was = np.array(shown[3:]), np.array(truth[:-3])
    # torque, of two mid-steps: a chord through the jump at the touch, else within the channel's noise of 0.05 Nm
    assert np.abs(late - was).max() <= (0.0 if name == "pressure" else 0.02 * np.ptp(was))
    assert np.abs(late - np.array(truth[3:])).max() > 0.02 * np.ptp(was)  # the truth of now is another


# --- leakage ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [STEP, COARSE])
@pytest.mark.parametrize("rate", [0.05, 0.3912, 10.0])
def test_a_constant_torque_fades_exponentially(rate: float, step: float) -> None:
    time, shown = simulate_sensor({"torque_sensor_leakage.decay_rate": rate}, make_constant(20.0), 0.5, step)
    assert shown[:, CLUTCH] == pytest.approx(20.0 * np.exp(-rate * time), rel=EXACT)


def test_two_percent_are_left_after_t_98() -> None:
    _, shown = simulate_sensor({"torque_sensor_leakage.decay_rate": -log(0.02) / 0.5}, make_constant(20.0), 0.5)
    assert shown[-1, CLUTCH] == pytest.approx(0.4, rel=EXACT)


def test_unloading_after_a_leak_shows_a_torque_of_the_other_sign() -> None:
    """Figs C.5 and C.6: the leak is a high pass."""
    off = 0.25
    time, shown = simulate_sensor({"torque_sensor_leakage.decay_rate": 2.0}, lambda t: 20.0 * (t < off), 0.5)
    after = time > off
    leaked = 20.0 * (1.0 - np.exp(-2.0 * off))
    assert shown[after, CLUTCH] == pytest.approx(-leaked * np.exp(-2.0 * (time[after] - off)), rel=EXACT)


@pytest.mark.parametrize("hertz", [0.2, 2.0])
def test_the_leak_is_a_high_pass_of_first_order(hertz: float) -> None:
    rate = 2 * pi * 0.5
    time, shown = simulate_sensor({"torque_sensor_leakage.decay_rate": rate}, make_sine(hertz), 20.0)
    s = 2j * pi * hertz
    result = compute_amplitude(time, shown[:, CLUTCH], hertz)
    assert abs(result / (s / (s + rate)) - 1) < 1e-7  # measured 2e-8: the load is held over a step


def test_warming_acts_as_a_load_and_leaks_away_too() -> None:
    changed = {"torque_sensor_leakage.decay_rate": 2.0, "torque_sensor_leakage.warming_load": -0.2}
    warming = 3.0  # K, at once
    time, shown = simulate_sensor(changed, make_constant(0.0), 0.5, temperature=lambda t: 343.15 + warming * (t >= 0.1))
    after = time >= 0.1
    begun = STEP * (np.flatnonzero(after)[0] - 1)  # the step at whose end it is warm counts as warm
    assert np.abs(shown[~after, CLUTCH]).max() == 0.0
    assert shown[after, CLUTCH] == pytest.approx(-0.2 * warming * np.exp(-2.0 * (time[after] - begun)), rel=EXACT)


def test_without_a_leak_warming_stays() -> None:
    changed = {"torque_sensor_leakage.warming_load": -0.2}
    time, shown = simulate_sensor(changed, make_constant(5.0), 0.5, temperature=make_ramp(343.15, 4.0))
    assert shown[1:, CLUTCH] == pytest.approx(5.0 - 0.2 * 4.0 * (time[1:] - STEP), rel=EXACT)  # from the first step on


def test_what_the_oil_was_before_the_switching_on_is_no_load() -> None:
    _, shown = simulate_sensor(
        {"torque_sensor_leakage.warming_load": -0.2}, make_constant(5.0), 0.1, temperature=make_constant(400.0)
    )
    assert np.all(shown[:, CLUTCH] == 5.0)


# --- thermal lag ------------------------------------------------------------------------------------------------------


def test_the_probe_follows_a_step_of_the_oil_exponentially() -> None:
    time, shown = simulate_sensor({"temperature_sensor_lag.time": 0.2}, lambda t: 343.15 + 10.0 * (t > 0.1), 0.6)
    after = time > 0.1
    begun = STEP * (np.flatnonzero(after)[0] - 1)
    assert np.all(shown[~after, TEMPERATURE] == 343.15)
    assert shown[after, TEMPERATURE] == pytest.approx(353.15 - 10.0 * np.exp(-(time[after] - begun) / 0.2), rel=EXACT)


def test_the_probe_trails_a_ramp_by_its_time_constant() -> None:
    time, shown = simulate_sensor({"temperature_sensor_lag.time": 0.2}, make_ramp(343.15, 1.0), 4.0)
    assert time[-1] - (shown[-1, TEMPERATURE] - 343.15) == pytest.approx(0.2, abs=STEP)


def test_the_probe_begins_at_the_oils_temperature() -> None:
    _, shown = simulate_sensor({"temperature_sensor_lag.time": 60.0}, make_constant(343.15), 0.1)
    assert np.all(shown[:, TEMPERATURE] == 343.15)


# --- lag of the motor's torque ----------------------------------------------------------------------------------------

MOTOR_LAG = {"motor_torque_sensor_lag.time": 5.0}  # ms


@pytest.mark.parametrize("hertz", [5.0, 50.0, 200.0])
def test_the_motors_torque_lags_as_a_low_pass_of_first_order(hertz: float) -> None:
    time, shown = simulate_sensor(MOTOR_LAG, make_sine(hertz), 0.5, COARSE)
    expected = 1.0 / (1.0 + 2j * pi * hertz * 5e-3)
    allowed = 2 * ((pi * hertz * COARSE) ** 2 / 6 + (COARSE / 5e-3) ** 2 / 12)  # input and decay are held over a step
    assert abs(compute_amplitude(time, shown[:, MOTOR], hertz) / expected - 1) < allowed
    for column in (PRESSURE, TEMPERATURE, CLUTCH):
        assert np.array_equal(shown[:, column], make_sine(hertz)(time))


def test_the_lag_has_settled_when_it_is_switched_on() -> None:
    _, shown = simulate_sensor(MOTOR_LAG, make_constant(30.0), 0.05)
    assert shown[:, MOTOR] == pytest.approx(30.0, rel=EXACT)


# --- anti-alias filter ------------------------------------------------------------------------------------------------

# The filter is exact for an input held over a step; holding delays a sine by nothing, since it is held at mid-step, but
# takes (pi f h)^2 / 6 of its amplitude: 7e-4 at 200 Hz and 0.1 ms. Pressure and temperature are means of two values, another
# (pi f h)^2 / 2. Allowed are twice these.


def compute_butterworth(hertz: float) -> complex:
    s = 1j * hertz / CORNER
    return 1.0 / (s * s + sqrt(2.0) * s + 1.0)


@pytest.mark.parametrize("hertz", [20.0, 200.0, 1000.0])
@pytest.mark.parametrize("name", CHANNELS)
def test_the_filter_is_butterworths_in_amplitude_and_phase(name: str, hertz: float) -> None:
    time, shown = simulate_sensor(FILTER, make_sine(hertz), 0.5, COARSE)
    result = compute_amplitude(time, shown[:, CHANNELS[name]], hertz)
    allowed = 2 * (pi * hertz * COARSE) ** 2 * (1 / 6 + (1 / 2 if name in ("pressure", "temperature") else 0))
    assert abs(result / compute_butterworth(hertz) - 1) < allowed


def test_the_filter_takes_3_db_at_its_corner_and_40_db_a_decade_above() -> None:
    def decibels(hertz: float) -> float:
        time, shown = simulate_sensor(FILTER, make_sine(hertz), 0.5, COARSE)
        return 20 * np.log10(abs(compute_amplitude(time, shown[:, CLUTCH], hertz)))

    assert decibels(CORNER) == pytest.approx(-3.01, abs=0.01)
    assert decibels(1000.0) - decibels(2000.0) == pytest.approx(12.04, abs=0.2)  # an octave; holding takes 0.1 dB more


def test_a_step_through_the_filter_overshoots_by_4_3_percent() -> None:
    _, shown = simulate_sensor(FILTER, lambda t: 1.0 * (t > 0.01), 0.05)
    assert shown[:, CLUTCH].max() == pytest.approx(1.0 + np.exp(-pi), abs=1e-4)  # measured 4e-5
    assert shown[-1, CLUTCH] == pytest.approx(1.0, abs=1e-9)


def test_the_filter_has_settled_when_it_is_switched_on() -> None:
    _, shown = simulate_sensor(FILTER, make_constant(300.0), 0.05)
    assert shown == pytest.approx(300.0, rel=EXACT)


def test_half_a_filter_is_the_mean_of_with_and_without() -> None:
    (time, whole), (_, half) = (
        simulate_sensor(FILTER | {"anti_alias_filter.inserted": share}, lambda t: 1.0 * (t > 0.01), 0.05)
        for share in (1.0, 0.5)
    )
    assert half[:, PRESSURE] == pytest.approx(0.5 * (whole[:, PRESSURE] + (time > 0.01)), abs=EXACT)


@pytest.mark.parametrize("step", [STEP, COARSE, 5e-4])  # 0.5 ms: of the model that the discrepancy search simulates
@pytest.mark.parametrize("name", CHANNELS)
def test_a_ramp_through_the_filter_is_late_by_the_same_time_at_any_step(name: str, step: float) -> None:
    time, shown = simulate_sensor(FILTER, make_ramp(300.0, 50.0), 0.1, step)
    settled = time > 0.05
    assert shown[settled, CHANNELS[name]] == pytest.approx((300.0 + 50.0 * (time - LAG))[settled], rel=EXACT)


# --- every effect in sensors and acquisition --------------------------------------------------------------------------


@pytest.mark.parametrize("name", SENSOR_EFFECTS)
def test_a_sensor_does_not_answer_before_its_signal_changes(name: str) -> None:
    changed = load_effects()[name].list_typical_values()

    def jumping(at: float) -> Signal:
        return lambda time: 300.0 + np.sin(44.0 * time) + (time > at)

    early, late = (simulate_sensor(changed, jumping(at), 0.1)[1] for at in (0.05, 0.06))
    assert np.array_equal(early[:500], late[:500])
