"""Effects in the data acquisition: each one's law on counts, and the thesis's DC restoration (appendix C)."""

from functools import cache
from math import log, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.plant_sim.acquisition import LSB, PERIOD, QUIET, Acquisition
from tests.plant_sim.effects.sensing import CLUTCH, STEP, Signal, simulate_sensor

HALF_STEP = 0.5 * (1 + 1e-9)  # of a converter, and the rounding of the value itself
UNIFORM = 1e-3  # relative: 20000 values spread evenly over 20 coarse steps
CHANNELS = ("pressure", "temperature", "motor_torque", "clutch_torque", "encoder")


def make_quiet_rig(changed: dict[str, float]) -> Acquisition:
    return Acquisition(QUIET | changed)


# --- off --------------------------------------------------------------------------------------------------------------

AT_CONVERTER = (
    "sensor_saturation", "coarse_quantisation", "dc_restoration", "encoder_offset", "speed_sensor_offset", "sensor_freeze",
)  # fmt: skip


@cache
def make_odd_rig(also: tuple[str, ...]) -> Acquisition:
    """A rig whose range is no round number of anything."""
    return Acquisition(QUIET | {"sensors.input_range": 7.3}, also=also)


@pytest.mark.parametrize("name", AT_CONVERTER)
@given(st.floats(-12, 12), st.floats(-250, 250), st.floats(-60, 60), st.floats(-60, 60), st.floats(-1e4, 1e4))
def test_an_effect_that_is_off_changes_no_count(
    name: str, bar: float, degc: float, motor: float, clutch: float, rad: float
) -> None:
    assert make_odd_rig((name,)).sample(bar, degc, motor, clutch, rad) == make_odd_rig(()).sample(
        bar, degc, motor, clutch, rad
    )


# --- saturation -------------------------------------------------------------------------------------------------------


@given(st.floats(-9, 9), st.floats(-40, 40))
def test_an_amplifier_ends_at_its_limit_in_both_directions(bar: float, torque: float) -> None:
    result = ended().read(bar=bar, clutch=torque)
    assert abs(result["pressure"] - min(max(bar, -3.3), 3.3)) <= HALF_STEP * LSB["pressure"]  # 1 V/bar
    assert abs(result["clutch_torque"] - min(max(torque, -25.0), 25.0)) <= HALF_STEP * LSB["clutch_torque"]  # 0.2 V/Nm


@cache
def ended() -> Acquisition:
    return make_quiet_rig(
        {"sensor_saturation.pressure_limit": 3.3, "sensor_saturation.torque_limit": 5.0, "sensor_saturation.bend": 0.0}
    )


def test_a_saturated_channel_shows_no_noise() -> None:
    rig = Acquisition({"sensor_saturation.pressure_limit": 3.3, "sensor_saturation.bend": 0.0})
    assert len({rig.sample(bar=3.4).pressure for _ in range(1000)}) == 1
    assert len({rig.sample(bar=3.2).pressure for _ in range(1000)}) > 3


def test_an_amplifier_bends_before_its_limit() -> None:
    rig = make_quiet_rig({"sensor_saturation.pressure_limit": 3.3, "sensor_saturation.bend": 0.1})
    bars = np.linspace(0.0, 6.0, 121)
    shown = np.array([rig.read(bar=bar)["pressure"] for bar in bars])  # 1 V/bar
    expected = bars - 0.1 * np.logaddexp(0.0, (bars - 3.3) / 0.1)  # a smooth minimum of both, written in another way
    assert shown == pytest.approx(np.maximum(expected, 0.0), abs=HALF_STEP * LSB["pressure"])
    assert [rig.read(bar=-bar)["pressure"] for bar in (2.0, 3.3, 5.0)] == pytest.approx(
        [-rig.read(bar=bar)["pressure"] for bar in (2.0, 3.3, 5.0)], abs=LSB["pressure"]
    )


def test_motor_torque_and_temperature_have_amplifiers_of_their_own() -> None:
    result = ended().read(motor=40.0, degc=150.0)
    assert result["motor_torque"] == pytest.approx(40.0, abs=LSB["motor_torque"])
    assert result["temperature"] == pytest.approx(150.0, abs=LSB["temperature"])


# --- quantisation -----------------------------------------------------------------------------------------------------

LOST = {"pressure": ("pressure_bits_lost", "bar"), "clutch_torque": ("torque_bits_lost", "clutch")}


