"""Commands, status and heartbeat that the controller's cycle sends. Each test has the module as argument, so that it can run on
mutants (tests/mutation)."""

from math import inf
from types import ModuleType

import pytest

import rt_controller.loop.cycle
from protocols.can.lifecycle import Lifecycle
from rt_controller.law.phases import Fault, Phase
from tests.rt_controller.cycle_bench import PERIOD, RATE, CycleBench, Sent


@pytest.fixture(scope="module")
def cycle() -> ModuleType:
    return rt_controller.loop.cycle


def hold_phase(bench: CycleBench, phase: int) -> dict[str, Sent]:
    """Run a cycle that leaves a phase as it is."""
    bench.state.phases.phase, bench.state.phases.time_in_phase = phase, 0.0
    bench.state.phases.time_in_contact = -1.0
    bench.state.phases.fault = Fault.OVERSPEED if phase == Phase.FAULT else Fault.NONE
    request = {Phase.IDLE: 2, Phase.RELEASE: 2, Phase.FAULT: 2, Phase.LOCK: 4}.get(Phase(phase), 1)
    sent = bench.run([*bench.sample(int(bench.state.sample.tick) + 1), bench.demand(request)])
    assert bench.state.phases.phase == phase
    return sent


# --- which frames, and when ------------------------------------------------------------------------------------------


def test_frames_that_are_sent(cycle: ModuleType) -> None:
    assert cycle.SENT_FRAMES == ("VALVE_COMMAND", "MOTOR_COMMAND", "CONTROLLER_STATUS", "CONTROLLER_HEARTBEAT")
    bench = CycleBench(cycle)
    assert list(bench.run()) == ["CONTROLLER_HEARTBEAT", "CONTROLLER_STATUS", "MOTOR_COMMAND", "VALVE_COMMAND"]
    assert list(bench.run()) == ["MOTOR_COMMAND", "VALVE_COMMAND"]


def test_the_controller_of_clutch_b_leaves_the_motor_alone(cycle: ModuleType) -> None:
    bench = CycleBench(cycle, "b")
    assert list(bench.run()) == ["CONTROLLER_HEARTBEAT", "CONTROLLER_STATUS", "VALVE_COMMAND"]
    assert list(bench.run()) == ["VALVE_COMMAND"]


def list_slots(bench: CycleBench, name: str, slots: int, count: int) -> list[int]:
    """Slots, from 1 on, in which a frame comes; `slots` pass from one cycle to the next."""
    return [slots * (n + 1) for n in range(count) if name in bench.run(slots=slots)]


