"""A log of the bench's own frames becomes the run that the bench recorded."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import can
import numpy as np
import pytest
from typer.testing import CliRunner

from clutch_hil.command import make_application
from clutch_hil.recordings.bench_samples import BRIDGED
from clutch_hil.recordings.import_map import load_map
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.can.frames import Frame, load_frames
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.node import load_node

MAP = load_map("bench")
CODECS = load_frames()
NAMES = {codec.can_id: name for name, codec in CODECS.items()}
EQUAL = ("cylinder_pressure_bar", "oil_temperature_degc", "clutch_torque_nm", "motor_torque_nm", "shaft_angle_rad")


class Played(NamedTuple):
    """Frames with their stamps [s], and the plant's rows by column."""

    frames: list[tuple[float, Frame]]
    rows: dict[str, np.ndarray]


@pytest.fixture(scope="module")
def played() -> Played:
    """1.4 s of `engagement`, stamped as a receiver does it: late by up to 0.4 ms."""
    plant, controller = PlantNode(profile=load_profile("engagement", 1.4)), load_node("controller")()
    jitter = random.Random(5)
    frames, rows, inbox = [(0.9, plant.make_heartbeat(0))], [], []
    while not plant.finished:
        sensors = plant.step(inbox)
        rows.append(plant.make_row())
        inbox = controller.step(sensors)
        late = 1.0 + plant.tick * 1e-3 + 4e-4 * jitter.random()
        frames += [(late + 1e-6 * k, frame) for k, frame in enumerate(sensors)]
        frames += [(late + 2e-4 + 1e-6 * k, frame) for k, frame in enumerate(inbox)]
    table = np.array(rows)
    return Played(frames, {column.name: table[:, k] for k, column in enumerate(plant.columns)})


def import_frames(folder: Path, frames: list[tuple[float, Frame]]) -> list[Run]:
    path = folder / "bench.log"
    lines = (f"({stamp:.6f}) can0 {can_id:03X}#{data.hex().upper()}\n" for stamp, (can_id, data) in frames)
    path.write_text("".join(lines))
    return MAP.read_runs(path)


def leave_out(played: Played, drop: Callable[[float, str], bool]) -> list[tuple[float, Frame]]:
    """The frames without those of which `drop(stamp, name)` is true."""
    return [(stamp, frame) for stamp, frame in played.frames if not drop(stamp, NAMES[frame.can_id])]


def test_the_run_of_a_log_is_the_one_that_the_plant_recorded(tmp_path: Path, played: Played) -> None:
    (run,) = import_frames(tmp_path, played.frames)
    columns = run.columns
    assert np.diff(columns["time_s"]) == pytest.approx(1e-3, abs=1e-9)  # whatever the stamps are
    for name in EQUAL:
        assert columns[name] - columns[name][0] == pytest.approx(played.rows[name] - played.rows[name][0], abs=1e-6), (
            name
        )
    assert columns["slip_speed_rad_s"][1:] == pytest.approx(played.rows["slip_speed_rad_s"][1:], abs=1e-6)
    assert columns["valve_voltage_v"] == pytest.approx(played.rows["valve_voltage_v"], abs=1e-6)
    assert columns["motor_speed_demand_rad_s"] == pytest.approx(played.rows["motor_speed_demand_rad_s"], abs=1e-3)
    assert columns["cylinder_pressure_bar"].max() > 2.5
    assert "rows are the samples of the bench, by SAMPLE_TICK at 1000 Hz" in run.metadata["import"]["done"]


def test_a_few_missing_samples_are_bridged_and_told(tmp_path: Path, played: Played) -> None:
    lost = {0x100: {1.2003, 1.3}, 0x101: {1.4}}
    counts: dict[int, int] = {}

    def drop(stamp: float, name: str) -> bool:
        can_id = CODECS[name].can_id
        tick = counts[can_id] = counts.get(can_id, -1) + 1
        return can_id in lost and tick in (300, 301, 700) and (can_id == 0x100 or tick == 700)

    (run,) = import_frames(tmp_path, leave_out(played, drop))
    assert len(run["time_s"]) == len(played.rows["time_s"])
    assert run["cylinder_pressure_bar"] == pytest.approx(played.rows["cylinder_pressure_bar"], abs=0.05)
    sentence = run.metadata["import"]["done"]
    assert "bridged 3 samples that are missing" in sentence
    assert "left out 2 frames of ENCODER without one of ANALOG_SENSORS" in sentence