@pytest.mark.parametrize("bits", [4.0, 5.0, 8.0])
@pytest.mark.parametrize("channel", LOST)
def test_the_error_of_quantisation_is_uniform_over_a_step(channel: str, bits: float) -> None:
    parameter, argument = LOST[channel]
    rig, step = make_quiet_rig({f"coarse_quantisation.{parameter}": bits}), LSB[channel] * 2**bits
    low = -10.5 * step if bits < 8.0 else -3.5 * step  # whole steps within the range
    truth = np.linspace(low, -low, 20_000, endpoint=False) + 1e-4 * step
    errors = np.array([rig.read(**{argument: value})[channel] for value in truth]) - truth
    assert np.abs(errors).max() <= HALF_STEP * step
    assert np.sort(errors) / step == pytest.approx(np.linspace(-0.5, 0.5, truth.size), abs=UNIFORM)
    assert errors.std() == pytest.approx(step / 12**0.5, rel=UNIFORM)  # Bennett 1948


@pytest.mark.parametrize("channel", LOST)
def test_lost_bits_read_0(channel: str) -> None:
    parameter, argument = LOST[channel]
    rig = make_quiet_rig({f"coarse_quantisation.{parameter}": 4.0})
    counts = {getattr(rig.sample(**{argument: value}), channel) for value in np.linspace(-9.0, 9.0, 4001)}
    assert {count % 16 for count in counts} == {0}


def test_a_converter_that_truncates_has_no_level_at_0() -> None:
    rig, step = (
        make_quiet_rig({"coarse_quantisation.torque_bits_lost": 8.0, "coarse_quantisation.offset": 0.5}),
        2**8 * LSB["clutch_torque"],
    )
    result = {rig.read(clutch=value)["clutch_torque"] for value in (-0.9 * step, -0.1 * step, 0.1 * step, 0.9 * step)}
    assert sorted(result) == pytest.approx([-0.5 * step, 0.5 * step])


def test_a_fraction_of_a_bit_can_be_lost() -> None:
    rig, step = make_quiet_rig({"coarse_quantisation.pressure_bits_lost": 3.5}), LSB["pressure"] * 2**3.5
    truth = np.linspace(-4.0, 4.0, 4001)
    result = np.array([rig.read(bar=value)["pressure"] for value in truth])
    assert np.abs(result - truth).max() <= HALF_STEP * (step + LSB["pressure"])  # rounded twice
    assert len(set(result)) == 2 * round(4.0 / step) + 1


def test_noise_is_quantised_with_the_signal() -> None:
    """12 bits of 16 keep 0.024 Nm a step, of which noise of 0.05 Nm crosses some; 7 bits keep 0.78 Nm, crossed by none."""
    fine, coarse = (Acquisition({"coarse_quantisation.torque_bits_lost": bits}) for bits in (4.0, 9.0))
    assert len({fine.sample(clutch=10.0).clutch_torque for _ in range(1000)}) > 8
    level = 13 * 512 * LSB["clutch_torque"]
    assert {coarse.sample(clutch=level).clutch_torque for _ in range(1000)} == {13 * 512}


# --- DC restoration ---------------------------------------------------------------------------------------------------

RATE, SECONDS, LOAD = 0.3912, 20.0, 15.0  # 1/s, s, Nm: 98 % of a load has leaked away after 10 s
# A load held from sample to sample is restored exactly: what is left is half a step of the converter.
RESOLVED = HALF_STEP * LSB["clutch_torque"]
# A zero error does not fade within a cycle as the law of the restoration assumes, so its drift is smaller by a h / 2.
HELD = 0.5 * RATE * PERIOD  # relative


def make_constant(value: float) -> Signal:
    return lambda time: np.full(time.shape, value)


WARM = make_constant(343.15)  # K