def test_heartbeat_and_status_come_in_the_slot_after_a_multiple(cycle: ModuleType) -> None:
    for name, every in (("CONTROLLER_HEARTBEAT", "heartbeat_every"), ("CONTROLLER_STATUS", "status_every")):
        for slots, expected in ((1, [1, 7, 13, 19]), (2, [2, 8, 14, 20]), (5, [5, 10, 15, 20]), (7, [7, 14, 21])):
            bench = CycleBench(cycle)
            setattr(bench.settings, every, 6)
            setattr(bench.settings, "status_every" if every == "heartbeat_every" else "heartbeat_every", 1000)
            assert list_slots(bench, name, slots, 21 // slots) == expected


def test_counters_of_all_frames(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.settings.status_every, bench.settings.heartbeat_every = 1, 1
    for number in range(3):
        sent = bench.run()
        counters = {name: one.counter for name, one in sent.items()}
        assert counters == {
            "CONTROLLER_HEARTBEAT": number + 1, "CONTROLLER_STATUS": number, "MOTOR_COMMAND": number,
            "VALVE_COMMAND": number,
        }  # fmt: skip
    assert (bench.state.cycle, bench.state.beats, bench.state.statuses) == (3, 3, 3)


def test_the_heartbeat_tells_rate_and_session(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.settings.session = 0x1234
    values = bench.run()["CONTROLLER_HEARTBEAT"].values
    assert (values.lifecycle, values.rate, values.session) == (Lifecycle.ACTIVE, RATE, 0x1234)


def test_the_status_tells_the_state(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.settings.status_every = 1
    bench.close()
    bench.state.late_cycles = 17
    for tick in range(3, 40):  # the plates turn, with the motor's torque
        sent = bench.run([*bench.sample(tick, torque=400, angle=260 * tick), bench.demand()])
    values = sent["CONTROLLER_STATUS"].values
    law = bench.state.law.torque
    assert (values.phase, values.fault, values.late_cycles) == (Phase.SLIP_CONTROL, 0, 17)
    assert values.torque_estimate == pytest.approx(law.estimate, abs=0.0011)
    assert abs(law.estimate) > 5.0
    assert values.friction_level == pytest.approx(float(law.adaptation.level), abs=0.006)
    assert values.sticking == 0
    values = hold_phase(bench, Phase.FAULT)["CONTROLLER_STATUS"].values
    assert (values.phase, values.fault) == (Phase.FAULT, Fault.OVERSPEED)


def test_plates_stick_in_contact_without_motion(cycle: ModuleType) -> None:
    for pressure, still, sticking in ((700, 1.0, 1), (700, 0.0, 0), (100, 1.0, 0), (100, 0.0, 0)):
        bench = CycleBench(cycle)
        bench.settings.status_every = 1
        bench.close()
        bench.state.law.torque.motion.still = still  # s without motion
        values = bench.run([*bench.sample(3, pressure), bench.demand()])["CONTROLLER_STATUS"].values
        assert values.sticking == sticking, (pressure, still)


# --- the motor -------------------------------------------------------------------------------------------------------


def test_the_motor_gets_its_speed_and_its_limit(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.settings.motor_torque_limit = 31.0
    values = bench.run([*bench.sample(2), bench.demand(speed=-2500)])["MOTOR_COMMAND"].values
    assert values == (1, 2, -5.0, 31.0)
    assert bench.state.motor_limit == 31.0
    assert bench.state.guard.replaced == 0


def test_the_motor_is_on_in_every_phase_but_fault(cycle: ModuleType) -> None:
    for phase in Phase:
        bench = CycleBench(cycle)
        bench.close()
        values = hold_phase(bench, phase)["MOTOR_COMMAND"].values
        assert values.motor_enable == (0 if phase is Phase.FAULT else 1), phase
        assert values.speed_demand == (0.0 if phase is Phase.FAULT else 10.0)
        if phase is not Phase.LOCK:
            assert values.torque_limit == (0.0 if phase is Phase.FAULT else 40.0)


def test_the_motor_stays_off_until_a_first_set_point(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run(bench.sample(0))
    assert bench.run(bench.sample(1))["MOTOR_COMMAND"].values == (0, 1, 0.0, 0.0)
    assert bench.state.setpoint_age == inf
    assert bench.state.motor_limit == 0.0
    assert bench.run([*bench.sample(2), bench.demand()])["MOTOR_COMMAND"].values.motor_enable == 1


def test_the_motor_stays_on_while_a_set_point_is_too_old(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.state.setpoint_age = 99.0
    assert bench.run(bench.sample(2))["MOTOR_COMMAND"].values.motor_enable == 1


def test_locked_plates_lower_the_limit_of_the_motor(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.close()
    values = hold_phase(bench, Phase.LOCK)["MOTOR_COMMAND"].values
    assert bench.state.locked
    # capacity at 4.72 bar with the margin of 8 %: Table 6.4
    assert values.torque_limit == pytest.approx((10.8 * 4.72 - 25.1) / 1.08, abs=0.001)
    bench.settings.motor_torque_limit = 20.0  # the lower of both
    assert hold_phase(bench, Phase.LOCK)["MOTOR_COMMAND"].values.torque_limit == 20.0


def test_the_limit_of_locked_plates_is_that_of_their_friction_level(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.close()
    bench.state.law.torque.adaptation["base"] = 0.8
    values = hold_phase(bench, Phase.LOCK)["MOTOR_COMMAND"].values
    level = float(bench.state.law.torque.adaptation["level"])
    assert level < 0.95
    assert values.torque_limit == pytest.approx(level * (10.8 * 4.72 - 25.1) / 1.08, abs=0.001)


def test_of_two_clutches_locked_plates_lower_no_limit(cycle: ModuleType) -> None:
    bench = CycleBench(cycle, "a")
    bench.close()
    assert hold_phase(bench, Phase.LOCK)["MOTOR_COMMAND"].values.torque_limit == 40.0
    assert bench.state.locked


def test_the_lower_limit_holds_until_locked_plates_slide_or_separate(cycle: ModuleType) -> None:
    for phase, locked, still, held, pressure, expected in (
        (Phase.SLIP_CONTROL, True, 1.0, 0.0, 700, True),  # they stand
        (Phase.SLIP_CONTROL, False, 1.0, 0.0, 700, False),  # they were not locked
        (Phase.SLIP_CONTROL, True, 0.0, 0.0, 700, False),  # they slide
        (Phase.SLIP_CONTROL, True, 0.0, 22.0, 700, True),  # they slide while the capacity falls from lock
        (Phase.SLIP_CONTROL, True, 0.0, 0.5, 700, True),
        (Phase.RELEASE, True, 0.0, 0.0, 700, True),  # they slide in release
        (Phase.RELEASE, True, 1.0, 0.0, 100, False),  # they have separated
        (Phase.RELEASE, True, 1.0, 0.0, 700, True),
        (Phase.LOCK, False, 0.0, 0.0, 700, True),
        (Phase.LOCK, False, 0.0, 0.0, 100, True),
    ):
        bench = CycleBench(cycle)
        bench.close()
        bench.state.phases.phase, bench.state.locked = phase, locked
        bench.state.law.held, bench.state.law.torque.motion.still = held, still
        request = {Phase.RELEASE: 2, Phase.LOCK: 4}.get(phase, 1)
        bench.settings.phases.released_pressure = 0.0
        values = bench.run([*bench.sample(3, pressure), bench.demand(request)])["MOTOR_COMMAND"].values
        what = (phase, locked, still, held, pressure)
        assert bench.state.phases.phase == phase, what
        assert bool(bench.state.locked) is expected, what
        assert (values.torque_limit < 40.0) is expected, what


# --- the valve -------------------------------------------------------------------------------------------------------


def test_the_valve_opens_in_fill_slip_control_and_lock_only(cycle: ModuleType) -> None:
    for phase in Phase:
        bench = CycleBench(cycle)
        bench.close()
        replaced = int(bench.state.guard.replaced)
        values = hold_phase(bench, phase)["VALVE_COMMAND"].values
        opens = phase in (Phase.FILL, Phase.SLIP_CONTROL, Phase.LOCK)
        assert values.valve_enable == opens, phase
        assert (values.valve_voltage > 0.5) is opens, phase
        if opens:
            assert values.valve_voltage == pytest.approx(float(bench.state.law.voltage), abs=1e-4)
            assert bench.state.guard.replaced == replaced


def test_commands_answer_the_newest_sample(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    sent = bench.run()
    assert (sent["VALVE_COMMAND"].values.sample_tick, sent["MOTOR_COMMAND"].values.sample_tick) == (0, 0)
    bench = CycleBench(cycle)
    for tick in (1, 300, 1030):
        sent = bench.run(bench.sample(tick))
        assert sent["VALVE_COMMAND"].values.sample_tick == tick % 1024
        assert sent["MOTOR_COMMAND"].values.sample_tick == tick % 128


# --- the guard has the last word -------------------------------------------------------------------------------------


def test_the_guard_closes_the_valve_and_stops_the_motor_before_a_first_sample(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run([bench.demand(0)])
    bench.state.phases.phase, bench.state.phases.permitted = Phase.SLIP_CONTROL, False
    bench.state.law.pressure_loop.integral = 3.0e5
    sent = bench.run([bench.demand()])
    assert bench.state.phases.phase == Phase.SLIP_CONTROL
    assert bench.state.law.voltage > 0.5
    assert sent["VALVE_COMMAND"].values[:2] == (0, 0.0)
    assert sent["MOTOR_COMMAND"].values == (0, 0, 0.0, 0.0)


def test_the_guard_lowers_both_commands(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.close()
    bench.settings.guard.valve, bench.settings.guard.motor = 100, 2000  # counts
    sent = hold_phase(bench, Phase.SLIP_CONTROL)
    assert sent["VALVE_COMMAND"].values.valve_voltage == pytest.approx(100 * 10.0 / 65536)
    assert sent["MOTOR_COMMAND"].values.torque_limit == 2.0
    assert bench.read_column("commands_lowered") == 0  # of the cycles before
    bench.run()
    assert bench.read_column("commands_lowered") == 2


def test_the_guard_of_clutch_b_knows_its_valve(cycle: ModuleType) -> None:
    bench = CycleBench(cycle, "b")
    bench.close()
    bench.settings.guard.valve = 100
    sent = hold_phase(bench, Phase.SLIP_CONTROL)
    assert sent["VALVE_COMMAND"].values.valve_voltage == pytest.approx(100 * 10.0 / 65536)


def test_the_record_has_phase_and_request(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.close()
    bench.run([*bench.sample(3), bench.demand()], slots=2)
    names = ("sample_tick", "phase", "fault", "request", "torque_demand_nm")
    assert [bench.read_column(name) for name in names] == [3.0, Phase.SLIP_CONTROL, 0.0, 1.0, 10.0]
    assert bench.state.phases.time_in_phase == 5 * PERIOD
