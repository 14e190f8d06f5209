"""The guard: whether the content of a sensor frame can be believed. Each test has the module as argument, so that it can run
on mutants (tests/mutation)."""

from types import ModuleType

import pytest

import rt_controller.guard.limits
from tests.rt_controller.guard_bench import CONFIRM, IDLE, TEMPERATURE_LIMIT, VALVE_LIMIT, Bench

VACUUM, COLD, STEP = -204, -409, 51  # counts: -1 bar, -40 degC, 5 K
FOLLOWED, FROZEN = 655, 50  # counts of the valve: 0.1 V; samples: 0.05 s at 1 kHz


@pytest.fixture(scope="module")
def limits() -> ModuleType:
    return rt_controller.guard.limits


def test_what_a_sensor_cannot_show_is_found_after_3_samples(limits: ModuleType) -> None:
    for wild in (
        {"pressure": VACUUM - 1}, {"pressure": -2048}, {"temperature": -2048},
        {"temperature": 717 + STEP + 1}, {"temperature": 717 - STEP - 1},
    ):  # fmt: skip
        bench = Bench(limits)
        bench.run_cycle()
        for _ in range(CONFIRM - 1):
            assert bench.run_cycle(**wild) == limits.HEALTHY
        assert bench.run_cycle() == limits.HEALTHY, "two of them are noise"
        for _ in range(CONFIRM - 1):
            assert bench.run_cycle(**wild) == limits.HEALTHY
        assert bench.run_cycle(**wild) == limits.SENSOR_IMPLAUSIBLE, wild
        assert not bench.open
        bench.ask(IDLE)
        assert bench.run_cycle() == limits.SENSOR_IMPLAUSIBLE, "it still stood when idle was asked for"
        bench.ask(IDLE)
        assert bench.run_cycle() == limits.HEALTHY


def test_a_motor_torque_at_an_end_of_its_range_is_found_with_the_next_sample(limits: ModuleType) -> None:
    for torque in (2047, -2048):
        bench = Bench(limits)
        bench.run_cycle()
        for _ in range(CONFIRM):
            assert bench.run_cycle(torque=torque) == limits.HEALTHY
        assert bench.run_cycle() == limits.SENSOR_IMPLAUSIBLE
        bench.run_cycle()
        bench.ask(IDLE)
        assert bench.run_cycle() == limits.HEALTHY


def test_a_temperature_beyond_its_limits_is_not_what_jumps_are_measured_from(limits: ModuleType) -> None:
    for wild in (TEMPERATURE_LIMIT + 1, COLD - 1):
        bench = Bench(limits)
        bench.run_cycle(temperature=wild)
        for _ in range(5):
            assert bench.run_cycle() == limits.HEALTHY
    for last in (TEMPERATURE_LIMIT, COLD):
        bench = Bench(limits)
        bench.run_cycle(temperature=last)
        assert [bench.run_cycle() for _ in range(CONFIRM)][-1] == limits.SENSOR_IMPLAUSIBLE


def test_the_last_values_that_a_sensor_can_show_are_believed(limits: ModuleType) -> None:
    for good in ({"pressure": VACUUM}, {"torque": 2046}, {"torque": -2047}, {"temperature": 717 + STEP},
                 {"temperature": 717 - STEP}):  # fmt: skip
        bench = Bench(limits)
        bench.run_cycle()
        for _ in range(5):
            assert bench.run_cycle(**good) == limits.HEALTHY, good
    for over in (0, 1):
        bench = Bench(limits)  # the first temperature is no jump
        result = [bench.run_cycle(temperature=COLD - over) for _ in range(3)][-1]
        assert result == (limits.SENSOR_IMPLAUSIBLE if over else limits.HEALTHY)


def test_limits_of_whole_counts_are_still_believed(limits: ModuleType) -> None:
    bench = Bench(limits, temperature_low=273.15)  # 0 degC, 0 counts
    assert [bench.run_cycle(temperature=0) for _ in range(5)][-1] == limits.HEALTHY
    assert [bench.run_cycle() for _ in range(CONFIRM)][-1] == limits.SENSOR_IMPLAUSIBLE, "from 0 counts on"
    bench = Bench(limits, temperature=273.15)
    bench.run_cycle(temperature=0)
    assert [bench.run_cycle(temperature=-STEP - 1) for _ in range(CONFIRM)][-1] == limits.SENSOR_IMPLAUSIBLE
    for over in (0, 1):
        bench = Bench(limits, temperature_step=128 / (4096 / 20.0 * 0.05))  # K
        bench.run_cycle()
        result = [bench.run_cycle(temperature=717 + 128 + over) for _ in range(CONFIRM)][-1]
        assert result == (limits.SENSOR_IMPLAUSIBLE if over else limits.HEALTHY)
        bench = Bench(limits, frozen_voltage=0.625)  # V, 4096 counts
        bench.run_cycle(pressure=699)
        bench.run_cycle()
        assert _hold_pressure(bench, 4096 + over, FROZEN) == (limits.SENSOR_FROZEN if over else limits.HEALTHY)


def test_oil_that_warms_by_less_than_a_jump_each_sample_is_believed(limits: ModuleType) -> None:
    bench = Bench(limits)
    for k in range(15):
        assert bench.run_cycle(temperature=717 + k * STEP) == limits.HEALTHY


