"""Samples that the plant begins and shows: its frames, and when it closes a valve. Each test has the module as argument, so
that it can run on mutants (tests/mutation)."""

from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

import plant_sim.node.plant_cycle
from plant_sim.node.injection import switch_on
from plant_sim.node.plant_cycle import Actuators
from plant_sim.node.schedule import Schedule
from protocols.can.lifecycle import Lifecycle
from protocols.can.reception import REJECTED
from tests.mutation.plain import is_plain, view_records
from tests.plant_sim.plant_bench import FRAMES, NOMINAL, RATE, VOLT, PlantBench, read_names

LATCH = 15  # cycles: FAULT_TOLERANT_TIME at 1024 Hz
STALE = 5  # cycles


@pytest.fixture(scope="module")
def plant_cycle() -> ModuleType:
    return plant_sim.node.plant_cycle


def read_status(bench: PlantBench) -> Any:
    """The plant's status in a sample of its own."""
    bench.settings.status_every = 1
    return next(one.values for one in bench.begin(bench.tick + 1) if one.name == "PLANT_STATUS")


# --- when a valve closes ---------------------------------------------------------------------------------------------


def test_a_valve_closes_after_five_cycles_without_a_command(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    bench.take(bench.valve(3), bench.motor(3))
    for age in range(LATCH + 3):
        clutch = bench.sample(4 + age)
        expected = Actuators.COMMANDED if age < STALE else Actuators.STALE if age < LATCH else Actuators.LOST
        assert (clutch.actuators, clutch.age) == (expected, age + 1)
        assert clutch.voltage == (VOLT if age < STALE else 0.0)
        assert clutch.latched == (Actuators.LOST if age >= LATCH else 0)
        motor = (bench.state.speed_demand, bench.state.torque_limit)
        assert motor == ((5.0, 20.0) if age < STALE else (0.0, 0.0)), age


def test_after_late_commands_alone_a_valve_stays_closed_as_late(plant_cycle: ModuleType) -> None:
    for late, latched in ((0, Actuators.LOST), (1, Actuators.LATE), (2, Actuators.LATE)):
        bench = PlantBench(plant_cycle)
        bench.go_to(3)
        bench.take(bench.valve(3))
        bench.clutch.age, bench.clutch.late = LATCH, late
        assert bench.sample(4).latched == latched


def test_a_controller_that_has_ended_in_order_leaves_no_latch(plant_cycle: ModuleType) -> None:
    for lifecycle in Lifecycle:
        bench = PlantBench(plant_cycle)
        bench.go_to(3)
        bench.take(bench.valve(3))
        bench.clutch.age, bench.clutch.controller = LATCH, lifecycle
        assert bench.sample(4).latched == (0 if lifecycle is Lifecycle.FINALIZED else Actuators.LOST), lifecycle


def test_before_a_first_command_nothing_is_latched(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.begin(0)
    bench.clutch.age = 2 * LATCH
    bench.show()
    assert (bench.clutch.latched, bench.clutch.actuators, bench.clutch.age) == (0, Actuators.SAFE, 2 * LATCH + 1)


def test_a_doubted_sender_closes_the_valve(plant_cycle: ModuleType) -> None:
    for of_valve, of_motor, latched in ((49, 49, 0), (50, 0, 5), (51, 0, 5), (0, 50, 5), (0, 51, 5)):
        bench = PlantBench(plant_cycle)
        bench.go_to(3)
        bench.take(bench.valve(3))
        bench.clutch.valve["doubts"], bench.state.motor["doubts"] = of_valve, of_motor
        clutch = bench.sample(4)
        assert clutch.latched == latched, (of_valve, of_motor)
        assert clutch.voltage == (0.0 if latched else VOLT)


def test_a_doubted_motor_closes_the_valve_of_clutch_a_only(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle, clutches=2)
    bench.begin(0)
    bench.state.motor["doubts"] = 50
    bench.show(1)
    assert [int(clutch.latched) for clutch in bench.state.clutches] == [0, 0]
    bench.show(0)
    assert [int(clutch.latched) for clutch in bench.state.clutches] == [Actuators.TWO_SENDERS, 0]


def test_a_gap_of_commands_is_kept_for_a_second(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    bench.take(bench.valve(3))
    expected = 0
    for age in range(LATCH):
        expected = max(expected + (RATE if age == STALE else 0) - 1, 0)
        assert bench.sample(4 + age).gaps == expected
    bench.take(bench.valve(bench.tick))
    assert bench.clutch.gaps == expected, "a command to open the valve ends the gap, not the memory of it"
    bench.take(bench.valve(bench.tick, on=0))
    assert bench.clutch.gaps == 0


def test_a_computer_that_stands_still_in_a_gap_makes_no_second_gap_of_it(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.go_to(3)
    bench.take(bench.valve(3))
    for _ in range(STALE + 1):
        before = int(bench.sample(bench.tick + 1).gaps)
    assert before == RATE - 1
    bench.skip(20)
    for _ in range(20):
        clutch = bench.sample(bench.tick + 1)
        assert clutch.gaps == before - 1, "no new gap"
        assert clutch.actuators == Actuators.STALE, "no command has come"
        before -= 1
    bench.take(bench.valve(bench.tick))
    assert bench.sample(bench.tick + 1).actuators == Actuators.COMMANDED


def test_a_clutch_that_was_never_commanded_has_no_gap(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.begin(0)
    bench.clutch.age = STALE
    bench.show()
    assert bench.clutch.gaps == 0


def test_the_fourth_gap_in_about_a_second_is_a_lost_connection(plant_cycle: ModuleType) -> None:
    for before, latched in ((2 * RATE, 0), (2 * RATE + 1, Actuators.LOST)):  # of the gaps before this one
        bench = PlantBench(plant_cycle)
        bench.go_to(3)
        bench.take(bench.valve(3))
        bench.clutch.age, bench.clutch.gaps = STALE, before
        clutch = bench.sample(4)
        assert (clutch.latched, clutch.gaps) == (latched, before + RATE - 1)
        assert clutch.actuators == (latched or Actuators.STALE)


def test_a_latch_is_what_the_plant_tells(plant_cycle: ModuleType) -> None:
    for latched in (Actuators.LOST, Actuators.LATE, Actuators.TWO_SENDERS):
        bench = PlantBench(plant_cycle)
        bench.go_to(3)
        bench.clutch.latched = latched
        assert bench.sample(4).actuators == Actuators.SAFE  # never commanded
        bench.take(bench.valve(4))
        clutch = bench.sample(5)
        assert (clutch.actuators, clutch.voltage) == (latched, 0.0)


# --- frames of the plant ---------------------------------------------------------------------------------------------


def test_heartbeat_and_status_keep_their_rate(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.settings.heartbeat_every, bench.settings.status_every = 3, 4
    names = [read_names(bench.begin(tick)) for tick in range(13)]
    assert [tick for tick, sent in enumerate(names) if "PLANT_HEARTBEAT" in sent] == [0, 3, 6, 9, 12]
    assert [tick for tick, sent in enumerate(names) if "PLANT_STATUS" in sent] == [0, 4, 8, 12]
    assert names[12] == ["PLANT_HEARTBEAT", "PLANT_STATUS"]
    assert bench.state.tick == 12


def test_counters_of_heartbeat_and_status(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle)
    bench.settings.heartbeat_every = bench.settings.status_every = 2
    for number, tick in enumerate((0, 2, 4)):
        beat, status = bench.begin(tick)
        assert (beat.counter, status.counter) == (number + 1, number)
        assert beat.values == (Lifecycle.ACTIVE, RATE, 7)
    assert bench.state.beats == 3


def test_the_status_tells_late_cycles_and_rejected_frames(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle, clutches=2)
    bench.late_cycles = 300
    assert read_status(bench) == (Actuators.SAFE, 300, 0)
    rows = [bench.state.motor, *bench.state.own]
    rows += [row for clutch in bench.state.clutches for row in (clutch.valve, clutch.heartbeat)]
    total = 0
    for number, row in enumerate(rows, 1):
        row[REJECTED[number % len(REJECTED)]] = number
        total += number
        assert read_status(bench).rejected_frames == total
    bench.state.own[0]["received"] = 1000  # of another plant
    bench.state.motor["received"] = 500
    assert read_status(bench).rejected_frames == total + 1000


def test_the_status_tells_the_worse_of_both_clutches(plant_cycle: ModuleType) -> None:
    for a, b in ((0, 0), (Actuators.LOST, 0), (0, Actuators.LATE), (Actuators.TWO_SENDERS, Actuators.LOST)):
        bench = PlantBench(plant_cycle, clutches=2)
        for clutch, latched in zip(bench.state.clutches, (a, b), strict=True):
            clutch.commanded, clutch.latched = True, latched
        assert read_status(bench).actuators == max(a, b, Actuators.COMMANDED)


def test_without_commands_of_clutch_a_the_motor_stops(plant_cycle: ModuleType) -> None:
    for k, stops in ((0, True), (1, False)):
        bench = PlantBench(plant_cycle, clutches=2)
        bench.state.speed_demand, bench.state.torque_limit = 5.0, 20.0
        bench.state.clutches[k].commanded, bench.state.clutches[k].age = True, STALE
        bench.begin(0)
        assert (bench.state.speed_demand, bench.state.torque_limit) == ((0.0, 0.0) if stops else (5.0, 20.0))


# --- set-points ------------------------------------------------------------------------------------------------------


def make_table(torque: float, speed: float, pressure: float) -> list[list[float]]:
    """Rows at 0 s and 1024 s, with constant values but for the speed, which rises."""
    return [[0.0, 1024.0], [torque, torque], [speed, speed + 1024.0], [pressure, pressure], [0.0, 0.0]]


def test_set_points_are_those_of_the_profile(plant_cycle: ModuleType) -> None:
    tables = np.array([make_table(12.0, 1.0, 0.0), make_table(7.0, 2.0, 3.0)])
    bench = PlantBench(plant_cycle, 2, tables)
    bench.settings.heartbeat_every = bench.settings.status_every = bench.settings.claim_every = 1 << 20
    tick = 2 * RATE
    a, b = bench.begin(tick)
    assert (a.name, b.name) == ("TORQUE_SETPOINT", "TORQUE_SETPOINT_B")
    assert (a.counter, b.counter) == (tick % 256, tick % 256)
    assert a.values == pytest.approx((1, 12.0, 3.0, 0.0))
    assert b.values == pytest.approx((3, 7.0, 4.0, 3.0))
    assert [float(clutch.torque_demand) for clutch in bench.state.clutches] == [12.0, 7.0]
    assert bench.begin(tick + RATE)[0].values.speed_demand == pytest.approx(4.0)  # 1 s later


def test_frames_of_a_sample_follow_each_other(plant_cycle: ModuleType) -> None:
    bench = PlantBench(plant_cycle, 1, np.array([make_table(12.0, 1.0, 0.0)]))
    sent = bench.begin(0)
    assert read_names(sent) == ["PLANT_HEARTBEAT", "PLANT_STATUS", "SUPERVISOR_CLAIM", "TORQUE_SETPOINT"]
    assert read_names(bench.show(0, len(sent))) == ["ANALOG_SENSORS", "ENCODER"]
    assert read_names(bench.read(0, 6))[:4] == read_names(sent)


def test_set_points_are_claimed_at_their_rate(plant_cycle: ModuleType) -> None:
    tables = np.array([make_table(12.0, 1.0, 0.0), make_table(7.0, 2.0, 3.0)])
    bench = PlantBench(plant_cycle, 2, tables)
    bench.settings.heartbeat_every = bench.settings.status_every = 1 << 20
    bench.settings.claim_every = 3
    sent = [[one for one in bench.begin(tick) if "CLAIM" in one.name] for tick in range(1, 8)]
    assert [read_names(claims) for claims in sent] == [
        [], [], ["SUPERVISOR_CLAIM", "SUPERVISOR_CLAIM_B"], [], [], ["SUPERVISOR_CLAIM", "SUPERVISOR_CLAIM_B"], [],
    ]  # fmt: skip
    assert [(one.counter, one.values.claim, one.values.session) for one in (*sent[2], *sent[5])] == [
        (1, 1, 0x8007), (1, 1, 0x8007), (2, 1, 0x8007), (2, 1, 0x8007),
    ]  # fmt: skip


def test_a_plant_without_a_profile_claims_nothing(plant_cycle: ModuleType) -> None:
    assert "SUPERVISOR_CLAIM" not in read_names(PlantBench(plant_cycle).begin(0))


# --- sensors ---------------------------------------------------------------------------------------------------------


def make_sensing(plant_cycle: ModuleType) -> PlantBench:
    """A bench whose sensors read 3 bar, 70 degC, 10 Nm of the clutch and 12 Nm of the motor."""
    bench = PlantBench(plant_cycle, clutches=2)
    y = bench.y.view(np.recarray)[0]
    y.sensed_pressure, y.sensed_temperature = 3.0e5, 343.15
    y.sensed_clutch_torque, y.sensed_motor_torque, y.slip_speed, y.angle = 10.0, 12.0, 4.5, 1.0
    return bench


def test_sensors_are_shown_and_kept(plant_cycle: ModuleType) -> None:
    bench = make_sensing(plant_cycle)
    bench.begin(1500)
    analog, encoder = bench.show()
    clutch = bench.clutch
    assert (analog.counter, encoder.counter) == (1500 % 256, 1500 % 256)
    assert encoder.values.sample_tick == 1500 % 1024
    shown = (analog.values.cylinder_pressure, analog.values.oil_temperature, analog.values.clutch_torque)
    assert shown == pytest.approx((3.0, 70.0, 10.0), abs=0.5)
    assert (clutch.pressure, clutch.temperature, clutch.clutch_torque) == pytest.approx(shown, rel=1e-12)
    assert encoder.values.motor_torque == clutch.motor_torque == pytest.approx(12.0, abs=0.5)
    assert encoder.values.shaft_angle == pytest.approx(1.0, abs=1e-3)


def test_the_noise_of_each_clutch_is_its_own(plant_cycle: ModuleType) -> None:
    bench = make_sensing(plant_cycle)
    bench.begin(0)
    for k, seed in ((0, 1), (1, 2)):
        bench.show(k)
        expected = np.random.default_rng(seed).standard_normal(4)
        np.testing.assert_array_equal(bench.state.clutches[k].noise, expected)


def test_the_slip_is_the_difference_of_two_counts(plant_cycle: ModuleType) -> None:
    bench = make_sensing(plant_cycle)
    step = FRAMES["ENCODER"].scale["shaft_angle"]
    bench.begin(0)
    bench.show()
    clutch = bench.clutch
    assert (clutch.slip_speed, clutch.angle, bool(clutch.begun)) == (4.5, 0.0, True)  # the true one in the first sample
    before, total = int(clutch.count), 0
    for tick, angle in enumerate((1.1, 0.7, 4.0), 1):
        bench.y["angle"] = angle
        bench.begin(tick)
        bench.show()
        counts = int(bench.clutch.count) - before
        before, total = int(bench.clutch.count), total + counts
        assert bench.clutch.slip_speed == pytest.approx(counts * step * RATE, rel=1e-12)
        assert bench.clutch.angle == pytest.approx(total * step, rel=1e-12)
        assert abs(counts * step - (angle - (1.0, 1.1, 0.7)[tick - 1])) < 2 * step


def test_the_states_of_the_effects_advance_in_place(plant_cycle: ModuleType) -> None:
    """Effects need a compiler: without one a made-up sensor takes their place."""
    bench = PlantBench(plant_cycle)
    bench.begin(0)
    memory, outbox = (bench.node._interfaces, bench.node._settings), view_records(bench.node.outbox)
    if is_plain():
        states = np.array([1.0, 2.0])
        sensed = patch.object(plant_cycle, "acquire", lambda y, before, *_: ((1, 2, 3, 4, 5), before + 1.0))
        with sensed:
            plant_cycle.show(*map(view_records, memory), 0, 0, view_records(bench.y), states, None, None, outbox, 0)
        assert states.tolist() == [2.0, 3.0]
        return
    rig, _ = Schedule(NOMINAL.with_values(switch_on("dc_restoration"))).make_rig(0.0)
    _, states = rig.make_rest_state(0.0, 343.15)
    before = states.copy()
    bench.y["sensed_pressure"] = 2.0e5
    plant_cycle.show(*memory, 0, 0, bench.y, states, rig.record, rig.table.kernel, outbox, 0)
    assert (states != before).any()


def test_the_bounds_are_those_that_were_chosen(plant_cycle: ModuleType) -> None:
    assert (plant_cycle.COMMAND_AGE, plant_cycle.FAULT_TOLERANT_TIME, plant_cycle.STALE_CYCLES) == (0.01, 0.015, 5)
    assert plant_cycle.OUTBOX == 10  # heartbeat, status; claim, set-point, analog and encoder of two clutches
