"""Protection of frames by AUTOSAR E2E profile 5: what it detects, in every frame of both clutches."""

from itertools import permutations

import numpy as np
import pytest
from e2e.p05 import e2e_p05_check, e2e_p05_protect
from numba import njit

from protocols.can.frames import FrameCodec, list_bus_frames
from protocols.can.reception import MAX_DELTA, Reception, accept_word, make_receptions
from protocols.can.two_clutches import CLUTCHES
from protocols.can.words import compute_crc, protect

CODECS = list_bus_frames(clutches=len(CLUTCHES))
EVERY = pytest.mark.parametrize("codec", CODECS, ids=[codec.name for codec in CODECS])
BITS = 64  # of a payload
BURST = 16  # bits: the longest burst
RANDOM_BURSTS = 100_000
# Place of the bits in a word, in the order of the wire: byte by byte, and in each byte the highest bit first
WIRE = np.array([8 * (k // 8) + 7 - k % 8 for k in range(BITS)])


def make_payloads(codec: FrameCodec, count: int, seed: int = 1) -> list[bytes]:
    """Valid payloads with random values."""
    generator, made = np.random.default_rng([seed, codec.data_id]), []
    for number in range(count):
        body = bytearray(generator.bytes(codec.length))
        body[2] = number % 256
        e2e_p05_protect(body, codec.data_id, length=codec.length, increment_counter=False)
        made.append(bytes(body))
    return made


def read_word(data: bytes) -> np.int64:
    return np.int64(int.from_bytes(data, "little", signed=True))


def find_passed_bursts(data_id: int) -> list[int]:
    """All error patterns of bursts up to BURST bits on the wire after which the CRC is still correct, as words.

    The CRC is linear: whether an error is seen depends on the error alone.
    """
    zero = int(compute_crc(np.int64(0), data_id))
    syndromes = []
    for bit in WIRE:
        error = 1 << int(bit)
        body = np.int64(error - (1 << 64) if error >> 63 else error)
        syndromes.append((int(compute_crc(body, data_id)) ^ zero) ^ (error & 0xFFFF))
    passed = []
    for begin in range(BITS):
        more = min(BURST, BITS - begin) - 1
        patterns = np.arange(1 << more)
        seen = np.full(1 << more, syndromes[begin])
        for k in range(more):
            seen ^= np.where(patterns >> k & 1, syndromes[begin + 1 + k], 0)
        for pattern in patterns[seen == 0]:
            places = [0, *(k + 1 for k in range(more) if pattern >> k & 1)]
            passed.append(sum(1 << int(WIRE[begin + k]) for k in places))
    return passed


@njit
def count_accepted(receptions, words, errors):
    """Number of frames `words` that are accepted after `errors`, each after the valid frame before it."""
    count = 0
    for index in range(1, len(words)):
        reception = receptions[0]
        reception.counter = 0
        if not accept_word(reception, words[index - 1], 8):
            return -1
        count += accept_word(reception, words[index] ^ errors[index], 8)
    return count


@EVERY
def test_the_compiled_crc_is_that_of_the_library_byte_for_byte(codec: FrameCodec) -> None:
    for data in make_payloads(codec, 300):
        word = read_word(data)
        assert int(compute_crc(word, codec.data_id)) == data[0] + 256 * data[1]
        blank = read_word(b"\0\0\0" + data[3:])
        assert int(protect(blank, codec.data_id, data[2])) == word
        assert codec.is_valid(data)


@EVERY
def test_every_single_bit_is_detected(codec: FrameCodec) -> None:
    record = make_receptions([codec])
    for data in make_payloads(codec, 5):
        for bit in range(BITS):
            wrong = (int.from_bytes(data, "little") ^ 1 << bit).to_bytes(8, "little")
            assert not e2e_p05_check(wrong, codec.data_id, length=8)
            assert not Reception(codec).accept(wrong)
            assert not accept_word(record[0], read_word(wrong), 8)


@EVERY
def test_no_random_burst_is_accepted(codec: FrameCodec) -> None:
    """A frame with a burst error, after a valid frame: CRC and counter together."""
    generator = np.random.default_rng(codec.data_id)
    words = np.array([read_word(data) for data in make_payloads(codec, 256)], np.int64)
    words = np.tile(words, RANDOM_BURSTS // 256 + 1)[: RANDOM_BURSTS + 1]
    length = generator.integers(1, BURST + 1, len(words))
    begin = generator.integers(0, BITS - length + 1)
    errors = np.zeros(len(words), np.int64)
    for k in range(BURST):  # first and last bit of a burst are wrong, those between are as may be
        wrong = (k == 0) | (k == length - 1) | ((k < length) & (generator.random(len(words)) < 0.5))
        errors[wrong] |= np.left_shift(np.int64(1), WIRE[np.minimum(begin + k, BITS - 1)])[wrong]
    assert count_accepted(make_receptions([codec]), words, np.zeros_like(errors)) == RANDOM_BURSTS
    assert count_accepted(make_receptions([codec]), words, errors) == 0


def test_of_all_bursts_the_crc_misses_6_and_the_counter_refuses_these() -> None:
    """All 1 638 399 bursts of up to 16 bits on the wire: the 6 are of 16 bits and change the counter by more than MAX_DELTA."""
    for data_id in (CODECS[0].data_id, 1, 0xFFFF):
        passed = find_passed_bursts(data_id)
        assert len(passed) == 6
        for error in passed:
            places = [int(np.flatnonzero(bit == WIRE)[0]) for bit in range(BITS) if error >> bit & 1]
            assert max(places) - min(places) + 1 == BURST
            flips = error >> 16 & 0xFF
            for counter in range(256):
                for delta in range(1, MAX_DELTA + 1):  # of the frame before the error
                    assert not 1 <= ((counter ^ flips) - (counter - delta)) % 256 <= MAX_DELTA


def test_every_frame_under_the_data_id_of_another_is_detected() -> None:
    for sent, other in permutations(CODECS, 2):
        record = make_receptions([other])
        for data in make_payloads(sent, 20):
            assert not other.is_valid(data)
            assert not accept_word(record[0], read_word(data), 8)


def test_data_ids_of_both_clutches_are_different() -> None:
    assert len({codec.data_id for codec in CODECS}) == len(CODECS)
