"""Age of commands: the plant uses none that answers a sample too old, or one that has not been."""

import pytest

from plant_sim.node.plant_cycle import COMMAND_AGE, FAULT_TOLERANT_TIME, STALE_CYCLES, Actuators
from plant_sim.node.plant_node import PlantNode
from protocols.can.frames import Frame, load_frames

RATE = 1000  # Hz
OLDEST = round(COMMAND_AGE * RATE)  # ticks
LATCH = round(FAULT_TOLERANT_TIME * RATE)  # cycles
VOLTAGE, ACTUATORS, SPEED = "valve_voltage_v", "actuators", "motor_speed_demand_rad_s"
FRAMES = load_frames()
VALVE, MOTOR = FRAMES["VALVE_COMMAND"], FRAMES["MOTOR_COMMAND"]


def read_value(plant: PlantNode, column: str) -> float:
    return float(plant.record[[one.name for one in plant.columns].index(column)])


def make_valve_frame(count: int, tick: int, enable: int = 1) -> Frame:
    return Frame(VALVE.can_id, VALVE.pack(count, enable, 2.0, VALVE.wrap("sample_tick", tick)))


def make_motor_frame(count: int, tick: int) -> Frame:
    return Frame(MOTOR.can_id, MOTOR.pack(count, 1, MOTOR.wrap("sample_tick", tick), 12.0, 30.0))


def make_plant_at(tick: int) -> PlantNode:
    """A plant whose last sample is `tick`, without a command before."""
    plant = PlantNode(rate=RATE)
    while plant.tick < tick:
        plant.step([])
    return plant


@pytest.mark.parametrize("tick", [20, 125, 1021])  # before the ticks of a command wrap, and after
@pytest.mark.parametrize(("age", "used"), [(0, True), (OLDEST, True), (OLDEST + 1, False), (100, False), (-1, False)])
def test_a_command_is_used_up_to_its_age(tick: int, age: int, used: bool) -> None:
    plant = make_plant_at(tick + 5)
    plant.step([make_valve_frame(1, plant.tick - age), make_motor_frame(1, plant.tick - age)])
    assert read_value(plant, VOLTAGE) == pytest.approx(2.0 if used else 0.0, abs=1e-3)
    assert (read_value(plant, SPEED) == pytest.approx(12.0)) is used
    unusable = [plant.count_receptions()[name]["unusable"] for name in ("VALVE_COMMAND", "MOTOR_COMMAND")]
    assert unusable == [0, 0] if used else [1, 1]
    assert plant.first_rejected.startswith("" if used else "frame VALVE_COMMAND (0x080) answers a sample of ")


def test_a_command_to_close_is_never_too_late() -> None:
    plant = make_plant_at(50)
    plant.step([make_valve_frame(1, 50)])
    assert read_value(plant, VOLTAGE) > 1.9
    plant.step([make_valve_frame(2, 20, enable=0)])
    assert read_value(plant, VOLTAGE) == 0.0


def test_without_commands_the_valve_closes_and_stays_closed_until_a_command_to_close() -> None:
    plant = make_plant_at(50)
    plant.step([make_valve_frame(1, 50)])
    for age in range(1, LATCH + 5):
        plant.step([])
        expected = Actuators.COMMANDED if age < STALE_CYCLES else Actuators.STALE if age < LATCH else Actuators.LOST
        assert read_value(plant, ACTUATORS) == expected
        assert (read_value(plant, VOLTAGE) > 1.9) is (age < STALE_CYCLES)
    for count in (2, 3):
        plant.step([make_valve_frame(count, plant.tick)])
        assert (read_value(plant, ACTUATORS), read_value(plant, VOLTAGE)) == (Actuators.LOST, 0.0)
    plant.step([make_valve_frame(4, plant.tick, enable=0)])
    assert read_value(plant, ACTUATORS) == Actuators.COMMANDED
    plant.step([make_valve_frame(5, plant.tick)])
    assert read_value(plant, VOLTAGE) > 1.9


def test_a_controller_that_has_ended_in_order_leaves_nothing_latched() -> None:
    plant, beat = make_plant_at(50), FRAMES["CONTROLLER_HEARTBEAT"]
    plant.step([make_valve_frame(1, 50), Frame(beat.can_id, beat.pack(1, lifecycle=3, rate=RATE, session=1))])
    for _ in range(3 * LATCH):
        plant.step([])
    assert read_value(plant, ACTUATORS) == Actuators.STALE


@pytest.mark.parametrize(("rate", "oldest", "latch"), [(50, 2, 6), (400, 4, 6), (1000, 10, 15), (4000, 40, 60)])
def test_limits_follow_the_rate(rate: int, oldest: int, latch: int) -> None:
    settings = PlantNode(rate=rate)._settings[0]
    assert (settings["oldest"], settings["latch_after"]) == (oldest, latch)
