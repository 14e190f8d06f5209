"""Reception of one kind of frame: length, CRC and alive counter decide whether a payload is accepted.

There is a class for tools, and a record with `accept_word` for compiled loops. A test compares both.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from protocols.can.frames import COUNTER_MODULUS, FrameCodec
from protocols.can.words import counter, valid
from protocols.errors import InputError

# Counts of `Reception`; counter: alive counter of the last frame plus 1, 0 before the first frame
RECEPTION = np.dtype(
    [(name, "i8") for name in ("can_id", "length", "counter", "received", "lost", "repeated", "corrupt")]
)
_COUNTS = ("received", "lost", "repeated", "corrupt")


class Reception:
    """Counts the frames of one kind and decides whether a payload may be used.

    `received`: accepted frames. `lost`: missing values of the alive counter; as it wraps at 16, more may be lost. `repeated`:
    frames with the counter of the frame before, refused because their sender is stuck. `corrupt`: frames with a wrong CRC,
    refused.
    """

    def __init__(self, codec: FrameCodec) -> None:
        self.codec = codec
        self.received = self.lost = self.repeated = self.corrupt = 0
        self._counter = -1

    def accept(self, data: bytes) -> bool:
        """Count a frame; return whether its payload `data` may be used.

        Raises InputError for a wrong length: then the sender has another definition of the frame.
        """
        codec = self.codec
        if len(data) != codec.length:
            raise InputError(
                f"frame {codec.name} (0x{codec.can_id:03X}) came with {len(data)} bytes; its definition has {codec.length}"
            )
        if not codec.valid(data):
            self.corrupt += 1
            return False
        counter = codec.counter(data)
        if counter == self._counter:
            self.repeated += 1
            return False
        if self._counter >= 0:
            self.lost += (counter - self._counter - 1) % COUNTER_MODULUS
        self._counter = counter
        self.received += 1
        return True

    def counts(self) -> dict[str, int]:
        """Return the four counts by name."""
        return {name: getattr(self, name) for name in _COUNTS}


def new_receptions(codecs: Sequence[FrameCodec]) -> np.ndarray:
    """Return records for the frames `codecs` before the first reception, shape (codecs,) of RECEPTION."""
    rows = np.zeros(len(codecs), RECEPTION)
    rows["can_id"], rows["length"] = [c.can_id for c in codecs], [c.length for c in codecs]
    return rows


def read_counts(row: np.void) -> dict[str, int]:
    """Return the four counts of a record by name."""
    return {name: int(row[name]) for name in _COUNTS}


@njit
def accept_word(reception, word, length):
    """Count a payload of correct length; return whether it may be used: correct CRC, and another counter than the last."""
    if not valid(word, length):
        reception.corrupt += 1
        return False
    count = counter(word) + 1
    if count == reception.counter:
        reception.repeated += 1
        return False
    if reception.counter:
        reception.lost += (count - reception.counter - 1) % COUNTER_MODULUS
    reception.counter = count
    reception.received += 1
    return True
