"""Which payloads are believed: length, CRC and alive counter."""

import numpy as np
import pytest

from protocols.can.frame_batch import load, make_batch, read_word
from protocols.can.frames import Frame, FrameCodec, load_frames
from protocols.can.reception import (
    INTRUDER,
    INTRUSION,
    INTRUSION_PERIODS,
    MAX_DELTA,
    Reception,
    accept_word,
    intrudes,
    make_receptions,
    read_counts,
)

CODECS = load_frames()
each_frame = pytest.mark.parametrize("codec", CODECS.values(), ids=CODECS)


def make_data(codec: FrameCodec, counter: int, value: int = 0) -> bytes:
    return codec.pack_raw(counter, *(value for _ in codec.signals))


def make_counts(
    received: int,
    lost: int,
    repeated: int,
    corrupt: int,
    misshapen: int = 0,
    wrong_sequence: int = 0,
    conflicting: int = 0,
) -> dict[str, int]:
    values = locals()
    return {**values, "unusable": 0}


def make_pattern(codec: FrameCodec, counter: int) -> bytes:
    """A frame whose payload is neither all zeros nor symmetric."""
    return codec.pack_raw(counter, *((n + 1) % 2 for n in range(len(codec.signals))))


@pytest.fixture
def reception() -> Reception:
    return Reception(CODECS["ENCODER"])


@each_frame
def test_frames_in_order_are_accepted_through_the_wrap(codec: FrameCodec) -> None:
    reception = Reception(codec)
    assert all(reception.accept(make_data(codec, n)) for n in range(600))
    assert reception.read_counts() == make_counts(600, 0, 0, 0)


def test_a_first_frame_of_any_counter_is_accepted() -> None:
    for counter in range(256):
        reception = Reception(CODECS["ENCODER"])
        assert reception.accept(make_data(reception.codec, counter))
        assert reception.lost == 0


@pytest.mark.parametrize("first", [0, 7, 255])
@pytest.mark.parametrize("gap", range(MAX_DELTA))
def test_a_gap_in_the_counter_is_counted(reception: Reception, first: int, gap: int) -> None:
    assert reception.accept(make_data(reception.codec, first))
    assert reception.accept(make_data(reception.codec, first + 1 + gap))
    assert reception.read_counts() == make_counts(2, gap, 0, 0)


@pytest.mark.parametrize("first", [0, 7, 255])
@pytest.mark.parametrize("step", [MAX_DELTA + 1, 20, 127, 128, 129, 200, 254, 255])
def test_after_a_long_gap_or_a_step_back_the_next_frame_is_accepted(
    reception: Reception, first: int, step: int
) -> None:
    accepted = [reception.accept(make_data(reception.codec, first + n)) for n in (0, step, step + 1)]
    assert accepted == [True, False, True]
    assert reception.read_counts() == make_counts(2, step - 1 if step <= 128 else 0, 0, 0, wrong_sequence=1)


def test_of_two_senders_in_turn_none_is_accepted(reception: Reception) -> None:
    """A second sender with correct CRC, data ID and length: after its first frame no frame of either is used."""
    counters = [n for k in range(100) for n in (k, k + 100)]
    assert sum(reception.accept(make_data(reception.codec, n)) for n in counters) == 1
    assert reception.wrong_sequence == len(counters) - 1


def test_frames_that_come_twice_are_used_once(reception: Reception) -> None:
    assert sum(reception.accept(make_data(reception.codec, n)) for k in range(300) for n in (k, k)) == 300
    assert reception.read_counts() == make_counts(300, 0, 300, 0)


def test_frames_in_another_order_cost_the_late_one_and_no_other(reception: Reception) -> None:
    accepted = [n for n in (0, 1, 3, 2, 4, 5) if reception.accept(make_data(reception.codec, n))]
    assert accepted == [0, 1, 3, 4, 5]
    assert reception.wrong_sequence == 1


def test_gaps_add_up(reception: Reception) -> None:
    sent = [n for n in range(100) if n % 7]  # every seventh is lost, the first before anybody listens
    assert all(reception.accept(make_data(reception.codec, n)) for n in sent)
    assert reception.received == len(sent)
    assert reception.lost == 99 - len(sent)


def test_a_repeated_counter_is_refused_whatever_it_carries(reception: Reception) -> None:
    assert reception.accept(make_data(reception.codec, 4))
    assert not reception.accept(make_data(reception.codec, 4))
    assert not reception.accept(make_data(reception.codec, 4, value=1))
    assert reception.read_counts() == make_counts(1, 0, 1, 0, conflicting=1)


def test_a_stuck_sender_is_believed_again_when_its_counter_moves(reception: Reception) -> None:
    for counter in (4, 4, 4):
        reception.accept(make_data(reception.codec, counter))
    assert reception.accept(make_data(reception.codec, 5))
    assert reception.read_counts() == make_counts(2, 0, 2, 0)


