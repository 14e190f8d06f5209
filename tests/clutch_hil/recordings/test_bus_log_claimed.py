"""A bus log whose supervisors claim the set-points is imported, and watched, as one without claims."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.format import open_recording
from protocols.can.frames import Frame, list_bus_frames
from protocols.can.request import Request
from protocols.can.traffic import Traffic
from protocols.files.bus_logs.bus_log import mark_bench_frames, read_bus_log
from tests.claims import Supervisor
from tests.clutch_hil.recordings.bus_logs import START, make_message, write

ASKED, CLAIMED = 150, 50  # set-points of a supervisor; it claims before every fiftieth


def list_frames(clutch: str, *sessions: int) -> list[Frame]:
    """What supervisors send one after the other, each with a torque of its own, and one set-point that is damaged."""
    frames = []
    for number, session in enumerate(sessions):
        supervisor = Supervisor(session, clutch=clutch)
        for n in range(ASKED):
            frames += [supervisor.claim()] if session and n % CLAIMED == 0 else []
            frames.append(supervisor.ask(Request.ENGAGE, 1.0 + number))
    damaged = frames[-10]
    return [*frames[:-10], Frame(damaged.can_id, bytes((damaged.data[0] ^ 1,)) + damaged.data[1:]), *frames[-9:]]


@pytest.mark.parametrize("clutch", ["a", "b"])
@pytest.mark.parametrize("sessions", [(0,), (0x9B21,), (0x9B21, 0x8A3F), (0, 0x9B21)])
@pytest.mark.parametrize("late", [False, True], ids=["whole", "begun in a run"])
def test_set_points_of_every_supervisor_are_read(
    tmp_path: Path, clutch: str, sessions: tuple[int, ...], late: bool
) -> None:
    frames = list_frames(clutch, *sessions)[7 if late else 0 :]
    messages = [make_message(START + 1e-3 * n, can_id, data) for n, (can_id, data) in enumerate(frames)]
    path = write(tmp_path / "bus.log", messages)
    name = "TORQUE_SETPOINT" + ("" if clutch == "a" else "_B")
    log = read_bus_log(path)
    assert np.count_nonzero(~mark_bench_frames(log)) == 1
    traffic = Traffic(list_bus_frames(clutches=2))
    for message in messages:
        traffic.take(message.timestamp, message.arbitration_id, bytes(message.data))
    assert traffic.count("corrupt") == 1
    if clutch == "a":  # the shipped database has the frames of clutch a
        recording = open_recording(path)
        assert f"left out 1 frame of {name} with a wrong CRC" in recording.notes
        (torque,) = (channel for channel in recording.channels if channel.name == f"{name}.TORQUE_DEMAND")
        (read,) = recording.read([torque])
        kept = len(sessions) * ASKED - 1 - (7 - (sessions[0] > 0) if late else 0)
        assert len(read.values) == kept
        assert set(np.round(read.values, 2)) == {1.0 + number for number in range(len(sessions))}
