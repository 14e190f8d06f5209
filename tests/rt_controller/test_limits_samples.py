"""The guard: the frames that it checks, and the samples that it accepts. Each test has the module as argument, so that it can
run on mutants (tests/mutation)."""

import random
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from e2e.p05 import e2e_p05_protect

import rt_controller.guard.limits
from protocols.can.two_clutches import OFFSET
from tests.rt_controller.guard_bench import (
    DATABASE,
    ENGAGE,
    IDENTIFIERS,
    NOMINAL,
    STALE,
    Bench,
    Guard,
    decode,
    make_frame,
)


@pytest.fixture(scope="module")
def limits() -> ModuleType:
    return rt_controller.guard.limits


def test_identifiers_agree_with_the_dbc(limits: ModuleType) -> None:
    for name in ("VALVE_COMMAND", "MOTOR_COMMAND", "ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT"):
        assert getattr(limits, name) == IDENTIFIERS[name]


def test_the_guard_of_a_second_clutch_sees_its_own_frames_and_no_others(limits: ModuleType) -> None:
    guard = Guard(limits, OFFSET)
    command = make_frame("VALVE_COMMAND", 5, OFFSET, VALVE_ENABLE=1, VALVE_VOLTAGE=9000)
    own = IDENTIFIERS["VALVE_COMMAND"] + OFFSET
    for offset, passes in ((0, False), (OFFSET, True)):  # the sample of the other clutch, then its own
        for name in ("ANALOG_SENSORS", "ENCODER"):
            guard.check_inbound(IDENTIFIERS[name] + offset, make_frame(name, 1, offset))
        guard.run_cycle()
        assert bool(decode("VALVE_COMMAND", guard.limit_outbound(own, command), OFFSET)["VALVE_ENABLE"]) is passes


def test_scales_agree_with_the_dbc(limits: ModuleType) -> None:
    def scale(frame_name: str, signal: str) -> float:
        return float(DATABASE.get_message_by_name(frame_name).get_signal_by_name(signal).scale)

    pressure = NOMINAL["pressure_range"] / limits.PRESSURE_COUNTS  # Pa
    assert pytest.approx(scale("ANALOG_SENSORS", "CYLINDER_PRESSURE") * 1e5, rel=1e-12) == pressure
    assert pytest.approx(1 / scale("ANALOG_SENSORS", "OIL_TEMPERATURE"), rel=1e-12) == limits.TEMPERATURE_COUNTS
    assert pytest.approx(1 / scale("ENCODER", "SHAFT_ANGLE"), rel=1e-12) == limits.ANGLE_COUNTS
    assert pytest.approx(1 / scale("VALVE_COMMAND", "VALVE_VOLTAGE"), rel=1e-12) == limits.VALVE_COUNTS
    torque = NOMINAL["motor_range"] / limits.MOTOR_COUNTS
    assert pytest.approx(scale("MOTOR_COMMAND", "TORQUE_LIMIT"), rel=1e-12) == torque


def test_crc_agrees_with_the_e2e_library(limits: ModuleType) -> None:
    generator = random.Random(1)

    for number in (*(1 << bit for bit in range(16)), *(generator.randrange(1 << 16) for _ in range(300))):
        data = bytearray(generator.randbytes(8))
        crc = int(limits.compute_crc16(np.frombuffer(bytes(data), np.uint8), number))
        e2e_p05_protect(data, number, length=8, increment_counter=False)
        assert crc == data[0] + 256 * data[1]


# --- stale sensors ---------------------------------------------------------------------------------------------------


def test_sensors_stale_for_more_than_5_cycles_close_the_valve_and_not_before(limits: ModuleType) -> None:
    for seen in (1, 2, 40):
        bench = Bench(limits)
        for _ in range(seen):
            bench.run_cycle()
        for age in range(1, STALE + 1):
            assert bench.guard.run_cycle() == limits.HEALTHY
            assert bench.guard.age == age
            assert bench.open
        assert bench.guard.run_cycle() == limits.STALE_SENSORS
        assert not bench.open


def test_one_sample_in_time_starts_the_age_again(limits: ModuleType) -> None:
    bench = Bench(limits)
    for _ in range(5):
        bench.run_cycle(ticks=6)
        assert bench.run_silent(STALE) == limits.HEALTHY
    assert bench.run_silent(1) == limits.STALE_SENSORS


def test_periods_slept_through_age_the_sample_by_one_at_most(limits: ModuleType) -> None:
    bench = Bench(limits)
    bench.run_cycle()
    assert bench.guard.run_cycle(30) == limits.HEALTHY, "the machine stood still, sensors and all"
    assert bench.guard.age == 2
    assert bench.run_cycle(ticks=31) == limits.HEALTHY, "their frames were on the way"
    assert bench.guard.age == 0
    for age in (2, 4):  # every other slot
        assert bench.guard.run_cycle(2) == limits.HEALTHY
        assert bench.guard.age == age
    assert bench.guard.run_cycle(1) == limits.HEALTHY
    assert bench.guard.age == STALE
    assert bench.guard.run_cycle(3) == limits.STALE_SENSORS


def test_half_a_sample_is_no_sample(limits: ModuleType) -> None:
    for half in (Bench.send_analog, Bench.send_encoder):
        bench = Bench(limits)
        bench.run_cycle()
        for _ in range(STALE):
            half(bench)
            assert bench.guard.run_cycle() == limits.HEALTHY
        half(bench)
        assert bench.guard.run_cycle() == limits.STALE_SENSORS


