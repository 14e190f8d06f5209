"""Frames that the controller's cycle takes, counts or refuses. Each test has the module as argument, so that it can run on
mutants (tests/mutation)."""

from types import ModuleType

import numpy as np
import pytest

import rt_controller.loop.cycle
from protocols.can.frames import Frame
from rt_controller.law.phases import Fault
from rt_controller.loop.cycle import Refusal
from tests.rt_controller.cycle_bench import ANALOG, ENCODER, FRAMES, PERIOD, PLANT, RATE, SETPOINT, CycleBench


@pytest.fixture(scope="module")
def cycle() -> ModuleType:
    return rt_controller.loop.cycle


FIRST, SECOND = 0x9B21, 0x8A3F  # sessions of two supervisors


def list_rejected(bench: CycleBench) -> tuple[int, int, float]:
    state = bench.state
    return int(state.rejected_why), int(state.rejected_id), float(state.rejected_value)


def list_demands(bench: CycleBench) -> tuple[float, ...]:
    """Request, demand [Nm], speed [rad/s] and pressure [Pa] of the set-point in use."""
    state = bench.state
    return int(state.request), float(state.demand), float(state.speed_demand), float(state.pressure_demand)


# --- samples ---------------------------------------------------------------------------------------------------------


def test_frames_are_received_in_their_places(cycle: ModuleType) -> None:
    names = "ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT", "PLANT_HEARTBEAT", "SUPERVISOR_CLAIM"
    assert names == cycle.RECEIVED_FRAMES
    bench = CycleBench(cycle)
    bench.run([bench.beat(), *bench.sample(0), bench.demand(), bench.claim(FIRST)])
    assert [int(row["received"]) for row in bench.state.receptions] == [1, 1, 1, 1, 1, 0, 0]
    bench = CycleBench(cycle, "a")
    assert [int(row["can_id"]) for row in bench.state.receptions] == [0x100, 0x101, 0x180, 0x701, 0x170, 0x109, 0x308]


