"""Frames of version 1 as frames of version 2, compared with cantools on both databases."""

from collections.abc import Sequence
from pathlib import Path

import cantools.database
import numpy as np
import pytest
from cantools.database.can import Signal

from protocols.can.frames import DBC, DBC_1, Frame, FrameCodec, load_frames
from protocols.can.reception import Reception
from protocols.can.version import VERSION_1, VERSION_2, find_version
from protocols.files.bus_logs.bus_frames import FD, BusLog
from protocols.files.bus_logs.bus_log import mark_bench_frames
from protocols.files.bus_logs.version_1 import convert_frames, find_old_channels, fit_setpoint

OLD, NEW = load_frames(DBC_1), load_frames()
OLD_DATABASE, NEW_DATABASE = cantools.database.load_file(DBC_1), cantools.database.load_file(DBC)
WRAPPED = ("SHAFT_ANGLE", "SAMPLE_TICK", "SESSION")  # signals of which version 2 has the lower bits
FROM_OTHERS = {("ENCODER", "MOTOR_TORQUE"), ("MOTOR_COMMAND", "SAMPLE_TICK")}
SAMPLES = 400


def compute_crc8(data: bytes) -> int:
    """CRC-8 SAE J1850, bit by bit: polynomial x^8 + x^4 + x^3 + x^2 + 1, start and final xor 0xFF."""
    crc = 0xFF
    for byte in data:
        for bit in range(7, -1, -1):
            out = (crc >> 7) ^ (byte >> bit & 1)
            crc = (crc << 1 & 0xFF) ^ (0x1D if out else 0)
    return crc ^ 0xFF


def list_payload(name: str, database: cantools.database.can.Database) -> list[Signal]:
    signals = database.get_message_by_name(name).signals
    return [signal for signal in signals if signal.name not in ("CRC", "COUNTER")]


def encode_old(name: str, counter: int, values: dict[str, float]) -> bytes:
    """A payload of version 1 by cantools."""
    data = OLD_DATABASE.encode_message(name, {"CRC": 0, "COUNTER": counter % 16, **values}, strict=False)
    return bytes([compute_crc8(data[1:])]) + data[1:]


def draw_values(name: str, generator: np.random.Generator) -> dict[str, float]:
    """Random physical values of the whole range of each signal of version 1."""
    values = {}
    for signal in list_payload(name, OLD_DATABASE):
        half = 1 << signal.length - 1
        low, high = (-half, half) if signal.is_signed else (0, 2 * half)
        values[signal.name] = float(generator.integers(low, high) * signal.scale + signal.offset)
    return values


def make_log(frames: Sequence[Frame], flags: int = 0, channels: Sequence[int] | None = None) -> BusLog:
    """A log of frames that are 1 ms apart."""
    count = len(frames)
    lengths = np.array([len(frame.data) for frame in frames], np.uint8)
    return BusLog(
        Path("bus.log"), "candump", 1e-3 * np.arange(count), np.array([frame.can_id for frame in frames], np.uint32),
        np.full(count, flags, np.uint8), np.array(channels or [0] * count, np.uint16),
        np.cumsum([0, *lengths[:-1]]).astype(np.int64), lengths, b"".join(frame.data for frame in frames), ("can0", "can1"),
    )  # fmt: skip


def convert(frames: Sequence[Frame]) -> list[Frame]:
    log = convert_frames(make_log(frames))
    return [Frame(int(log.ids[row]), log.read_data(row)) for row in range(len(log))]


def count_frames(codec: FrameCodec, frames: Sequence[Frame]) -> Reception:
    reception = Reception(codec)
    for frame in frames:
        reception.accept(frame.data)
    return reception


def make_encoders(counters: Sequence[int]) -> list[Frame]:
    codec = OLD["ENCODER"]
    return [Frame(codec.can_id, codec.pack_raw(n, sample_tick=k)) for k, n in enumerate(counters)]


