"""Batch: frames in preallocated memory, in the layout of the Linux kernel, for compiled loops."""

import struct
from collections.abc import Sequence

import numpy as np
from numba import njit

from protocols.can.frames import Frame

# struct can_frame of linux/can.h, then the time stamp [ns of CLOCK_REALTIME]
FRAME = np.dtype([("can_id", "u4"), ("length", "u1"), ("_", "u1", (3,)), ("data", "u1", (8,)), ("stamp", "i8")])
_FRAME_STRUCT = struct.Struct("=IB3x8sq")  # same layout as FRAME


def make_batch(capacity: int) -> np.ndarray:
    """Return memory for frames, shape (capacity,) of FRAME."""
    return np.zeros(capacity, FRAME)


def load(into: np.ndarray, frames: Sequence[Frame]) -> int:
    """Write frames into a batch; return their number. Raises ValueError when there are more than it can hold."""
    if len(frames) > len(into):
        raise ValueError(f"{len(frames)} frames are too many for a batch of {len(into)}")
    room = into.view(np.uint8).data
    for index, (can_id, data) in enumerate(frames):
        _FRAME_STRUCT.pack_into(room, index * _FRAME_STRUCT.size, can_id, len(data), data, 0)
    return len(frames)


def unload(frames: np.ndarray) -> list[Frame]:
    """Return the frames of a batch as objects."""
    return [Frame(can_id, data[:length]) for can_id, length, data, _ in _FRAME_STRUCT.iter_unpack(frames.tobytes())]


@njit(inline="always")
def read_word(data):
    """Return a payload of 8 bytes as a little-endian integer."""
    word = np.int64(0)
    for index in range(8):
        word |= np.int64(data[index]) << 8 * index
    return word


@njit(inline="always")
def write(frame, can_id, length, word):
    """Set identifier, length [bytes] and payload of `frame`."""
    frame.can_id, frame.length = can_id, length
    for index in range(8):
        frame.data[index] = word >> 8 * index & 0xFF
