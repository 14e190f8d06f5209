"""Every frame of the DBC against cantools and a bitwise CRC; bad values and bad DBCs; what the frames take of the wire."""

import re
from pathlib import Path
from typing import Any

import cantools.database
import pytest
from cantools.database.can import Signal
from hypothesis import given, settings
from hypothesis import strategies as st

from protocols.can.bus_load import compute_bus_load, count_worst_bits, find_highest_rate
from protocols.can.frames import DBC, FrameCodec, load_frames
from protocols.errors import InputError

ROUNDING = 1e-12  # relative: one multiplication in doubles, whose order differs between cantools and ours
HALF_LSB = 0.5 + 1e-6  # of a raw count: rounding to the nearest, and dividing by the scale in doubles
PRINTED = 1e-9  # relative: messages print 10 digits
DECLARED = 1e-8  # of the range: the DBC prints its limits with 10 digits
EXAMPLES = 50  # a frame
LOAD = 0.8  # of the wire: the highest load a bus is planned for

# Sender of each frame; the supervisor asks for torque, pressure or lock.
SENDERS = {
    "VALVE_COMMAND": "CONTROLLER",
    "MOTOR_COMMAND": "CONTROLLER",
    "ANALOG_SENSORS": "PLANT",
    "ENCODER": "PLANT",
    "SUPERVISOR_CLAIM": "SUPERVISOR",
    "TORQUE_SETPOINT": "SUPERVISOR",
    "CONTROLLER_STATUS": "CONTROLLER",
    "PLANT_STATUS": "PLANT",
    "CONTROLLER_HEARTBEAT": "CONTROLLER",
    "PLANT_HEARTBEAT": "PLANT",
}

CODECS = load_frames()
DATABASE: Any = cantools.database.load_file(DBC)
TEXT = DBC.read_text(encoding="utf-8")
REFUSAL = re.compile(r"^(\w+)\.(\w+) = (\S+?)( \S+)? is outside ([^ ]+?)\.\.([^ ]+)(?: (?:\S+))?$")

each_frame = pytest.mark.parametrize("codec", CODECS.values(), ids=CODECS)


def list_payload(codec: FrameCodec) -> list[Signal]:
    return [signal for signal in codec.definitions if signal.name not in ("CRC", "COUNTER")]


def find_raw_range(signal: Signal) -> tuple[int, int]:
    half = 1 << signal.length - 1
    return (-half, half - 1) if signal.is_signed else (0, 2 * half - 1)


def convert_to_physical(signal: Signal, raw: float) -> float:
    return raw * float(signal.scale) + float(signal.offset)


def draw_raw_values(codec: FrameCodec) -> st.SearchStrategy[list[int]]:
    return st.tuples(*(st.integers(*find_raw_range(signal)) for signal in list_payload(codec))).map(list)


