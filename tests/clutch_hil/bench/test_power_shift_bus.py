"""Two clutches on one bus: frames that cannot be mistaken, two controllers, and a hand-over of torque between them."""

import json
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.judgement.power_shift_measures import MEASURES, find_handover
from clutch_hil.bench.scenario import Scenario, load_scenario
from clutch_hil.bench.simulate import Simulation
from clutch_hil.live.monitor.collector import Collector
from plant_sim.node.injection import Injection
from plant_sim.node.plant_cycle import Actuators
from plant_sim.node.power_shift_node import COLUMNS, PowerShiftNode
from plant_sim.profiles.profile import load_profile
from plant_sim.profiles.shift_profile import load_shift_profile
from protocols.buses.bus import listen, open_bus
from protocols.can.frames import Frame, load_frames
from protocols.can.reception import INTRUSION, WRONG_RATES
from protocols.errors import InputError
from protocols.files.runs import read_run
from protocols.node import load_node
from protocols.telemetry.batch import Batch, list_run_columns
from tests.processes import ONE_CPU, PATIENCE, play_here, service

RATE = 500  # Hz: two clutches fill 59 % of a bus of 1 Mbit/s
A, B = load_frames(clutch="a"), load_frames(clutch="b")
# Share of the torque before: 0.022 and 0.102 measured (the rise is the touch of clutch b at the end of its fill)
GAP, PEAK = 0.04, 0.13
WEAK = 0.8  # friction level of clutch b: its torque, and with it the output's, falls by a fifth after the hand-over
CLOSED = 0.3  # s until a valve without commands has emptied its cylinder

controller_node = load_node("controller")


def make_scenario(seconds: float | None = None, **changed: float) -> Scenario:
    """The shipped hand-over, cut, with parameters of the plant by dotted name with `__` for dots."""
    shipped = load_scenario("shift", {"seconds": seconds} if seconds else None)
    return replace(shipped, plant=shipped.plant.with_values({n.replace("__", "."): v for n, v in changed.items()}))


