"""Data acquisition (docs/rig.md, eq. 9): steps of the converters, clipping, noise, encoder, the valve's converter."""

from math import floor, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.blocks import dac, encoder
from plant_sim.blocks.adc import counts
from plant_sim.node.plant_node import COLUMNS, PlantNode
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.sensors import Counts
from protocols.can.frames import Frame, load_frames
from tests.plant_sim.acquisition import LSB, QUIET, Acquisition

SAMPLES = 20_000
# standard deviation of a standard deviation from 20000 samples is 0.5 %; four of them
NOISE_TOLERANCE = 0.02
MEAN_TOLERANCE = 4 / SAMPLES**0.5  # of the noise: four standard deviations of the mean
NOISE = {
    "pressure": 5e-3,
    "temperature": 0.1,
    "motor_torque": 0.05,
    "clutch_torque": 0.05,
}  # docs/rig.md: bar, degC, Nm, Nm
COUNTS_PER_REVOLUTION = 163840
DAC_STEP = 10.0 / 65536  # V, of the frame
COUNT = 2 * pi / COUNTS_PER_REVOLUTION  # rad
HALF = 1 << 31
FRAMES = load_frames()
ANGLE_BITS = 32  # of the counter in the data acquisition

RIG = Acquisition(QUIET)
RIG.sample()  # compiles: no example of hypothesis shall wait for it


@given(st.floats(-9.9, 9.9), st.floats(-190, 190), st.floats(-49, 49), st.floats(-49, 49))
def test_a_converter_errs_by_at_most_half_its_step(bar: float, degc: float, motor: float, clutch: float) -> None:
    truth = {"pressure": bar, "temperature": degc, "motor_torque": motor, "clutch_torque": clutch}
    result = RIG.read(bar=bar, degc=degc, motor=motor, clutch=clutch)
    for name, value in truth.items():
        assert abs(result[name] - value) <= 0.5 * LSB[name] * (1 + 1e-9), name  # 1e-9: rounding of the value itself


def test_steps_are_those_of_rig_md_and_change_in_the_middle() -> None:
    for step in (0, 1, -3, 1000):
        for inside in (-0.4999, 0.0, 0.4999):
            near = (step + inside) * 4.8828125e-3, (step + inside) * 0.09765625, (step + inside) * 0.0244140625
            assert RIG.sample(*near, (step + inside) * 50 / 32768)[:4] == (step,) * 4
    assert LSB["pressure"] == pytest.approx(4.88e-3, abs=5e-6)


def test_dbc_has_the_same_steps() -> None:
    definitions = [*FRAMES["ANALOG_SENSORS"].definitions, *FRAMES["ENCODER"].definitions]
    scale = {signal.name: float(signal.scale) for signal in definitions}
    assert scale["CYLINDER_PRESSURE"] == LSB["pressure"]
    assert scale["OIL_TEMPERATURE"] == LSB["temperature"]
    assert scale["MOTOR_TORQUE"] == LSB["motor_torque"]
    assert scale["CLUTCH_TORQUE"] == LSB["clutch_torque"]
    assert scale["SHAFT_ANGLE"] == pytest.approx(COUNT, rel=1e-15)


@pytest.mark.parametrize(("sign", "twelve", "sixteen"), [(1, 2047, 32767), (-1, -2048, -32768)])
def test_a_converter_clips_at_its_range(sign: int, twelve: int, sixteen: int) -> None:
    for factor in (1.0, 1.0001, 1.5, 1000.0):
        result = RIG.sample(10 * sign * factor, 200 * sign * factor, 50 * sign * factor, 50 * sign * factor)
        assert result[:4] == (twelve, twelve, twelve, sixteen)