def test_a_wrong_crc_is_refused(reception: Reception) -> None:
    good = make_data(reception.codec, 1)
    assert not reception.accept(bytes([good[0] ^ 0xFF]) + good[1:])
    assert reception.read_counts() == make_counts(0, 0, 0, 1)


def test_a_corrupt_frame_leaves_a_gap_and_no_other_trace(reception: Reception) -> None:
    codec = reception.codec
    broken = bytearray(make_data(codec, 1))
    broken[2] ^= 0x05  # its counter would read 4
    accepted = [reception.accept(bytes(frame)) for frame in (make_data(codec, 0), broken, make_data(codec, 2))]
    assert accepted == [True, False, True]
    assert reception.read_counts() == make_counts(2, 1, 0, 1)


@each_frame
def test_a_flipped_bit_is_refused(codec: FrameCodec) -> None:
    reception = Reception(codec)
    good = make_pattern(codec, 6)
    for bit in range(8 * codec.length):
        flipped = (int.from_bytes(good, "little") ^ 1 << bit).to_bytes(codec.length, "little")
        assert not reception.accept(flipped), f"bit {bit}"
    assert reception.read_counts() == make_counts(0, 0, 0, 8 * codec.length)
    assert reception.accept(good)


@each_frame
def test_two_flipped_bits_are_refused(codec: FrameCodec) -> None:
    # this polynomial detects every double error in up to 32 751 bits
    good = int.from_bytes(make_pattern(codec, 6), "little")
    bits = range(8 * codec.length)
    for first in bits:
        for second in bits[first + 1 :]:
            assert not codec.is_valid((good ^ 1 << first ^ 1 << second).to_bytes(codec.length, "little"))


@each_frame
def test_a_frame_of_zeros_or_ones_is_refused(codec: FrameCodec) -> None:
    reception = Reception(codec)
    assert not reception.accept(bytes(codec.length))
    assert not reception.accept(b"\xff" * codec.length)


@each_frame
def test_a_wrong_length_is_refused_and_leaves_no_other_trace(codec: FrameCodec) -> None:
    reception = Reception(codec)
    assert reception.accept(make_data(codec, 0))
    for length in {*range(9)} - {codec.length}:
        assert not reception.accept(bytes(length))
        assert not codec.is_valid(bytes(length))
    assert reception.accept(make_data(codec, 1))
    assert reception.read_counts() == make_counts(2, 0, 0, 0, misshapen=8)


@each_frame
def test_compiled_loops_believe_the_same(codec: FrameCodec) -> None:
    generator = np.random.default_rng(codec.can_id)
    reception, record = Reception(codec), make_receptions([codec])
    number = 0
    for _ in range(500):
        number += int(generator.choice([0, 1, 1, 1, 1, 2, MAX_DELTA, MAX_DELTA + 1, -1]))
        good = bytearray(make_pattern(codec, number) if generator.random() < 0.7 else make_data(codec, number))
        if generator.random() < 0.2:
            good[generator.integers(len(good))] ^= 1 << generator.integers(8)
        if generator.random() < 0.1:
            good = good[: generator.integers(len(good))]
        into = make_batch(1)
        load(into, [Frame(codec.can_id, bytes(good))])
        word = read_word.py_func(into["data"][0])
        assert accept_word(record[0], np.int64(word), len(good)) == reception.accept(bytes(good))
    assert read_counts(record[0]) == reception.read_counts()
    assert all(count for name, count in reception.read_counts().items() if name != "unusable")  # every kind has come


def has_second_sender(period_between: int, frames: int, change: int = 0) -> bool:
    """Whether that many frames of another sender, so many periods apart, are a second service. change: of each payload."""
    codec = CODECS["ENCODER"]
    intruder, record = np.zeros(1, INTRUDER).view(np.recarray)[0], make_receptions([codec]).view(np.recarray)[0]
    words = (int.from_bytes(make_data(codec, n), "little") ^ change for n in range(frames))
    return any(intrudes(intruder, record, np.int64(w), 8, n * period_between) for n, w in enumerate(words))


def test_only_a_sender_that_goes_on_is_a_second_service() -> None:
    assert not has_second_sender(1, INTRUSION - 1)
    assert has_second_sender(1, INTRUSION)
    assert has_second_sender(INTRUSION_PERIODS, INTRUSION)
    assert not has_second_sender(INTRUSION_PERIODS + 1, 3 * INTRUSION)  # a stray frame now and then
    assert not has_second_sender(1, 3 * INTRUSION, change=1)  # wrong CRC


def test_a_frame_that_is_repeated_for_ever_is_no_second_service() -> None:
    codec = CODECS["ENCODER"]
    intruder, record = np.zeros(1, INTRUDER).view(np.recarray)[0], make_receptions([codec]).view(np.recarray)[0]
    word = np.int64(int.from_bytes(make_data(codec, 3), "little"))
    assert not any(intrudes(intruder, record, word, length, n) for n in range(100) for length in (7, 8))
    assert read_counts(record) == make_counts(1, 0, 99, 0, misshapen=100)
