"""Decisions of the controller's cycle: times, request, findings, checks. Each test has the module as argument, so that it can
run on mutants (tests/mutation)."""

from math import isnan
from types import ModuleType

import numpy as np
import pytest

import rt_controller.loop.cycle
from protocols.can.frames import Frame
from rt_controller.law.phases import Fault, Phase
from tests.rt_controller.cycle_bench import ENCODER, FRAMES, FRAMES_B, PERIOD, RATE, CycleBench

REQUEST_OF_RELEASE = 2


@pytest.fixture(scope="module")
def cycle() -> ModuleType:
    return rt_controller.loop.cycle


# --- time ------------------------------------------------------------------------------------------------------------


def test_ages_and_slots_count_every_slot_that_was_slept_through(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.state.other.age = 1.0
    slot = bench.state.slot
    for slots, total in ((1, 1), (3, 4), (7, 11)):
        bench.run(slots=slots)
        assert bench.state.setpoint_age == total * PERIOD
        assert bench.state.other.age == 1.0 + total * PERIOD
        assert bench.state.slot == slot + total


def test_the_phase_counts_every_slot_that_was_slept_through(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    before = float(bench.state.phases.time_in_phase)
    bench.run(slots=5)
    assert bench.state.phases.time_in_phase - before == 5 * PERIOD


def test_the_guard_is_told_how_many_slots_have_passed(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    for slots, age in ((1, 1), (2, 3), (1, 4)):
        bench.run(slots=slots)
        assert bench.state.guard.age == age == bench.read_column("sample_age")


def test_the_guard_sees_each_frame_as_it_came(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.run(bench.sample(2))
    assert bench.state.guard.age == 0
    assert bench.state.guard.tick == 3
    bench.run(bench.sample(3)[:1])  # half a sample
    assert bench.state.guard.age == 1
    analog, encoder = bench.sample(4)
    bench.run([analog, Frame(encoder.can_id, encoder.data[:7])])  # another length
    assert bench.state.guard.age == 2
    analog, encoder = bench.sample(5)
    bench.run([analog, Frame(encoder.can_id + 0x400, encoder.data)])  # another identifier
    assert bench.state.guard.age == 3


def test_the_law_advances_by_the_samples_and_not_by_the_slots(cycle: ModuleType) -> None:
    for ticks, steps in ((1, 1), (2, 2), (9, 9), (10, 10), (11, 10), (30, 10)):
        bench = CycleBench(cycle)
        bench.start()
        before = float(bench.state.law.torque.motion.still)
        bench.run(bench.sample(1 + ticks), slots=3)
        assert bench.state.law.torque.motion.still - before == steps * PERIOD, ticks


def test_the_law_advances_by_all_samples_of_a_cycle(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    before = float(bench.state.law.torque.motion.still)
    bench.run([*bench.sample(2), *bench.sample(4)])
    assert bench.state.law.torque.motion.still - before == 3 * PERIOD
    bench.run()
    assert bench.state.law.torque.motion.still - before == 3 * PERIOD  # without a sample it stands


def test_a_refused_frame_takes_no_time_back(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    before = float(bench.state.law.torque.motion.still)
    wrong = [bench.beat(rate=RATE + 1) for _ in range(3)]
    bench.run([*bench.sample(3), *wrong])
    assert bench.state.law.torque.motion.still - before == 2 * PERIOD


def test_only_a_sample_takes_time(cycle: ModuleType) -> None:
    others = {
        "unknown": Frame(0x7F, bytes(8)),
        "corrupt": Frame(ENCODER.can_id, bytes(8)),
        "own": Frame(FRAMES["VALVE_COMMAND"].can_id, bytes(8)),
    }
    for what in (*others, "heartbeat", "set-point", "analog"):
        bench = CycleBench(cycle)
        frame = others.get(what) or {
            "heartbeat": bench.beat(), "set-point": bench.demand(), "analog": bench.sample(0)[0]
        }[what]  # fmt: skip
        assert bench.listen([frame]) == 0, what
        assert bench.try_cycle([frame]) > 0, what
        bench = CycleBench(cycle)
        bench.start()
        frame = others.get(what) or {
            "heartbeat": bench.beat(), "set-point": bench.demand(), "analog": bench.sample(0)[0]
        }[what]  # fmt: skip
        still = float(bench.state.law.torque.motion.still)
        bench.run([frame])
        assert bench.state.law.torque.motion.still == still, what


# --- request ---------------------------------------------------------------------------------------------------------


def test_a_set_point_is_followed_up_to_its_age(cycle: ModuleType) -> None:
    for beyond, request in ((0.0, 1), (2.0**-40, REQUEST_OF_RELEASE)):
        bench = CycleBench(cycle)
        bench.close()
        bench.settings.setpoint_timeout = 0.25
        bench.state.setpoint_age = 0.25 - 2 * PERIOD + beyond
        bench.run(bench.sample(3))
        assert bench.read_column("request") == 1
        bench.run(bench.sample(4))
        assert bench.state.setpoint_age == 0.25 + beyond
        assert bench.read_column("request") == request
        assert bench.read_column("phase") == (Phase.SLIP_CONTROL if request == 1 else Phase.RELEASE)


def test_without_a_set_point_release_is_asked_for(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run(bench.sample(0))
    assert bench.read_column("request") == REQUEST_OF_RELEASE


def test_a_demand_for_a_pressure_is_followed_only_when_it_is_asked_for(cycle: ModuleType) -> None:
    for request, follows in ((1, False), (3, True)):
        bench = CycleBench(cycle)
        bench.close()
        bench.run([*bench.sample(3), bench.demand(request, pressure=600)])  # 3 bar
        assert isnan(bench.read_column("torque_demand_nm")) is follows
        assert (bench.read_column("pressure_demand_bar") == pytest.approx(3.0)) is follows
        if not follows:
            assert bench.read_column("torque_demand_nm") == 10.0


# --- findings --------------------------------------------------------------------------------------------------------


def test_the_finding_of_the_guard_comes_first(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.state.wrong_rates = 3
    bench.state.guard.finding = Fault.OVERPRESSURE
    bench.run()
    assert bench.read_column("fault") == Fault.OVERPRESSURE
    bench.state.guard.finding = 0
    bench.run()
    assert bench.read_column("fault") == Fault.WRONG_RATE


def test_three_heartbeats_of_another_rate_are_a_fault(cycle: ModuleType) -> None:
    for count, fault in ((2, Fault.NONE), (3, Fault.WRONG_RATE), (4, Fault.WRONG_RATE)):
        bench = CycleBench(cycle)
        bench.start()
        bench.state.wrong_rates = count
        bench.run()
        assert bench.read_column("fault") == fault


def test_a_doubted_sender_is_a_fault(cycle: ModuleType) -> None:
    for kind in range(6):
        for doubts, fault in ((49, Fault.NONE), (50, Fault.SECOND_SENDER)):
            bench = CycleBench(cycle)
            bench.state.receptions[kind]["doubts"] = doubts
            bench.run()
            expected = fault if kind < 3 else Fault.NONE  # heartbeats and the other clutch are doubted by nobody
            assert bench.read_column("fault") == expected, (kind, doubts)


def test_a_second_controller_is_a_fault_for_a_second(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.state.intruder.frames, bench.state.intruder.period = 10, bench.state.slot + 1 - 1000
    bench.run([bench.demand(request=0)])
    assert bench.read_column("fault") == Fault.SECOND_SENDER
    bench.run([*bench.sample(2), bench.demand(request=0)])
    assert bench.read_column("fault") == Fault.NONE


def test_faults_are_counted(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.state.wrong_rates = 3
    bench.run()
    assert bench.state.faults.count == 1
    assert bench.state.faults.last == Fault.WRONG_RATE


# --- plausibility ----------------------------------------------------------------------------------------------------


def make_standing(cycle: ModuleType, request: int = 1, clutch: str | None = None) -> CycleBench:
    """A bench in slip control whose plates stand: the motor is asked for 10 rad/s, and the limit of a step is far."""
    bench = CycleBench(cycle, clutch)
    bench.close()
    bench.run([bench.demand(request)])
    torque = bench.state.law.torque
    torque.contact, torque.motion.moves = True, False
    bench.state.motor_limit, bench.state.sample.motor_torque, bench.state.sample.speed = 40.0, 0.0, 0.0
    bench.state.plausibility.standing = bench.state.plausibility.time_mismatch = 0.0
    return bench


def test_plates_that_stand_are_checked(cycle: ModuleType) -> None:
    bench = make_standing(cycle)
    bench.state.sample.speed = 4.0
    bench.run(slots=2)
    assert bench.state.plausibility.standing == (10.0 - 4.0) * 2 * PERIOD


def test_plates_that_stand_are_checked_in_slip_control_and_lock_only(cycle: ModuleType) -> None:
    for phase, checked in ((0, False), (1, False), (2, True), (3, False), (4, False), (5, True)):
        bench = make_standing(cycle)
        bench.state.phases.phase = phase
        bench.run()
        assert (bench.state.plausibility.standing > 0.0) == checked, phase


def test_plates_that_stand_are_not_checked_while_a_pressure_is_asked_for(cycle: ModuleType) -> None:
    bench = make_standing(cycle, request=3)
    bench.run()
    assert bench.state.plausibility.standing == 0.0


def test_only_plates_in_contact_that_do_not_move_stand(cycle: ModuleType) -> None:
    for contact, moves in ((False, False), (True, True), (False, True)):
        bench = make_standing(cycle)
        bench.state.law.torque.contact, bench.state.law.torque.motion.moves = contact, moves
        bench.run()
        assert bench.state.plausibility.standing == 0.0


def test_a_motor_at_its_limit_is_not_blamed(cycle: ModuleType) -> None:
    for torque, checked in ((35.9, True), (36.0, False), (36.1, False), (-35.9, True), (-36.0, False), (-40.0, False)):
        bench = make_standing(cycle)
        bench.state.sample.motor_torque = torque
        bench.run()
        assert (bench.state.plausibility.standing > 0.0) == checked, torque


def test_plates_of_two_clutches_are_not_said_to_stand(cycle: ModuleType) -> None:
    bench = make_standing(cycle, clutch="a")
    bench.run()
    assert bench.state.plausibility.standing == 0.0


def test_the_torque_of_the_motor_is_compared_with_the_model(cycle: ModuleType) -> None:
    for request, phase, compared in ((1, 2, True), (1, 5, True), (3, 2, False), (1, 1, False)):
        bench = make_standing(cycle, request)
        bench.state.phases.phase = phase
        bench.state.law.torque.observed = 20.0  # the model says nothing
        bench.settings.plausibility.torque_mismatch = 0.5
        bench.run(slots=3)
        assert bench.state.plausibility.time_mismatch == (3 * PERIOD if compared else 0.0), (request, phase)
    bench = make_standing(cycle)
    bench.state.law.torque.observed = 0.1
    bench.run()
    assert bench.state.plausibility.time_mismatch == 0.0


def test_a_torque_that_is_not_plausible_is_a_fault(cycle: ModuleType) -> None:
    bench = make_standing(cycle)
    bench.state.plausibility.standing = 3.9999
    bench.run()
    assert bench.read_column("fault") == Fault.TORQUE_IMPLAUSIBLE


def test_a_pressure_that_is_lost_is_a_fault(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.close()
    for tick in range(3, 12):
        bench.run([*bench.sample(tick, pressure=200), bench.demand()])
    assert bench.read_column("fault") == Fault.PRESSURE_LOST
    assert bench.state.plausibility.pressure == pytest.approx(200 * 0.0048828125e5)


def test_a_pressure_is_asked_for_as_in_the_cycle_before(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.close()
    bench.state.law.pressure_demand = 3.25e5
    bench.run([*bench.sample(3, pressure=701), bench.demand()])
    assert bench.state.plausibility.asked == 3.25e5
    bench.state.law.pressure_demand = 3.75e5
    bench.run([*bench.sample(4, pressure=701), bench.demand()], slots=2)
    assert bench.state.plausibility.time_frozen == 2 * PERIOD


def test_more_than_the_valve_gives_is_asked_of_no_pressure(cycle: ModuleType) -> None:
    """A joint of a robot with a valve of 2 bar: its pressure stayed at 2 bar, and was taken for a signal that stands still."""
    bench = CycleBench(cycle)
    bench.close()
    bench.settings.law.valve_gain, bench.settings.law.voltage_limit = 0.5e5, 4.0
    bench.state.law.pressure_demand = 2.5e5
    bench.run([*bench.sample(3, pressure=701), bench.demand()])
    assert bench.state.plausibility.asked == 2e5
    bench.state.law.pressure_demand = 3.75e5
    bench.run([*bench.sample(4, pressure=701), bench.demand()])
    assert bench.state.plausibility.time_frozen == 0.0


# --- two clutches ----------------------------------------------------------------------------------------------------


def make_pair(cycle: ModuleType) -> CycleBench:
    """A bench of clutch a in slip control, that knows of a clutch b which is open; motor 20 Nm, own estimate 5 Nm."""
    bench = make_standing(cycle, clutch="a")
    other, torque = bench.state.other, bench.state.law.torque
    other.tick, other.age, other.estimate, other.sticks, other.acceleration = 5, 0.0, 0.0, False, 0.0
    bench.state.sample.motor_torque, bench.state.sample.acceleration = 20.0, 0.0
    torque.estimate, torque.level, torque.coulomb_torque, torque.motion.moves = 5.0, 2.0, 10.0, True
    return bench


def test_the_torque_of_the_motor_is_compared_with_both_clutches(cycle: ModuleType) -> None:
    for moves, request, mismatch in ((True, 1, True), (False, 1, False), (True, 3, False)):
        bench = make_pair(cycle)
        bench.state.law.torque.motion.moves = moves  # plates that stand carry up to 20 Nm, level times Coulomb torque
        if request == 3:
            bench.run([bench.demand(request)])
            bench.state.plausibility.time_mismatch = 0.0
            bench.state.law.torque.estimate = 5.0
        bench.run()
        assert (bench.state.plausibility.time_mismatch > 0.0) == mismatch, (moves, request)


def test_the_capacity_of_plates_that_stand_is_their_level_times_the_coulomb_torque(cycle: ModuleType) -> None:
    for level, coulomb, mismatch in ((2.0, 10.0, False), (1.0, 5.0, True), (0.5, 10.0, True)):
        bench = make_pair(cycle)
        bench.state.law.torque.motion.moves = False
        bench.state.law.torque.level, bench.state.law.torque.coulomb_torque = level, coulomb
        bench.state.sample.motor_torque = 25.0
        bench.run()
        assert (bench.state.plausibility.time_mismatch > 0.0) == mismatch


def test_of_two_clutches_the_applied_torque_is_known_while_the_other_is_open(cycle: ModuleType) -> None:
    for estimate, known in ((0.0, True), (1.0, False)):
        bench = make_pair(cycle)
        bench.state.other.estimate = estimate
        bench.state.other.acceleration = 10.0
        bench.run()
        assert bool(bench.state.sample.known) is known
        # ratio 3 of 3 - 2, inertia 0.05 kg m^2
        assert bench.state.sample.applied == pytest.approx(20.0 - 0.05 * 3.0 * 10.0)


def test_of_one_clutch_the_applied_torque_is_that_of_the_motor(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.run(bench.sample(2, torque=100))
    assert bench.state.sample.applied == bench.state.sample.motor_torque == 100 * 0.0244140625
    assert bench.state.sample.known


def test_both_controllers_expect_the_jump_of_the_motor_torque_at_a_new_speed_demand(cycle: ModuleType) -> None:
    for torque, jumps in ((100, True), (1600, False)):  # 2.4 Nm; 39 Nm, at the limit of the motor
        for clutch in "ab":
            bench = CycleBench(cycle, clutch)
            bench.start()
            bench.run([*bench.sample(2, torque=torque), bench.demand(speed=6000)])
            bench.run(bench.sample(3, torque=torque))
            state = bench.state.law.torque
            half = (
                0.5
                * bench.settings.law.torque.model.motor_gain
                * 1000
                * FRAMES["TORQUE_SETPOINT"].scale["speed_demand"]
            )
            expected = torque * ENCODER.scale["motor_torque"] + (half if jumps else 0.0)
            assert state.motor_before == pytest.approx(expected, rel=1e-12), (torque, clutch)


def test_a_motor_at_a_lowered_limit_has_no_jump(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.run([*bench.sample(2, torque=100), bench.demand(speed=6000)])
    bench.state.motor_limit = 2.0  # Nm, as in lock; 2.4 Nm are measured
    bench.run(bench.sample(3, torque=100))
    assert bench.state.law.torque.motor_before == pytest.approx(100 * ENCODER.scale["motor_torque"], rel=1e-12)


def test_a_status_of_the_other_clutch_is_used_between_two(cycle: ModuleType) -> None:
    every = 102  # slots between two statuses
    for slot in (0, 50, 51, 52, 101, 102, 153):
        bench = make_pair(cycle)
        bench.state.other.is_new, bench.state.other.new_estimate = True, 7.0
        bench.state.slot = slot - 1
        bench.run()
        assert (bench.state.other.estimate == 7.0) == (slot % every == 51), slot
    assert bench.settings.status_every == every


def test_missed_slots_do_not_keep_a_status_of_the_other_clutch_from_use(cycle: ModuleType) -> None:
    for slot, slots, used in (
        (51, 2, True),
        (52, 2, True),
        (53, 2, False),
        (60, 10, True),
        (61, 10, False),
        (50, 10, False),
    ):
        bench = make_pair(cycle)
        bench.state.other.is_new, bench.state.other.new_estimate = True, 7.0
        bench.state.slot = slot - slots
        bench.run(slots=slots)
        assert (bench.state.other.estimate == 7.0) == used, (slot, slots)
    for slot in range(5):
        bench = make_pair(cycle)
        bench.settings.status_every = 5
        bench.state.other.is_new, bench.state.other.new_estimate = True, 7.0
        bench.state.slot = slot - 1
        bench.run()
        assert (bench.state.other.estimate == 7.0) == (slot == 2), "half of an odd period, rounded down"


def test_frames_of_the_other_clutch_are_taken(cycle: ModuleType) -> None:
    bench = CycleBench(cycle, "a")
    bench.run([bench.make(FRAMES_B["ENCODER"], sample_tick=9, shaft_angle=77)])
    assert (bench.state.other.tick, bench.state.other.count) == (9, 77)
    assert bench.state.sample.tick == -1
    for sticking in (1, 0):
        bench.run([bench.make(FRAMES_B["CONTROLLER_STATUS"], torque_estimate=500, sticking=sticking)])
        assert (bench.state.other.new_estimate, bool(bench.state.other.new_sticks)) == (1.0, sticking == 1)


def test_the_observer_of_the_other_clutch_has_the_period_and_bandwidth_of_the_first(cycle: ModuleType) -> None:
    bench = CycleBench(cycle, "a")
    for tick in range(3):
        encoders = [bench.make(one["ENCODER"], sample_tick=tick, shaft_angle=50 * tick) for one in (FRAMES, FRAMES_B)]
        bench.run([bench.make(FRAMES["ANALOG_SENSORS"]), *encoders])
    assert bench.state.other.slip == bench.state.sample.slip != 0.0
    assert (
        bench.state.other.angle
        == bench.state.sample.angle
        == pytest.approx(100 * ENCODER.scale["shaft_angle"], rel=0.1)
    )


def test_one_clutch_hears_no_other(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run([bench.make(FRAMES_B["ENCODER"], sample_tick=9, shaft_angle=77)])
    assert bench.state.other.tick == -1
    assert np.isinf(bench.state.other.age)
