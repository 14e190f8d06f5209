"""A sample from its two frames. Each test has the module as argument, so that it can run on mutants (tests/mutation)."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

import rt_controller.law.sample
from protocols.can.frames import load_frames
from protocols.can.words import make_frame_definition, make_frame_layout
from rt_controller.law.slip import observe
from tests.mutation.plain import make_record

ENCODER = load_frames()["ENCODER"]
PERIOD = 2.0**-10  # s
BANDWIDTH = 500.0  # 1/s
SPEED = 8.0  # rad/s: demand
STEP = ENCODER.scale["shaft_angle"]  # rad
COUNT = ENCODER.scale["motor_torque"]  # Nm


@pytest.fixture(scope="module")
def sample() -> ModuleType:
    return rt_controller.law.sample


class Bench:
    """A SAMPLE before its first frame."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module
        self.sample: Any = make_record(module.SAMPLE, tick=-1)
        definition = make_frame_definition(ENCODER)
        self.encoder = make_record(
            make_frame_layout(ENCODER), **{name: definition[name] for name in definition.dtype.names}
        )

    def take(self, tick: int, angle: int = 0, torque: int = 0, analog: bool = True, zero: float = 0.0) -> int:
        """Take a sample of raw values; return its ticks."""
        if analog:
            self.module.take_analog(self.sample, 1000.0 * tick, 300.0 + tick)
        data = ENCODER.pack_raw(0, sample_tick=tick & 0x3FF, shaft_angle=angle, motor_torque=torque)
        word = np.int64(int.from_bytes(data, "little", signed=True))
        return int(self.module.take_encoder(self.sample, word, self.encoder, PERIOD, BANDWIDTH, SPEED, zero))

    @property
    def observed(self) -> tuple[float, float, float]:
        return float(self.sample.angle), float(self.sample.slip), float(self.sample.acceleration)


def test_the_first_sample_begins_at_the_speed_demand(sample: ModuleType) -> None:
    bench = Bench(sample)
    bench.sample.acceleration = 9.0
    assert bench.take(1023, angle=100, torque=40) == 1
    assert (bench.sample.tick, bench.sample.count) == (1023, 100)
    assert bench.observed == (100 * STEP, SPEED, 0.0)
    assert bench.sample.speed == SPEED
    assert (bench.sample.pressure, bench.sample.temperature) == (1023000.0, 1323.0)
    assert bench.sample.motor_torque == 40 * COUNT


def test_the_motor_s_zero_is_taken_off(sample: ModuleType) -> None:
    bench = Bench(sample)
    bench.take(0, torque=40, zero=0.75)
    assert bench.sample.motor_torque == 40 * COUNT - 0.75
    bench.take(1, torque=40, zero=0.75)
    assert bench.sample.motor_stuck == PERIOD


def test_a_sample_of_tick_0_is_followed_by_others(sample: ModuleType) -> None:
    bench = Bench(sample)
    bench.take(0)
    assert bench.take(1) == 1
    assert bench.sample.tick == 1
    assert bench.sample.speed == 0.0


def test_an_encoder_alone_is_no_sample(sample: ModuleType) -> None:
    bench = Bench(sample)
    assert bench.take(5, analog=False) == 0
    assert bench.sample.tick == -1
    bench.take(5, angle=10)
    assert not bench.sample.analog
    assert bench.take(6, angle=20, torque=7, analog=False) == 0
    assert (bench.sample.tick, bench.sample.count, bench.sample.motor_torque) == (5, 10, 0.0)


def test_analog_values_wait_for_the_encoder(sample: ModuleType) -> None:
    bench = Bench(sample)
    sample.take_analog(bench.sample, 2.0e5, 343.0)
    assert bench.sample.analog
    assert (bench.sample.pressure, bench.sample.temperature) == (0.0, 0.0)
    assert (bench.sample.next_pressure, bench.sample.next_temperature) == (2.0e5, 343.0)


def test_ticks_and_counts_are_unwrapped(sample: ModuleType) -> None:
    bench = Bench(sample)
    bench.take(1022, angle=0x1FFF0)
    assert bench.take(1025, angle=0x1FFF0 + 0x20 - 0x40000) == 3
    assert (bench.sample.tick, bench.sample.count) == (1025, 0x1FFF0 + 0x20)
    assert bench.sample.speed == pytest.approx(0x20 * STEP / (3 * PERIOD), rel=1e-12)


def test_the_observer_advances_by_the_ticks(sample: ModuleType) -> None:
    bench = Bench(sample)
    bench.take(4, angle=10)
    before = bench.observed
    assert bench.take(6, angle=50) == 2
    step_function = getattr(observe, "py_func", observe)
    expected = step_function(before, 50 * STEP, 2 * PERIOD, BANDWIDTH)
    assert bench.observed == pytest.approx(expected, rel=1e-12)


def test_a_tick_that_comes_twice_takes_no_time(sample: ModuleType) -> None:
    bench = Bench(sample)
    bench.take(4, angle=10, torque=3)
    bench.take(5, angle=50, torque=3)
    before, speed = bench.observed, float(bench.sample.speed)
    assert bench.take(5, angle=60, torque=3) == 0
    assert (bench.observed, bench.sample.speed, bench.sample.tick) == (before, speed, 5)
    assert bench.sample.motor_stuck == PERIOD
    assert bench.sample.count == 60


def test_a_torque_that_does_not_change_is_stuck(sample: ModuleType) -> None:
    bench = Bench(sample)
    for tick, torque, stuck in ((0, 0, 1), (1, 0, 2), (4, 0, 5), (5, 1, 0), (7, 1, 2), (8, 2, 0)):
        bench.take(tick, torque=torque)
        assert bench.sample.motor_stuck == stuck * PERIOD, tick
        assert bench.sample.motor_torque == torque * COUNT
