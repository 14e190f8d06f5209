"""The plant's compiled interface against the codecs and the sensors of which it is made; what it costs memory."""

import subprocess
import sys

import numpy as np
import pytest

from plant_sim.node.injection import switch_on
from plant_sim.node.interface import Interface
from plant_sim.node.plant_cycle import Actuators
from plant_sim.node.plant_node import PlantNode
from plant_sim.node.power_shift_node import PowerShiftNode
from plant_sim.node.power_shift_record import RECORD
from plant_sim.profiles.profile import load_profile
from plant_sim.profiles.shift_profile import load_shift_profile
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.sensors import Counts, Sensors
from protocols.can.claim import make_claim_session
from protocols.can.frames import Frame, load_frames
from protocols.can.reception import INTRUSION, REJECTED, WRONG_RATES
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError
from protocols.node import load_node
from tests.memory import measure_growth

FRAMES = load_frames()
ANALOG, ENCODER, SETPOINT = (FRAMES[name] for name in ("ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT"))
VALVE, MOTOR, BEAT = (FRAMES[name] for name in ("VALVE_COMMAND", "MOTOR_COMMAND", "CONTROLLER_HEARTBEAT"))
STATUS = FRAMES["PLANT_STATUS"]


def find_payload(frames: list[Frame], codec) -> bytes:
    (data,) = (data for can_id, data in frames if can_id == codec.can_id)
    return data


@pytest.mark.parametrize("kind", [PlantNode, PowerShiftNode])
def test_a_sample_fills_every_column(kind: type[Interface]) -> None:
    node = kind()
    for _ in range(3):
        node.record[:] = np.nan
        node.step([])
    empty = [column.name for column, value in zip(node.columns, node.make_row(), strict=True) if np.isnan(value)]
    assert not empty


def test_a_record_of_two_clutches_is_the_row_by_name() -> None:
    """Each clutch has a part of its own, where the columns have its name."""
    node = PowerShiftNode()
    node.step([])
    row = dict(zip((column.name for column in node.columns), node.make_row(), strict=True))
    for clutch in CLUTCHES:
        part = node.record.view(RECORD)[clutch]
        for name in ("truth_oil_temperature_degc", "valve_voltage_v"):
            quantity, unit = name.rsplit("_", 1)
            assert part[name][0] == row[f"{quantity}_{clutch}_{unit}"]
    assert list(row)[-1] == RECORD.names[-1]


def test_actuators_are_numbered_as_in_the_dbc() -> None:
    choices = FRAMES["PLANT_STATUS"].list_choices("actuators")
    assert {value: name.upper().replace(" ", "_") for value, name in choices.items()} == {
        a.value: a.name for a in Actuators
    }


def list_analog_counts(counts: Counts) -> dict[str, int]:
    return {
        "cylinder_pressure": counts.pressure, "oil_temperature": counts.temperature, "clutch_torque": counts.clutch_torque,
    }  # fmt: skip


def list_encoder_signals(counts: Counts, tick: int) -> dict[str, int]:
    angle = (counts.encoder + 2**17) % 2**18 - 2**17
    return {
        "shaft_angle": angle, "sample_tick": ENCODER.wrap("sample_tick", tick), "motor_torque": counts.motor_torque,
    }  # fmt: skip


@pytest.mark.parametrize("effect", [None, "pressure_sensor_gain", "channel_skew"])
def test_frames_are_what_sensors_and_codecs_make_of_the_rig(effect: str | None) -> None:
    parameters = wet_clutch.load_nominal().with_values(switch_on(effect) if effect else {})
    profile = load_profile("engagement", 3.0)
    plant, controller = PlantNode(parameters=parameters, profile=profile, seed=5), load_node("controller")()
    setpoint = SETPOINT.bind(make_claim_session(1))
    rig, sensors = wet_clutch.Rig(parameters), Sensors(seed=5)
    state = rig.make_rest_state(profile.interpolate(0.0).speed, parameters["oil.reference"].si)
    inbox: list[Frame] = []
    voltage, speed, limit = 0.0, profile.interpolate(0.0).speed, rig.record["motor_torque_limit"][0]
    for tick in range(3000):
        for can_id, data in inbox:
            if can_id == VALVE.can_id:
                command = VALVE.unpack(data)
                # the converter's steps are the frame's
                voltage = command.valve_voltage if command.valve_enable else 0.0
            if can_id == MOTOR.can_id:
                asked = MOTOR.unpack(data)
                speed, limit = (asked.speed_demand, asked.torque_limit) if asked.motor_enable else (0.0, 0.0)
        frames = plant.step(inbox)
        counts, state = sensors.sample(rig, state, 1e-3)
        for codec, sensed in (
            (ANALOG, list_analog_counts(counts)),
            (ENCODER, list_encoder_signals(counts, tick)),
        ):
            data = find_payload(frames, codec)
            others = codec.raw(data)._asdict()  # signals of the frame that are no sensor's
            assert data == codec.pack_raw(tick, **others | sensed)
        assert find_payload(frames, SETPOINT) == setpoint.pack(tick, *profile.interpolate(tick * 1e-3))
        state = rig.advance(state, voltage, speed, limit, 1e-3, 10)
        inbox = controller.step(frames)
    assert voltage > 0.5  # the clutch is engaged


