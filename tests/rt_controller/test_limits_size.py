"""The guard of a bench of another size: its range of pressures, and its data IDs. Each test has the module as argument, so that
it can run on mutants (tests/mutation)."""

from types import ModuleType
from typing import Any

import pytest
from e2e.p05 import e2e_p05_check

import rt_controller.guard.limits
from tests.rt_controller.guard_bench import (
    DATABASE,
    ENGAGE,
    IDENTIFIERS,
    IDLE,
    STALE,
    VALVE_LIMIT,
    Guard,
    encode,
    protect,
    read_data_id,
)

KEY = 0x0A11
SESSION = 0x9234


@pytest.fixture(scope="module")
def limits() -> ModuleType:
    return rt_controller.guard.limits


class SizedBench:
    """A guard with frames whose data IDs are XOR `key`."""

    def __init__(self, limits: ModuleType, key: int = KEY, offset: int = 0, **changed: float) -> None:
        self.key, self.offset = key, offset
        self.guard = Guard(limits, offset, data_key=float(KEY), **changed)
        self.count = 0

    def make_frame(self, name: str, session: int = 0, **signals: int) -> bytes:
        number = (read_data_id(DATABASE.get_message_by_name(name)) + self.offset) ^ self.key ^ session
        return protect(encode(name, self.count, tuple(signals.items()), 0), number)

    def send(self, name: str, session: int = 0, **signals: int) -> None:
        self.guard.check_inbound(IDENTIFIERS[name] + self.offset, self.make_frame(name, session, **signals))

    def run_cycle(self, **signals: int) -> int:
        self.count += 1
        values = {"CYLINDER_PRESSURE": 600 + self.count % 2, "OIL_TEMPERATURE": 717} | signals
        self.send("ANALOG_SENSORS", **values)
        self.send("ENCODER", SAMPLE_TICK=self.count)
        return self.guard.run_cycle()

    def pass_command(self, name: str, **signals: int) -> dict[str, Any]:
        offset = self.offset if name == "VALVE_COMMAND" else 0
        number = (read_data_id(DATABASE.get_message_by_name(name)) + offset) ^ self.key
        sent = protect(encode(name, 5, tuple(signals.items()), 0), number)
        data = self.guard.limit_outbound(IDENTIFIERS[name] + offset, sent)
        assert e2e_p05_check(data, number, length=8), "every command has the data ID of this size"
        message = DATABASE.get_message_by_name(name)
        return dict(message.decode(data, decode_choices=False, scaling=False))


def test_frames_with_the_key_of_the_guard_are_samples_and_others_are_none(limits: ModuleType) -> None:
    for key, fresh in ((KEY, True), (0, False), (KEY ^ 0x0800, False), (KEY ^ 1, False)):
        for offset in (0, 8):
            bench = SizedBench(limits, key, offset)
            for _ in range(STALE + 2):
                bench.run_cycle()
            assert (bench.guard.age == 0) is fresh
            assert bool(bench.guard.armed) is fresh


def test_commands_that_the_guard_changes_keep_the_key(limits: ModuleType) -> None:
    for offset in (0, 8):
        bench = SizedBench(limits, offset=offset)
        assert bench.pass_command("VALVE_COMMAND", VALVE_ENABLE=1, VALVE_VOLTAGE=9000)["VALVE_VOLTAGE"] == 0
        motor = {"MOTOR_ENABLE": 1, "SPEED_DEMAND": 100, "TORQUE_LIMIT": 50_000}
        assert bench.pass_command("MOTOR_COMMAND", **motor)["TORQUE_LIMIT"] == 0
        bench.run_cycle()
        lowered = bench.pass_command("VALVE_COMMAND", VALVE_ENABLE=1, VALVE_VOLTAGE=VALVE_LIMIT + 1)
        assert (lowered["VALVE_ENABLE"], lowered["VALVE_VOLTAGE"]) == (1, VALVE_LIMIT)
        assert bench.pass_command("MOTOR_COMMAND", **motor)["TORQUE_LIMIT"] == 40_000
        same = bench.pass_command("VALVE_COMMAND", VALVE_ENABLE=1, VALVE_VOLTAGE=9000)
        assert same["VALVE_VOLTAGE"] == 9000


def test_set_points_of_a_claim_have_key_and_session(limits: ModuleType) -> None:
    for session, heard in ((SESSION, True), (0, False), (SESSION ^ KEY, False)):
        bench = SizedBench(limits)
        bench.run_cycle()
        bench.send("SUPERVISOR_CLAIM", CLAIM=1, SESSION=SESSION)
        assert bench.guard.session == SESSION
        bench.send("TORQUE_SETPOINT", session, REQUEST=ENGAGE)
        assert (bench.guard.asked > 0) is heard
        bench.send("TORQUE_SETPOINT", session, REQUEST=IDLE)


def test_pressures_are_judged_over_the_range_of_this_size(limits: ModuleType) -> None:
    for bar, full, counts in ((12.0, 25.0, 983), (5.0, 25.0, 409), (5.0, 10.0, 1024), (59.4, 60.0, 2027)):
        for over in (0, 1):
            bench = SizedBench(limits, pressure=bar * 1e5, pressure_range=full * 1e5)
            result = [bench.run_cycle(CYLINDER_PRESSURE=counts + over) for _ in range(3)][-1]
            assert result == (limits.OVERPRESSURE if over else limits.HEALTHY)


def test_a_pressure_below_vacuum_is_not_believed_whatever_the_range(limits: ModuleType) -> None:
    for full, counts in ((10.0, -204), (20.48, -100), (51.2, -40)):
        for below, finding in ((0, limits.HEALTHY), (1, limits.SENSOR_IMPLAUSIBLE)):
            bench = SizedBench(limits, pressure_range=full * 1e5)
            assert [bench.run_cycle(CYLINDER_PRESSURE=counts - below) for _ in range(3)][-1] == finding