def test_before_the_first_sample_nothing_is_called_stale(limits: ModuleType) -> None:
    bench = Bench(limits)
    assert bench.guard.age == 0
    assert bench.run_silent(50) == limits.HEALTHY
    assert bench.guard.age == 50


def _check_ages(bench: Bench, spoil: Any) -> None:
    """Check that six cycles of samples changed by `spoil(name, counter, signals)` count as cycles without a sample."""
    bench.run_cycle()
    for age in range(1, STALE + 2):
        for name, signals in (("ANALOG_SENSORS", {"CYLINDER_PRESSURE": 700}), ("ENCODER", {"SHAFT_ANGLE": 1000})):
            bench.guard.check_inbound(IDENTIFIERS[name], spoil(name, bench.counters[name] + age, signals))
        bench.guard.run_cycle()
        assert bench.guard.age == age


def test_a_sample_with_a_wrong_crc_is_not_fresh(limits: ModuleType) -> None:
    def spoil(name: str, counter: int, signals: dict[str, int]) -> bytes:
        good = make_frame(name, counter, **signals)
        return bytes((good[0] ^ 0x01,)) + good[1:]

    bench = Bench(limits)
    _check_ages(bench, spoil)
    assert bench.guard.finding == limits.STALE_SENSORS


def test_a_sample_with_any_flipped_bit_is_not_fresh(limits: ModuleType) -> None:
    bench = Bench(limits)
    bench.run_cycle()
    analog, encoder = make_frame("ANALOG_SENSORS", 9, CYLINDER_PRESSURE=700), make_frame("ENCODER", 9, SHAFT_ANGLE=1000)
    for bit in range(64):
        for identifier, good in ((0x100, analog), (0x101, encoder)):
            word = int.from_bytes(good, "little") ^ 1 << bit
            bench.guard.check_inbound(identifier, word.to_bytes(8, "little"))
        bench.guard.run_cycle()
        assert bench.guard.age == bit + 1


def test_a_sample_with_a_repeated_counter_is_not_fresh(limits: ModuleType) -> None:
    bench = Bench(limits)
    _check_ages(bench, lambda name, counter, signals: make_frame(name, bench.counters[name], **signals))
    assert bench.guard.finding == limits.STALE_SENSORS
    for _ in range(300):  # a counter that steps is fresh, whatever its value
        bench.send_analog()
        bench.send_encoder()
        bench.guard.run_cycle()
        assert bench.guard.age == 0


def test_up_to_three_frames_may_be_lost_and_an_older_one_is_not_fresh(limits: ModuleType) -> None:
    for step, fresh in ((1, True), (2, True), (4, True), (5, False), (6, False), (128, False), (255, False)):
        bench = Bench(limits)
        for begin in (100, 250, 254):  # also where the counter wraps
            bench.counters["ANALOG_SENSORS"] = bench.counters["ENCODER"] = begin
            bench.run_cycle()
            bench.run_cycle()
            bench.counters["ANALOG_SENSORS"] += step - 1
            bench.counters["ENCODER"] += step - 1
            bench.run_cycle()
            assert (bench.guard.age == 0) is fresh, step
            bench.run_cycle()
            assert bench.guard.age == 0, "compared with the frame before, used or not"


def test_a_frame_under_the_data_id_of_another_is_not_fresh(limits: ModuleType) -> None:
    for name in ("ANALOG_SENSORS", "ENCODER"):
        for other in IDENTIFIERS:
            bench = Bench(limits)
            bench.run_cycle()
            bench.run_cycle()
            bench.send_analog() if name == "ENCODER" else bench.send_encoder()
            bench.guard.check_inbound(IDENTIFIERS[name], make_frame(other, 3))
            bench.guard.run_cycle()
            assert (bench.guard.age == 0) is (other == name)


def test_counters_of_frames_are_kept_apart(limits: ModuleType) -> None:
    bench = Bench(limits)
    for k in range(STALE + 2):
        bench.guard.check_inbound(0x100, make_frame("ANALOG_SENSORS", k))
        bench.guard.check_inbound(0x101, make_frame("ENCODER", k))
        bench.guard.check_inbound(0x180, make_frame("TORQUE_SETPOINT", k, REQUEST=ENGAGE))
        bench.guard.run_cycle()
        assert bench.guard.age == 0


def _make_short_frame(length: int, counter: int) -> bytes:
    """Return the first `length` bytes of a frame that is correct."""
    return make_frame("ENCODER", counter)[:length]


def test_a_frame_too_short_is_no_sample(limits: ModuleType) -> None:
    for half, other in (("ANALOG_SENSORS", Bench.send_encoder), ("ENCODER", Bench.send_analog)):
        for length in range(6):
            bench = Bench(limits)
            bench.run_cycle()
            other(bench)
            bench.guard.check_inbound(IDENTIFIERS[half], _make_short_frame(length, 9))
            bench.guard.run_cycle()
            assert bench.guard.age == 1


def test_an_encoder_frame_of_6_or_7_bytes_is_no_sample(limits: ModuleType) -> None:
    for length in (6, 7):
        bench = Bench(limits)
        bench.run_cycle()
        bench.send_analog()
        bench.guard.check_inbound(IDENTIFIERS["ENCODER"], _make_short_frame(length, 9))
        bench.guard.run_cycle()
        assert bench.guard.age == 1