@pytest.mark.parametrize(
    ("frames", "sentence"),
    [
        (
            [Frame(ENCODER.can_id, ENCODER.pack_raw(n)) for n in range(INTRUSION)],
            "a second plant is on the bus: it sends ENCODER (0x101)",
        ),
        (
            [Frame(BEAT.can_id, BEAT.pack(n, lifecycle=2, rate=500, session=1)) for n in range(WRONG_RATES)],
            "the controller runs at 500 Hz, this plant at 1000 Hz: give both one rate",
        ),
    ],
)
def test_a_bus_that_cannot_be_worked_on_is_told(frames: list[Frame], sentence: str) -> None:
    plant = PlantNode()
    plant.receive([Frame(VALVE.can_id, VALVE.pack(0, 1, 1.0, 0)), *frames[:-1]])
    with pytest.raises(InputError) as message:
        plant.receive(frames[-1:])
    assert str(message.value) == sentence


def test_before_a_run_one_heartbeat_of_another_rate_is_enough() -> None:
    with pytest.raises(InputError, match="give both one rate"):
        PlantNode().receive([Frame(BEAT.can_id, BEAT.pack(0, lifecycle=2, rate=500, session=1))])


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        (Frame(VALVE.can_id, bytes(5)), "frame VALVE_COMMAND (0x080) was received with 5 bytes; its definition has 8"),
        (Frame(MOTOR.can_id, bytes(6)), "frame MOTOR_COMMAND (0x090) was received with 6 bytes; its definition has 8"),
        (
            Frame(BEAT.can_id, BEAT.pack(0, lifecycle=5, rate=1000, session=1)),
            "lifecycle 5 of the controller is unknown; allowed are 0 to 3",
        ),
    ],
)
def test_a_strange_frame_is_counted_and_told_and_changes_nothing(frame: Frame, sentence: str) -> None:
    plant, other = PlantNode(), PlantNode()
    for _ in range(200):
        plant.step([frame])
        other.step([])
    assert plant.make_row() == other.make_row()
    assert plant.first_rejected == sentence
    counts = {name: sum(of[what] for what in REJECTED) for name, of in plant.count_receptions().items()}
    assert sum(counts.values()) == 200


def test_a_stray_frame_on_an_identifier_of_the_plant_ends_nothing() -> None:
    plant = PlantNode()
    for n in range(5):
        strays = [bytes(7), bytes(8), ENCODER.pack_raw(n)]
        plant.step([Frame(ENCODER.can_id, data) for data in strays])
    counts = plant.count_strays()
    message = {
        "received": 5,
        "lost": 0,
        "repeated": 0,
        "conflicting": 0,
        "wrong_sequence": 0,
        "corrupt": 5,
        "misshapen": 5,
        "unusable": 0,
    }
    assert counts == {"ENCODER": message}
    status = next(data for n in range(100) for can_id, data in plant.step([]) if can_id == STATUS.can_id)
    assert STATUS.unpack(status).rejected_frames == 15


def test_a_flood_is_taken_in_parts() -> None:
    plant = PlantNode()
    plant.receive([Frame(VALVE.can_id, VALVE.pack(n, 1, 1.0, n & 0x3FF)) for n in range(10_000)])
    assert plant.count_receptions()["VALVE_COMMAND"]["received"] == 10_000
    assert plant.answered_tick == 9_999 % 2**10


@pytest.mark.parametrize("rig", ["wet_clutch", "power_shift"])
def test_a_sample_keeps_no_memory(rig: str) -> None:
    if rig == "power_shift":
        plant = PowerShiftNode(profile=load_shift_profile("shift", 3.0))
    else:
        plant = PlantNode(profile=load_profile("engagement", 3.0))
    controller = load_node("controller")()

    def play(count: int) -> None:
        commands = 0
        for _ in range(count):
            plant.take(controller.outbox, commands)
            frames = plant.show()
            plant.advance()
            commands = controller.run_cycle(plant.outbox, frames)

    # bytes in 1400 samples: an object that a sample kept would be 28 each
    assert measure_growth(play, 500, 1400) < 1000


@pytest.mark.parametrize("name", ["PlantNode", "PowerShiftNode"])
def test_once_warm_a_plant_loads_nothing(name: str) -> None:
    """Not even with its first frame: it has real-time priority then, and others on its CPU would wait for the disk."""
    code = f"""
import sys
from plant_sim.node.plant_node import PlantNode
from plant_sim.node.power_shift_node import PowerShiftNode
from plant_sim.node.power_shift_record import RECORD
from protocols.can.frame_batch import load, make_batch
from protocols.can.frames import Frame, load_frames
{name}.warm()
plant, line, valve = {name}(), make_batch(64), load_frames()["VALVE_COMMAND"]
def told(event, arguments):
    if event == "open" and str(arguments[0]).endswith((".nbi", ".nbc")):
        print(arguments[0])
sys.addaudithook(told)
for tick in range(3):
    plant.take(line, load(line, [Frame(valve.can_id, valve.pack(tick, 1, 1.0, tick))]))
    plant.skip_periods(0)
    plant.show()
    plant.advance()
plant.make_heartbeat(1)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""
