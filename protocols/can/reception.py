"""Reception of one kind of frame: length, CRC and alive counter decide whether a payload is believed.

For tools a class, for compiled loops a record and `accepted`; tests hold both to the same.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from protocols.can.frames import COUNTER_MODULUS, FrameCodec
from protocols.can.words import counter, valid
from protocols.errors import InputError

# Counts as of `Reception`; counter: one more than the last, 0 before the first
RECEPTION = np.dtype(
    [(name, "i8") for name in ("can_id", "length", "counter", "received", "lost", "repeated", "corrupt")]
)
_COUNTS = ("received", "lost", "repeated", "corrupt")


class Reception:
    """Counts what arrives of one frame and gates its payload.

    `received` accepted frames; `lost` gaps in the alive counter (at least: it wraps at 16); `repeated` frames with the
    counter of the frame before, refused as a stuck sender; `corrupt` frames whose CRC is wrong, refused.
    """

    def __init__(self, codec: FrameCodec) -> None:
        self.codec = codec
        self.received = self.lost = self.repeated = self.corrupt = 0
        self._counter = -1

    def accept(self, data: bytes) -> bool:
        """Whether `data` may be used.

        Raises InputError for a wrong length: the sender has another definition of the frame, nothing it says can be
        believed.
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
        """The four counters by name."""
        return {name: getattr(self, name) for name in _COUNTS}


def receptions(codecs: Sequence[FrameCodec]) -> np.ndarray:
    """Records of the frames `codecs` before anything has come, shape (codecs,) of RECEPTION."""
    rows = np.zeros(len(codecs), RECEPTION)
    rows["can_id"], rows["length"] = [c.can_id for c in codecs], [c.length for c in codecs]
    return rows


def counted(row: np.void) -> dict[str, int]:
    """The four counters of a record by name."""
    return {name: int(row[name]) for name in _COUNTS}


@njit
def accepted(reception, word, length):
    """Whether a payload of the right length may be used: its CRC is right and its counter another than the last."""
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
