"""Bus logs: every format gives the same frames; signals are those of cantools; what is damaged is counted or refused."""

import random
import struct
import time
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import cantools.database
import numpy as np
import pytest

from clutch_hil.recordings.can_signals import physical_values, rows_with_signal
from clutch_hil.recordings.channel import Recording, choose_channel
from clutch_hil.recordings.format import open_recording, recognise
from clutch_hil.recordings.import_map import load_map
from protocols.can.frames import load_frames
from protocols.errors import InputError
from protocols.files.bus_log import read_bus_log

CODECS = load_frames()
ENCODER, ANALOG = CODECS["ENCODER"], CODECS["ANALOG_SENSORS"]
START = 1_700_000_000.0  # s, UNIX time
CAR = """VERSION ""
NS_ :
BS_:
BU_: ECU
BO_ 291 ENGINE: 8 ECU
 SG_ SPEED : 7|16@0+ (0.25,-10) [0|0] "rpm" ECU
 SG_ TORQUE : 16|12@1- (0.5,3) [0|0] "Nm" ECU
 SG_ GEAR : 28|3@1+ (1,0) [0|0] "" ECU
 SG_ BRAKE : 31|1@1+ (1,0) [0|0] "" ECU
 SG_ COOLANT : 47|8@0- (1,40) [0|0] "°C" ECU
BO_ 2566844926 PAGES: 8 ECU
 SG_ PAGE M : 0|4@1+ (1,0) [0|0] "" ECU
 SG_ VOLTAGE m0 : 8|32@1- (1,0) [0|0] "V" ECU
 SG_ CURRENT m1 : 15|24@0- (0.001,0) [0|0] "A" ECU
 SG_ POWER m1 : 40|24@1+ (2,0) [0|0] "W" ECU
SIG_VALTYPE_ 2566844926 VOLTAGE : 1;
VAL_ 291 GEAR 0 "neutral" 1 "first" 2 "second" ;
"""


def message(stamp: float, can_id: int, data: bytes, **kinds: Any) -> can.Message:
    return can.Message(stamp, can_id, **{"is_extended_id": False, "data": data, "channel": 0, **kinds})


def bench(samples: int = 40, start: float = START) -> list[can.Message]:
    """Sensor frames of some samples at 1 kHz."""
    messages = []
    for n in range(samples):
        at = round(start + n * 1e-3, 6)
        messages.append(message(at, ANALOG.can_id, ANALOG.pack(n, 0.01 * (n % 500), 60.0, 0.0, 0.0)))
        messages.append(message(round(at + 1e-4, 6), ENCODER.can_id, ENCODER.pack(n, 0.001 * n, n)))
    return messages


def candump(messages: list[can.Message], channel: str = "can0") -> str:
    return "".join(f"({m.timestamp:.6f}) {channel} {m.arbitration_id:03X}#{m.data.hex().upper()}\n" for m in messages)


def screen(messages: list[can.Message]) -> str:
    return "".join(
        f" ({m.timestamp:.6f})  can0  {m.arbitration_id:03X}   [{len(m.data)}]  {m.data.hex(' ').upper()}\n"
        for m in messages
    )


def write(path: Path, messages: list[can.Message]) -> Path:
    if path.suffix == ".mf4":
        write_mf4(path, messages)
        return path
    with can.Logger(path) as writer:
        for one in messages:
            writer(one)
    return path


