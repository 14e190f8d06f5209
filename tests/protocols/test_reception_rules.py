"""Rules of reception: each boundary on both sides, in the class and in the record. Each test has the module as argument, so
that it can run on mutants (tests/mutation)."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

import protocols.can.reception
from protocols.can.frames import FrameCodec, load_frames
from tests.mutation.plain import is_plain, view_records

CODECS = load_frames()
ENCODER = CODECS["ENCODER"]
COUNTS = ("received", "lost", "repeated", "conflicting", "wrong_sequence", "corrupt", "misshapen", "unusable")


@pytest.fixture(scope="module")
def reception() -> ModuleType:
    return protocols.can.reception


class Receiver:
    """The record of a module for frames ENCODER, and its object. Both must say the same."""

    def __init__(self, reception: ModuleType) -> None:
        self.module = reception
        rows = reception.make_receptions([ENCODER])
        self.record = view_record(rows)
        self.object = reception.Reception(ENCODER)

    def accept(self, counter: int, value: int = 0, length: int = 8, flip: int = 0) -> bool:
        """Give both a frame; `flip` are bits of the payload that are wrong."""
        data = make_data(counter, value, flip)
        used = self.module.accept_word(self.record, to_word(data), length)
        assert self.object.accept(data[:length] + bytes(max(length - 8, 0))) == used
        assert self.read_counts() == self.object.read_counts()
        return bool(used)

    def read_counts(self) -> dict[str, int]:
        return dict(self.module.read_counts(self.record))

    def count(self, **expected: int) -> bool:
        """Whether the counts are those expected, and 0 where none is."""
        return self.read_counts() == dict.fromkeys(COUNTS, 0) | expected


class Intruded:
    """The records of a module for frames on an identifier of this service."""

    def __init__(self, reception: ModuleType) -> None:
        self.module, self.counter = reception, 0
        self.intruder = view_record(np.zeros(1, reception.INTRUDER))
        self.record = view_record(reception.make_receptions([ENCODER]))

    def hear(self, period: int, flip: int = 0) -> bool:
        """Give the next frame of the other sender in a `period`; return whether it is a second service."""
        self.counter += 1
        word = to_word(make_data(self.counter, 0, flip))
        return bool(self.module.intrudes(self.intruder, self.record, word, 8, period))

    def is_intruded(self, period: int) -> bool:
        return bool(self.module.is_intruded(self.intruder, period))


def view_record(rows: np.ndarray) -> Any:
    return (view_records(rows) if is_plain() else rows.view(np.recarray))[0]


def make_data(counter: int, value: int = 0, flip: int = 0, codec: FrameCodec = ENCODER) -> bytes:
    data = codec.pack_raw(counter, *(value for _ in codec.signals))
    return (int.from_bytes(data, "little") ^ flip).to_bytes(len(data), "little")


def to_word(data: bytes) -> np.int64:
    return np.int64(int.from_bytes(data, "little", signed=True))


# --- which frames are used -------------------------------------------------------------------------------------------


def test_records_are_those_of_their_frames(reception: ModuleType) -> None:
    rows = reception.make_receptions(list(CODECS.values()))
    for row, codec in zip(rows, CODECS.values(), strict=True):
        assert (row["can_id"], row["length"], row["data_id"]) == (codec.can_id, codec.length, codec.data_id)
        assert dict(reception.read_counts(row)) == dict.fromkeys(COUNTS, 0)
        assert (row["counter"], row["word"], row["doubts"]) == (0, 0, 0)
    assert (*COUNTS[2:],) == reception.REJECTED


def test_the_first_frame_is_used_with_any_counter(reception: ModuleType) -> None:
    for counter in (0, 1, 4, 5, 200, 255):
        receiver = Receiver(reception)
        assert receiver.accept(counter)
        assert receiver.count(received=1)
        assert receiver.record.counter == counter + 1


def test_a_step_of_1_to_4_is_used_and_the_missing_ones_are_counted(reception: ModuleType) -> None:
    for first in (0, 100, 253, 255):
        for step in (1, 2, 3, 4):
            receiver = Receiver(reception)
            receiver.accept(first)
            assert receiver.accept(first + step)
            assert receiver.count(received=2, lost=step - 1)


def test_a_step_of_5_or_more_is_not_used(reception: ModuleType) -> None:
    for first in (0, 100, 253):
        for step, lost in ((5, 4), (127, 126), (128, 127), (129, 0), (254, 0), (255, 0)):
            receiver = Receiver(reception)
            receiver.accept(first)
            assert not receiver.accept(first + step)
            assert receiver.count(received=1, lost=lost, wrong_sequence=1)
            assert receiver.accept(first + step + 1)  # the next one is compared with it
            assert receiver.count(received=2, lost=lost, wrong_sequence=1)


def test_a_step_of_0_is_not_used(reception: ModuleType) -> None:
    receiver = Receiver(reception)
    receiver.accept(7, value=1)
    assert not receiver.accept(7, value=1)
    assert receiver.count(received=1, repeated=1)
    assert not receiver.accept(7, value=0)
    assert receiver.count(received=1, repeated=1, conflicting=1)
    assert not receiver.accept(7, value=1)  # it is compared with the one that was used
    assert receiver.count(received=1, repeated=2, conflicting=1)
    assert receiver.accept(8)


def test_a_frame_of_another_length_leaves_nothing_but_its_count(reception: ModuleType) -> None:
    receiver = Receiver(reception)
    receiver.accept(7)
    assert not receiver.accept(8, length=7)
    assert not receiver.accept(8, length=9)
    assert receiver.count(received=1, misshapen=2)
    assert receiver.accept(8)


def test_a_corrupt_frame_leaves_nothing_but_its_count(reception: ModuleType) -> None:
    receiver = Receiver(reception)
    receiver.accept(7)
    assert not receiver.accept(12, flip=1 << 50)
    assert not receiver.accept(12, flip=1)
    assert receiver.count(received=1, corrupt=2)
    assert receiver.accept(8)
    assert receiver.count(received=2, corrupt=2)


def test_counts_add_up(reception: ModuleType) -> None:
    receiver = Receiver(reception)
    for counter in (0, 3, 6, 6, 6, 20, 40):
        receiver.accept(counter)
    for _ in range(2):
        receiver.accept(40, value=1)
        receiver.accept(41, flip=2)
        receiver.accept(41, length=3)
    counts = {
        "lost": 2 + 2 + 13 + 19,
        "repeated": 2,
        "conflicting": 2,
        "wrong_sequence": 2,
        "corrupt": 2,
        "misshapen": 2,
    }
    assert receiver.count(received=3, **counts)
    assert reception.count_rejected(receiver.record) == 10


def test_every_frame_that_is_not_used_is_rejected(reception: ModuleType) -> None:
    for number, name in enumerate(COUNTS):
        record = Receiver(reception).record
        setattr(record, name, 3)
        assert reception.count_rejected(record) == (3 if number >= 2 else 0), name


# --- doubts whether there are two senders ----------------------------------------------------------------------------


def test_what_is_used_and_what_is_doubted(reception: ModuleType) -> None:
    record = Receiver(reception).record
    expected = 0
    for counter, value, more, used in (
        (0, 0, 0, True),
        (0, 1, 25, False),  # conflicts
        (10, 0, 10, False),  # out of sequence
        (11, 0, -1, True),
        (11, 0, 0, False),  # repeated: a frame that comes twice has one sender
        (12, 0, -1, True),
        (13, 0, -1, True),
    ):
        expected += more
        assert reception.count_doubts(record, to_word(make_data(counter, value)), 8) == used
        assert record.doubts == expected
    for length, flip in ((7, 0), (8, 1)):
        assert not reception.count_doubts(record, to_word(make_data(14, 0, flip)), length)
        assert record.doubts == expected


def test_doubts_stay_between_none_and_twice_the_bound(reception: ModuleType) -> None:
    record = Receiver(reception).record
    record.doubts = 1
    for counter, doubts in ((0, 0), (1, 0)):
        assert reception.count_doubts(record, to_word(make_data(counter)), 8)
        assert record.doubts == doubts
    record.doubts = 74
    for doubts in (99, 100):
        assert not reception.count_doubts(record, to_word(make_data(1, value=1)), 8)
        assert record.doubts == doubts
    assert reception.MOST_DOUBTS == 50


# --- a second service ------------------------------------------------------------------------------------------------


def test_ten_frames_are_a_second_service(reception: ModuleType) -> None:
    bench = Intruded(reception)
    assert [bench.hear(period) for period in range(11)] == 9 * [False] + 2 * [True]
    assert bench.intruder.frames == 11
    assert bench.intruder.period == 10
    assert bench.is_intruded(10)


def test_frames_that_are_not_used_are_no_second_service(reception: ModuleType) -> None:
    bench = Intruded(reception)
    assert not any(bench.hear(period, flip=1) for period in range(30))
    assert bench.intruder.frames == 0
    for period in range(9):
        bench.hear(period)
    assert not bench.hear(9, flip=1)
    assert bench.hear(10)


def test_a_pause_of_1000_periods_is_the_longest(reception: ModuleType) -> None:
    for pause, intrudes in ((1000, True), (1001, False)):
        bench = Intruded(reception)
        for _ in range(9):
            bench.hear(5)
        assert bench.hear(5 + pause) is intrudes
        assert bench.intruder.frames == (10 if intrudes else 1)
        assert bench.intruder.period == 5 + pause


def test_a_second_service_is_known_for_1000_periods(reception: ModuleType) -> None:
    bench = Intruded(reception)
    for _ in range(9):
        bench.hear(7)
    assert not bench.is_intruded(7)
    bench.hear(7)
    assert bench.is_intruded(7)
    assert bench.is_intruded(1007)
    assert not bench.is_intruded(1008)


def test_the_bounds_are_those_that_were_chosen(reception: ModuleType) -> None:
    assert (reception.MAX_DELTA, reception.INTRUSION, reception.INTRUSION_PERIODS) == (4, 10, 1000)
    assert (reception.SEQUENCE_DOUBT, reception.CONFLICT_DOUBT, reception.WRONG_RATES) == (10, 25, 3)
