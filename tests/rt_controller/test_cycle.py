"""The controller's cycle as one compiled call: the same answers for batches and objects, no memory allocation, no GIL."""

import threading
import time
from typing import Any

import numpy as np
import pytest

from protocols.can.frame_batch import load, make_batch, unload
from protocols.can.frames import Frame, load_frames
from protocols.can.words import is_valid, make_frame_definition, protect, put, read_counter, read_raw, read_value
from rt_controller.law.record import make_record
from rt_controller.loop.cycle import OUTBOX, RECEIVED_FRAMES, run_cycle
from rt_controller.loop.cycle_record import RECORD
from rt_controller.loop.node import ControllerNode
from tests.memory import measure_growth

FRAMES = load_frames()
ANALOG, ENCODER, SETPOINT = (FRAMES[name] for name in ("ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT"))


def make_encoder_data(tick: int) -> bytes:
    angle = (260 * tick + 2**17) % 2**18 - 2**17
    return ENCODER.pack_raw(tick, shaft_angle=angle, sample_tick=ENCODER.wrap("sample_tick", tick), motor_torque=100)


def sample(tick: int) -> list[Frame]:
    return [
        Frame(
            ANALOG.can_id,
            ANALOG.pack_raw(tick, cylinder_pressure=700, oil_temperature=717, clutch_torque=100),
        ),
        Frame(ENCODER.can_id, make_encoder_data(tick)),
        Frame(SETPOINT.can_id, SETPOINT.pack(tick, 1 if tick > 5 else 0, 10.0, 10.0, 0.0)),
    ]


def _make_attributes(signal: np.void) -> Any:
    """Return a SIGNAL with its fields as attributes, as in compiled code."""
    return make_record(signal.dtype, dict(zip(signal.dtype.names or (), signal.item(), strict=True)))


def test_words_are_what_the_codecs_make_of_every_frame() -> None:
    for codec in FRAMES.values():
        definition = make_frame_definition(codec)
        assert (definition["can_id"], definition["length"]) == (codec.can_id, codec.length)
        table = [_make_attributes(definition[name]) for name in codec.signals]
        for end in ("low", "high"):
            raws = [int(getattr(signal, end)) for signal in table]
            data = codec.pack_raw(11, *raws)
            word = int.from_bytes(data, "little", signed=len(data) == 8)
            assert [read_raw(word, signal) for signal in table] == raws
            assert [read_value(word, signal) for signal in table] == pytest.approx(codec.unpack(data), rel=1e-15)
            assert read_counter(word) == 11
            assert is_valid(word, codec.data_id)
            assert not is_valid(word ^ 1 << 13, codec.data_id)
            full = 0
            for signal in table:  # beyond its range a signal stays at its end
                full = put(full, signal, (2.0 if end == "high" else -2.0) * signal.high * signal.scale + signal.offset)
            protected = protect(full, codec.data_id, 11) & (1 << 8 * codec.length) - 1
            assert protected.to_bytes(codec.length, "little") == data


def test_a_batch_is_answered_as_objects_are() -> None:
    one, other = ControllerNode(), ControllerNode()
    inbox = make_batch(8)
    for tick in range(300):
        frames = sample(tick)
        sent = one.run_cycle(inbox, load(inbox, frames), 1)
        assert unload(one.outbox[:sent]) == other.step(frames)
        assert one.make_row() == other.make_row()


def test_a_cycle_fills_every_column() -> None:
    node = ControllerNode()
    for tick in range(20):
        node.record[:] = np.nan
        node.step(sample(tick))
    empty = [column.name for column, value in zip(node.columns, node.make_row(), strict=True) if np.isnan(value)]
    assert not empty


def test_a_record_is_the_row_by_name() -> None:
    node = ControllerNode()
    for tick in range(20):
        node.step(sample(tick))
    record = node.record.view(RECORD)[0]
    assert RECORD.names == tuple(column.name for column in node.columns)
    assert record.item() == node.make_row()
    assert record["sample_tick"] == 19


def test_a_cycle_allocates_nothing() -> None:
    node, inbox = ControllerNode(), make_batch(8)
    batches = iter([(load(inbox, sample(tick)), inbox.copy()) for tick in range(2000)])

    def play(cycles: int) -> None:
        for _ in range(cycles):
            count, frames = next(batches)
            node.run_cycle(frames, count, 1)

    assert measure_growth(play, 500, 1400) < 1000  # bytes in 1400 cycles: an object that a cycle kept would be 28 each