def test_what_is_not_for_the_controller_is_left_alone(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run([Frame(0x7F, bytes(8)), Frame(0x301, bytes(8)), Frame(0x109, bytes(8))])
    assert not any(row[name] for row in bench.state.receptions for name in ("received", "corrupt", "misshapen"))
    assert list_rejected(bench) == (0, 0, 0.0)


def test_sensor_values_are_in_si(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run(bench.sample(3, pressure=700, torque=200, angle=1000))
    sample = bench.state.sample
    assert sample.pressure == pytest.approx(700 * 0.0048828125 * 1e5, rel=1e-12)
    assert sample.temperature == pytest.approx(717 * 0.09765625 + 273.15, rel=1e-12)
    assert sample.motor_torque == 200 * 0.0244140625
    assert (sample.tick, sample.count) == (3, 1000)


def test_an_encoder_without_its_analog_half_is_no_sample(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    still = float(bench.state.law.torque.motion.still)
    bench.run([bench.make(ENCODER, sample_tick=2, motor_torque=9)])
    assert bench.state.sample.tick == 1
    assert bench.state.law.torque.motion.still == still


def test_the_slip_observer_begins_at_the_speed_demand(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run([bench.demand(speed=5000)])
    bench.run(bench.sample(0))
    assert (bench.state.sample.slip, bench.state.sample.speed) == (10.0, 10.0)
    bench.run(bench.sample(2, angle=100))
    angle = 100 * ENCODER.scale["shaft_angle"]
    assert bench.state.sample.speed == pytest.approx(angle / (2 * PERIOD), rel=1e-12)
    # the filter's pole is exp(-bandwidth step): docs/rig.md
    q = np.exp(-566.0 * 2 * PERIOD)
    residual = angle - 10.0 * 2 * PERIOD
    assert bench.state.sample.slip == pytest.approx(
        10.0 + 1.5 * (1 - q) ** 2 * (1 + q) * residual / (2 * PERIOD), rel=1e-9
    )


def test_frames_that_are_not_valid_are_not_taken(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    for frame in bench.sample(2, pressure=900):
        bench.run([Frame(frame.can_id, frame.data[:7] + bytes([frame.data[7] ^ 1]))])
    assert (bench.state.sample.tick, bool(bench.state.sample.analog)) == (1, False)
    assert [int(bench.state.receptions[kind]["corrupt"]) for kind in (0, 1)] == [1, 1]
    assert list_rejected(bench) == (0, 0, 0.0)  # corrupt frames are counted, not told


def test_another_length_is_told(cycle: ModuleType) -> None:
    for codec in (ANALOG, ENCODER, SETPOINT, PLANT):
        for length in (0, 7):
            bench = CycleBench(cycle)
            bench.start()
            assert bench.try_cycle([Frame(codec.can_id, bytes(length))]) > 0
            assert list_rejected(bench) == (Refusal.LENGTH, codec.can_id, length)
            bench.run([Frame(codec.can_id, bytes(3))])
            assert list_rejected(bench) == (Refusal.LENGTH, codec.can_id, length)  # the first stays


def test_frames_out_of_sequence_are_doubted(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.counters[ENCODER.can_id] += 20
    bench.run(bench.sample(2))
    assert bench.state.receptions[1]["doubts"] == 10
    assert bench.state.sample.tick == 1


# --- set-points ------------------------------------------------------------------------------------------------------


def test_a_set_point_is_taken_whole(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.run([bench.demand(request=3, torque=1234, speed=-4000, pressure=600)])
    assert list_demands(bench) == pytest.approx((3, 12.34, -8.0, 3.0e5), rel=1e-12)
    assert bench.state.setpoint_age == 0.0
    assert list_rejected(bench) == (0, 0, 0.0)


def check_request(cycle: ModuleType, request: int, taken: bool) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.run([bench.demand(request=request, torque=777)])
    assert list_demands(bench)[1] == pytest.approx(7.77 if taken else 10.0)
    assert list_rejected(bench) == ((0, 0, 0.0) if taken else (Refusal.REQUEST, SETPOINT.can_id, request))
    assert bench.state.receptions[2]["unusable"] == (0 if taken else 1)
    assert (bench.state.setpoint_age == 0.0) == taken


def test_a_request_is_one_of_five(cycle: ModuleType) -> None:
    for request in range(8):
        check_request(cycle, request, request <= 4)


def test_limits_of_a_set_point_may_be_asked_for_but_not_exceeded(cycle: ModuleType) -> None:
    sound = {"torque": 1000, "speed": 5000, "pressure": 400}
    for name, limit, highest, why, scale in (
        ("torque", "demand_limit", 2000, Refusal.TORQUE, 0.01),
        ("pressure", "pressure_limit", 800, Refusal.PRESSURE, 0.005),
        ("speed", "speed_limit", 9000, Refusal.SPEED, 0.002),
        ("speed", "speed_limit", -9000, Refusal.SPEED, 0.002),
    ):
        beyond = highest + (1 if highest > 0 else -1)
        for raw, taken in ((highest, True), (beyond, False)):
            bench = CycleBench(cycle)
            bench.start()
            setattr(bench.settings, limit, abs(highest) * scale)
            bench.run([bench.demand(**sound | {name: raw})], slots=2)
            rejected = (why, SETPOINT.can_id, pytest.approx(raw * scale, rel=1e-12))
            assert list_rejected(bench) == ((0, 0, 0.0) if taken else rejected), (name, raw)
            assert bench.state.receptions[2]["unusable"] == (0 if taken else 1)
            if not taken:  # the one before stays, and ages
                assert list_demands(bench) == pytest.approx((0, 10.0, 10.0, 0.0))
                assert bench.state.setpoint_age == 2 * PERIOD


def test_limits_are_those_of_the_parameters(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    for name, value in (("demand_limit", 30.0), ("pressure_limit", 4.5), ("speed_limit", 26.2)):
        assert float(getattr(bench.settings, name)) == pytest.approx(value)


# --- the plant's rate ------------------------------------------------------------------------------------------------


def test_before_the_start_another_rate_is_refused_at_once(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    assert bench.listen([bench.beat()]) == 0
    assert bench.listen([bench.beat(RATE + 1)]) == Refusal.RATE
    assert (bench.state.refused_id, bench.state.refused_value) == (PLANT.can_id, RATE + 1)
    assert list_rejected(bench) == (Refusal.RATE, PLANT.can_id, RATE + 1)
    assert bench.try_cycle([bench.beat(RATE - 1)]) == -Refusal.RATE
    assert bench.state.cycle == 0


def test_before_the_start_the_first_refusal_counts(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    assert bench.listen([bench.beat(), bench.beat(RATE + 1), bench.beat(RATE + 2)]) == Refusal.RATE
    assert bench.state.refused_value == RATE + 1
    assert bench.state.wrong_rates == 1


def test_in_a_run_three_heartbeats_in_sequence_tell_another_rate(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    for tick, (rates, wrong, fault) in enumerate(
        (
            ([RATE + 1, RATE + 1], 2, Fault.NONE),
            ([RATE], 0, Fault.NONE),
            ([RATE + 1, RATE + 1], 2, Fault.NONE),
            ([RATE + 1], 3, Fault.WRONG_RATE),
            ([RATE + 1], 4, Fault.WRONG_RATE),
            ([RATE], 0, Fault.NONE),
        ),
        2,
    ):
        assert bench.try_cycle([*bench.sample(tick), *map(bench.beat, rates), bench.demand(request=0)]) > 0
        assert bench.state.wrong_rates == wrong
        assert bench.read_column("fault") == fault
    assert list_rejected(bench) == (Refusal.RATE, PLANT.can_id, RATE + 1)


def test_two_wrong_heartbeats_in_a_run_are_not_told(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.run([bench.beat(RATE + 1), bench.beat(RATE + 1)])
    assert list_rejected(bench) == (0, 0, 0.0)
    bench.run([bench.beat(RATE + 1)])
    assert list_rejected(bench) == (Refusal.RATE, PLANT.can_id, RATE + 1)


# --- a second controller ---------------------------------------------------------------------------------------------


def make_own(bench: CycleBench, name: str, count: int) -> list[Frame]:
    """Frames that another controller sends on an identifier of this one."""
    return [bench.make(FRAMES[name]) for _ in range(count)]


def test_ten_frames_of_another_controller_end_a_start(cycle: ModuleType) -> None:
    for name in cycle.SENT_FRAMES:
        bench = CycleBench(cycle)
        assert bench.listen(make_own(bench, name, 9)) == 0
        assert bench.listen(make_own(bench, name, 1)) == Refusal.SECOND_CONTROLLER
        assert (bench.state.refused_id, bench.state.refused_value) == (FRAMES[name].can_id, 0.0)
        assert list_rejected(bench) == (Refusal.SECOND_CONTROLLER, FRAMES[name].can_id, 0.0)
        assert sum(int(row["received"]) for row in bench.state.own) == 10


def test_a_first_cycle_with_another_controller_ends_the_service(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    assert bench.try_cycle(make_own(bench, "VALVE_COMMAND", 9)) > 0
    bench = CycleBench(cycle)
    assert bench.try_cycle(make_own(bench, "VALVE_COMMAND", 10)) == -Refusal.SECOND_CONTROLLER


def test_in_a_run_another_controller_is_a_fault(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    assert bench.try_cycle(make_own(bench, "VALVE_COMMAND", 9)) > 0
    assert bench.read_column("fault") == Fault.NONE
    assert bench.try_cycle(make_own(bench, "VALVE_COMMAND", 1)) > 0
    assert bench.read_column("fault") == Fault.SECOND_SENDER
    assert bench.state.intruder.period == bench.state.slot
    assert list_rejected(bench)[0] == Refusal.SECOND_CONTROLLER


def test_stray_frames_of_two_kinds_are_counted_together(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    bench.run([*make_own(bench, "VALVE_COMMAND", 4), *make_own(bench, "MOTOR_COMMAND", 5)])
    assert [int(row["received"]) for row in bench.state.own] == [4, 5, 0, 0]
    assert bench.state.intruder.frames == 9


def test_own_frames_that_are_not_valid_are_no_second_controller(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.start()
    can_id = FRAMES["VALVE_COMMAND"].can_id
    bench.run([Frame(can_id, bytes(8)), Frame(can_id, bytes(7))])
    assert (bench.state.own[0]["corrupt"], bench.state.own[0]["misshapen"]) == (1, 1)
    assert bench.state.intruder.frames == 0


def test_controller_b_does_not_own_the_motor(cycle: ModuleType) -> None:
    bench = CycleBench(cycle, "b")
    bench.start()
    bench.run(make_own(bench, "MOTOR_COMMAND", 20))
    assert bench.state.intruder.frames == 0
    assert list_rejected(bench) == (0, 0, 0.0)


# --- claims of the set-points -----------------------------------------------------------------------------------------


def test_the_claim_of_one_supervisor_is_taken_and_that_of_another_is_told(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run([bench.claim(FIRST)])
    assert (int(bench.state.claim.session), int(bench.state.claim.refused)) == (FIRST, 0)
    assert int(bench.state.receptions[4]["received"]) == 1
    assert list_rejected(bench) == (0, 0, 0.0)
    bench.run([bench.claim(SECOND)])
    assert (int(bench.state.claim.session), int(bench.state.claim.refused)) == (FIRST, 1)
    assert int(bench.state.receptions[4]["received"]) == 1, "its counters are its own"
    assert int(bench.state.claim.others["received"]) == 1
    assert list_rejected(bench) == (8, 0x170, float(SECOND))


def test_beside_a_claim_other_frames_are_received_in_their_places(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run([bench.claim(FIRST)])
    bench.run([bench.beat(), *bench.sample(0)])
    assert [int(row["received"]) for row in bench.state.receptions] == [1, 1, 0, 1, 1, 0, 0]
    assert int(bench.state.claim.others["received"]) == 0


def test_a_claim_ages_by_the_time_that_has_passed(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run([bench.claim(FIRST)])
    bench.run([bench.claim(SECOND)])
    assert (float(bench.state.claim.age), float(bench.state.claim.refused_age)) == (PERIOD, 0.0)
    bench.run(slots=3)
    assert (float(bench.state.claim.age), float(bench.state.claim.refused_age)) == (4 * PERIOD, 3 * PERIOD)


def test_a_silent_claim_ends_in_the_cycle_after_its_time(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    bench.run([bench.claim(FIRST)])
    bench.run(slots=RATE // 4)
    assert (int(bench.state.claim.session), bench.read_column("supervisor")) == (FIRST, 1.0)
    bench.run()
    assert (int(bench.state.claim.session), bench.read_column("supervisor")) == (0, 0.0)
    bench = CycleBench(cycle)
    bench.run([bench.claim(FIRST)])
    bench.run([bench.claim(FIRST)], slots=RATE)
    assert int(bench.state.claim.session) == FIRST, "its claim came with the frames of this cycle"


def test_the_heartbeat_tells_whether_the_set_points_are_claimed(cycle: ModuleType) -> None:
    bench = CycleBench(cycle)
    sentence = []
    for claims in ([], [FIRST], [SECOND]):
        bench.state.beat_after = -1
        sent = bench.run([bench.claim(session) for session in claims])
        sentence.append((sent["CONTROLLER_HEARTBEAT"].values.supervisor, bench.read_column("supervisor")))
    assert sentence == [(0, 0.0), (1, 1.0), (2, 2.0)]
