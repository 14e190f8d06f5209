"""Commands and heartbeats that the plant takes, counts or refuses. Each test has the module as argument, so that it can run on
mutants (tests/mutation)."""

from types import ModuleType

import pytest

import plant_sim.node.plant_cycle
from plant_sim.node.plant_cycle import Actuators, Refusal
from protocols.can.frames import Frame
from tests.plant_sim.plant_bench import BEAT, FRAMES, FRAMES_B, MOTOR, RATE, VALVE, VOLT, PlantBench

OLDEST = 10  # ticks: COMMAND_AGE at 1024 Hz


@pytest.fixture(scope="module")
def plant_cycle() -> ModuleType:
    return plant_sim.node.plant_cycle


# --- the valve -------------------------------------------------------------------------------------------------------


def test_a_valve_command_is_followed(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    assert bench.take(bench.valve(3)) == 0
    clutch = bench.clutch
    assert (clutch.voltage, clutch.answered_tick, clutch.age, clutch.late) == (VOLT, 3, 0, 0)
    assert clutch.commanded
    assert bench.list_rejected() == (0, 0, 0, 0)


def test_a_valve_that_is_not_enabled_is_closed(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    bench.take(bench.valve(3))
    bench.take(bench.valve(3, on=0))
    assert (bench.clutch.voltage, bench.clutch.answered_tick) == (0.0, 3)


def test_the_converter_drops_the_lowest_bits(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.settings.clutches["dac_bits"] = 8
    bench.settings.clutches["dac_range"] = 5.0
    bench.take(bench.valve(0, counts=16384 + 255))
    assert bench.clutch.voltage == 64 * 5.0 / 256


def test_a_valve_command_may_answer_a_sample_of_ten_ticks_ago(plant_cycle: ModuleType) -> None:
    for age, used in ((0, True), (OLDEST, True), (OLDEST + 1, False), (-1, False)):
        bench = PlantBench(plant_cycle)
        bench.go_to(20)
        bench.take(bench.valve(20 - age))
        assert bench.clutch.voltage == (VOLT if used else 0.0), age
        assert bool(bench.clutch.commanded) is used
        assert bench.clutch.late == (0 if used else 1)
        assert bench.clutch.valve["unusable"] == (0 if used else 1)
        rejected = (Refusal.AGE, VALVE.can_id, age & 0x3FF, 0)
        assert bench.list_rejected() == ((0, 0, 0, 0) if used else rejected)
    assert bench.settings.oldest == OLDEST


def test_before_the_first_sample_no_command_is_late(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.take(bench.valve(100), bench.motor(100))
    assert (bench.clutch.voltage, bench.state.speed_demand) == (VOLT, 5.0)


def test_the_first_sample_may_be_answered_late(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(0)
    bench.take(bench.valve(500))
    assert bench.clutch.late == 1


def test_late_commands_are_counted_until_one_is_used(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(50)
    bench.take(bench.valve(50))
    bench.clutch.age = 3
    for late in (1, 2):
        bench.take(bench.valve(5))
        assert (bench.clutch.late, bench.clutch.voltage, bench.clutch.age) == (late, VOLT, 3)
    assert bench.clutch.answered_tick == 50
    bench.take(bench.valve(45))
    assert (bench.clutch.late, bench.clutch.answered_tick, bench.clutch.age) == (0, 45, 0)


def test_a_late_command_may_close_the_valve(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(50)
    bench.take(bench.valve(50))
    bench.take(bench.valve(5, on=0))
    assert (bench.clutch.voltage, bench.clutch.late) == (0.0, 1)


def test_a_latched_valve_opens_after_a_command_to_close(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    bench.clutch.latched = Actuators.LOST
    bench.take(bench.valve(3))
    assert (bench.clutch.voltage, bench.clutch.latched, bench.clutch.answered_tick) == (0.0, Actuators.LOST, 3)
    bench.take(bench.valve(3, on=0))
    assert (bench.clutch.voltage, bench.clutch.latched) == (0.0, 0)
    bench.take(bench.valve(3))
    assert bench.clutch.voltage == VOLT


def test_a_late_command_to_close_leaves_the_latch(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(50)
    bench.clutch.latched = Actuators.LOST
    bench.take(bench.valve(5, on=0))
    assert bench.clutch.latched == Actuators.LOST


def test_commands_that_are_not_valid_are_not_followed(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    for frame in (bench.valve(3), bench.motor(3), bench.beat()):
        assert bench.take(Frame(frame.can_id, frame.data[:7] + bytes([frame.data[7] ^ 1]))) == 0
    assert (bench.clutch.voltage, bench.state.speed_demand, bench.clutch.controller) == (0.0, 0.0, 0)
    assert [int(row["corrupt"]) for row in (bench.clutch.valve, bench.state.motor, bench.clutch.heartbeat)] == [1, 1, 1]
    assert bench.list_rejected() == (0, 0, 0, 0)


def test_another_length_is_told(plant_cycle: ModuleType) -> None:
    b = {name: FRAMES_B[name] for name in ("VALVE_COMMAND", "CONTROLLER_HEARTBEAT")}
    for codec, k in ((VALVE, 0), (MOTOR, 0), (BEAT, 0), (b["VALVE_COMMAND"], 1), (b["CONTROLLER_HEARTBEAT"], 1)):
        bench = PlantBench(plant_cycle, clutches=2)
        bench.go_to(3)
        assert bench.take(Frame(codec.can_id, bytes(5))) == 0
        assert bench.list_rejected() == (Refusal.LENGTH, codec.can_id, 5, k)
        bench.take(Frame(codec.can_id, bytes(4)))
        assert bench.list_rejected() == (Refusal.LENGTH, codec.can_id, 5, k)  # the first stays


def test_commands_out_of_sequence_are_doubted(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.take(bench.valve(0))
    bench.counters[VALVE.can_id] += 20
    bench.take(bench.valve(0, counts=20000))
    assert (bench.clutch.voltage, bench.clutch.valve["doubts"]) == (VOLT, 10)


def test_what_is_not_for_the_plant_is_left_alone(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    assert bench.take(Frame(0x123, bytes(8)), bench.valve(0, codec=FRAMES_B["VALVE_COMMAND"])) == 0
    assert (bench.clutch.voltage, bool(bench.clutch.commanded)) == (0.0, False)
    assert bench.state.period == 1
    assert bench.list_rejected() == (0, 0, 0, 0)


def test_all_frames_of_a_batch_are_taken(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    bench.take(bench.motor(3), bench.valve(3), bench.beat())
    assert (bench.state.speed_demand, bench.clutch.voltage, bench.clutch.controller) == (5.0, VOLT, 2)


# --- two clutches ----------------------------------------------------------------------------------------------------


def test_each_clutch_follows_its_own_controller(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle, clutches=2)
    bench.go_to(3)
    bench.state.clutches[1].latched = Actuators.LOST
    bench.take(
        bench.valve(3, on=0, codec=FRAMES_B["VALVE_COMMAND"]), bench.beat(codec=FRAMES_B["CONTROLLER_HEARTBEAT"])
    )
    bench.take(bench.valve(2, codec=FRAMES_B["VALVE_COMMAND"]))
    a, b = bench.state.clutches
    assert (a.voltage, a.controller, a.answered_tick) == (0.0, 0, -1)
    assert (b.voltage, b.controller, b.answered_tick) == (VOLT, 2, 2)
    bench.take(bench.valve(3, counts=8192))
    a, b = bench.state.clutches
    assert (a.voltage, b.voltage) == (VOLT / 2, VOLT)


def test_faults_of_clutch_b_are_told_as_its_own(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle, clutches=2)
    bench.go_to(50)
    bench.take(bench.valve(5, codec=FRAMES_B["VALVE_COMMAND"]))
    assert bench.list_rejected() == (Refusal.AGE, FRAMES_B["VALVE_COMMAND"].can_id, 45, 1)
    bench = PlantBench(plant_cycle, clutches=2)
    bench.take(bench.beat(lifecycle=4, codec=FRAMES_B["CONTROLLER_HEARTBEAT"]))
    assert bench.list_rejected() == (Refusal.LIFECYCLE, FRAMES_B["CONTROLLER_HEARTBEAT"].can_id, 4, 1)
    bench = PlantBench(plant_cycle, clutches=2)
    assert bench.take(bench.beat(rate=5, codec=FRAMES_B["CONTROLLER_HEARTBEAT"])) == Refusal.RATE
    assert bench.state.refused_clutch == 1


# --- the motor -------------------------------------------------------------------------------------------------------


def test_a_motor_command_is_followed(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    assert bench.take(bench.motor(3)) == 0
    assert (bench.state.speed_demand, bench.state.torque_limit) == (5.0, 20.0)
    bench.take(bench.motor(3, on=0))
    assert (bench.state.speed_demand, bench.state.torque_limit) == (0.0, 0.0)


def test_a_motor_command_may_answer_a_sample_of_ten_ticks_ago(plant_cycle: ModuleType) -> None:
    for age, used in ((0, True), (OLDEST, True), (OLDEST + 1, False), (-1, False)):
        bench = PlantBench(plant_cycle)
        bench.go_to(20)
        bench.take(bench.motor(20 - age))
        assert bench.state.speed_demand == (5.0 if used else 0.0), age
        assert bench.state.motor["unusable"] == (0 if used else 1)
        rejected = (Refusal.AGE, MOTOR.can_id, age & 0x7F, 0)
        assert bench.list_rejected() == ((0, 0, 0, 0) if used else rejected)


# --- heartbeats ------------------------------------------------------------------------------------------------------


def test_the_state_of_a_controller_is_that_of_its_heartbeat(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    for lifecycle in (1, 2, 3):
        assert bench.take(bench.beat(lifecycle=lifecycle)) == 0
        assert bench.clutch.controller == lifecycle
    for lifecycle in (4, 7):
        assert bench.take(bench.beat(lifecycle=lifecycle)) == 0
        assert bench.clutch.controller == 3
    assert bench.clutch.heartbeat["unusable"] == 2
    assert bench.list_rejected() == (Refusal.LIFECYCLE, BEAT.can_id, 4, 0)


def test_before_a_first_command_another_rate_is_refused_at_once(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    assert bench.take(bench.beat(RATE + 1)) == Refusal.RATE
    assert (bench.state.refused_id, bench.state.refused_value, bench.state.refused_clutch) == (BEAT.can_id, RATE + 1, 0)
    assert bench.list_rejected() == (Refusal.RATE, BEAT.can_id, RATE + 1, 0)
    assert bench.clutch.controller == 0
    assert bench.clutch.wrong_rates == 1


def test_in_a_run_another_rate_closes_the_valve_after_three_heartbeats(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    bench.take(bench.valve(3), bench.beat())
    for rate, wrong, latched in (
        (RATE + 1, 1, 0), (RATE - 1, 2, 0), (RATE, 0, 0), (7, 1, 0), (7, 2, 0), (7, 3, Actuators.TWO_SENDERS),
        (7, 4, Actuators.TWO_SENDERS),
    ):  # fmt: skip
        assert bench.take(bench.beat(rate, lifecycle=3)) == 0
        assert (bench.clutch.wrong_rates, bench.clutch.latched) == (wrong, latched)
        assert bench.clutch.controller == (3 if rate == RATE else 2)
        bench.clutch.controller = 2
    assert bench.list_rejected() == (Refusal.RATE, BEAT.can_id, 7, 0)


def test_a_refused_frame_in_a_run_closes_all_valves(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle, clutches=2)
    bench.go_to(0)
    assert bench.take(bench.beat(RATE + 1)) == 0
    assert [int(clutch.latched) for clutch in bench.state.clutches] == 2 * [Actuators.TWO_SENDERS]


# --- a second plant --------------------------------------------------------------------------------------------------


def make_own(bench: PlantBench, name: str, count: int) -> list[Frame]:
    """Frames that another plant sends on an identifier of this one."""
    return [bench.make(FRAMES[name]) for _ in range(count)]


def test_ten_frames_of_another_plant_end_a_start(plant_cycle: ModuleType) -> None:
    for name in ("PLANT_HEARTBEAT", "PLANT_STATUS", "ANALOG_SENSORS", "ENCODER"):
        bench = PlantBench(plant_cycle)
        assert bench.take(*make_own(bench, name, 9)) == 0
        assert bench.take(*make_own(bench, name, 1), bench.valve(0)) == Refusal.SECOND_PLANT
        assert (bench.state.refused_id, bench.state.refused_value) == (FRAMES[name].can_id, 0)
        assert bench.list_rejected() == (Refusal.SECOND_PLANT, FRAMES[name].can_id, 0, 0)
        assert not bench.clutch.commanded  # the first refusal ends it
        assert bench.state.intruder.period == bench.state.period == 2


def test_in_a_run_another_plant_closes_the_valve(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(0)
    assert bench.take(*make_own(bench, "ENCODER", 9)) == 0
    assert bench.clutch.latched == 0
    assert bench.take(*make_own(bench, "ENCODER", 1), bench.beat()) == 0
    assert (bench.clutch.latched, bench.clutch.controller) == (Actuators.TWO_SENDERS, 2)


def test_own_frames_that_are_not_valid_are_no_second_plant(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    can_id = FRAMES["ENCODER"].can_id
    assert bench.take(Frame(can_id, bytes(8)), Frame(can_id, bytes(7))) == 0
    assert bench.state.intruder.frames == 0
    assert sum(int(row["misshapen"]) + int(row["corrupt"]) for row in bench.state.own) == 2


# --- missed periods --------------------------------------------------------------------------------------------------


def test_missed_periods_together_age_a_command_by_one(plant_cycle: ModuleType) -> None:
    for periods, age in ((0, 9), (1, 9), (2, 8), (5, 5)):
        bench = PlantBench(plant_cycle, clutches=2)
        for clutch in bench.state.clutches:
            clutch.age = 9
        bench.skip(periods)
        assert [int(clutch.age) for clutch in bench.state.clutches] == [age, age]
    bench = PlantBench(plant_cycle)
    bench.skip(5)
    assert [int(clutch.age) for clutch in bench.state.clutches] == [-4, 0]  # of one clutch there is one
