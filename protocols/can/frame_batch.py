"""Batch: frames in memory that is there from the start, as the kernel and compiled loops read and write them."""

import struct
from collections.abc import Sequence

import numpy as np
from numba import njit

from protocols.can.frames import Frame

# struct can_frame, then its time stamp [ns of CLOCK_REALTIME]
FRAME = np.dtype([("can_id", "u4"), ("length", "u1"), ("_", "u1", (3,)), ("data", "u1", (8,)), ("stamp", "i8")])
_PACKED = struct.Struct("=IB3x8sq")  # the same


def batch(capacity: int) -> np.ndarray:
    """Room for frames, shape (capacity,) of FRAME."""
    return np.zeros(capacity, FRAME)


def load(into: np.ndarray, frames: Sequence[Frame]) -> int:
    """Put frames into a batch; return their number. Raises ValueError where there is no room for them."""
    if len(frames) > len(into):
        raise ValueError(f"{len(frames)} frames are too many for a batch of {len(into)}")
    room = into.view(np.uint8).data
    for index, (can_id, data) in enumerate(frames):
        _PACKED.pack_into(room, index * _PACKED.size, can_id, len(data), data, 0)
    return len(frames)


def unload(frames: np.ndarray) -> list[Frame]:
    """The frames of a batch as objects."""
    return [Frame(can_id, data[:length]) for can_id, length, data, _ in _PACKED.iter_unpack(frames.tobytes())]


@njit(inline="always")
def word_of(data):
    """Payload of up to 8 bytes as a word, little-endian."""
    word = np.int64(0)
    for index in range(8):
        word |= np.int64(data[index]) << 8 * index
    return word


@njit(inline="always")
def write(frame, can_id, length, word):
    """Make `frame` one with this identifier and payload."""
    frame.can_id, frame.length = can_id, length
    for index in range(8):
        frame.data[index] = word >> 8 * index & 0xFF