@pytest.mark.parametrize("clutch", ["a", "b"])
@pytest.mark.parametrize("name", OLD)
def test_values_are_those_of_version_1_within_the_step_of_version_2(name: str, clutch: str) -> None:
    generator = np.random.default_rng(OLD[name].can_id)
    drawn = [draw_values(name, generator) for _ in range(SAMPLES)]
    can_id, new = load_frames(DBC_1, clutch)[name].can_id, load_frames(clutch=clutch)[name]
    old = [Frame(can_id, encode_old(name, n, values)) for n, values in enumerate(drawn)]
    compared = 0
    for n, (before, (result, data)) in enumerate(zip(drawn, convert(old), strict=True)):
        assert result == can_id
        assert new.is_valid(data)
        assert new.read_counter(data) == n % 256
        after = NEW_DATABASE.decode_message(name, data, decode_choices=False)
        for signal in list_payload(name, NEW_DATABASE):
            if (name, signal.name) in FROM_OTHERS:
                continue
            if signal.name not in before:
                assert after[signal.name] == 0, "what a sender does not know"
                continue
            expected, turn = before[signal.name], (1 << signal.length) * signal.scale
            if signal.name in WRAPPED:
                off = (after[signal.name] - expected + turn / 2) % turn - turn / 2
            else:
                half = 1 << signal.length - 1
                low, high = (-half, half - 1) if signal.is_signed else (0, 2 * half - 1)
                off = after[signal.name] - np.clip(expected, low * signal.scale, high * signal.scale)
            assert abs(off) <= 0.5000001 * signal.scale * (signal.scale != 1), signal.name
            compared += 1
    assert compared >= SAMPLES


def test_the_motor_torque_of_a_sample_goes_from_one_frame_to_the_other() -> None:
    generator = np.random.default_rng(1)
    frames, torques = [], generator.integers(-2048, 2048, SAMPLES)
    for n, torque in enumerate(torques.tolist()):
        analog = OLD["ANALOG_SENSORS"].pack_raw(n, motor_torque=torque)
        frames += [Frame(OLD["ANALOG_SENSORS"].can_id, analog), *make_encoders([n])]
    encoders = [data for can_id, data in convert(frames) if can_id == NEW["ENCODER"].can_id]
    assert [NEW["ENCODER"].raw(data).motor_torque for data in encoders] == torques.tolist()


def test_a_motor_command_answers_the_last_sample() -> None:
    motor, encoder = OLD["MOTOR_COMMAND"], OLD["ENCODER"]
    frames = []
    for n in range(300):
        frames += [
            Frame(encoder.can_id, encoder.pack_raw(n, sample_tick=1000 + n)),
            Frame(motor.can_id, motor.pack_raw(n)),
        ]
    commands = [data for can_id, data in convert(frames) if can_id == motor.can_id]
    assert [NEW["MOTOR_COMMAND"].raw(data).sample_tick for data in commands] == [(1000 + n) % 128 for n in range(300)]


def test_the_angle_turns_on_where_it_wraps() -> None:
    encoder = OLD["ENCODER"]
    angles = np.cumsum(np.random.default_rng(2).integers(-100_000, 130_000, SAMPLES))
    frames = [Frame(encoder.can_id, encoder.pack_raw(n, shaft_angle=int(a))) for n, a in enumerate(angles)]
    result = np.array([NEW["ENCODER"].raw(data).shaft_angle for _, data in convert(frames)])
    assert np.array_equal(np.unwrap(result, period=2**18) - result[0], angles - angles[0])


@pytest.mark.parametrize("lost", range(4))
@pytest.mark.parametrize("first", [0, 7, 15])
def test_lost_frames_stay_lost(first: int, lost: int) -> None:
    counters = [n for n in range(first, first + 600) if n % 40 >= lost]
    reception = count_frames(NEW["ENCODER"], convert(make_encoders(counters)))
    missing = counters[-1] - counters[0] + 1 - len(counters)
    assert (reception.received, reception.lost, reception.repeated) == (len(counters), missing, 0)


