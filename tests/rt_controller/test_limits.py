"""The guard: its findings, and the commands that it passes. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

import ast
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import rt_controller.guard.limits
from tests.rt_controller.guard_bench import (
    CONFIRM,
    DATABASE,
    ENGAGE,
    IDLE,
    MOTOR_LIMIT,
    PRESSURE_LIMIT,
    STALE,
    TEMPERATURE_LIMIT,
    TURN_LIMIT,
    VALVE_LIMIT,
    Bench,
    make_frame,
    protect,
)


@pytest.fixture(scope="module")
def limits() -> ModuleType:
    return rt_controller.guard.limits


def trip(limits: ModuleType) -> Bench:
    """Return the bench of a guard with latched overpressure, after the cause has gone."""
    bench = Bench(limits)
    for _ in range(CONFIRM):
        bench.run_cycle(pressure=1500)
    assert bench.run_cycle() == limits.OVERPRESSURE
    return bench


# --- agreement with the definition of the bus ------------------------------------------------------------------------


def test_findings_are_those_of_controller_status(limits: ModuleType) -> None:
    result = (limits.HEALTHY, limits.STALE_SENSORS, limits.OVERPRESSURE, limits.OVERTEMPERATURE, limits.OVERSPEED)
    assert result == (0, 1, 2, 3, 4)
    assert (limits.SENSOR_IMPLAUSIBLE, limits.SENSOR_FROZEN) == (10, 11)
    names = DATABASE.get_message_by_name("CONTROLLER_STATUS").get_signal_by_name("FAULT").choices
    assert (str(names[10]), str(names[11])) == ("sensor_implausible", "sensor_frozen")


# --- healthy: commands pass untouched --------------------------------------------------------------------------------


def test_healthy_commands_pass_to_the_bit(limits: ModuleType) -> None:
    bench = Bench(limits)
    for k in range(20):
        assert bench.run_cycle() == limits.HEALTHY
        assert bench.guard.age == 0
        valve = make_frame("VALVE_COMMAND", k, VALVE_ENABLE=1, VALVE_VOLTAGE=VALVE_LIMIT - k, SAMPLE_TICK=500 + k)
        motor = make_frame("MOTOR_COMMAND", k, MOTOR_ENABLE=1, SPEED_DEMAND=-20000, TORQUE_LIMIT=MOTOR_LIMIT - k)
        closed = make_frame("VALVE_COMMAND", k, VALVE_ENABLE=0, VALVE_VOLTAGE=0, SAMPLE_TICK=500 + k)
        assert bench.guard.limit_outbound(0x080, valve) == valve
        assert bench.guard.limit_outbound(0x080, closed) == closed
        assert bench.guard.limit_outbound(0x090, motor) == motor
        assert bench.guard.limit_outbound(0x300, b"\xff" * 8) == b"\xff" * 8
    assert (bench.guard.lowered, bench.guard.replaced) == (0, 0)


# --- overpressure, overtemperature, overspeed ------------------------------------------------------------------------


def _check_finding_after_three(limits: ModuleType, finding: int, **wild: int) -> None:
    for good in (0, 3):
        bench = Bench(limits)
        for _ in range(good):
            assert bench.run_cycle() == limits.HEALTHY
        if "turned" in wild and not good:
            bench.run_cycle()  # a speed needs two angles
        for _ in range(CONFIRM - 1):
            assert bench.run_cycle(**wild) == limits.HEALTHY
            assert bench.open
        assert bench.run_cycle(**wild) == finding
        assert not bench.open
    bench = Bench(limits)
    bench.run_cycle()
    for _ in range(5):  # two wild samples and a good one are noise, however often
        for _ in range(CONFIRM - 1):
            bench.run_cycle(**wild)
        assert bench.run_cycle() == limits.HEALTHY


def test_overpressure_is_found_after_3_samples_and_not_after_2(limits: ModuleType) -> None:
    _check_finding_after_three(limits, limits.OVERPRESSURE, pressure=PRESSURE_LIMIT + 1)
    _check_finding_after_three(limits, limits.OVERPRESSURE, pressure=2047)


def test_overtemperature_is_found_after_3_samples_and_not_after_2(limits: ModuleType) -> None:
    _check_finding_after_three(limits, limits.OVERTEMPERATURE, temperature=TEMPERATURE_LIMIT + 1)
    _check_finding_after_three(limits, limits.OVERTEMPERATURE, temperature=2047)


def test_overspeed_is_found_after_3_samples_and_not_after_2(limits: ModuleType) -> None:
    for direction in (1, -1):
        _check_finding_after_three(limits, limits.OVERSPEED, turned=direction * (TURN_LIMIT + 1))
        _check_finding_after_three(limits, limits.OVERSPEED, turned=direction * 100_000)


def test_at_the_limit_nothing_is_found(limits: ModuleType) -> None:
    for direction in (1, -1):
        bench = Bench(limits)
        for _ in range(10):
            turned = direction * TURN_LIMIT
            assert bench.run_cycle(PRESSURE_LIMIT, TEMPERATURE_LIMIT, turned) == limits.HEALTHY


def test_negative_pressure_and_temperature_are_not_too_high(limits: ModuleType) -> None:
    for counts in (-1, -204):
        bench = Bench(limits)
        for _ in range(5):
            assert bench.run_cycle(pressure=counts, temperature=counts) == limits.HEALTHY
    for counts in (-700, -2048):
        bench = Bench(limits)
        assert [bench.run_cycle(counts, counts) for _ in range(5)][-1] == limits.SENSOR_IMPLAUSIBLE


def test_limits_are_resolved_to_a_count(limits: ModuleType) -> None:
    for bar, counts in ((1.0, 204), (4.2, 860), (9.9, 2027)):
        for over in (0, 1):
            bench = Bench(limits, pressure=bar * 1e5, temperature=463.15)
            result = [bench.run_cycle(pressure=counts + over) for _ in range(3)][-1]
            assert result == (limits.OVERPRESSURE if over else limits.HEALTHY)
    for celsius, counts in ((0.0, 0), (40.0, 409), (100.0, 1024), (190.0, 1945)):
        for over in (0, 1):
            bench = Bench(limits, temperature=celsius + 273.15)
            result = [bench.run_cycle(temperature=counts + over) for _ in range(3)][-1]
            assert result == (limits.OVERTEMPERATURE if over else limits.HEALTHY)


def test_speed_is_judged_over_the_ticks_that_have_passed(limits: ModuleType) -> None:
    for ticks, counts in ((2, 1637), (10, 8187), (100, 81878), (160, 131005)):
        for over, direction in ((0, 1), (0, -1), (1, 1), (1, -1)):
            bench = Bench(limits)
            bench.run_cycle()
            result = [bench.run_cycle(turned=direction * (counts + over), ticks=ticks) for _ in range(3)][-1]
            assert result == (limits.OVERSPEED if over else limits.HEALTHY)


def test_a_standing_shaft_has_no_speed_even_where_the_tick_repeats(limits: ModuleType) -> None:
    bench = Bench(limits)
    for _ in range(10):
        assert bench.run_cycle(turned=0, ticks=0) == limits.HEALTHY
    for turned in (1, -1, 1):  # a shaft that turns in no time is not believed
        bench.run_cycle(turned=turned, ticks=0)
    assert bench.guard.finding == limits.OVERSPEED


def test_wrapping_of_encoder_and_tick_is_no_speed(limits: ModuleType) -> None:
    for direction in (1, -1):
        bench = Bench(limits)
        bench.angle, bench.tick = direction * (2**17 - 1200), 0x3FD
        for _ in range(8):
            assert bench.run_cycle(turned=direction * 700) == limits.HEALTHY
        assert bench.tick < 10
        assert abs(bench.angle) > 2**17 - 5000


def test_the_first_angle_is_no_speed(limits: ModuleType) -> None:
    for tick in (0, 1, 7, 1023):
        bench = Bench(limits)
        bench.angle, bench.tick = 100_000, tick - 1
        bench.run_cycle()
        for _ in range(CONFIRM - 1):
            assert bench.run_cycle(turned=5000) == limits.HEALTHY
        assert bench.run_cycle(turned=5000) == limits.OVERSPEED


def test_confirmation_and_age_come_from_the_limits(limits: ModuleType) -> None:
    bench = Bench(limits, confirm_samples=1.0, stale_cycles=2.0)
    bench.run_cycle()
    assert bench.run_silent(2) == limits.HEALTHY
    assert bench.run_silent(1) == limits.STALE_SENSORS
    assert Bench(limits, confirm_samples=1.0).run_cycle(pressure=1025) == limits.OVERPRESSURE


# --- latch -----------------------------------------------------------------------------------------------------------


def test_a_finding_is_latched_until_idle_is_asked(limits: ModuleType) -> None:
    for request in range(ENGAGE, 8):
        bench = trip(limits)
        for _ in range(40):  # all counters
            bench.ask(request)
            assert bench.run_cycle() == limits.OVERPRESSURE
            assert not bench.open
    bench = trip(limits)
    for _ in range(40):  # no request at all
        assert bench.run_cycle() == limits.OVERPRESSURE
    bench.ask(IDLE)
    assert bench.run_cycle() == limits.HEALTHY
    assert bench.open


def test_a_finding_is_not_replaced_by_that_of_silence(limits: ModuleType) -> None:
    assert trip(limits).run_silent(10 * STALE) == limits.OVERPRESSURE


def test_idle_does_not_clear_what_still_stands(limits: ModuleType) -> None:
    for wild in ({"pressure": 1500}, {"temperature": 1800}, {"turned": 2000}):
        bench = Bench(limits)
        bench.run_cycle()
        for _ in range(CONFIRM):
            bench.run_cycle(**wild)
        for _ in range(10):
            bench.ask(IDLE)
            assert bench.run_cycle(**wild) != limits.HEALTHY
        assert bench.run_cycle() != limits.HEALTHY
        bench.ask(IDLE)
        assert bench.run_cycle() == limits.HEALTHY


def test_idle_does_not_clear_stale_sensors_before_a_sample_has_come(limits: ModuleType) -> None:
    bench = Bench(limits)
    bench.run_cycle()
    bench.run_silent(STALE + 1)
    for _ in range(3):
        bench.ask(IDLE)
        assert bench.guard.run_cycle() == limits.STALE_SENSORS
    assert bench.run_cycle(ticks=9) == limits.STALE_SENSORS
    bench.guard.run_cycle()  # the sample is one cycle old
    bench.ask(IDLE)
    assert bench.guard.finding == limits.STALE_SENSORS
    bench.run_cycle(ticks=2)
    bench.ask(IDLE)
    assert bench.guard.finding == limits.HEALTHY


def test_only_a_believable_request_clears(limits: ModuleType) -> None:
    idle = make_frame("TORQUE_SETPOINT", 3, REQUEST=IDLE)
    bench = trip(limits)
    bench.guard.check_inbound(0x180, bytes((idle[0] ^ 0xFF,)) + idle[1:])
    for other in (0x300, 0x090, 0x700):  # other frames with the same bits
        bench.guard.check_inbound(other, idle)
        bench.guard.check_inbound(other, protect(idle, 0xC000 + other))
    assert bench.guard.finding == limits.OVERPRESSURE
    bench.guard.check_inbound(0x180, make_frame("TORQUE_SETPOINT", 4, REQUEST=ENGAGE))
    bench.guard.check_inbound(0x180, make_frame("TORQUE_SETPOINT", 4, REQUEST=IDLE))  # a stuck counter
    assert bench.guard.finding == limits.OVERPRESSURE
    bench.guard.check_inbound(0x180, idle)  # an older one
    assert bench.guard.finding == limits.OVERPRESSURE
    bench.guard.check_inbound(0x180, make_frame("TORQUE_SETPOINT", 4, REQUEST=IDLE))
    assert bench.guard.finding == limits.HEALTHY


# --- commands --------------------------------------------------------------------------------------------------------


def test_the_valve_command_is_never_above_its_limit(limits: ModuleType) -> None:
    for volts, highest in ((4.0, VALVE_LIMIT), (0.1, 655), (9.9998, 65534)):
        bench = Bench(limits, voltage=volts)
        bench.run_cycle()
        for lowered, counts in enumerate((highest + 1, min(highest + 256, 65535), 65535), start=1):
            result = bench.command_valve(counts, counter=lowered, tick=500 + lowered)
            expected = {"VALVE_VOLTAGE": highest, "VALVE_ENABLE": 1, "COUNTER": lowered, "SAMPLE_TICK": 500 + lowered}
            assert result.items() >= expected.items()
            assert bench.guard.lowered == lowered
        assert bench.command_valve(highest)["VALVE_VOLTAGE"] == highest
        assert (bench.guard.lowered, bench.guard.replaced) == (3, 0)


def test_the_motor_torque_is_never_above_its_limit(limits: ModuleType) -> None:
    for newton_metre, highest in ((40.0, MOTOR_LIMIT), (0.5, 500), (65.0, 65000)):
        bench = Bench(limits, motor_torque=newton_metre)
        bench.run_cycle()
        for lowered, counts in enumerate((highest + 1, highest + 256, 65535), start=1):
            for_speed = -20000 + 7 * lowered
            result = bench.command_motor(for_speed, counts, counter=lowered)
            expected = {"TORQUE_LIMIT": highest, "MOTOR_ENABLE": 1, "COUNTER": lowered, "SPEED_DEMAND": for_speed}
            assert result.items() >= expected.items()
            assert bench.guard.lowered == lowered
        assert bench.command_motor(torque=highest)["TORQUE_LIMIT"] == highest
        assert (bench.guard.lowered, bench.guard.replaced) == (3, 0)


def test_a_finding_closes_the_valve_and_stops_the_motor_keeping_counter_and_tick(limits: ModuleType) -> None:
    bench = trip(limits)
    for replaced, counter in enumerate(range(16), start=1):
        result = bench.command_valve(9000 + counter, counter=counter, tick=400 + counter)
        del result["CRC"]
        assert result == {"COUNTER": counter, "VALVE_ENABLE": 0, "VALVE_VOLTAGE": 0, "SAMPLE_TICK": 400 + counter}
        result = bench.command_motor(-20000, 30000, counter=counter, tick=40 + counter)
        del result["CRC"]
        kept = {"COUNTER": counter, "SAMPLE_TICK": 40 + counter}
        assert result == kept | {"MOTOR_ENABLE": 0, "SPEED_DEMAND": 0, "TORQUE_LIMIT": 0}
        assert bench.guard.replaced == 2 * replaced
    assert bench.guard.lowered == 0


def test_a_voltage_without_enable_is_taken_away(limits: ModuleType) -> None:
    for counter in range(16):
        bench = Bench(limits)
        bench.run_cycle()
        for counts in (1, 256, 9000, 65535):
            result = bench.command_valve(counts, enable=0, counter=counter)
            assert (result["VALVE_ENABLE"], result["VALVE_VOLTAGE"], result["COUNTER"]) == (0, 0, counter)
        assert bench.guard.replaced == 4
        bench.command_valve(0, enable=0, counter=counter)  # already safe
        assert bench.guard.replaced == 4


def test_a_command_already_safe_is_not_counted_as_replaced(limits: ModuleType) -> None:
    bench = trip(limits)
    for counter in range(16):
        bench.command_valve(0, enable=0, counter=counter)
        assert bench.guard.replaced == 0
    for count, (counts, enable) in enumerate(((1, 0), (256, 0), (0, 1)), start=1):
        bench.command_valve(counts, enable)
        assert bench.guard.replaced == count


def test_before_the_first_sample_the_valve_is_closed_and_the_motor_stopped(limits: ModuleType) -> None:
    bench = Bench(limits)
    for _ in range(2):
        assert (bench.command_valve()["VALVE_ENABLE"], bench.command_motor()["MOTOR_ENABLE"]) == (0, 0)
        bench.send_analog()  # half a sample is none
        bench.guard.run_cycle()
    bench.run_cycle()
    assert (bench.command_valve()["VALVE_ENABLE"], bench.command_motor()["MOTOR_ENABLE"]) == (1, 1)


# --- anything may happen ---------------------------------------------------------------------------------------------

happenings = st.one_of(
    st.tuples(st.just("sample"), st.integers(-2048, 2047), st.integers(-2048, 2047), st.integers(-3000, 3000)),
    st.tuples(st.just("good")),
    st.tuples(st.just("silence")),
    st.tuples(st.just("ask"), st.integers(0, 3)),
    st.tuples(
        st.just("garbage"), st.sampled_from([0x080, 0x100, 0x101, 0x180, 0x300]), st.binary(min_size=8, max_size=8)
    ),
    st.tuples(st.just("command"), st.integers(0, 65535), st.integers(0, 1), st.integers(0, 255), st.integers(0, 1023)),
)


@given(st.lists(happenings, max_size=60))
def test_no_command_passes_with_the_valve_enabled_while_anything_is_found(sequence: list[Any]) -> None:
    bench = Bench(rt_controller.guard.limits)
    for kind, *values in sequence:
        if kind == "sample":
            bench.run_cycle(*values)
        elif kind == "good":
            bench.run_cycle()
        elif kind == "silence":
            bench.guard.run_cycle()
        elif kind == "ask":
            bench.ask(*values)
        elif kind == "garbage":
            bench.guard.check_inbound(*values)
        else:
            counts, enable, counter, tick = values
            valve, motor = (
                bench.command_valve(counts, enable, counter, tick),
                bench.command_motor(1000, counts, enable, counter),
            )
            assert valve["VALVE_VOLTAGE"] <= VALVE_LIMIT
            assert motor["TORQUE_LIMIT"] <= MOTOR_LIMIT
            assert (valve["COUNTER"], valve["SAMPLE_TICK"], motor["COUNTER"]) == (counter, tick, counter)
            if bench.guard.finding or not enable:
                assert valve["VALVE_ENABLE"] == valve["VALVE_VOLTAGE"] == 0
            if bench.guard.finding:
                assert motor["MOTOR_ENABLE"] == motor["SPEED_DEMAND"] == motor["TORQUE_LIMIT"] == 0


@given(st.integers(0, 0x3FFFFFF), st.integers(0, 255))
def test_rewriting_keeps_what_is_not_limited(noise: int, counter: int) -> None:
    speed, tick = (noise & 0xFFFF) - 0x8000, noise >> 16
    bench = Bench(rt_controller.guard.limits)
    bench.run_cycle()
    assert bench.command_valve(65535, counter=counter, tick=tick)["SAMPLE_TICK"] == tick
    assert bench.command_motor(speed, 65535, counter=counter)["SPEED_DEMAND"] == speed


# --- independence and known gaps -------------------------------------------------------------------------------------


def test_the_guard_imports_nothing_from_the_project() -> None:
    tree = ast.parse(Path(rt_controller.guard.limits.__file__).read_text())
    modules = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            modules.add(node.module or "")
    assert modules == {"collections.abc", "numpy", "numba"}
    assert not [
        n for n in ast.walk(tree) if isinstance(n, ast.Name) and n.id in ("__import__", "exec", "eval", "globals")
    ]


def test_the_valve_stays_closed_until_a_sample_has_been_seen(limits: ModuleType) -> None:
    bench = Bench(limits)
    for half in (Bench.send_analog, Bench.send_encoder):
        assert not bench.open
        half(bench)
    bench.guard.run_cycle()
    assert bench.open
