"""Words: payloads of the bus for compiled loops, each an integer of 64 bits, its signals by name as the DBC defines them.

Equation        value = raw scale + offset;  raw = floor((value - offset) / scale + 0.5)                    (as frames.py)
Assumptions     up to 8 bytes, little-endian integers (frames.py checks that); CRC in byte 0, alive counter in bits 8 to 11
Valid range     values of which the raw integer fits its signal; `put` saturates at the signal's range
"""

from math import floor

import numpy as np
from e2e.crc import calculate_crc8
from numba import njit

from protocols.can.frame_batch import write
from protocols.can.frames import FrameCodec

# How a signal lies in the word and what a count of it is worth; low, high: the ends of its raw integer
SIGNAL = np.dtype(
    [("start", "i8"), ("mask", "i8"), ("sign", "i8"), ("low", "i8"), ("high", "i8"), ("scale", "f8"), ("offset", "f8")]
)
# CRC-8 of e2e as a table: of one byte it is table[0xFF ^ byte] ^ 0xFF
_TABLE = np.array([calculate_crc8(bytes((index ^ 0xFF,))) ^ 0xFF for index in range(256)], np.uint8)
_COUNTER = 15  # mask of the alive counter


def frame_layout(codec: FrameCodec) -> np.dtype:
    """The type of a frame's definition: can_id, length [bytes], and a SIGNAL for each of `codec.signals`, by its name."""
    return np.dtype([("can_id", "i8"), ("length", "i8"), *((name, SIGNAL) for name in codec.signals)])


def frame_definition(codec: FrameCodec) -> np.void:
    """A frame as the DBC defines it, a record of `frame_layout(codec)`."""
    definition: np.void = np.zeros(1, frame_layout(codec))[0]
    definition["can_id"], definition["length"] = codec.can_id, codec.length
    for signal in codec.definitions:
        if (name := signal.name.lower()) in codec.signals:
            half = 1 << signal.length - 1
            sign, low, high = (half, -half, half - 1) if signal.is_signed else (0, 0, 2 * half - 1)
            definition[name] = signal.start, 2 * half - 1, sign, low, high, float(signal.scale), float(signal.offset)
    return definition


@njit(inline="always")
def raw(word, signal):
    """Raw integer of a signal."""
    return ((word >> signal.start & signal.mask) ^ signal.sign) - signal.sign


@njit(inline="always")
def value(word, signal):
    """Physical value of a signal, in its unit."""
    return raw(word, signal) * signal.scale + signal.offset


@njit(inline="always")
def count_turn(counts, before, signal):
    """Counts from `before`, a total, to the raw integer `counts` of a signal that wraps: less than half a turn, either way."""
    wrap = signal.mask + 1
    return (counts - before + wrap // 2) % wrap - wrap // 2


@njit(inline="always")
def count_rise(counts, before, signal):
    """Counts from `before`, a total, to the raw integer `counts` of a signal that wraps and only rises."""
    return counts - before & signal.mask


@njit(inline="always")
def put(word, signal, physical):
    """`word` with the signal at `physical`, or at the nearest value that it has."""
    counts = min(max(floor((physical - signal.offset) / signal.scale + 0.5), signal.low), signal.high)
    return put_raw(word, signal, counts)


@njit(inline="always")
def put_raw(word, signal, counts):
    """`word` with the signal at the raw integer `counts`, which wraps where it is beyond the range."""
    return word | (counts & signal.mask) << signal.start


@njit(inline="always")
def counter(word):
    """Alive counter, 0..15."""
    return word >> 8 & _COUNTER


@njit
def crc(word, length):
    """CRC of the bytes after the first."""
    found = np.int64(0xFF)
    for index in range(1, length):
        found = np.int64(_TABLE[found ^ (word >> 8 * index & 0xFF)])
    return found ^ 0xFF


@njit(inline="always")
def sealed(word, length, count):
    """The payload `word`, CRC and counter of which are zero, with both."""
    word |= (count & _COUNTER) << 8
    return word | crc(word, length)


@njit(inline="always")
def write_frame(frame, definition, word, count):
    """Make `frame` the one that `definition` defines, with the payload `word`, its CRC and the counter of `count`."""
    write(frame, definition.can_id, definition.length, sealed(word, definition.length, count))


@njit(inline="always")
def valid(word, length):
    """Whether the CRC is right."""
    return crc(word, length) == word & 0xFF
