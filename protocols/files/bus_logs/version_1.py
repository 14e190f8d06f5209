"""Version 1: converts frames of the bench in an old log to frames of version 2.

Method          Signals are decoded by `clutch_rig_version_1.dbc` and encoded by `clutch_rig.dbc`, with the data ID and the CRC.
                A signal of the same step keeps its counts, another is rounded. The angle, the ticks and the session keep their
                lower bits; other signals are limited to the range of version 2
Counter         its 4 bits are extended to 8, so that a lost or repeated frame is lost or repeated in both versions. From 16
                lost frames on, their number is too small by a multiple of 16, as in version 1
Other frames    MOTOR_TORQUE of ENCODER is taken from the last ANALOG_SENSORS before it, SAMPLE_TICK of MOTOR_COMMAND from the
                last ENCODER: in version 1 the first signal is in another frame, and the second does not exist
Wrong frames    a frame with a wrong CRC or length keeps a wrong CRC or length
Set-points      version 2 has larger steps. `fit_setpoint` makes a frame definition that is exact for the values in a log
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion

from protocols.can.database import read_database
from protocols.can.frames import COUNTER_START, DBC, DBC_1, FrameCodec, load_frames
from protocols.can.two_clutches import CLUTCHES
from protocols.can.version import LENGTH, VERSION_1, VERSION_2
from protocols.files.bus_logs.bus_frames import BusLog
from protocols.files.bus_logs.bus_log import check_crcs, compute_crcs, mark_bench_frames

NOTE = "its frames are of version 1 of the bench's database, with a CRC of 8 bits; converted to version 2"
_WRAPPED = ("SHAFT_ANGLE", "SAMPLE_TICK", "SESSION")  # signals of which the lower bits are kept
_SETPOINT, _FIRST_DEMAND = "TORQUE_SETPOINT", 27  # the frame, and its first bit after header and request


def find_old_channels(log: BusLog) -> list[int]:
    """Return the indices of the channels of a log whose frames of the bench are of version 1."""
    old, new = (np.unique(log.channel[mark_bench_frames(log, version)]) for version in (VERSION_1, VERSION_2))
    return np.setdiff1d(old, new).tolist()


def convert_frames(log: BusLog, setpoint: FrameCodec | None = None) -> BusLog:
    """Return the log with its frames of version 1 as frames of version 2.

    setpoint: definition of TORQUE_SETPOINT of clutch a, if not the bench's own.
    """
    kinds = list(_find_frames(log))
    payload = bytearray(log.payload)
    starts, lengths = log.starts.copy(), log.lengths.copy()
    for kind in kinds:
        new = setpoint if setpoint and kind.new.can_id == setpoint.can_id else kind.new
        rows = kind.rows[kind.shaped]
        starts[rows] = len(payload) + LENGTH * np.arange(len(rows))
        payload += _encode(log, kind, new, kinds).tobytes()
        lengths[rows] = LENGTH
        others = kind.rows[~kind.shaped]
        lengths[others] = np.where(log.lengths[others] == LENGTH, LENGTH - 1, log.lengths[others])
    return replace(log, starts=starts, lengths=lengths, payload=bytes(payload))


def fit_setpoint(log: BusLog) -> FrameCodec | None:
    """Return a definition of TORQUE_SETPOINT with the steps of version 1, exact for the values in a log.

    None if they need more bits. A constant demand needs one bit, another the bits of its highest count. The request stays where
    the guard reads it.
    """
    (message,) = (message for message in read_database(DBC).messages if message.name == _SETPOINT)
    old = load_frames(DBC_1)[_SETPOINT]
    kinds = [kind for kind in _find_frames(log) if kind.old.can_id == old.can_id]
    start, signals = _FIRST_DEMAND, []
    for signal in sorted(message.signals, key=lambda signal: signal.start):
        if signal.start < _FIRST_DEMAND:
            signals.append(signal)
            continue
        (before,) = (one for one in old.definitions if one.name == signal.name)
        counts = np.concatenate([_read_counts(log, kind, before)[kind.good[kind.shaped]] for kind in kinds] or [[]])
        signals.append(_fit_signal(before, counts.astype(np.int64), start))
        start += signals[-1].length
    if start > 8 * LENGTH:
        return None
    fine = Message(
        message.frame_id, message.name, LENGTH, signals, senders=message.senders, cycle_time=message.cycle_time,
        dbc_specifics=message.dbc,
    )  # fmt: skip
    return FrameCodec(fine)


@dataclass(frozen=True)
class _Kind:
    """Frames of one kind on a channel. rows (n,): indices in the log; shaped: of the right length; good: also valid."""

    channel: int
    clutch: str
    old: FrameCodec
    new: FrameCodec
    rows: np.ndarray
    shaped: np.ndarray
    good: np.ndarray


def _find_frames(log: BusLog) -> Iterator[_Kind]:
    """Yield the frames of version 1 by channel and kind; shared frames count as clutch a's."""
    for channel in find_old_channels(log):
        seen = set()
        there = (log.channel == channel) & (log.flags == 0)
        for clutch in CLUTCHES:
            for name, old in load_frames(DBC_1, clutch).items():
                if old.can_id in seen:
                    continue
                seen.add(old.can_id)
                rows = np.flatnonzero(there & (log.ids == old.can_id))
                shaped = log.lengths[rows] == old.length
                good = shaped.copy()
                good[shaped] = check_crcs(log, rows[shaped], old.length, 0, VERSION_1)
                yield _Kind(channel, clutch, old, load_frames(clutch=clutch)[name], rows, shaped, good)