def sample_torque(
    torque: Signal, rate: float = RATE, warm: Signal = WARM, **changed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times of samples (n,) [s] and the torque (n,) [Nm] an acquisition reports that restores a leaking sensor at `rate`."""
    effects = {name.replace("__", "."): value for name, value in changed.items()}
    time, shown = simulate_sensor(
        {"torque_sensor_leakage.decay_rate": RATE} | effects, torque, SECONDS, temperature=warm
    )
    every = round(PERIOD / STEP)
    rig = make_quiet_rig({"dc_restoration.decay_rate": rate})
    return time[::every], np.array([rig.read(clutch=value)["clutch_torque"] for value in shown[::every, CLUTCH]])


def make_weights(time: np.ndarray) -> np.ndarray:
    """Loads put on and taken off, as in fig C.5."""
    changes = ((1, 5.0), (2, 5.0), (3, 5.0), (8, -5.0), (10, -10.0))  # s, Nm
    return np.sum([change * (time >= at - 1e-9) for at, change in changes], axis=0)


@pytest.mark.parametrize(
    "torque", [make_constant(LOAD), make_constant(-LOAD), make_weights], ids=["constant", "negative", "weights"]
)
def test_restoring_at_the_rate_of_the_leak_gives_back_the_load(torque: Signal) -> None:
    time, result = sample_torque(torque)
    assert np.abs(result - torque(time)).max() <= RESOLVED


def test_a_load_that_changes_within_a_cycle_is_restored_within_the_noise() -> None:
    time, result = sample_torque(lambda t: LOAD * np.sin(2 * pi * t))
    error = np.abs(result - LOAD * np.sin(2 * pi * time)).max()
    assert error <= RESOLVED + 2 * LOAD * HELD  # the integral takes a cycle's first voltage for its mean
    assert error < 0.2 * 0.05  # Nm, of the noise


@pytest.mark.parametrize("k", [0.95, 1.05])
def test_a_rate_that_is_5_percent_wrong_moves_a_load_by_5_percent(k: float) -> None:
    """Appendix C: (s + k a)/s behind s/(s + a) turns a step F into F (k - (k - 1) exp(-a t))."""
    time, result = sample_torque(make_constant(LOAD), rate=k * RATE)
    expected = LOAD * (k - (k - 1.0) * np.exp(-RATE * time))
    assert np.abs(result - expected).max() <= RESOLVED + k * abs(k - 1.0) * LOAD * HELD
    assert result[-1] == pytest.approx(k * LOAD, rel=1e-3)


def test_a_zero_error_drifts_linearly() -> None:
    """Fig C.4: slope a V_0 of the zero error V_0, under load and without."""
    for load in (0.0, LOAD):
        time, result = sample_torque(make_constant(load), torque_sensor_offset__offset=0.5)
        drift = 0.5 * (1.0 + RATE * time)
        assert np.abs(result - load - drift).max() <= RESOLVED + HELD * drift[-1]
        assert np.polyfit(time, result, 1)[0] == pytest.approx(0.5 * RATE, rel=1e-3)


def test_warming_that_the_leak_hides_appears_restored() -> None:
    """Fig C.7: slow warming shows less in the output of the sensor than in the restored torque."""

    def warm(time: np.ndarray) -> np.ndarray:
        return 343.15 + 0.5 * np.maximum(time - 5.0, 0.0)

    time, result = sample_torque(make_constant(LOAD), warm=warm, torque_sensor_leakage__warming_load=-0.2)
    expected = LOAD - 0.2 * (warm(time) - 343.15)
    assert np.abs(result - expected).max() <= RESOLVED + 2 * HELD * 0.2 * 7.5
    _, shown = simulate_sensor({"torque_sensor_leakage.decay_rate": RATE, "torque_sensor_leakage.warming_load": -0.2},
                      make_constant(0.0), SECONDS, temperature=warm)  # fmt: skip
    assert abs(shown[-1, CLUTCH]) < 0.5 * 0.2 * 7.5


def test_what_the_converter_cuts_is_never_restored() -> None:
    """60 Nm are 12 V: until they have faded to 50 Nm, 60 - 50 - 50 ln(60/50) = 0.88 Nm pass by the integral."""
    time, result = sample_torque(lambda t: np.where(t < 15.0, 60.0, 20.0))
    assert np.all(result[time < 0.4] >= 32767 * LSB["clutch_torque"])
    lost = 60.0 - 50.0 - 50.0 * log(60.0 / 50.0)
    assert result[-1] == pytest.approx(20.0 - lost, abs=RESOLVED + 10.0 * HELD)


def test_what_the_amplifier_cuts_is_cut_before_it_is_restored() -> None:
    rig = make_quiet_rig(
        {"dc_restoration.decay_rate": RATE, "sensor_saturation.torque_limit": 2.0, "sensor_saturation.bend": 0.0}
    )
    result = [rig.read(clutch=LOAD)["clutch_torque"] for _ in range(2000)]
    assert result[0] == pytest.approx(10.0, abs=RESOLVED)  # 2 V
    assert result[-1] == pytest.approx(10.0 * (1.0 + RATE * 1.999), rel=HELD, abs=RESOLVED)


def test_without_a_leak_the_restoration_runs_away() -> None:
    rig = make_quiet_rig({"dc_restoration.decay_rate": RATE})
    result = [rig.read(clutch=1.0)["clutch_torque"] for _ in range(5001)]
    assert result[-1] == pytest.approx(1.0 + RATE * 5.0, rel=HELD, abs=RESOLVED)


# --- encoder ----------------------------------------------------------------------------------------------------------

EDGE = 2 * pi / 163840  # rad


@pytest.mark.parametrize("edges", [-100, 1, 7])
def test_an_offset_of_the_encoder_is_so_many_counts(edges: int) -> None:
    turned, plain = make_quiet_rig({"encoder_offset.offset": edges * EDGE}), make_quiet_rig({})
    for angle in ((k + 0.5) * EDGE for k in range(-1000, 1000, 13)):
        assert turned.sample(rad=angle).encoder - plain.sample(rad=angle).encoder == edges


@pytest.mark.parametrize("offset", [0.3, -0.2])
def test_a_zero_error_of_the_speed_turns_the_shown_angle(offset: float) -> None:
    turned = make_quiet_rig({"speed_sensor_offset.offset": offset})
    shown = [turned.sample(rad=0.0).encoder for _ in range(1001)]
    assert (shown[-1] - shown[0]) * EDGE == pytest.approx(offset * 1000 * PERIOD, abs=EDGE)


# --- freeze -----------------------------------------------------------------------------------------------------------


def make_values(k: int) -> dict[str, float]:
    """What a running rig might show at sample k: each channel moves by several steps of its converter."""
    return {
        "bar": 3.0 + 0.02 * k,
        "degc": 70.0 + 0.4 * k,
        "motor": 5.0 + 0.1 * k,
        "clutch": 6.0 + 0.1 * k,
        "rad": 0.02 * k,
    }


@pytest.mark.parametrize("channel", CHANNELS)
def test_a_frozen_channel_is_constant_to_the_count_while_the_others_go_on(channel: str) -> None:
    rig, free = (Acquisition(changed) for changed in ({f"sensor_freeze.{channel}": 1.0}, {}))
    rows = [(rig.sample(**make_values(k))._asdict(), free.sample(**make_values(k))._asdict()) for k in range(50)]
    assert {row[channel] for row, _ in rows} == {rows[0][1][channel]}  # the count of the first sample, with its noise
    for other in set(CHANNELS) - {channel}:
        assert [row[other] for row, _ in rows] == [row[other] for _, row in rows]


@pytest.mark.parametrize("channel", CHANNELS)
def test_a_channel_recovers_when_it_is_switched_off(channel: str) -> None:
    rig, free = (Acquisition(changed) for changed in ({f"sensor_freeze.{channel}": 1.0}, {}))
    rows = []
    for k in range(60):
        if k == 20:
            rig.tune({f"sensor_freeze.{channel}": 0.0})
        if k == 40:
            rig.tune({f"sensor_freeze.{channel}": 1.0})
        rows.append((getattr(rig.sample(**make_values(k)), channel), getattr(free.sample(**make_values(k)), channel)))
    frozen, true = (list(column) for column in zip(*rows, strict=True))
    assert frozen[:20] == true[:1] * 20
    assert frozen[20:40] == true[20:40]
    assert frozen[40:] == true[40:41] * 20  # and freezes anew at what it is then


def test_a_channel_that_freezes_later_keeps_the_sample_before() -> None:
    rig = Acquisition({"sensor_freeze.temperature": 1.0})
    before = [rig.sample(**make_values(k)) for k in range(10)][-1]
    rig.tune({"sensor_freeze.pressure": 1.0})
    assert {rig.sample(**make_values(k)).pressure for k in range(10, 20)} == {before.pressure}


def test_a_frozen_channel_does_not_drift() -> None:
    """Frozen is what the acquisition reports, restored or not."""
    rig = make_quiet_rig({"sensor_freeze.clutch_torque": 1.0, "dc_restoration.decay_rate": RATE})
    assert len({rig.sample(clutch=LOAD).clutch_torque for _ in range(1000)}) == 1