def test_repeated_frames_stay_repeated_and_those_of_another_content_conflict() -> None:
    codec = OLD["ENCODER"]
    frames = [
        Frame(codec.can_id, codec.pack_raw(n, sample_tick=tick)) for n, tick in ((0, 0), (0, 0), (1, 1), (1, 2), (2, 3))
    ]
    reception = count_frames(NEW["ENCODER"], convert(frames))
    assert (reception.received, reception.repeated, reception.conflicting) == (3, 1, 1)


@pytest.mark.parametrize("name", OLD)
def test_wrong_frames_stay_wrong_and_leave_one_gap(name: str) -> None:
    old = OLD[name]
    frames = [Frame(old.can_id, old.pack_raw(n, *(n % 2 for _ in old.signals))) for n in range(300)]
    generator = np.random.default_rng(3)
    for n in range(5, 300, 20):
        bit = int(generator.integers(8 * old.length))
        frames[n] = Frame(old.can_id, bytes(b ^ (1 << bit % 8) * (k == bit // 8) for k, b in enumerate(frames[n].data)))
        frames[n + 10] = Frame(old.can_id, frames[n + 10].data[:-1] if n % 40 == 5 else frames[n + 10].data + b"\0")
    reception = count_frames(NEW[name], convert(frames))
    assert (reception.corrupt, reception.misshapen, reception.lost) == (15, 15, 30)
    assert reception.received == 270


def test_set_points_keep_the_steps_of_version_1_where_their_values_fit() -> None:
    old = OLD["TORQUE_SETPOINT"]
    generator = np.random.default_rng(4)
    values = [(int(n % 5), int(generator.integers(30_001)), -10_473, 0) for n in range(SAMPLES)]
    log = make_log([Frame(old.can_id, old.pack_raw(n, *raw)) for n, raw in enumerate(values)])
    setpoint = fit_setpoint(log)
    assert setpoint is not None
    assert (setpoint.can_id, setpoint.data_id) == (NEW["TORQUE_SETPOINT"].can_id, NEW["TORQUE_SETPOINT"].data_id)
    exact = convert_frames(log, setpoint)
    for row, raw in enumerate(values):
        data = exact.read_data(row)
        assert NEW["TORQUE_SETPOINT"].is_valid(data)
        assert data[3] & 7 == raw[0], "where the guard reads the request"
        assert setpoint.unpack(data) == old.unpack(old.pack_raw(0, *raw))  # to the bit


def test_set_points_of_all_kinds_at_once_need_more_bits() -> None:
    old = OLD["TORQUE_SETPOINT"]
    ends = [(1, 0, -26_000, 0), (3, 30_000, 26_000, 4_500)]
    assert fit_setpoint(make_log([Frame(old.can_id, old.pack_raw(n, *raw)) for n, raw in enumerate(ends)])) is None


def test_the_version_is_that_of_most_frames_on_a_channel() -> None:
    old, new = OLD["ENCODER"], NEW["ENCODER"]
    frames = [Frame(codec.can_id, codec.pack_raw(n)) for n in range(20) for codec in (old, new)]
    log = make_log(frames, channels=[0, 1] * 20)
    assert find_old_channels(log) == [0]
    assert mark_bench_frames(log, VERSION_1).tolist() == [True, False] * 20
    assert mark_bench_frames(log, VERSION_2).tolist() == [False, True] * 20
    converted = convert_frames(log)
    assert mark_bench_frames(converted, VERSION_2).all()
    assert [converted.read_data(row) for row in range(1, 40, 2)] == [frame.data for frame in frames[1::2]]


def test_frames_that_a_bus_port_ignores_and_those_of_another_bus_stay_as_they_are() -> None:
    encoders = make_encoders(range(20))
    for frames, flags in ((encoders, FD), ([Frame(can_id, bytes(8)) for can_id, _ in encoders], 0)):
        log = make_log(frames, flags)
        assert find_old_channels(log) == []
        converted = convert_frames(log)
        assert [converted.read_data(row) for row in range(20)] == [frame.data for frame in frames]


def test_each_database_is_found_by_its_version() -> None:
    assert (find_version(OLD_DATABASE), find_version(NEW_DATABASE)) == (VERSION_1, VERSION_2)
    assert all(codec.version is VERSION_1 for codec in OLD.values())