def make_columns(rows: list[np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of a played hand-over by their names in a run file."""
    plant, a, b = rows
    names = [column.name for column in controller_node.columns]
    return (
        {column.name: plant[:, i] for i, column in enumerate(COLUMNS)}
        | {f"controller_{name}": a[:, i] for i, name in enumerate(names)}
        | {f"controller_b_{name}": b[:, i] for i, name in enumerate(names)}
    )


def play(case: Scenario) -> dict[str, np.ndarray]:
    """Columns of a scenario played in one process."""
    return Simulation(case).play_with_metadata()[0].make_columns()


@pytest.fixture(scope="module")
def played() -> dict[str, np.ndarray]:
    """The shipped hand-over in one process."""
    return play(make_scenario())


def make_nodes() -> tuple[PowerShiftNode, object, object]:
    plant = PowerShiftNode(RATE, profile=load_shift_profile("shift"))
    return plant, controller_node(rate=RATE, clutch="a"), controller_node(rate=RATE, clutch="b")


# two controllers


def test_controllers_of_two_clutches_do_not_hear_each_other() -> None:
    plant, a, b = make_nodes()
    frames = plant.step([])
    of_a = a.step(frames)
    for each in (of_a, b.listen(of_a), b.step([*frames, *of_a])):
        assert each  # b takes a's frames for nobody's
    for node, valve, name in ((a, A["VALVE_COMMAND"], "VALVE_COMMAND"), (b, B["VALVE_COMMAND"], "VALVE_COMMAND_B")):
        own = [Frame(valve.can_id, valve.pack(n, 0, 0.0, 0)) for n in range(INTRUSION)]
        node.step(own)
        assert node.first_rejected == f"a second controller is on the bus: it sends {name} (0x{valve.can_id:03X})"


def test_only_clutch_a_commands_the_motor() -> None:
    plant, a, b = make_nodes()
    frames = plant.step([])
    motor = A["MOTOR_COMMAND"].can_id
    for node, drives in ((a, True), (b, False)):
        assert (motor in [frame.can_id for frame in node.step(frames)]) is drives
        assert (motor in [frame.can_id for frame in node.list_safe_frames()]) is drives


def test_the_guard_of_clutch_b_watches_clutch_b() -> None:
    plant, _, b = make_nodes()
    for k in range(5):
        frames = [f for f in plant.step([]) if f.can_id != B["ANALOG_SENSORS"].can_id]
        hot = B["ANALOG_SENSORS"].pack(k, cylinder_pressure=2.0, oil_temperature=160.0)
        b.step([Frame(B["ANALOG_SENSORS"].can_id, hot), *frames])
    named = dict(zip([column.name for column in b.columns], b.make_row(), strict=True))
    assert load_frames()["CONTROLLER_STATUS"].list_choices("fault")[int(named["fault"])] == "overtemperature"


def test_a_second_plant_is_refused() -> None:
    plant, *_ = make_nodes()
    with pytest.raises(InputError, match=r"a second plant is on the bus: it sends ENCODER_B \(0x109\)"):
        plant.step([Frame(B["ENCODER"].can_id, B["ENCODER"].pack(n)) for n in range(INTRUSION)])


def test_a_controller_at_another_rate_is_refused() -> None:
    plant, _, _ = make_nodes()
    beat = B["CONTROLLER_HEARTBEAT"]
    other = [Frame(beat.can_id, beat.pack(n, lifecycle=2, rate=250, session=9)) for n in range(WRONG_RATES)]
    with pytest.raises(InputError, match="the controller of clutch b runs at 250 Hz, this plant at 500 Hz"):
        plant.step(other)


# the hand-over


def test_the_output_torque_is_kept_while_both_clutches_slip(played: dict[str, np.ndarray]) -> None:
    assert MEASURES["torque_gap"].of(played) < GAP
    assert MEASURES["torque_peak"].of(played) < PEAK
    assert MEASURES["tie_up_nm"].of(played) == 0.0
    assert MEASURES["fault"].of(played) == "none"
    shift = find_handover(played)
    assert shift is not None
    crossing = slice(
        shift.begin, shift.torque_end
    )  # Janssens 2010, sec. 6.2.1: both slip, one opens while the other closes
    assert np.all(played["truth_slip_speed_a_rad_s"][crossing] > 0.0)
    assert np.all(played["truth_slip_speed_b_rad_s"][crossing] > 0.0)
    both = np.minimum(played["truth_clutch_torque_a_nm"], played["truth_clutch_torque_b_nm"])[crossing]
    assert both.max() > 4.0


def test_each_clutch_has_its_own_sensors_and_noise(played: dict[str, np.ndarray]) -> None:
    still = played["time_s"] < 0.3
    noise = [played[f"cylinder_pressure_{clutch}_bar"][still] for clutch in "ab"]
    assert abs(np.corrcoef(*noise)[0, 1]) < 0.4  # 150 samples: 0.08 is one deviation


def test_a_weak_clutch_shows_as_a_torque_gap_and_in_the_report(tmp_path: Path) -> None:
    case = make_scenario(5.2, b__friction_level__level=WEAK)
    case = replace(case, settings=replace(case.settings, out=tmp_path))
    result = Simulation(case).run(lambda done, total: None)
    assert result.document["torque_gap"] == pytest.approx(1.0 - WEAK, abs=GAP)
    assert result.document["effects"] == ["b.friction_level"]
    assert "effects: b.friction_level" in result.text
    assert not result.good
    assert result.verdict.startswith("failed: torque_gap <= 0.08")
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".parquet", ".png"]


def test_an_injection_reaches_its_clutch_alone(played: dict[str, np.ndarray]) -> None:
    weaker = Injection({"b.friction_level.level": WEAK}, at=5.5)
    other = play(replace(make_scenario(), injections=(weaker,)))
    before, after = played["time_s"] < 5.5, (played["time_s"] > 5.6) & (played["time_s"] < 6.0)
    for name in played:
        assert np.array_equal(played[name][before], other[name][before]), name
    torque = "truth_output_torque_nm"
    assert other[torque][after].mean() == pytest.approx(WEAK * played[torque][after].mean(), rel=0.02)


@pytest.mark.parametrize("limited", [True, False])
@pytest.mark.parametrize(("clutch", "at"), [("a", 3.9), ("b", 3.9), ("a", 2.0)])  # at last no torque is handed over
def test_a_fault_of_either_clutch_is_told_in_the_report(clutch: str, at: float, limited: bool, tmp_path: Path) -> None:
    high = Injection({f"{clutch}.pressure_sensor_offset.offset": 4.0}, at=at)
    case = make_scenario(5.0)
    case = replace(case, settings=replace(case.settings, out=tmp_path), injections=(high,))
    result = Simulation(case if limited else replace(case, limits=())).run(lambda done, total: None)
    message = rf"fault of clutch {clutch} at {at}\d s: overpressure: "
    assert not result.good
    assert re.search(message, result.text if limited else result.verdict), result


def test_a_change_of_the_motor_is_told_once() -> None:
    plant = PowerShiftNode(RATE)
    (planned,) = plant.accept({"motor.proportional_gain": 5.0}, {"at": 0.005})
    while plant.tick / RATE < 0.01:
        plant.step([])
    assert plant.injected_changes == [planned]
    assert plant.parameters["motor.proportional_gain"].value == 5.0


@pytest.mark.parametrize("name", ["driveline.grade", "a.sensors.pressure_noise", "b.backlash.gap"])
def test_what_is_fixed_is_neither_tuned_nor_injected(name: str) -> None:
    plant = PowerShiftNode(RATE)
    for change in (plant.tune, lambda values: plant.inject(Injection(values))):
        with pytest.raises(InputError, match=r"is fixed while the plant runs|acts between motor and clutch"):
            change({name: 0.01})


def play_stopped_controller(clutch: str, at: float) -> tuple[dict[str, np.ndarray], list[int]]:
    """Both clutches half-way; the controller of `clutch` dies at a time [s]; the columns, and ACTUATORS of each status."""
    plant, a, b = make_nodes()
    actuators: list[int] = []
    inbox: list[Frame] = []
    rows: list[list] = [[], [], []]
    while plant.tick / RATE < at + 0.6:
        frames = plant.step(inbox)
        actuators += [A["PLANT_STATUS"].unpack(d).actuators for i, d in frames if i == A["PLANT_STATUS"].can_id]
        alive = [n for n, name in ((a, "a"), (b, "b")) if name != clutch or plant.tick / RATE < at]
        inbox = [frame for node in alive for frame in node.step(frames)]
        for record, node in zip(rows, (plant, a, b), strict=True):
            record.append(node.make_row())
    return make_columns([np.array(record, float) for record in rows]), actuators


def test_when_the_controller_of_b_dies_its_clutch_opens_and_a_carries_on() -> None:
    played, actuators = play_stopped_controller("b", at=4.2)
    time = played["time_s"]
    late = time > 4.2 + CLOSED
    assert np.all(played["valve_voltage_b_v"][time > 4.22] == 0.0)
    assert np.all(played["truth_clutch_torque_b_nm"][late] == 0.0)
    assert np.all(played["controller_fault"] == 0.0)
    after = (time > 4.22) & (time < 4.38)
    np.testing.assert_allclose(
        played["truth_clutch_torque_a_nm"][after], played["torque_demand_a_nm"][after], atol=0.5
    )  # Nm: it follows as before, 0.2 measured
    assert played["truth_input_speed_rad_s"][-1] == pytest.approx(played["input_speed_demand_rad_s"][-1], abs=1.0)
    assert actuators[-1] == Actuators.LOST


def test_when_the_controller_of_a_dies_its_clutch_opens_and_the_motor_stops_driving() -> None:
    played, actuators = play_stopped_controller("a", at=4.2)
    time = played["time_s"]
    assert np.all(played["valve_voltage_a_v"][time > 4.22] == 0.0)
    assert np.all(played["truth_clutch_torque_a_nm"][time > 4.2 + CLOSED] == 0.0)
    assert np.all(played["motor_torque_nm"][time > 4.25] < 0.5)
    assert np.all(played["controller_b_fault"] == 0.0)
    assert actuators[-1] == Actuators.LOST


# as processes


def test_three_processes_in_lock_step_are_one_process_to_the_bit(local_bus: str, tmp_path: Path) -> None:
    seconds = 4.3  # into the torque phase: both clutches carry
    arguments = ("up", "shift", "--bus", local_bus, "--lockstep", "--no-telemetry", "--seconds", str(seconds))
    done = play_here(*arguments, "--out", tmp_path, "--json")
    message = json.loads(done.stdout)
    run = read_run(Path(message["run"]), [column.name for column in COLUMNS])
    expected = play(make_scenario(seconds))
    assert expected["truth_clutch_torque_a_nm"][-1] > 1.0
    assert expected["truth_clutch_torque_b_nm"][-1] > 5.0
    for name, values in expected.items():
        assert np.array_equal(run[name], values), name
    assert run.metadata["rig"] == "power_shift"
    for name in ("plant", "controller", "controller_b"):
        assert all(c["lost"] == c["corrupt"] == 0 for c in message[name]["frames"].values())


def test_in_real_time_a_killed_controller_stops_neither_plant_nor_the_other(local_bus: str) -> None:
    common = ("--bus", local_bus, "--rate", "250", "--no-telemetry", *ONE_CPU)
    with (
        service("plant", *common, "--rig", "power_shift", "--profile", "shift"),
        service("controller", *common, "--clutch", "a") as a,
        service("controller", *common, "--clutch", "b") as b,
        open_bus(local_bus) as port,
    ):
        assert await_frame(port, "PLANT_STATUS", lambda status: status.actuators == 1)
        b.kill()
        assert await_frame(port, "PLANT_STATUS", lambda status: status.actuators == Actuators.LOST)
        frames = listen(port, 0.2)
        assert sum(frame.can_id == A["VALVE_COMMAND"].can_id for frame in frames) > 20
        assert not any(frame.can_id == B["VALVE_COMMAND"].can_id for frame in frames)
        a.terminate()
        _, errors = a.communicate(timeout=PATIENCE)
        assert a.returncode == 0, errors


def await_frame(port, frame: str, wanted) -> bool:
    """Whether a frame that is `wanted` comes."""
    codec = A[frame]
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if any(can_id == codec.can_id and wanted(codec.unpack(data)) for can_id, data in listen(port, 0.05)):
            return True
    return False


# bad input


HEADER = "time_s,torque_demand_a_nm,torque_demand_b_nm,input_speed_demand_rad_s\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time_s,torque_demand_nm,motor_speed_demand_rad_s\n0,0,9\n", "has the columns time_s, torque_demand_nm"),
        (HEADER + "0,0,0\n", "row 1 has 3 cells; 4 are needed"),
        (HEADER + "0,0,0,20\n1,0,40,20\n", "of clutch b, row 2: set-point 40 Nm"),
        (HEADER + "0,0,0,x\n", "row 1: input_speed_demand_rad_s is 'x'; a number is needed"),
    ],
)
def test_a_bad_shift_profile_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence):
        load_shift_profile(str(path))


def test_a_profile_of_one_clutch_and_one_of_two_are_not_mistaken() -> None:
    with pytest.raises(InputError, match=r"shift profile .*engagement.csv has the columns"):
        load_shift_profile("engagement")
    with pytest.raises(InputError, match=r"profile .*shift.csv has the columns"):
        load_profile("shift")


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"driveline.grade": 0.1}, "parameter driveline.grade is fixed while the plant runs"),
        ({"a.sensors.pressure_noise": 0.1}, "parameter a.sensors.pressure_noise is fixed while the plant runs"),
        ({"b.backlash.gap": 0.01}, "effect b.backlash acts between motor and clutch"),
        ({"friction_level.level": 0.9}, "parameter 'friction_level.level' is unknown"),
    ],
)
def test_what_cannot_change_while_it_runs_is_refused(values: dict[str, float], sentence: str) -> None:
    plant, *_ = make_nodes()
    with pytest.raises(InputError, match=sentence):
        plant.inject(Injection(values, at=1.0))


def test_tuning_one_clutch_keeps_its_states_and_the_other() -> None:
    plant, a, b = make_nodes()
    inbox: list[Frame] = []
    for _ in range(300):
        frames = plant.step(inbox)
        inbox = [*a.step(frames), *b.step(frames)]
    before = plant.parameters
    plant.tune({"b.friction_level.level": 0.9, "motor.integral_gain": 30.0})
    after = plant.parameters
    assert {name for name in before if before[name].value != after[name].value} == {
        "b.friction_level.level", "motor.integral_gain",
    }  # fmt: skip
    assert plant.step(inbox)


def test_a_monitor_shows_both_clutches() -> None:
    collector = Collector("bench")
    collector.alive = {"plant": True, "controller": True, "controller_b": True}
    for value, name, node in zip((1.0, 2.0, 5.0), ("plant", "controller", "controller_b"), make_nodes(), strict=True):
        columns = list_run_columns(name, node.columns)
        rows = np.full((10, len(columns)), value)
        if name == "plant":
            rows[:, [column.name for column in columns].index("truth_clutch_torque_b_nm")] = 7.0
        collector.take([Batch(name, 1, 0, RATE, 0.0, 0, columns, rows)], now=1.0)
    a, b = collector.make_snapshot(now=1.1).clutches
    assert [(a.name, a.phase, a.state), (b.name, b.phase, b.state)] == [
        ("a", "slip control", "sticking"),
        ("b", "lock", "5"),
    ]
    assert [clutch.values["torque demand"] for clutch in (a, b)] == [2.0, 5.0]
    assert [clutch.values["torque true"] for clutch in (a, b)] == [1.0, 7.0]


def test_a_monitor_misses_the_second_controller() -> None:
    collector = Collector("bench")
    collector.alive = {"plant": True, "controller": True}
    for name, node in zip(("plant", "controller"), make_nodes(), strict=False):
        columns = list_run_columns(name, node.columns)
        collector.take([Batch(name, 1, 0, RATE, 0.0, 0, columns, np.zeros((10, len(columns))))], now=1.0)
    assert collector.make_snapshot(now=1.1).list_troubles() == ["controller_b absent: phase and fault unknown"]