def _encode(log: BusLog, kind: _Kind, new: FrameCodec, kinds: list[_Kind]) -> np.ndarray:
    """Return payloads (n, LENGTH) of version 2 for the frames that have the right length."""
    rows, good = kind.rows[kind.shaped], kind.good[kind.shaped]
    words = _count_on(log, kind).astype(np.uint64) << np.uint64(COUNTER_START)
    before = {signal.name: signal for signal in kind.old.definitions}
    for signal in new.definitions:
        if signal.name.lower() not in new.signals:
            continue
        if signal.name in before:
            counts = _convert_counts(_read_counts(log, kind, before[signal.name]), before[signal.name], signal)
        else:
            counts = _take_from_other(log, kind, signal, rows, kinds)
        words |= (counts & (1 << signal.length) - 1).astype(np.uint64) << np.uint64(signal.start)
    data = words.astype("<u8")[:, None].view(np.uint8)
    crcs = compute_crcs(data, new.data_id, VERSION_2) ^ np.where(good, 0, 0xFFFF).astype(np.uint16)
    data[:, 0], data[:, 1] = crcs & 0xFF, crcs >> 8
    return data


def _count_on(log: BusLog, kind: _Kind) -> np.ndarray:
    """Return 8-bit counters (n,) for the frames of the right length; those of valid frames step as in version 1."""
    rows, good = kind.rows[kind.shaped], kind.good[kind.shaped]
    counters = (log.read_matrix(rows, 2)[:, 1] & VERSION_1.counter_modulus - 1).astype(np.int64)
    valid = counters[good]
    steps = np.diff(valid, prepend=valid[:1]) % VERSION_1.counter_modulus
    counters[good] = (valid[:1] + np.cumsum(steps)) % VERSION_2.counter_modulus
    return counters


def _read_counts(log: BusLog, kind: _Kind, signal: Signal) -> np.ndarray:
    """Return the raw integers (n,) of a signal of version 1 in the frames of the right length."""
    data = np.zeros((np.count_nonzero(kind.shaped), LENGTH), np.uint8)
    data[:, : kind.old.length] = log.read_matrix(kind.rows[kind.shaped], kind.old.length)
    mask = (1 << signal.length) - 1
    counts = (data.view("<u8")[:, 0] >> np.uint64(signal.start) & np.uint64(mask)).astype(np.int64)
    sign = 1 << signal.length - 1 if signal.is_signed else 0
    return (counts ^ sign) - sign


def _convert_counts(counts: np.ndarray, old: Signal, new: Signal) -> np.ndarray:
    """Return the raw integers of a signal of version 2 from those of version 1."""
    if (old.scale, old.offset) != (new.scale, new.offset):
        values = counts * float(old.scale) + float(old.offset)
        counts = np.floor((values - float(new.offset)) / float(new.scale) + 0.5).astype(np.int64)
    if new.name in _WRAPPED:
        return counts
    half = 1 << new.length - 1
    return np.clip(counts, *((-half, half - 1) if new.is_signed else (0, 2 * half - 1)))


def _take_from_other(log: BusLog, kind: _Kind, signal: Signal, rows: np.ndarray, kinds: list[_Kind]) -> np.ndarray:
    """Return the raw integers of a signal that version 1 has in another sensor frame.

    Each is from the last valid frame before each of `rows`; 0 if there is none.
    """
    for other in kinds:
        places = [one for one in other.old.definitions if one.name == signal.name]
        sensor = other.old.sender == load_frames(DBC_1, kind.clutch)["ENCODER"].sender
        if other.channel == kind.channel and other.clutch == kind.clutch and sensor and places:
            there = other.rows[other.good]
            counts = _read_counts(log, other, places[0])[other.good[other.shaped]]
            last = np.searchsorted(there, rows) - 1
            return np.where(last >= 0, counts[np.maximum(last, 0)], 0) if len(there) else np.zeros(len(rows), np.int64)
    return np.zeros(len(rows), np.int64)


def _fit_signal(old: Signal, counts: np.ndarray, start: int) -> Signal:
    """Return a signal from bit `start` on, with the step of `old` and the bits that `counts` need.

    A constant value becomes the offset.
    """
    scale, offset, signed = float(old.scale), float(old.offset), bool(old.is_signed)
    if len(counts) == 0 or counts.min() == counts.max():
        constant = int(counts[0]) if len(counts) else 0
        length, signed, offset = 1, False, constant * scale + offset
    else:
        highest = int(np.max(np.where(counts < 0, ~counts, counts)))
        length = highest.bit_length() + signed
    conversion = BaseConversion.factory(scale=scale, offset=offset)
    return Signal(old.name, start, length, is_signed=signed, conversion=conversion, unit=old.unit)