@pytest.mark.parametrize("bits", [12, 16])
def test_a_converter_saturates_at_the_ends_of_twos_complement(bits: int) -> None:
    half, step = 2 ** (bits - 1), 10.0 / 2 ** (bits - 1)
    assert counts(10.0 - 1.5 * step, 10.0, bits, bits) == half - 1 == counts(1e6, 10.0, bits, bits)
    assert counts(10.0 - 1.6 * step, 10.0, bits, bits) == half - 2
    assert counts(-10.0, 10.0, bits, bits) == -half == counts(-1e6, 10.0, bits, bits)
    assert counts(-10.0 + 0.6 * step, 10.0, bits, bits) == -half + 1
    assert counts(0.0, 10.0, bits, bits) == 0


@pytest.mark.parametrize("full", [5.0, 10.0])
def test_counts_scale_with_the_range(full: float) -> None:
    rig = Acquisition(QUIET | {"sensors.input_range": full})
    assert rig.sample(bar=2.5, clutch=12.5)[::3] == (2.5 / full * 2048, 2.5 / full * 32768)


def test_noise_has_the_deviation_of_rig_md_and_no_mean() -> None:
    rig = Acquisition({}, seed=3)
    rows = [rig.read(bar=3.4, degc=70.0, motor=10.0, clutch=10.0) for _ in range(SAMPLES)]
    truth = {"pressure": 3.4, "temperature": 70.0, "motor_torque": 10.0, "clutch_torque": 10.0}
    for name, sigma in NOISE.items():
        values = [row[name] for row in rows]
        mean = sum(values) / SAMPLES
        deviation = (sum((value - mean) ** 2 for value in values) / SAMPLES) ** 0.5
        expected = (sigma**2 + LSB[name] ** 2 / 12) ** 0.5  # the converter adds a twelfth of its step squared
        assert deviation == pytest.approx(expected, rel=NOISE_TOLERANCE), name
        assert abs(mean - truth[name]) < MEAN_TOLERANCE * expected, name


def test_channels_have_noise_of_their_own() -> None:
    rig = Acquisition({}, seed=3)
    rows = [rig.read() for _ in range(SAMPLES)]
    for first, second in (
        ("pressure", "temperature"),
        ("motor_torque", "clutch_torque"),
        ("pressure", "clutch_torque"),
    ):
        product = sum(row[first] * row[second] for row in rows) / SAMPLES
        assert abs(product) < 2 * MEAN_TOLERANCE * NOISE[first] * NOISE[second]


def test_noise_is_reproducible_by_its_seed_alone() -> None:
    def series(seed: int) -> list[Counts]:
        rig = Acquisition({}, seed)
        return [rig.sample(bar=3.4, degc=70.0) for _ in range(5000)]  # beyond one block of draws

    assert series(7) == series(7)
    assert series(7) != series(8)


def test_encoder_counts_floor() -> None:
    for angle, expected in ((0.0, 0), (0.5, 0), (0.999, 0), (1.001, 1), (-0.001, -1), (-0.999, -1), (-1.001, -2)):
        assert RIG.sample(rad=angle * COUNT).encoder == expected, angle
    assert RIG.sample(rad=2 * pi * 10.0000001).encoder == 10 * COUNTS_PER_REVOLUTION


@pytest.mark.parametrize("per_revolution", [1000, COUNTS_PER_REVOLUTION])
def test_encoder_counts_every_edge_of_a_turn_once_in_either_direction(per_revolution: int) -> None:
    edge = 2 * pi / per_revolution
    seen = [
        encoder.counts((k + 0.5) * edge, per_revolution, ANGLE_BITS) for k in range(-per_revolution, per_revolution)
    ]
    steps = COUNTS_PER_REVOLUTION / per_revolution  # the frame counts in the finest encoder's lines
    assert seen == [floor(k * steps) for k in range(-per_revolution, per_revolution)]


WRAPS = [(HALF - 1, HALF - 1), (HALF, -HALF), (HALF + 1, -HALF + 1), (-HALF, -HALF), (-HALF - 1, HALF - 1)]


@pytest.mark.parametrize(("turned", "expected"), WRAPS)
def test_encoder_wraps_at_32_bit(turned: int, expected: int) -> None:
    assert RIG.sample(rad=(turned + 0.5) * COUNT).encoder == expected


