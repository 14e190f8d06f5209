"""Reception of one kind of frame: length, CRC with data ID, and alive counter decide whether a payload is accepted.

There is a class for tools, and a record with `accept_word` for compiled loops. A test compares both. A frame that is not
accepted is only counted: a wrong frame on the bus does not end a run.

Sequence               A counter that steps by 1 to MAX_DELTA is a new frame. One that does not step is a repetition. Any other
                       step is a wrong sequence: an older frame, a gap that is too long, or a second sender. The frame is
                       not used, and the next one is compared with it (AUTOSAR PRS_E2EProtocol, profile 5).

A second service       A service hears no frame of its own. So a frame on an identifier that it sends itself comes from another
                       sender. That is a stray frame of a tool, or a second service of the same kind. Only the second service
                       continues: INTRUSION frames with correct length and CRC, whose counter moves, none later than
                       INTRUSION_PERIODS after the one before (`intrudes`).
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from protocols.can.frames import COUNTER_MODULUS, FrameCodec
from protocols.can.words import is_valid, read_counter

# Highest step of the counter of a frame that is used: 3 may be lost. The CRC misses 6 bursts of 16 bits; each of them changes
# the counter by more (docs/protection.md)
MAX_DELTA = 4
# misshapen: frames of another length; unusable: frames whose values the receiver cannot follow
_COUNTS = ("received", "lost", "repeated", "conflicting", "wrong_sequence", "corrupt", "misshapen", "unusable")
REJECTED = _COUNTS[2:]  # counts of frames that were not used
# Counts of `Reception`; counter: alive counter of the last frame plus 1, 0 before the first frame; word: its payload; doubts:
# see `count_doubts`
RECEPTION = np.dtype([(name, "i8") for name in ("can_id", "length", "data_id", "counter", "word", "doubts", *_COUNTS)])
# Frames of a second service on identifiers of this service: number of recent frames, and period of the last
INTRUDER = np.dtype([("frames", "i8"), ("period", "i8")])
# frames: chosen; a second plant or controller sends as many in 10 ms at 1 kHz, a person with a tool does not
INTRUSION = 10
# Doubts of a frame out of sequence, and of one that conflicts with the one before; doubts from which on there are two senders.
# One frame that is used takes 1 away. Chosen: 5 or 2 in short order are a second sender, which makes one in each cycle; a bus
# that brings 3 of 1000 in another order makes 1 in 300
SEQUENCE_DOUBT, CONFLICT_DOUBT, MOST_DOUBTS = 10, 25, 50
INTRUSION_PERIODS = 1000  # periods of the loop: 1 s at 1 kHz, 20 heartbeats
WRONG_RATES = 3  # consecutive heartbeats with another rate, 0.15 s: during a run a single one may be a stray frame


class Reception:
    """Counts the frames of one kind and decides whether a payload may be used.

    `received`: accepted frames. `lost`: missing values of the alive counter; as it wraps at 256, more may be lost. `repeated`:
    the frame before once more, refused. `conflicting`: frames with the counter of the frame before and another content, as only
    a second sender makes them; refused. `wrong_sequence`: frames whose counter makes another step than 1 to
    MAX_DELTA, refused. `corrupt`: frames with a wrong CRC, or with the data ID of another frame, refused. `misshapen`: frames
    of another length than the definition's, refused. `unusable`: accepted frames whose values the receiver could not follow
    (not counted here).
    """

    def __init__(self, codec: FrameCodec) -> None:
        self.codec = codec
        self.received = self.lost = self.repeated = self.conflicting = self.wrong_sequence = 0
        self.corrupt = self.misshapen = self.unusable = 0
        self._counter, self._data = -1, b""

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
        delta = (counter - self._counter) % COUNTER_MODULUS if self._counter >= 0 else 1
        if delta == 0:
            self.repeated += data == self._data
            self.conflicting += data != self._data
            return False
        self._counter, self._data = counter, data
        if delta <= COUNTER_MODULUS // 2:  # a larger step is one back
            self.lost += delta - 1
        if delta > MAX_DELTA:
            self.wrong_sequence += 1
            return False
        self.received += 1
        return True

    def read_counts(self) -> dict[str, int]:
        """Return the counts by name."""
        return {name: getattr(self, name) for name in _COUNTS}


def make_receptions(codecs: Sequence[FrameCodec]) -> np.ndarray:
    """Return records for the frames `codecs` before the first reception, shape (codecs,) of RECEPTION."""
    rows = np.zeros(len(codecs), RECEPTION)
    for name in ("can_id", "length", "data_id"):
        rows[name] = [getattr(codec, name) for codec in codecs]
    return rows


def read_counts(row: np.void) -> dict[str, int]:
    """Return the counts of a record by name."""
    return {name: int(row[name]) for name in _COUNTS}


@njit
def accept_word(reception, word, length):
    """Count a payload of `length` [bytes]; return whether it may be used: correct length, CRC and sequence."""
    if length != reception.length:
        reception.misshapen += 1
        return False
    if not is_valid(word, reception.data_id):
        reception.corrupt += 1
        return False
    count = read_counter(word) + 1
    delta = (count - reception.counter) % COUNTER_MODULUS if reception.counter else 1
    if delta == 0:
        reception.repeated += word == reception.word
        reception.conflicting += word != reception.word
        return False
    reception.counter, reception.word = count, word
    if delta <= COUNTER_MODULUS // 2:
        reception.lost += delta - 1
    if delta > MAX_DELTA:
        reception.wrong_sequence += 1
        return False
    reception.received += 1
    return True


@njit
def count_rejected(reception):
    """Return the number of frames of a kind that were not used."""
    rejected = reception.repeated + reception.conflicting + reception.wrong_sequence + reception.corrupt
    return rejected + reception.misshapen + reception.unusable


@njit
def intrudes(intruder, reception, word, length, period):
    """Count a frame on an identifier of this service; return whether a second service sends (module docstring).

    `intruder` is an INTRUDER, `reception` that of the identifier, `period` the number of the loop's period.
    """
    if not accept_word(reception, word, length):
        return False
    if period - intruder.period > INTRUSION_PERIODS:
        intruder.frames = 0
    intruder.frames, intruder.period = intruder.frames + 1, period
    return intruder.frames >= INTRUSION


@njit
def is_intruded(intruder, period):
    """Return whether a second service sends, or has sent in the last INTRUSION_PERIODS before `period`."""
    return intruder.frames >= INTRUSION and period - intruder.period <= INTRUSION_PERIODS


@njit
def count_doubts(reception, word, length):
    """Accept a frame as `accept_word`, and update the doubts whether a second sender uses its identifier."""
    conflicting, wrong_sequence = reception.conflicting, reception.wrong_sequence
    if accept_word(reception, word, length):
        reception.doubts = max(reception.doubts - 1, 0)
        return True
    more = CONFLICT_DOUBT * (reception.conflicting - conflicting)
    more += SEQUENCE_DOUBT * (reception.wrong_sequence - wrong_sequence)
    reception.doubts = min(reception.doubts + more, 2 * MOST_DOUBTS)
    return False