def test_a_long_gap_cuts_the_log_into_runs_that_keep_their_times(tmp_path: Path, played: Played) -> None:
    first, second = import_frames(tmp_path, leave_out(played, lambda stamp, _: 1.4 < stamp < 1.4 + 3.0 * BRIDGED))
    assert first["time_s"][-1] < 0.41 + 0.1
    steps = second["time_s"][0] - first["time_s"][-1]
    assert steps == pytest.approx(3.0 * BRIDGED, abs=2.5e-3)
    row = round((second["time_s"][0] - first["time_s"][0]) * 1000)
    n = len(second["time_s"])
    assert second["cylinder_pressure_bar"] == pytest.approx(
        played.rows["cylinder_pressure_bar"][row : row + n], abs=1e-6
    )


def test_a_plant_that_begins_anew_begins_another_run(tmp_path: Path, played: Played) -> None:
    half = [(stamp, frame) for stamp, frame in played.frames if stamp < 1.6]
    again = [(stamp + 0.75, frame) for stamp, frame in half]
    runs = import_frames(tmp_path, half + again)
    assert len(runs) == 2
    assert len(runs[0]["time_s"]) == len(runs[1]["time_s"])
    assert runs[1]["time_s"][0] > runs[0]["time_s"][-1]


def test_a_command_that_is_not_enabled_is_none(tmp_path: Path, played: Played) -> None:
    valve = CODECS["VALVE_COMMAND"]
    closed = [
        (stamp, Frame(f.can_id, valve.pack(k, valve_enable=0, valve_voltage=5.0)) if f.can_id == valve.can_id else f)
        for k, (stamp, f) in enumerate(played.frames)
    ]
    (run,) = import_frames(tmp_path, closed)
    assert not run["valve_voltage_v"].any()


def test_while_the_motor_is_not_enabled_there_are_no_rows(tmp_path: Path, played: Played) -> None:
    """It coasts then: after the end of a run, and in a fault. A model would follow a speed that nobody asks for."""
    motor = CODECS["MOTOR_COMMAND"]
    off = [
        (stamp, Frame(f.can_id, motor.pack(k)) if f.can_id == motor.can_id and stamp > 2.0 else f)
        for k, (stamp, f) in enumerate(played.frames)
    ]
    (run,) = import_frames(tmp_path, off)
    rows = len(run["time_s"])
    assert rows == pytest.approx(1001, abs=2)
    assert run["motor_speed_demand_rad_s"] == pytest.approx(played.rows["motor_speed_demand_rad_s"][:rows], abs=1e-3)
    out = len(played.rows["time_s"]) - rows
    sentence = f"left out {out} samples in which the motor is not enabled: it has no speed demand"
    assert sentence in run.metadata["import"]["done"]
    never = leave_out(played, lambda _, name: name == "MOTOR_COMMAND")
    assert len(import_frames(tmp_path, never)[0]["time_s"]) == len(played.rows["time_s"])


@pytest.mark.parametrize(
    ("kept", "why"),
    [
        ({"ENCODER", "ANALOG_SENSORS"}, "without a heartbeat the rate is not known"),
        ({"ENCODER", "PLANT_HEARTBEAT"}, "no sample is whole"),
    ],
)
def test_a_log_without_samples_has_no_such_channels(tmp_path: Path, played: Played, kept: set[str], why: str) -> None:
    with pytest.raises(InputError, match=r"has no column 'SAMPLES\.time'"):
        import_frames(tmp_path, leave_out(played, lambda _, name: name not in kept))


def test_who_imports_a_log_without_a_map_is_told_of_this_one(tmp_path: Path, played: Played) -> None:
    path = tmp_path / "bench.asc"
    with can.Logger(path) as log:
        for stamp, (can_id, data) in played.frames:
            log(can.Message(stamp, can_id, is_extended_id=False, data=data, channel=0))
    refused = CliRunner().invoke(make_application(), ["import", str(path)]).exception
    assert isinstance(refused, InputError)
    assert "--map bench reads a log of the bench's own frames" in str(refused)
    out = tmp_path / "run.parquet"
    done = CliRunner().invoke(make_application(), ["import", str(path), "--map", "bench", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert out.is_file()
