"""MDF files with signals and frames of a bus: both are channels, on one clock, or the frames are told."""

from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal
from asammdf.blocks.v4_constants import FLAG_CG_BUS_EVENT

from benchmarks.logged_frames import write_mf4
from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.format import open_recording, recognise
from protocols.can.frames import DBC
from protocols.errors import InputError
from protocols.files.bus_logs.bus_log import read_bus_log
from tests.clutch_hil.recordings.bus_logs import START, make_bench_messages, make_message
from tests.clutch_hil.recordings.maps import import_by

TIME = 0.01 * np.arange(20)
FORCE = np.cos(TIME)
LATE = 0.02  # s after the start of the file, at which the first frame comes
MAP = """[file]
resample_hz = 100.0
[columns]
time_s = { from = "time" }
motor_force_n = { from = "force", unit = "N" }
cylinder_pressure_bar = { from = "ANALOG_SENSORS.CYLINDER_PRESSURE" }
shaft_angle_rad = { from = "ENCODER.SHAFT_ANGLE" }
"""


@pytest.fixture
def both(tmp_path: Path) -> Path:
    path = tmp_path / "both.mf4"
    messages = [
        make_message(START, 0x7AB, b"\1"),
        *make_bench_messages(150, START + LATE),
    ]  # the writer counts times from the first frame
    write_mf4(path, messages, [Signal(FORCE, TIME, name="force", unit="N")])
    return path


def test_signals_and_frames_are_channels_of_one_recording(both: Path) -> None:
    assert recognise(both).name == "MDF"
    recording = open_recording(both)
    assert len({channel.number for channel in recording.channels}) == len(recording.channels)
    paths = [channel.path for channel in recording.channels]
    assert "force" in paths
    assert "ENCODER.SHAFT_ANGLE" in paths
    wanted = [choose_channel(both, recording.channels, name) for name in ("ENCODER.SHAFT_ANGLE", "force")]
    angle, force = recording.read(wanted)
    assert [angle.channel, force.channel] == wanted
    np.testing.assert_array_equal(force.values, FORCE)
    np.testing.assert_array_equal(force.time, TIME)
    assert angle.time is not None
    np.testing.assert_allclose(angle.time, LATE + 1e-3 * np.arange(150) + 1e-4, atol=2e-6)
    np.testing.assert_allclose(angle.values, 1e-3 * np.arange(150), atol=4e-5)
    assert any("left out 1 frame that the database does not have: 0x7AB" in note for note in recording.notes)


def test_a_map_joins_signals_and_frames_on_one_clock(tmp_path: Path, both: Path) -> None:
    run = import_by(tmp_path, both, MAP)
    inside = (run["time_s"] > LATE + 0.02) & (run["time_s"] < LATE + 0.11)
    assert np.count_nonzero(inside) > 5
    np.testing.assert_allclose(run["shaft_angle_rad"][inside], run["time_s"][inside] - LATE - 1e-4, atol=1e-4)
    np.testing.assert_allclose(run["motor_force_n"], np.cos(run["time_s"]), atol=1e-4)


def test_a_map_may_ask_for_signals_of_frames_alone(tmp_path: Path, both: Path) -> None:
    columns = MAP.replace('"time"', '"ENCODER.time"').replace('motor_force_n = { from = "force", unit = "N" }\n', "")
    run = import_by(tmp_path, both, columns)
    assert list(run) == ["time_s", "cylinder_pressure_bar", "shaft_angle_rad"]
    np.testing.assert_allclose(run["shaft_angle_rad"], run["time_s"] - LATE - 1e-4, atol=1e-3)
    assert open_recording(both).read([]) == []


def test_frames_of_an_unknown_bus_are_told_beside_the_signals(tmp_path: Path) -> None:
    path = tmp_path / "both.mf4"
    write_mf4(path, [make_message(START, 0x7AB, b"\1")], [Signal(FORCE, TIME, name="force", unit="N")])
    recording = open_recording(path)
    assert "force" in [channel.path for channel in recording.channels]
    assert any("messages of a bus, not signals" in note and "dbc = " in note for note in recording.notes)
    with pytest.raises(InputError, match=r"DBC no.dbc does not exist"):
        open_recording(path, {"dbc": "no.dbc"})


def test_the_frames_of_such_a_file_are_a_log_too(both: Path) -> None:
    assert len(read_bus_log(both)) == 301


@pytest.mark.parametrize("with_frames", [False, True])
def test_signals_that_a_tool_decoded_of_frames_are_signals(tmp_path: Path, with_frames: bool) -> None:
    """extract_bus_logging of asammdf leaves the mark of a bus to their groups."""
    path, decoded = tmp_path / "frames.mf4", tmp_path / "decoded.mf4"
    messages = make_bench_messages(150)
    if with_frames:
        signal = Signal(FORCE, TIME, name="force", unit="N", comment="of CAN_DataFrame")
        write_mf4(path, messages, [signal])
        with MDF(path) as mdf:
            mdf.groups[1].channel_group.flags |= FLAG_CG_BUS_EVENT  # type: ignore[union-attr]
            mdf.save(decoded)
        wanted, values, times = "force", FORCE, TIME
    else:
        write_mf4(path, messages)
        with MDF(path) as mdf, mdf.extract_bus_logging({"CAN": [(DBC, 0)]}) as extracted:
            assert all(getattr(group.channel_group, "flags", 0) & FLAG_CG_BUS_EVENT for group in extracted.groups)
            extracted.groups[0].channel_group.comment = "of CAN_DataFrame"
            extracted.save(decoded)
        wanted, values, times = "SHAFT_ANGLE", 1e-3 * np.arange(150), 1e-3 * np.arange(150) + 1e-4
    assert recognise(path).name == ("MDF" if with_frames else "bus log")
    assert recognise(decoded).name == "MDF"
    recording = open_recording(decoded)
    (read,) = recording.read([choose_channel(decoded, recording.channels, wanted)])
    np.testing.assert_allclose(read.values, values, atol=4e-5)
    assert read.time is not None
    np.testing.assert_allclose(read.time, times, atol=2e-6)
    assert any(channel.path == "ENCODER.SHAFT_ANGLE" for channel in recording.channels) is with_frames
