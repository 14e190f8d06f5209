"""Sensors and data acquisition (rig.md 9): steps of the converters, clipping, noise, encoder."""

from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.blocks.adc import counts
from plant_sim.blocks.sensors import Counts, Sensors
from plant_sim.rigs import wet_clutch
from protocols.frames import load_frames

BAR, KELVIN = 1e5, 273.15
SAMPLES = 20_000
# standard deviation of a standard deviation from 20000 samples is 0.5 %; four of them
NOISE_TOLERANCE = 0.02
MEAN_TOLERANCE = 4 / SAMPLES**0.5  # of the noise: four standard deviations of the mean
LSB = {"pressure": 4.8828125e-3, "temperature": 0.09765625, "motor_torque": 0.0244140625, "clutch_torque": 50 / 32768}
NOISE = {"pressure": 5e-3, "temperature": 0.1, "motor_torque": 0.05, "clutch_torque": 0.05}  # rig.md: bar, degC, Nm, Nm
QUIET = {"sensors.pressure_noise": 0.0, "sensors.temperature_noise": 0.0, "sensors.torque_noise": 0.0}
COUNTS_PER_REVOLUTION = 163840


def sensors(seed: int = 1, **changed: float) -> Sensors:
    return Sensors(wet_clutch.nominal().with_values({"sensors." + name: v for name, v in changed.items()}), seed)


def quiet(**changed: float) -> Sensors:
    return Sensors(wet_clutch.nominal().with_values(QUIET | {"sensors." + name: v for name, v in changed.items()}), 1)


def sample(
    source: Sensors, bar: float = 0, degc: float = 0, motor: float = 0, clutch: float = 0, rad: float = 0
) -> Counts:
    return source.sample(bar * BAR, degc + KELVIN, motor, clutch, rad)


def read(source: Sensors, **values: float) -> dict[str, float]:
    """Physical values after conversion, by rig.md's steps."""
    found = sample(source, **values)._asdict()
    return {name: found[name] * LSB[name] for name in LSB}


@given(st.floats(-9.9, 9.9), st.floats(-190, 190), st.floats(-49, 49), st.floats(-49, 49))
def test_a_converter_errs_by_at_most_half_its_step(bar: float, degc: float, motor: float, clutch: float) -> None:
    truth = {"pressure": bar, "temperature": degc, "motor_torque": motor, "clutch_torque": clutch}
    found = read(quiet(), bar=bar, degc=degc, motor=motor, clutch=clutch)
    for name, value in truth.items():
        assert abs(found[name] - value) <= 0.5 * LSB[name] * (1 + 1e-9), name  # 1e-9: rounding of the value itself


def test_steps_are_those_of_rig_md_and_change_in_the_middle() -> None:
    for step in (0, 1, -3, 1000):
        for inside in (-0.4999, 0.0, 0.4999):
            near = (step + inside) * 4.8828125e-3, (step + inside) * 0.09765625, (step + inside) * 0.0244140625
            assert sample(quiet(), *near, (step + inside) * 50 / 32768)[:4] == (step,) * 4
    assert LSB["pressure"] == pytest.approx(4.88e-3, abs=5e-6)


def test_dbc_has_the_same_steps() -> None:
    frames = load_frames()
    scale = {signal.name: float(signal.scale) for signal in frames["ANALOG_SENSORS"].definitions}
    assert scale["CYLINDER_PRESSURE"] == LSB["pressure"]
    assert scale["OIL_TEMPERATURE"] == LSB["temperature"]
    assert scale["MOTOR_TORQUE"] == LSB["motor_torque"]
    assert scale["CLUTCH_TORQUE"] == LSB["clutch_torque"]
    assert float(frames["ENCODER"].definitions[2].scale) == pytest.approx(2 * pi / COUNTS_PER_REVOLUTION, rel=1e-15)


@pytest.mark.parametrize(("sign", "twelve", "sixteen"), [(1, 2047, 32767), (-1, -2048, -32768)])
def test_a_converter_clips_at_its_range(sign: int, twelve: int, sixteen: int) -> None:
    for factor in (1.0, 1.0001, 1.5, 1000.0):
        found = sample(quiet(), 10 * sign * factor, 200 * sign * factor, 50 * sign * factor, 50 * sign * factor)
        assert found[:4] == (twelve, twelve, twelve, sixteen)