def write_mf4(path: Path, messages: list[can.Message]) -> None:
    """An MF4 as a bus logger writes it."""
    from asammdf import MDF, Signal
    from asammdf.blocks.v4_blocks import SourceInformation
    from asammdf.blocks.v4_constants import BUS_TYPE_CAN, FLAG_CG_BUS_EVENT, SOURCE_BUS

    kind = [
        ("BusChannel", "u1"),
        ("ID", "u4"),
        ("IDE", "u1"),
        ("DLC", "u1"),
        ("DataLength", "u1"),
        ("DataBytes", "u1", (8,)),
    ]
    rows = np.zeros(len(messages), [(f"CAN_DataFrame.{name}", *rest) for name, *rest in kind])
    for row, one in zip(rows, messages, strict=True):
        row["CAN_DataFrame.BusChannel"], row["CAN_DataFrame.ID"] = 1, one.arbitration_id
        row["CAN_DataFrame.IDE"], row["CAN_DataFrame.DLC"] = one.is_extended_id, one.dlc
        row["CAN_DataFrame.DataLength"] = len(one.data)
        row["CAN_DataFrame.DataBytes"][: len(one.data)] = list(one.data)
    stamps = np.array([one.timestamp - messages[0].timestamp for one in messages])
    with MDF(version="4.10") as mdf:
        source = SourceInformation(source_type=SOURCE_BUS, bus_type=BUS_TYPE_CAN)
        mdf.append([Signal(rows, stamps, name="CAN_DataFrame", source=source)])
        mdf.groups[0].channel_group.flags |= FLAG_CG_BUS_EVENT
        mdf.save(path)


def frames_of(path: Path) -> list[tuple[int, bytes]]:
    log = read_bus_log(path)
    return [(int(log.ids[row]), log.data(row)) for row in range(len(log))]


WANTED = [(m.arbitration_id, bytes(m.data)) for m in bench()]


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".trc", ".mf4"])
def test_every_format_gives_the_same_frames_and_its_suffix_says_nothing(tmp_path: Path, suffix: str) -> None:
    path = write(tmp_path / f"bus{suffix}", bench())
    other = path.rename(tmp_path / "RECORD.DAT")
    assert frames_of(other) == WANTED
    log = read_bus_log(other)
    assert len(log.channels) == 1
    assert (log.damaged, log.cut, log.notes) == (0, "", [])
    assert np.allclose(np.diff(log.stamps), np.tile([1e-4, 9e-4], 40)[:-1], atol=2e-5)
    assert recognise(other).name == "bus log"


ASC_HEAD = "date Wed Nov 25 03:01:09.978 2026\nbase hex  timestamps absolute\ninternal events logged\n"


def asc(messages: list[can.Message], head: str = ASC_HEAD, base: str = "02X", relative: bool = False) -> str:
    lines, before = [head], START
    for m in messages:
        at = m.timestamp - (before if relative else START)
        before = m.timestamp
        data = " ".join(format(byte, base) for byte in m.data)
        lines.append(f"  {at:.6f} 1  {format(m.arbitration_id, base[-1])}             Rx   d {len(m.data)} {data}\n")
    return "".join(lines)


TEXTS: dict[str, bytes] = {
    "screen format": screen(bench()).encode(),
    "comment": ("# recorded on bench 3\n" + candump(bench())).encode(),
    "comment between": candump(bench()).replace("\n", "\n# lunch\n\n", 3).encode(),
    "CRLF": candump(bench()).replace("\n", "\r\n").encode(),
    "UTF-8 mark": b"\xef\xbb\xbf" + candump(bench()).encode(),
    "UTF-16": candump(bench()).encode("utf-16"),
    "lower case": candump(bench()).lower().encode(),
    "direction": candump(bench()).replace("\n", " R\n").encode(),
    "no end of the last line": candump(bench()).rstrip().encode(),
    "ASC of a code page": ("// Prüfstand °C\n" + asc(bench())).encode("cp1252"),
    "ASC without its events line": asc(bench(), "date Wed Nov 25 03:01:09 2026\nbase hex  timestamps absolute\n").encode(),
    "ASC in decimal": asc(bench(), ASC_HEAD.replace("hex", "dec"), "d").encode(),
    "ASC with relative times": asc(bench(), ASC_HEAD.replace("absolute", "relative"), relative=True).encode(),
    "ASC with requests to send": asc(bench()).encode()
    + b"  9.0 1  100             TxRq   d 8 0 0 0 0 0 0 0 0\n",
    "ASC with statistics": asc(bench()).encode()
    + b"  9.0 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\nEnd TriggerBlock\n",
}  # fmt: skip


