"""Reception of one kind of frame: length, CRC and alive counter decide whether a payload is accepted.

There is a class for tools, and a record with `accept_word` for compiled loops. A test compares both. A frame that is not
accepted is counted, and nothing else happens: a wrong frame on the bus ends no run.

A second service       A service hears no frame of its own. So a frame on an identifier that it sends itself comes from another
                       sender. That is a stray frame of a tool, or a second service of the same kind. Only the second service
                       goes on: INTRUSION frames with correct length and CRC, whose counter moves, none later than
                       INTRUSION_PERIODS after the one before (`intrudes`).
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from protocols.can.frames import COUNTER_MODULUS, FrameCodec
from protocols.can.words import is_valid, read_counter

# misshapen: frames of another length; unusable: frames whose values the receiver cannot follow
_COUNTS = ("received", "lost", "repeated", "corrupt", "misshapen", "unusable")
REJECTED = ("repeated", "corrupt", "misshapen", "unusable")  # counts of frames that were not used
# Counts of `Reception`; counter: alive counter of the last frame plus 1, 0 before the first frame
RECEPTION = np.dtype([(name, "i8") for name in ("can_id", "length", "counter", *_COUNTS)])
# Frames of a second service on identifiers of this service: the number of the last ones, and the period of the last
INTRUDER = np.dtype([("frames", "i8"), ("period", "i8")])
INTRUSION = (
    10  # frames: chosen; a second plant or controller sends as many in 10 ms at 1 kHz, a person with a tool does not
)
INTRUSION_PERIODS = 1000  # periods of the loop: 1 s at 1 kHz, 20 heartbeats
WRONG_RATES = 3  # heartbeats in sequence that tell another rate, 0.15 s: during a run one may be a stray frame


class Reception:
    """Counts the frames of one kind and decides whether a payload may be used.

    `received`: accepted frames. `lost`: missing values of the alive counter; as it wraps at 16, more may be lost. `repeated`:
    frames with the counter of the frame before, refused because their sender is stuck. `corrupt`: frames with a wrong CRC,
    refused. `misshapen`: frames of another length than the definition's, refused. `unusable`: accepted frames whose values the
    receiver could not follow (not counted here).
    """

    def __init__(self, codec: FrameCodec) -> None:
        self.codec = codec
        self.received = self.lost = self.repeated = self.corrupt = self.misshapen = self.unusable = 0
        self._counter = -1

    def accept(self, data: bytes) -> bool:
        """Count a frame; return whether its payload `data` may be used."""
        codec = self.codec
        if len(data) != codec.length:
            self.misshapen += 1
            return False
        if not codec.is_valid(data):
            self.corrupt += 1
            return False
        counter = codec.read_counter(data)
        if counter == self._counter:
            self.repeated += 1
            return False
        if self._counter >= 0:
            self.lost += (counter - self._counter - 1) % COUNTER_MODULUS
        self._counter = counter
        self.received += 1
        return True

    def read_counts(self) -> dict[str, int]:
        """Return the counts by name."""
        return {name: getattr(self, name) for name in _COUNTS}


def make_receptions(codecs: Sequence[FrameCodec]) -> np.ndarray:
    """Return records for the frames `codecs` before the first reception, shape (codecs,) of RECEPTION."""
    rows = np.zeros(len(codecs), RECEPTION)
    rows["can_id"], rows["length"] = [c.can_id for c in codecs], [c.length for c in codecs]
    return rows


def read_counts(row: np.void) -> dict[str, int]:
    """Return the counts of a record by name."""
    return {name: int(row[name]) for name in _COUNTS}


@njit
def accept_word(reception, word, length):
    """Count a payload of `length` [bytes]; return whether it may be used: correct length and CRC, and its counter has moved."""
    if length != reception.length:
        reception.misshapen += 1
        return False
    if not is_valid(word, length):
        reception.corrupt += 1
        return False
    count = read_counter(word) + 1
    if count == reception.counter:
        reception.repeated += 1
        return False
    if reception.counter:
        reception.lost += (count - reception.counter - 1) % COUNTER_MODULUS
    reception.counter = count
    reception.received += 1
    return True


@njit
def count_rejected(reception):
    """Return the number of frames of a kind that were not used."""
    return reception.repeated + reception.corrupt + reception.misshapen + reception.unusable


@njit
def intrudes(intruder, reception, word, length, period):
    """Count a frame on an identifier of ours; return whether a second service sends: see above.

    `intruder` is an INTRUDER, `reception` that of the identifier, `period` the number of the loop's period.
    """
    if not accept_word(reception, word, length):
        return False
    if period - intruder.period > INTRUSION_PERIODS:
        intruder.frames = 0
    intruder.frames, intruder.period = intruder.frames + 1, period
    return intruder.frames >= INTRUSION