def test_noise_has_the_deviation_of_rig_md_and_no_mean() -> None:
    source = sensors(seed=3)
    rows = [read(source, bar=3.4, degc=70.0, motor=10.0, clutch=10.0) for _ in range(SAMPLES)]
    truth = {"pressure": 3.4, "temperature": 70.0, "motor_torque": 10.0, "clutch_torque": 10.0}
    for name, sigma in NOISE.items():
        values = [row[name] for row in rows]
        mean = sum(values) / SAMPLES
        deviation = (sum((value - mean) ** 2 for value in values) / SAMPLES) ** 0.5
        expected = (sigma**2 + LSB[name] ** 2 / 12) ** 0.5  # the converter adds a twelfth of its step squared
        assert deviation == pytest.approx(expected, rel=NOISE_TOLERANCE), name
        assert abs(mean - truth[name]) < MEAN_TOLERANCE * expected, name


def test_channels_have_noise_of_their_own() -> None:
    source = sensors(seed=3)
    rows = [read(source) for _ in range(SAMPLES)]
    for first, second in (
        ("pressure", "temperature"),
        ("motor_torque", "clutch_torque"),
        ("pressure", "clutch_torque"),
    ):
        product = sum(row[first] * row[second] for row in rows) / SAMPLES
        assert abs(product) < 2 * MEAN_TOLERANCE * NOISE[first] * NOISE[second]


def test_noise_is_reproducible_by_its_seed_alone() -> None:
    def series(seed: int) -> list[Counts]:
        source = sensors(seed)
        return [sample(source, bar=3.4, degc=70.0) for _ in range(5000)]  # beyond one block of draws

    assert series(7) == series(7)
    assert series(7) != series(8)


def test_encoder_counts_floor() -> None:
    count = 2 * pi / COUNTS_PER_REVOLUTION
    for angle, expected in ((0.0, 0), (0.5, 0), (0.999, 0), (1.001, 1), (-0.001, -1), (-0.999, -1), (-1.001, -2)):
        assert sample(quiet(), rad=angle * count).encoder == expected, angle
    assert sample(quiet(), rad=2 * pi * 10.0000001).encoder == 10 * COUNTS_PER_REVOLUTION


def test_encoder_wraps_at_32_bit() -> None:
    count = 2 * pi / COUNTS_PER_REVOLUTION
    half = 1 << 31
    for turned, expected in (
        (half - 1, half - 1),
        (half, -half),
        (half + 1, -half + 1),
        (-half, -half),
        (-half - 1, half - 1),
    ):
        assert sample(quiet(), rad=(turned + 0.5) * count).encoder == expected


@given(st.floats(-11, 11), st.integers(4, 16), st.integers(0, 4))
def test_a_coarser_converter_is_left_justified(volts: float, bits: int, spare: int) -> None:
    coarse, field = counts(volts, 10.0, bits, bits), counts(volts, 10.0, bits, bits + spare)
    assert field == coarse * 2**spare
    assert -(2 ** (bits - 1)) <= coarse <= 2 ** (bits - 1) - 1


def test_an_8_bit_pressure_channel_reads_the_same_pressure_in_16_times_larger_steps() -> None:
    coarse = quiet(pressure_bits=8)
    for bar in (0.0, 1.0, 3.4, 9.0, -3.0):
        found = sample(coarse, bar=bar).pressure
        assert found % 16 == 0
        assert abs(found * LSB["pressure"] - bar) <= 8 * LSB["pressure"]


def test_sensors_read_si() -> None:
    found = read(quiet(), bar=3.4, degc=70.0, motor=-12.0, clutch=16.74)
    assert found["pressure"] == pytest.approx(3.4, abs=LSB["pressure"])
    assert found["temperature"] == pytest.approx(70.0, abs=LSB["temperature"])
    assert found["motor_torque"] == pytest.approx(-12.0, abs=LSB["motor_torque"])
    assert found["clutch_torque"] == pytest.approx(16.74, abs=LSB["clutch_torque"])