@pytest.mark.parametrize("content", TEXTS.values(), ids=TEXTS)
def test_everyday_texts_are_read(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bus.txt"
    path.write_bytes(content)
    assert frames_of(path) == WANTED
    log = read_bus_log(path)
    assert (log.damaged, log.cut) == (0, "")
    assert np.allclose(np.diff(log.stamps), np.tile([1e-4, 9e-4], 40)[:-1], atol=2e-6)


REFUSED: dict[str, tuple[bytes, str]] = {
    "no times": (screen(bench()).replace("(", "").encode().replace(b"1700000000", b""), "known are candump"),
    "screen without times": (
        b"".join(b"  can0  100   [2]  00 11\n" for _ in range(5)),
        "line 1 has no time; record with candump -L",
    ),
    "times between frames": (
        b"".join(b" (000.0%05d)  can0  100   [2]  00 11\n" % (n * 7919 % 9973) for n in range(100)),
        "times between frames",
    ),
    "compressed": (b"\x1f\x8b" + bytes(100), "it is compressed; unpack it first"),
    "binary": (bytes(range(256)) * 4, "it begins with"),
    "other TRC": (b";$FILEVERSION=3.1\n;$STARTTIME=45000.5\n1 0.1 DT 0100 Rx 2 00 11\n", "version 3.1; known are 1.0"),
    "wrong TRC head": (
        b";$FILEVERSION=2.1\n;$STARTTIME=x\n;$COLUMNS=N,O,T,I,d,L,D\n1 0.1 DT 0100 Rx 2 00 11\n",
        "cannot be read",
    ),
    "no frame": (b"date Wed Nov 25 03:01:09.978 2026\nbase hex  timestamps absolute\n", "has no frame"),
}


@pytest.mark.parametrize(("content", "words"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_read_is_one_sentence(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "bus.log"
    path.write_bytes(content)
    with pytest.raises(InputError) as told:
        read_bus_log(path)
    assert words in str(told.value)
    assert str(path) in str(told.value)


def test_frames_are_ordered_by_time_and_it_is_told(tmp_path: Path) -> None:
    messages, path = bench(), tmp_path / "bus.log"
    for one in messages:
        one.timestamp = round(one.timestamp, 3)  # the two of a sample have one time
    blocks = [messages[first : first + 20][::-1] for first in range(0, len(messages), 20)]
    path.write_text(candump([one for block in blocks for one in block]))
    assert frames_of(path) == WANTED
    (note,) = read_bus_log(path).notes
    assert "were not in order of time" in note
    mild = [*messages[:5], messages[8], *messages[5:8], *messages[9:]]  # one frame late
    path.write_text(candump(mild))
    assert frames_of(path) == WANTED


def test_frames_that_are_no_data_frames_are_marked(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text(
        "(1.0) can0 100#R\n(1.1) can0 100#R4\n(1.2) can0 100##1" + "AA" * 64 + "\n(1.3) can0 00000100#11\n"
        "(1.4) can0 20000088#0000000000000000\n(1.5) can0 100#\n"
    )
    log = read_bus_log(path)
    assert log.flags.tolist() == [2, 2, 8, 1, 4, 0] or log.flags.tolist() == [2, 2, 8, 1, 5, 0]
    assert log.lengths.tolist()[2:4] == [64, 1]


# damage


@pytest.mark.parametrize(
    "bad", ["(1.0) can0 100#123\n", "garbage\n", "(x) can0 100#11\n", "(1.0) can0 9FF#11\n", "A" * 10_000 + "\n"]
)
def test_a_damaged_line_is_counted_and_left_out(tmp_path: Path, bad: str) -> None:
    lines = candump(bench()).splitlines(keepends=True)
    path = tmp_path / "bus.log"
    path.write_text("".join([*lines[:9], bad, *lines[9:]]))
    assert frames_of(path) == WANTED
    assert read_bus_log(path).damaged == 1


@pytest.mark.parametrize(
    "bad", ["0.5 1  100 Rx d 8 11 22\n", "0.5 1  100 Rx d 2 11 XY\n", "0.5 CANFD  1 Rx 100\n", "0.5 1 9ff Rx d 1 11\n"]
)
def test_a_damaged_line_of_asc_is_counted_and_left_out(tmp_path: Path, bad: str) -> None:
    lines = asc(bench()).splitlines(keepends=True)
    path = tmp_path / "bus.asc"
    path.write_text("".join([*lines[:9], bad, *lines[9:]]))
    assert frames_of(path) == WANTED
    assert read_bus_log(path).damaged == 1


@pytest.mark.parametrize(
    "text", [candump(bench()), candump(bench()).replace("\n", " R\n"), screen(bench()), asc(bench())]
)
def test_a_text_that_ends_within_a_line_is_cut(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bus.log"
    short = text.rstrip()
    path.write_text(short[:-5])
    assert frames_of(path) == WANTED[:-1]
    log = read_bus_log(path)
    assert log.damaged == 0
    assert "ends within line" in log.cut


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.999])
def test_a_blf_that_is_cut_gives_what_is_there(tmp_path: Path, share: float) -> None:
    messages = bench(4000)
    with can.BLFWriter(str(tmp_path / "whole.blf")) as writer:
        for one in messages:
            writer(one)
    whole = (tmp_path / "whole.blf").read_bytes()
    path = tmp_path / "bus.blf"
    path.write_bytes(whole[: int(share * len(whole))])
    log = read_bus_log(path)
    assert "cut" in log.cut or "ends within" in log.cut
    assert 0.2 * share * len(messages) < len(log) < len(messages)
    assert [log.data(row) for row in range(len(log))] == [bytes(one.data) for one in messages[: len(log)]]


def blf(content: bytes, packed: bool = True) -> bytes:
    """A BLF file with one container."""
    data = zlib.compress(content) if packed else content
    body = struct.pack("<HHL2H4B", 2 if packed else 0, 0, 0, 0, 0, 0, 0, 0, 0)[:16].ljust(16, b"\0")
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(data), 10)
    top = struct.pack("<4sL8BQQLL8H8H", b"LOGG", 144, 0, 0, 0, 0, 2, 6, 8, 1, 144, 0, 1, 0, *([0] * 16)).ljust(
        144, b"\0"
    )
    return top + head + body + data


@pytest.mark.parametrize(
    "content",
    [
        struct.pack("<4sHHLL", b"LOBJ", 32, 1, 0, 1) + bytes(64),  # an object of no bytes: python-can would never end
        struct.pack("<4sHHLL", b"LOBJ", 32, 7, 0, 1) + bytes(64),
        struct.pack("<4sHHLL", b"LOBJ", 32, 1, 0xFFFFFFF0, 1) + bytes(64),
        bytes(1000),
    ],
)
def test_objects_that_cannot_be_end_the_reading(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bus.blf"
    path.write_bytes(blf(content))
    with pytest.raises(InputError, match="has no frame"):
        read_bus_log(path)


def test_a_container_that_unpacks_to_very_much_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "bus.blf"
    path.write_bytes(blf(bytes(200 << 20)))
    tracemalloc.start()
    with pytest.raises(InputError, match="unpacks to more than 64 MiB"):
        read_bus_log(path)
    assert tracemalloc.get_traced_memory()[1] < 200 << 20
    tracemalloc.stop()


def test_too_many_frames_or_channels_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "bus.log"
    path.write_text("".join(f"(1.0) can{n} 100#11\n" for n in range(300)))
    with pytest.raises(InputError, match="more than 256 channels"):
        read_bus_log(path)
    monkeypatch.setattr("protocols.files.bus_log.MOST_FRAMES", 50)
    for name in ("bus.blf", "bus.asc", "bus.mf4"):
        with pytest.raises(InputError, match="frames"):
            read_bus_log(write(tmp_path / name, bench()))


# signals


def car(folder: Path) -> tuple[Path, list[can.Message]]:
    """A log and a database of a car, with random payloads."""
    (folder / "car.dbc").write_text(CAR, encoding="cp1252")
    random_bytes = random.Random(1)
    messages = []
    for n in range(300):
        messages.append(message(START + n * 0.01, 291, random_bytes.randbytes(8)))
        page = bytes((n % 3,)) + random_bytes.randbytes(7)
        messages.append(message(START + n * 0.01 + 0.001, 2566844926 & 0x1FFFFFFF, page, is_extended_id=True))
    path = folder / "car.log"
    with can.Logger(path) as writer:
        for one in messages:
            writer(one)
    return path, messages


def values(recording: Recording, path: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    (signal,) = recording.read([choose_channel(path, recording.channels, name)])
    assert signal.time is not None
    return signal.time, signal.values


def test_signals_are_those_of_cantools(tmp_path: Path) -> None:
    path, messages = car(tmp_path)
    database: Any = cantools.database.load_string(CAR, "dbc")
    recording = open_recording(path, {"dbc": str(tmp_path / "car.dbc")})
    expected: dict[str, list[tuple[float, float]]] = {}
    for one in messages:
        definition = database.get_message_by_frame_id(one.arbitration_id)
        decoded = (
            definition.decode(one.data, decode_choices=False, allow_truncated=False)
            if one.data[0] % 16 < 2 or not one.is_extended_id
            else {"PAGE": one.data[0] & 15}
        )
        for name, value in decoded.items():
            expected.setdefault(f"{definition.name}.{name}", []).append((one.timestamp - START, value))
    assert {c.path for c in recording.channels if c.kind != "time"} == expected.keys()
    for name, pairs in expected.items():
        at, got = values(recording, path, name)
        assert np.allclose(at, [time for time, _ in pairs], atol=1e-6), name
        assert np.allclose(got, [value for _, value in pairs], rtol=1e-12, equal_nan=True), name


def test_channels_say_what_the_database_says(tmp_path: Path) -> None:
    path, _ = car(tmp_path)
    recording = open_recording(path, {"dbc": "car.dbc"})  # beside the log
    by_path = {channel.path: channel for channel in recording.channels}
    assert (by_path["ENGINE.COOLANT"].unit, by_path["ENGINE.SPEED"].unit) == ("°C", "rpm")
    assert [by_path[f"ENGINE.{name}"].kind for name in ("SPEED", "GEAR", "BRAKE")] == ["number", "status", "status"]
    assert by_path["PAGES.CURRENT"].raster == by_path["PAGES.POWER"].raster != by_path["PAGES.PAGE"].raster
    assert by_path["PAGES.VOLTAGE"].rows == 100
    assert by_path["ENGINE.time"].kind == "time"
    assert by_path["ENGINE.SPEED"].rate_hz == pytest.approx(100.0, rel=1e-6)
    assert recording.start.startswith("2023-11-14T22:13:20")


@pytest.mark.parametrize("length", range(1, 65))
def test_every_length_and_byte_order_is_that_of_cantools(length: int) -> None:
    generator = np.random.default_rng(length)
    payloads = generator.integers(0, 256, (50, 8), np.uint8)
    for order in (1, 0):
        for sign in "+-":
            start = int(generator.integers(0, 65 - length)) if order else 7
            text = f'VERSION ""\nBO_ 1 M: 8 E\n SG_ S : {start}|{length}@{order}{sign} (0.5,-3) [0|0] "" E\n'
            database: Any = cantools.database.load_string(text, "dbc")
            (definition,) = database.messages
            wanted = [definition.decode(bytes(row))["S"] for row in payloads]
            assert np.allclose(physical_values(definition.signals[0], payloads), wanted, rtol=1e-12)
            assert rows_with_signal(definition, definition.signals[0], payloads).all()


def test_a_map_makes_a_run_of_a_bus_log(tmp_path: Path) -> None:
    path = write(tmp_path / "bus.blf", bench(500))
    (tmp_path / "m.toml").write_text(
        '[file]\nresample_hz = 100.0\n[columns]\ntime_s = { from = "ANALOG_SENSORS.time" }\n'
        'cylinder_pressure_bar = { from = "ANALOG_SENSORS.CYLINDER_PRESSURE" }\n'
        'shaft_angle_rad = { from = "ENCODER.SHAFT_ANGLE" }\n'
    )
    run = load_map(str(tmp_path / "m.toml")).read(path)
    at = run["time_s"]
    assert len(at) == 50
    assert np.allclose(run["cylinder_pressure_bar"][5:-5], 10.0 * at[5:-5], atol=0.02)
    assert np.allclose(run["shaft_angle_rad"][5:-5], at[5:-5] - 1e-4, atol=1e-4)


def test_a_channel_is_asked_for_where_two_have_messages(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    both = zip(candump(bench()).splitlines(), candump(bench(), "can1").splitlines(), strict=True)
    path.write_text("".join(f"{a}\n{b}\n" for a, b in both))
    with pytest.raises(InputError, match=r"on 2 channels, can0, can1; write channel"):
        open_recording(path)
    with pytest.raises(InputError, match="has no channel 'can7'; it has can0, can1"):
        open_recording(path, {"channel": "can7"})
    recording = open_recording(path, {"channel": "can1"})
    assert choose_channel(path, recording.channels, "ENCODER.SHAFT_ANGLE").rows == 40
    assert any("took channel can1" in note for note in recording.notes)


def test_a_database_that_does_not_fit_is_told_with_the_identifiers_of_the_log(tmp_path: Path) -> None:
    path, _ = car(tmp_path)
    with pytest.raises(
        InputError, match=r"has no message of .*clutch_rig.dbc; its identifiers are 0x123, 0x18FEF1FE; name"
    ):
        open_recording(path)
    with pytest.raises(InputError, match=r"DBC no.dbc does not exist"):
        open_recording(path, {"dbc": "no.dbc"})


def test_frames_that_carry_nothing_are_left_out_and_told(tmp_path: Path) -> None:
    messages = bench()
    messages[10].data = bytearray(b"\0" * 8)  # wrong CRC
    messages[20].data, messages[20].dlc = bytearray(b"\0" * 3), 3
    del messages[31]
    extra = [message(START + 0.5, ANALOG.can_id, b"", is_remote_frame=True, dlc=8), message(START + 0.6, 0x555, b"\1")]
    recording = open_recording(write(tmp_path / "bus.log", [*messages, *extra]))
    for words in (
        "left out 1 frames of ANALOG_SENSORS with a wrong CRC", "left out 1 frames of ANALOG_SENSORS: remote",
        "left out 1 frames of ANALOG_SENSORS with fewer than 8 bytes", "1 frames of ENCODER are missing",
        "left out 1 frames that the database does not have: 0x555",
    ):  # fmt: skip
        assert any(words in note for note in recording.notes), (words, recording.notes)


# whatever comes


def _cut(data: bytearray, draw: random.Random) -> bytearray:
    return data[: draw.randrange(len(data))]


def _flip(data: bytearray, draw: random.Random) -> bytearray:
    for _ in range(draw.choice((1, 5, 50))):
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    return data


def _huge(data: bytearray, draw: random.Random) -> bytearray:
    at = draw.randrange(len(data) - 8)
    data[at : at + 8] = draw.choice((b"\xff" * 8, b"99999999", bytes(8), struct.pack("<Q", 1 << 40)))
    return data


def _shuffle(data: bytearray, draw: random.Random) -> bytearray:
    a, b = sorted(draw.randrange(len(data)) for _ in range(2))
    return data[:a] + data[b:] + data[a:b]


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".trc", ".mf4"])
def test_damaged_files_are_read_or_refused_in_one_sentence(tmp_path: Path, suffix: str) -> None:
    draw = random.Random(suffix)
    seed = write(tmp_path / f"seed{suffix}", bench(60)).read_bytes()
    path = tmp_path / "bus.bin"
    changes: list[Callable[[bytearray, random.Random], bytearray]] = [_cut, _flip, _huge, _shuffle]
    tracemalloc.start()
    for number in range(60):
        path.write_bytes(bytes(changes[number % 4](bytearray(seed), draw)))
        began = time.monotonic()
        said = ""
        try:
            recording = open_recording(path)
            recording.read(recording.channels)
        except InputError as error:
            said = str(error)
        assert "\n" not in said
        assert time.monotonic() - began < 20.0
    assert tracemalloc.get_traced_memory()[1] < 1 << 28
    tracemalloc.stop()
