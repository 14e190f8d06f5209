"""Words: payloads as 64-bit integers for compiled loops, with signals as the DBC defines them.

Equation        value = raw scale + offset;  raw = floor((value - offset) / scale + 0.5)                    (as frames.py)
Protection      AUTOSAR E2E profile 5, header offset 0: CRC-16 in bits 0 to 15, over bytes 2 to 7 and the data ID; counter in
                bits 16 to 23
Assumptions     8 bytes, little-endian integers (database.py checks that)
References      AUTOSAR PRS_E2EProtocol R22-11, profile 5
Valid range     values of which the raw integer fits its signal; `put` saturates at the signal's range
"""

from math import floor

import numpy as np
from e2e.crc import calculate_crc16
from numba import njit

from protocols.can.frame_batch import write
from protocols.can.frames import COUNTER_MODULUS, COUNTER_START, FrameCodec

# A signal: its place in the word, scaling, and range low..high of its raw integer
SIGNAL = np.dtype(
    [("start", "i8"), ("mask", "i8"), ("sign", "i8"), ("low", "i8"), ("high", "i8"), ("scale", "f8"), ("offset", "f8")]
)
CRC_START, _CRC_BITS = 0xFFFF, 16
# CRC-16 as a table, from the e2e library: remainder of a byte from the remainder 0
CRC_TABLE = np.array([calculate_crc16(bytes((index,)), 0, False) for index in range(256)], np.uint16)
_COUNTER_MASK = COUNTER_MODULUS - 1


def make_frame_layout(codec: FrameCodec) -> np.dtype:
    """Return the type of a frame definition: can_id, length [bytes], data_id, and a SIGNAL by its name for `codec.signals`."""
    return np.dtype(
        [("can_id", "i8"), ("length", "i8"), ("data_id", "i8"), *((name, SIGNAL) for name in codec.signals)]
    )


def make_frame_definition(codec: FrameCodec) -> np.void:
    """Return the definition of a frame in the DBC, a record of `make_frame_layout(codec)`."""
    definition: np.void = np.zeros(1, make_frame_layout(codec))[0]
    definition["can_id"], definition["length"], definition["data_id"] = codec.can_id, codec.length, codec.data_id
    for signal in codec.definitions:
        if (name := signal.name.lower()) in codec.signals:
            half = 1 << signal.length - 1
            sign, low, high = (half, -half, half - 1) if signal.is_signed else (0, 0, 2 * half - 1)
            definition[name] = signal.start, 2 * half - 1, sign, low, high, float(signal.scale), float(signal.offset)
    return definition


@njit(inline="always")
def read_raw(word, signal):
    """Return the raw integer of a signal."""
    return ((word >> signal.start & signal.mask) ^ signal.sign) - signal.sign


@njit(inline="always")
def read_value(word, signal):
    """Return the physical value of a signal, in its unit."""
    return read_raw(word, signal) * signal.scale + signal.offset


@njit(inline="always")
def count_turn(counts, before, signal):
    """Return the change from the total `before` to the raw integer `counts` of a signal that wraps: below half its range."""
    wrap = signal.mask + 1
    return (counts - before + wrap // 2) % wrap - wrap // 2


@njit(inline="always")
def count_rise(counts, before, signal):
    """Return the change from the total `before` to the raw integer `counts` of a signal that wraps and only rises."""
    return counts - before & signal.mask


@njit(inline="always")
def put(word, signal, physical):
    """Return `word` with a signal set to `physical`, saturated at its range. The bits of the signal must be 0 before."""
    counts = min(max(floor((physical - signal.offset) / signal.scale + 0.5), signal.low), signal.high)
    return put_raw(word, signal, counts)


@njit(inline="always")
def put_raw(word, signal, counts):
    """Return `word` with a signal set to the raw integer `counts`, which wraps. The bits of the signal must be 0 before."""
    return word | (counts & signal.mask) << signal.start


@njit(inline="always")
def read_counter(word):
    """Return the alive counter, 0..255."""
    return word >> COUNTER_START & _COUNTER_MASK


@njit(inline="always")
def add_byte(remainder, byte):
    """Return the CRC remainder after one more byte."""
    return (remainder << 8 & 0xFF00) ^ np.int64(CRC_TABLE[remainder >> 8 ^ byte])


@njit
def compute_crc(word, data_id):
    """Return the CRC of the payload `word` of a frame with `data_id`."""
    remainder = np.int64(CRC_START)
    for shift in range(_CRC_BITS, 64, 8):
        remainder = add_byte(remainder, word >> shift & 0xFF)
    return add_byte(add_byte(remainder, data_id & 0xFF), data_id >> 8)


@njit(inline="always")
def protect(word, data_id, count):
    """Return the payload `word`, in which CRC and counter are 0, with the alive counter `count` and the CRC."""
    word |= (count & _COUNTER_MASK) << COUNTER_START
    return word | compute_crc(word, data_id)


@njit(inline="always")
def write_frame(frame, definition, word, count):
    """Write to `frame` the frame of `definition` with the payload `word`, the alive counter `count` and the CRC."""
    write(frame, definition.can_id, definition.length, protect(word, definition.data_id, count))


@njit(inline="always")
def is_valid(word, data_id):
    """Return whether the CRC is correct."""
    return compute_crc(word, data_id) == word & 0xFFFF
