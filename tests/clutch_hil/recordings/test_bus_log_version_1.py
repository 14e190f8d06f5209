"""A bus log of version 1 of the bench's database is imported by that version, without a map that names a database."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.formats.bus_log import BusLogFormat
from protocols.can.frames import DBC_1, load_frames
from tests.clutch_hil.recordings.bus_logs import make_message, write

OLD = load_frames(DBC_1)
SAMPLES = 300
ANGLES = 0.05 * np.arange(SAMPLES)  # rad: beyond what the angle of version 2 can be
PRESSURES = 0.01 * np.arange(SAMPLES)  # bar


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A log with one lost sample and one wrong CRC."""
    messages = []
    for n in range(SAMPLES):
        if n == 100:
            continue
        for codec, values in (
            (OLD["ANALOG_SENSORS"], {"cylinder_pressure": PRESSURES[n], "motor_torque": 3.0}),
            (OLD["ENCODER"], {"shaft_angle": ANGLES[n], "sample_tick": n}),
        ):
            data = bytearray(codec.pack(n, **values))
            data[0] ^= n == 200
            messages.append(make_message(1e-3 * n + 1.0, codec.can_id, bytes(data)))
    return write(tmp_path / "bus.log", messages)


def test_signals_are_read_by_the_database_of_version_1_and_that_is_told(path: Path) -> None:
    recording = BusLogFormat().open(path, {})
    assert "signals by clutch_rig_version_1.dbc, the bench's own: the map names no dbc" in recording.notes
    assert sum("frames of version 1" in note for note in recording.notes) == 1
    kept = np.delete(np.arange(SAMPLES), [100, 200])
    wanted = {"ENCODER.SHAFT_ANGLE": ANGLES[kept], "ANALOG_SENSORS.CYLINDER_PRESSURE": PRESSURES[kept]}
    wanted["ANALOG_SENSORS.MOTOR_TORQUE"] = np.full(len(kept), 3.0)
    channels = {channel.name: channel for channel in recording.channels}
    for name, values in wanted.items():
        codec, signal = OLD[name.split(".")[0]], name.split(".")[1].lower()
        (read,) = recording.read([channels[name]])
        assert np.allclose(read.values, values, rtol=0.0, atol=0.5001 * codec.scale[signal])


def test_lost_and_corrupt_frames_are_counted(path: Path) -> None:
    notes = BusLogFormat().open(path, {}).notes
    for name in ("ENCODER", "ANALOG_SENSORS"):
        assert f"left out 1 frame of {name} with a wrong CRC" in notes
        assert f"missing by the alive counters: 1 frame of {name}" in notes


def test_a_database_of_version_1_that_the_map_names_reads_the_same(path: Path) -> None:
    own, named = BusLogFormat().open(path, {}), BusLogFormat().open(path, {"dbc": str(DBC_1)})
    assert [channel.name for channel in own.channels] == [channel.name for channel in named.channels]
    assert all("version 1 of" not in note for note in named.notes)