def compute_crc16(data: bytes) -> int:
    """CRC-16 of AUTOSAR, bit by bit: polynomial x^16 + x^12 + x^5 + 1, start 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            out = (crc >> 15) ^ (byte >> bit & 1)
            crc = (crc << 1 & 0xFFFF) ^ (0x1021 if out else 0)
    return crc


def encode_by_cantools(codec: FrameCodec, counter: int, values: dict[str, int]) -> bytes:
    data = DATABASE.encode_message(
        codec.name, {"CRC": 0, "COUNTER": counter % 256, **values}, scaling=False, strict=False
    )
    number = DATABASE.get_message_by_name(codec.name).dbc.attributes["E2EDataId"].value
    return compute_crc16(data[2:] + number.to_bytes(2, "little")).to_bytes(2, "little") + data[2:]


def list_edges(codec: FrameCodec) -> list[list[int]]:
    return [[find_raw_range(signal)[side] for signal in list_payload(codec)] for side in (0, 1)]


def test_the_crc_of_this_test_gives_the_published_check_value() -> None:
    assert compute_crc16(b"123456789") == 0x29B1


@each_frame
def test_packing_agrees_with_cantools(codec: FrameCodec) -> None:
    names = [signal.name for signal in list_payload(codec)]

    @settings(max_examples=EXAMPLES)
    @given(raw=draw_raw_values(codec), counter=st.integers(0, 1000))
    def agrees(raw: list[int], counter: int) -> None:
        expected = encode_by_cantools(codec, counter, dict(zip(names, raw, strict=True)))
        assert codec.pack_raw(counter, *raw) == expected
        assert (
            codec.pack(
                counter,
                *(convert_to_physical(signal, value) for signal, value in zip(list_payload(codec), raw, strict=True)),
            )
            == expected
        )
        assert codec.is_valid(expected)
        assert codec.read_counter(expected) == counter % 256

    agrees()
    for raw in list_edges(codec):
        assert codec.pack_raw(0, *raw) == encode_by_cantools(codec, 0, dict(zip(names, raw, strict=True)))


@each_frame
def test_unpacking_agrees_with_cantools(codec: FrameCodec) -> None:
    @settings(max_examples=EXAMPLES)
    @given(data=st.binary(min_size=codec.length, max_size=codec.length))
    def agrees(data: bytes) -> None:
        raw = DATABASE.decode_message(codec.name, data, scaling=False, decode_choices=False)
        values = DATABASE.decode_message(codec.name, data, decode_choices=False)
        assert codec.read_counter(data) == raw["COUNTER"]
        for signal in list_payload(codec):
            name = signal.name.lower()
            assert getattr(codec.raw(data), name) == raw[signal.name]
            assert getattr(codec.unpack(data), name) == pytest.approx(values[signal.name], rel=ROUNDING, abs=0.0)

    agrees()


@each_frame
def test_a_count_wraps_at_the_bits_of_its_signal(codec: FrameCodec) -> None:
    for signal in list_payload(codec):
        if not signal.is_signed:
            name, most = signal.name.lower(), 2**signal.length - 1
            assert [codec.wrap(name, count) for count in (-1, 0, most, most + 1, 2 * most + 1)] == [
                most,
                0,
                most,
                0,
                most,
            ]


@each_frame
def test_raw_values_survive_packing(codec: FrameCodec) -> None:
    @settings(max_examples=EXAMPLES)
    @given(raw=draw_raw_values(codec))
    def survive(raw: list[int]) -> None:
        assert list(codec.raw(codec.pack_raw(3, *raw))) == raw

    survive()
    for raw in list_edges(codec):
        assert list(codec.raw(codec.pack_raw(3, *raw))) == raw


@each_frame
def test_physical_values_come_back_within_half_a_count(codec: FrameCodec) -> None:
    values = st.tuples(
        *(
            st.floats(
                convert_to_physical(s, find_raw_range(s)[0]), convert_to_physical(s, find_raw_range(s)[1]), width=64
            )
            for s in list_payload(codec)
        )
    )

    @settings(max_examples=EXAMPLES)
    @given(sent=values)
    def come_back(sent: tuple[float, ...]) -> None:
        came = codec.unpack(codec.pack(0, *sent))
        for signal, before, after in zip(list_payload(codec), sent, came, strict=True):
            assert abs(after - before) <= HALF_LSB * float(signal.scale), signal.name

    come_back()


@each_frame
@pytest.mark.parametrize("beyond", ["below", "above"])
@pytest.mark.parametrize("packer", ["pack", "pack_raw"])
def test_a_value_outside_the_range_is_refused_by_name_value_and_range(
    codec: FrameCodec, beyond: str, packer: str
) -> None:
    for index, signal in enumerate(list_payload(codec)):
        low, high = find_raw_range(signal)
        raw = low - 1 if beyond == "below" else high + 1
        values: list[Any] = [0] * len(codec.signals)
        values[index] = raw if packer == "pack_raw" else convert_to_physical(signal, raw)
        with pytest.raises(InputError) as refused:
            getattr(codec, packer)(0, *values)
        sentence = REFUSAL.match(str(refused.value))
        assert sentence, str(refused.value)
        assert sentence.group(1, 2) == (codec.name, signal.name)
        assert (sentence.group(4) or "").strip() == (signal.unit or "")
        for text, expected in zip(sentence.group(3, 5, 6), (raw, low, high), strict=True):
            assert float(text) == pytest.approx(convert_to_physical(signal, expected), rel=PRINTED)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_a_value_that_is_no_number_is_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"VALVE_COMMAND\.VALVE_VOLTAGE"):
        CODECS["VALVE_COMMAND"].pack(0, 1, value, 0)


@each_frame
def test_the_counter_wraps_at_256(codec: FrameCodec) -> None:
    zeros = [0] * len(codec.signals)
    assert [codec.read_counter(codec.pack_raw(n, *zeros)) for n in range(514)] == [n % 256 for n in range(514)]
    assert codec.pack_raw(256, *zeros) == codec.pack_raw(0, *zeros)


@each_frame
def test_signals_can_be_packed_by_lower_case_name(codec: FrameCodec) -> None:
    by_name = {signal.name.lower(): convert_to_physical(signal, 1) for signal in reversed(list_payload(codec))}
    assert set(by_name) == set(codec.signals)
    assert codec.pack(5, **by_name) == codec.pack(5, *(by_name[name] for name in codec.signals))


@each_frame
def test_declared_limits_are_the_raw_range_or_the_named_values(codec: FrameCodec) -> None:
    for signal in list_payload(codec):
        low, high = (convert_to_physical(signal, raw) for raw in find_raw_range(signal))
        if signal.choices:
            low, high = min(signal.choices), max(signal.choices)
        tolerance = DECLARED * (high - low)
        assert (signal.minimum, signal.maximum) == pytest.approx((low, high), abs=tolerance), signal.name


def test_no_two_frames_share_an_identifier() -> None:
    identifiers = [codec.can_id for codec in CODECS.values()]
    assert len(set(identifiers)) == len(identifiers)
    assert all(0 < identifier < 0x800 for identifier in identifiers)


@each_frame
def test_no_two_signals_share_a_bit(codec: FrameCodec) -> None:
    bits = [bit for signal in codec.definitions for bit in range(signal.start, signal.start + signal.length)]
    assert len(set(bits)) == len(bits)
    assert max(bits) < 8 * codec.length


def test_every_frame_of_the_architecture_has_its_sender() -> None:
    assert {name: codec.sender for name, codec in CODECS.items()} == SENDERS


def test_every_frame_says_what_it_is_for_and_how_often_it_comes() -> None:
    assert all(codec.comment and codec.cycle_time > 0.0 for codec in CODECS.values())


def remove_frame(name: str) -> str:
    return re.sub(rf"(BO_ \d+ {name}:.*\n( SG_ .*\n)+)|(.* (128) .*;\n)", "", TEXT)


MALFORMED = {
    "garbage": ("this is no DBC ((", "is malformed"),
    "empty": ("", "is empty"),
    "blank": ("\n \n", "is empty"),
    "missing frame": (remove_frame("VALVE_COMMAND"), "lacks the frame VALVE_COMMAND"),
    "missing crc": (
        TEXT.replace(' SG_ CRC : 0|16@1+ (1,0) [0|65535] ""  PLANT\n', "", 1),
        "frame VALVE_COMMAND needs the signal CRC : 0|16@1+",
    ),
    "missing counter": (
        TEXT.replace(' SG_ COUNTER : 16|8@1+ (1,0) [0|255] ""  PLANT\n', "", 1),
        "frame VALVE_COMMAND needs the signal COUNTER : 16|8@1+",
    ),
    "displaced counter": (
        TEXT.replace("COUNTER : 16|8@1+", "COUNTER : 16|7@1+", 1),
        "frame VALVE_COMMAND needs the signal COUNTER : 16|8@1+",
    ),
    "missing data ID": (
        TEXT.replace('BA_ "E2EDataId" BO_ 256 49408;\n', ""),
        "frame ANALOG_SENSORS has no data ID; it needs the attribute E2EDataId, 1 to 65535",
    ),
    "one data ID twice": (
        TEXT.replace('BA_ "E2EDataId" BO_ 256 49408;', 'BA_ "E2EDataId" BO_ 256 49280;'),
        "the frames ANALOG_SENSORS, VALVE_COMMAND have the same data ID, 49280",
    ),
    "big-endian signal": (
        TEXT.replace("VALVE_VOLTAGE : 32|16@1+", "VALVE_VOLTAGE : 39|16@0+"),
        "frame VALVE_COMMAND: signal VALVE_VOLTAGE must be a plain little-endian integer",
    ),
    "9 bytes": (TEXT.replace("VALVE_COMMAND: 8", "VALVE_COMMAND: 9"), "frame VALVE_COMMAND has 9 bytes"),
    "signal beyond the frame": (TEXT.replace("VALVE_COMMAND: 8", "VALVE_COMMAND: 4"), "VALVE_COMMAND"),
    "overlapping signals": (TEXT.replace("VALVE_VOLTAGE : 32|16", "VALVE_VOLTAGE : 36|16"), "VALVE_VOLTAGE"),
}


def test_the_dbc_before_it_is_spoilt_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "whole.dbc"
    path.write_text(TEXT, encoding="utf-8")
    assert load_frames(path).keys() == CODECS.keys()


@pytest.mark.parametrize(("text", "sentence"), MALFORMED.values(), ids=MALFORMED)
def test_a_malformed_dbc_is_refused_in_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "spoilt.dbc"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        load_frames(path)
    assert str(path) in str(refused.value)
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_missing_dbc_is_refused_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        load_frames(tmp_path / "none.dbc")
    assert str(refused.value) == f"DBC {tmp_path / 'none.dbc'} does not exist"


def test_worst_case_frames_have_the_bits_counted_by_hand() -> None:
    # Standard data frame: start 1, identifier 11, RTR 1, IDE 1, r0 1, length 4, data 8 n, CRC 15: 34 + 8 n bits are
    # stuffed. CRC delimiter 1, acknowledge 2, end of frame 7 and 3 bits of pause are not: 13.
    # Stuffing: after five equal bits one of the other kind, which itself counts for the next five: at worst the first
    # stuff bit comes after 5 bits, each further after 4, floor((34 + 8 n - 1) / 4) in all.
    #   n = 8: 98 stuffed bits, floor(97 / 4) = 24, 98 + 24 + 13 = 135
    #   n = 6: 82 stuffed bits, floor(81 / 4) = 20, 82 + 20 + 13 = 115
    assert count_worst_bits(8) == 135
    assert count_worst_bits(6) == 115


def test_frames_at_1_khz_fit_a_bus_of_1_mbit_and_not_of_500_kbit() -> None:
    bits = sum(count_worst_bits(codec.length) / codec.cycle_time for codec in CODECS.values())  # in a second
    assert compute_bus_load(CODECS.values(), 1000, 1_000_000) == pytest.approx(bits / 1e6, rel=ROUNDING)
    assert compute_bus_load(CODECS.values(), 1000, 1_000_000) < LOAD
    assert compute_bus_load(CODECS.values(), 1000, 500_000) > 1.0


@pytest.mark.parametrize("bitrate", [250_000, 500_000, 1_000_000])
def test_the_highest_rate_is_the_last_one_that_fits(bitrate: int) -> None:
    rate = find_highest_rate(CODECS.values(), bitrate, LOAD)
    assert rate > 0
    assert compute_bus_load(CODECS.values(), rate, bitrate) < LOAD
    assert compute_bus_load(CODECS.values(), rate + 10, bitrate) >= LOAD


def test_slow_frames_keep_their_time_at_any_rate() -> None:
    slow = [codec for codec in CODECS.values() if codec.cycle_time > 0.001]
    assert len(slow) == 5
    assert compute_bus_load(slow, 100, 500_000) == compute_bus_load(slow, 4000, 500_000) > 0.0