@given(st.integers(-(2**40), 2**40), st.integers(-10_000, 10_000))
def test_a_difference_of_counts_is_right_across_a_wrap(turned: int, more: int) -> None:
    first, second = (
        encoder.counts((n + 0.5) * COUNT, COUNTS_PER_REVOLUTION, ANGLE_BITS) for n in (turned, turned + more)
    )
    assert (second - first + HALF) % (2 * HALF) - HALF == more


@given(st.floats(-11, 11), st.integers(4, 16), st.integers(0, 4))
def test_a_coarser_converter_is_left_justified(volts: float, bits: int, spare: int) -> None:
    coarse, field = counts(volts, 10.0, bits, bits), counts(volts, 10.0, bits, bits + spare)
    assert field == coarse * 2**spare
    assert -(2 ** (bits - 1)) <= coarse <= 2 ** (bits - 1) - 1


def test_an_8_bit_pressure_channel_reads_the_same_pressure_in_16_times_larger_steps() -> None:
    coarse = Acquisition(QUIET | {"sensors.pressure_bits": 8})
    for bar in (0.0, 1.0, 3.4, 9.0, -3.0):
        result = coarse.sample(bar=bar).pressure
        assert result % 16 == 0
        assert abs(result * LSB["pressure"] - bar) <= 8 * LSB["pressure"]


def test_a_12_bit_torque_channel_reads_the_same_torque_in_16_times_larger_steps() -> None:
    coarse = Acquisition(QUIET | {"sensors.clutch_torque_bits": 12})
    for torque in (0.0, 1.0, 16.74, 49.0, -12.0):
        result = coarse.sample(clutch=torque).clutch_torque
        assert result % 16 == 0
        assert abs(result * LSB["clutch_torque"] - torque) <= 8 * LSB["clutch_torque"]


def test_sensors_read_si() -> None:
    result = RIG.read(bar=3.4, degc=70.0, motor=-12.0, clutch=16.74)
    assert result["pressure"] == pytest.approx(3.4, abs=LSB["pressure"])
    assert result["temperature"] == pytest.approx(70.0, abs=LSB["temperature"])
    assert result["motor_torque"] == pytest.approx(-12.0, abs=LSB["motor_torque"])
    assert result["clutch_torque"] == pytest.approx(16.74, abs=LSB["clutch_torque"])


@given(st.integers(0, 0xFFFF))
def test_the_valve_converter_gives_a_65536th_of_its_range_a_count(count: int) -> None:
    assert dac.quantise_voltage(count * DAC_STEP, 10.0, 16) == count * 10.0 / 65536
    assert dac.quantise_voltage(count * DAC_STEP, 5.0, 16) == count * 5.0 / 65536


@given(st.integers(0, 0xFFFF), st.integers(4, 16))
def test_a_coarser_valve_converter_drops_the_lowest_bits(count: int, bits: int) -> None:
    step = 10.0 / 2**bits
    result = dac.quantise_voltage(count * DAC_STEP, 10.0, bits)
    assert result / step == int(result / step)
    assert 0.0 <= dac.quantise_voltage(count * DAC_STEP, 10.0, 16) - result < step


@pytest.mark.parametrize(("bits", "full"), [(16, 10.0), (8, 10.0), (16, 5.0)])
def test_the_plant_converts_valve_commands_as_its_parameters_say(bits: int, full: float) -> None:
    command, count = FRAMES["VALVE_COMMAND"], 0x89AB
    parameters = wet_clutch.load_nominal().with_values({"sensors.dac_bits": bits, "sensors.dac_range": full})
    node = PlantNode(parameters=parameters)
    node.step([Frame(command.can_id, command.pack(0, 1, count * command.scale["valve_voltage"], 0))])
    applied = node.make_row()[[column.name for column in COLUMNS].index("valve_voltage_v")]
    assert applied == dac.quantise_voltage(count * DAC_STEP, full, bits)
    assert applied != dac.quantise_voltage(count * DAC_STEP, 10.0, 16) or (bits, full) == (16, 10.0)
