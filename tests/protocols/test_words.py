"""Words: signals, counter and CRC of payloads as integers. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from e2e.p05 import e2e_p05_protect

import protocols.can.words
from protocols.can.frame_batch import make_batch
from protocols.can.frames import FrameCodec, load_frames
from tests.mutation.plain import make_record, view_records

CODECS = load_frames()
# bits 24 to 31, -8..7 in the low four of them; scale and offset are exact
SIGNED = {"start": 24, "mask": 0xF, "sign": 8, "low": -8, "high": 7, "scale": 0.5, "offset": 10.0}
PLAIN = {"start": 24, "mask": 0xF, "sign": 0, "low": 0, "high": 15, "scale": 0.5, "offset": 10.0}


@pytest.fixture(scope="module")
def words() -> ModuleType:
    return protocols.can.words


def make_signal(words: ModuleType, fields: dict[str, float]) -> Any:
    return make_record(words.SIGNAL, **fields)


def list_fields(words: ModuleType, codec: FrameCodec, name: str) -> tuple[float, ...]:
    return tuple(words.make_frame_definition(codec)[name].item())


def make_payload(data_id: int, counter: int, rest: bytes) -> bytes:
    """A payload of 8 bytes, protected by the e2e library."""
    data = bytearray(bytes((0, 0, counter)) + rest)
    e2e_p05_protect(data, data_id, length=8, increment_counter=False)
    return bytes(data)


def read_word(data: bytes) -> np.int64:
    return np.int64(int.from_bytes(data, "little", signed=True))


# --- definitions -----------------------------------------------------------------------------------------------------


def test_a_signed_signal_has_the_range_of_its_bits(words: ModuleType) -> None:
    name = "shaft_angle"  # 18 bits from bit 24 on
    scale, offset = CODECS["ENCODER"].scale[name], 0.0
    expected = (24, 0x3FFFF, 0x20000, -0x20000, 0x1FFFF, scale, offset)
    assert list_fields(words, CODECS["ENCODER"], name) == expected


def test_an_unsigned_signal_has_no_sign(words: ModuleType) -> None:
    assert list_fields(words, CODECS["ENCODER"], "sample_tick") == (42, 0x3FF, 0, 0, 0x3FF, 1.0, 0.0)


def test_a_definition_has_identifier_length_and_data_id(words: ModuleType) -> None:
    for codec in CODECS.values():
        definition = words.make_frame_definition(codec)
        result = tuple(int(definition[name]) for name in ("can_id", "length", "data_id"))
        assert result == (codec.can_id, codec.length, codec.data_id)
        assert definition.dtype.names == ("can_id", "length", "data_id", *codec.signals)
        assert all(definition[name]["mask"] for name in codec.signals)


# --- reading ---------------------------------------------------------------------------------------------------------


def test_raw_values_are_read_from_their_bits(words: ModuleType) -> None:
    signed, plain = make_signal(words, SIGNED), make_signal(words, PLAIN)
    for raw in range(16):
        word = np.int64(raw << 24 | 0xF0FF_FFFF | 0xFF << 32)
        assert words.read_raw(word, plain) == raw
        assert words.read_raw(word, signed) == (raw if raw < 8 else raw - 16)
        other = np.int64(raw << 24)
        assert words.read_raw(other, plain) == raw


def test_a_value_is_scaled_and_then_shifted(words: ModuleType) -> None:
    signal = make_signal(words, SIGNED)
    assert words.read_value(np.int64(3 << 24), signal) == 11.5
    assert words.read_value(np.int64(0xF << 24), signal) == 9.5


def test_a_turn_is_the_shortest_way_through_the_wrap(words: ModuleType) -> None:
    signal = make_signal(words, SIGNED)
    assert [words.count_turn(counts, 0, signal) for counts in (0, 1, 7, 8, 9, 15)] == [0, 1, 7, -8, -7, -1]
    assert words.count_turn(-8, 7, signal) == 1
    assert words.count_turn(7, -8, signal) == -1
    assert words.count_turn(3, 100, signal) == -1  # 100 is 4 after six turns


def test_a_rise_is_counted_forwards_through_the_wrap(words: ModuleType) -> None:
    signal = make_signal(words, PLAIN)
    assert [words.count_rise(counts, 14, signal) for counts in (14, 15, 0, 13)] == [0, 1, 2, 15]
    assert words.count_rise(3, 32, signal) == 3


# --- writing ---------------------------------------------------------------------------------------------------------


def test_a_value_is_rounded_to_the_nearest_count(words: ModuleType) -> None:
    signal = make_signal(words, SIGNED)
    for physical, raw in ((10.0, 0), (10.248, 0), (10.25, 1), (10.5, 1), (11.2, 2), (9.74, 15), (9.75, 0)):
        assert words.put(np.int64(0), signal, physical) == raw << 24, physical


def test_a_value_beyond_its_range_stays_at_its_end(words: ModuleType) -> None:
    signed, plain = make_signal(words, SIGNED), make_signal(words, PLAIN)
    for signal, physical, raw in (
        (signed, 13.5, 7), (signed, 14.0, 7), (signed, 99.0, 7), (signed, 6.0, 8), (signed, 5.5, 8),
        (plain, 17.5, 15), (plain, 18.0, 15), (plain, 9.0, 0),
    ):  # fmt: skip
        assert words.put(np.int64(0), signal, physical) == raw << 24, physical


def test_what_is_written_leaves_the_other_bits(words: ModuleType) -> None:
    signal, before = make_signal(words, PLAIN), np.int64(0x55_F0FF_FF12)
    assert words.put(before, signal, 12.5) == 0x55_F0FF_FF12 | 5 << 24
    assert words.put_raw(before, signal, 5) == 0x55_F0FF_FF12 | 5 << 24


def test_a_raw_value_wraps(words: ModuleType) -> None:
    signal = make_signal(words, PLAIN)
    assert [words.put_raw(np.int64(0), signal, counts) >> 24 for counts in (15, 16, 17, -1)] == [15, 0, 1, 15]


# --- protection ------------------------------------------------------------------------------------------------------


def test_the_counter_is_the_third_byte(words: ModuleType) -> None:
    for counter in (0, 1, 127, 128, 255):
        assert words.read_counter(read_word(bytes((0xAA, 0xFF, counter, 0xFF, 0, 0, 0, 0xFF)))) == counter


def test_the_crc_is_that_of_the_library(words: ModuleType) -> None:
    generator = np.random.default_rng(1)
    for data_id in (0, 1, 0xC101, 0x00FF, 0xFF00, 0xFFFF):
        for counter in (0, 3, 255):
            data = make_payload(data_id, counter, generator.bytes(5))
            assert words.compute_crc(read_word(data), data_id) == data[0] + 256 * data[1]
            blank = read_word(b"\0\0\0" + data[3:])
            assert words.protect(blank, data_id, counter) == read_word(data)
            assert words.protect(blank, data_id, counter + 256) == read_word(data)  # the counter wraps


def test_every_wrong_bit_is_seen(words: ModuleType) -> None:
    data = make_payload(0xC101, 9, b"\x01\x80\x55\xaa\xfe")
    assert words.is_valid(read_word(data), 0xC101)
    assert not words.is_valid(read_word(data), 0xC100)
    assert not words.is_valid(read_word(data), 0x4101)
    for bit in range(64):
        wrong = (int.from_bytes(data, "little") ^ 1 << bit).to_bytes(8, "little")
        assert not words.is_valid(read_word(wrong), 0xC101), bit


def test_a_written_frame_has_all_its_parts(words: ModuleType) -> None:
    layout = words.make_frame_layout(CODECS["ENCODER"])
    assert layout.names[:3] == ("can_id", "length", "data_id")
    outbox = make_batch(1)
    definition = make_record(layout, can_id=0x123, length=8, data_id=0xC101)
    frame = view_records(outbox)[0] if view_records(outbox) is not outbox else outbox.view(np.recarray)[0]
    rest = b"\x01\x80\x55\x0a\x7e"
    words.write_frame(frame, definition, read_word(b"\0\0\0" + rest), 9)
    assert (outbox[0]["can_id"], outbox[0]["length"]) == (0x123, 8)
    assert outbox[0]["data"].tobytes() == make_payload(0xC101, 9, rest)