def test_one_jump_does_not_move_what_jumps_are_measured_from(limits: ModuleType) -> None:
    bench = Bench(limits)
    bench.run_cycle()
    result = [bench.run_cycle(temperature=717 + (STEP + 1) * k) for k in (1, 2, 3)]
    assert result == [limits.HEALTHY, limits.HEALTHY, limits.SENSOR_IMPLAUSIBLE]


def test_another_temperature_is_believed_after_idle(limits: ModuleType) -> None:
    bench = Bench(limits)
    for _ in range(3):
        bench.run_cycle()
    bench.ask(IDLE)
    for _ in range(5):
        assert bench.run_cycle(temperature=300) == limits.HEALTHY
    for _ in range(CONFIRM):
        bench.run_cycle(temperature=500)
    assert bench.guard.finding == limits.SENSOR_IMPLAUSIBLE
    bench.ask(IDLE)
    assert bench.run_cycle(temperature=500) == limits.SENSOR_IMPLAUSIBLE
    bench.ask(IDLE)
    assert bench.run_cycle(temperature=500) == limits.HEALTHY


def _hold_pressure(bench: Bench, sent: int, samples: int, enable: int = 1) -> int:
    """Command the valve, then bring samples of the same pressure; the last finding."""
    bench.command_valve(sent, enable)
    return [bench.run_cycle() for _ in range(samples)][-1]


def test_a_pressure_that_does_not_follow_the_valve_is_found_after_50_samples(limits: ModuleType) -> None:
    for change in (FOLLOWED + 1, -FOLLOWED - 1):
        bench = Bench(limits)
        bench.run_cycle(pressure=699)
        bench.command_valve(9000)
        bench.run_cycle()  # the pressure changes, at 9000
        assert _hold_pressure(bench, 9000 + change, FROZEN - 1) == limits.HEALTHY
        assert bench.run_cycle() == limits.SENSOR_FROZEN
        assert not bench.open
        bench.ask(IDLE)
        assert bench.run_cycle() == limits.SENSOR_FROZEN, "the valve is closed, and the pressure still stands"
        bench.run_cycle(pressure=690)
        bench.ask(IDLE)
        assert bench.run_cycle(pressure=680) == limits.HEALTHY


def test_another_finding_is_not_replaced_where_the_pressure_stands_too(limits: ModuleType) -> None:
    bench = Bench(limits)
    bench.run_cycle(pressure=699)
    bench.command_valve(9000)
    bench.run_cycle()
    for _ in range(CONFIRM):
        bench.run_cycle(temperature=-2048)
    assert _hold_pressure(bench, 0, 2 * FROZEN) == limits.SENSOR_IMPLAUSIBLE


def test_a_pressure_is_not_frozen_where_it_moves_or_nothing_else_is_asked(limits: ModuleType) -> None:
    bench = Bench(limits)
    bench.run_cycle(pressure=699)
    bench.command_valve(9000)
    bench.run_cycle()
    assert _hold_pressure(bench, 9000 + FOLLOWED, 3 * FROZEN) == limits.HEALTHY, "the valve has hardly moved"
    assert _hold_pressure(bench, 9000 + FOLLOWED + 1, FROZEN - 1) == limits.HEALTHY
    assert bench.run_cycle(pressure=701) == limits.HEALTHY, "it moves"
    assert [bench.run_cycle(pressure=701) for _ in range(3 * FROZEN)][-1] == limits.HEALTHY, "held since then"
    assert _hold_pressure(bench, 9000, FROZEN - 2) == limits.HEALTHY
    bench.command_valve(9000 + FOLLOWED + 1)
    assert bench.run_cycle() == limits.HEALTHY
    assert [_hold_pressure(bench, 9000, FROZEN - 2)] == [limits.HEALTHY], "it came back: counted from the beginning"


def test_a_command_that_comes_back_begins_the_count_anew(limits: ModuleType) -> None:
    bench = Bench(limits)
    bench.run_cycle(pressure=699)
    bench.command_valve(9000)
    bench.run_cycle()
    for _ in range(2):
        assert _hold_pressure(bench, 9000 + FOLLOWED + 1, FROZEN - 1) == limits.HEALTHY
        assert _hold_pressure(bench, 9000, 1) == limits.HEALTHY
    assert _hold_pressure(bench, 9000 + FOLLOWED + 1, FROZEN) == limits.SENSOR_FROZEN


def test_the_pressure_follows_what_was_sent_and_not_what_was_asked_for(limits: ModuleType) -> None:
    bench = Bench(limits)
    bench.run_cycle(pressure=699)
    bench.command_valve(VALVE_LIMIT)
    bench.run_cycle()
    assert _hold_pressure(bench, 65535, 3 * FROZEN) == limits.HEALTHY, "lowered to the limit, as before"
    bench = Bench(limits)
    bench.run_cycle(pressure=699)
    bench.command_valve(9000, enable=0)
    bench.run_cycle()
    assert _hold_pressure(bench, 20000, 3 * FROZEN, enable=0) == limits.HEALTHY, "disabled: nothing was sent"
    assert _hold_pressure(bench, FOLLOWED, 3 * FROZEN) == limits.HEALTHY, "from 0 V on"
    assert _hold_pressure(bench, FOLLOWED + 1, FROZEN - 1) == limits.HEALTHY
    assert bench.run_cycle() == limits.SENSOR_FROZEN