def test_other_threads_run_during_a_cycle() -> None:
    """A cycle on very many frames takes long; another thread counts during it."""
    node = ControllerNode()
    frames = [frame for tick in range(1300) for frame in sample(tick)]
    inbox = make_batch(len(frames))
    count = load(inbox, frames)
    counted, ended = [0], threading.Event()

    def run() -> None:
        while not ended.is_set():
            counted[0] += 1
            time.sleep(0)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        result = 0
        for _ in range(200):
            before = counted[0]
            run_cycle(node.states, node.settings, inbox, count, 1, node.outbox)
            result += counted[0] > before
    finally:
        ended.set()
        thread.join()
    assert result > 30  # of 200: all of them where a core is free, 91 where both are busy, 5 if the lock were held


def test_there_is_room_for_what_a_cycle_sends() -> None:
    node = ControllerNode()
    assert max(len(node.step(sample(tick))) for tick in range(200)) == OUTBOX


@pytest.mark.parametrize("slots", [1, 2, 7])
def test_status_and_heartbeat_keep_their_rate_when_slots_are_left_out(slots: int) -> None:
    node = ControllerNode()
    for name, every in (("CONTROLLER_STATUS", 100), ("CONTROLLER_HEARTBEAT", 50)):
        can_id = node.frames[name].can_id
        begin = 0 if name == "CONTROLLER_STATUS" else 14 * every  # the node has gone on
        sent = [
            begin + slots * cycle
            for cycle in range(14 * every // slots)
            for frame in node.step([], slots)
            if frame.can_id == can_id
        ]
        assert len(sent) == 14
        assert all(abs(time - k * every - begin) < slots for k, time in enumerate(sent)), sent


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (SETPOINT.pack(1, 1, 40.0, 10.0, 0.0), "set-point 40 Nm is outside 0..30 Nm"),
        (SETPOINT.pack(1, 3, 0.0, 10.0, 5.0), "set-point 5 bar is outside 0..4.5 bar"),
        (
            SETPOINT.pack(1, 7, 0.0, 10.0, 0.0),
            "request 7 is unknown; allowed are 0 idle, 1 engage, 2 release, 3 pressure, 4 lock",
        ),
        (SETPOINT.pack(1, 1, 0.0, -30.0, 0.0), "set-point -30 rad/s is outside -26.2..26.2 rad/s"),
        (bytes(5), "frame TORQUE_SETPOINT (0x180) was received with 5 bytes; its definition has 8"),
    ],
)
def test_what_cannot_be_followed_is_counted_and_told_and_changes_nothing(data: bytes, words: str) -> None:
    node, other = ControllerNode(), ControllerNode()
    good = Frame(SETPOINT.can_id, SETPOINT.pack(0, 1, 10.0, 10.0, 0.0))
    assert node.step([good, Frame(SETPOINT.can_id, data)]) == other.step([good])
    assert node.step([]) == other.step([])
    corrupt = [column.name for column in node.columns].index("frames_corrupt")
    assert (
        node.make_row()[:corrupt] + node.make_row()[corrupt + 1 :]
        == other.make_row()[:corrupt] + other.make_row()[corrupt + 1 :]
    )
    assert node.first_rejected == words
    counts = node.count_receptions()["TORQUE_SETPOINT"]
    assert counts["misshapen"] + counts["unusable"] == 1
    node.step([Frame(SETPOINT.can_id, bytes(3))])
    assert node.first_rejected == words  # the first stays


def test_a_set_point_that_cannot_be_followed_for_ever_releases_the_clutch() -> None:
    node = ControllerNode()
    node.step([Frame(SETPOINT.can_id, SETPOINT.pack(0, 1, 10.0, 10.0, 0.0))])
    for n in range(1, 400):
        node.step([Frame(SETPOINT.can_id, SETPOINT.pack(n, 1, 31.0, 10.0, 0.0))])
    assert float(node.states["setpoint_age"][0]) > float(node.settings["setpoint_timeout"][0])
    assert node.count_receptions()["TORQUE_SETPOINT"]["unusable"] == 399


def test_what_is_heard_is_counted_by_its_name() -> None:
    node = ControllerNode()
    for tick in (0, 1, 1, 4):
        node.step(sample(tick))
    node.step([Frame(ENCODER.can_id, bytes(8))])
    assert list(node.count_receptions()) == list(RECEIVED_FRAMES)
    assert node.count_receptions()["ENCODER"] == {
        "received": 3, "lost": 2, "repeated": 1, "conflicting": 0, "wrong_sequence": 0, "corrupt": 1, "misshapen": 0,
        "unusable": 0,
    }  # fmt: skip
