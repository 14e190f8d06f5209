"""Bus logs: every format gives the same frames, in order of time, or one sentence says why not."""

import random
from pathlib import Path

import can
import numpy as np
import pytest

from clutch_hil.recordings.format import recognise
from protocols.errors import InputError
from protocols.files.bus_logs.bus_log import read_bus_log
from tests.clutch_hil.recordings.bus_logs import (
    ASC_HEAD,
    WANTED,
    format_asc,
    format_candump,
    format_screen,
    make_bench_messages,
    read_frames,
    write,
)

# The head and the frames as PEAK's description of its formats shows them, with a semicolon behind the start
TRC = {
    "1.1": ("", "{n}) {ms:.1f} Rx 0300 {size} {data}"),
    "1.2": ("", "{n}) {ms:.3f} 1 Rx 0300 {size} {data}"),
    "1.3": ("", "{n}) {ms:.3f} 1 Rx 0300 - {size} {data}"),
    "2.0": (";$COLUMNS=N,O,T,I,d,l,D\n", "{n} {ms:.3f} DT 0300 Rx {size} {data}"),
    "2.1": (";$COLUMNS=N,O,T,B,I,d,R,L,D\n", "{n} {ms:.3f} DT 1 0300 Rx - {size} {data}"),
    "2.1 without numbers": (";$COLUMNS=O,T,I,d,l,D\n", "{ms:.3f} DT 0300 Rx {size} {data}"),
}


@pytest.mark.parametrize("version", TRC)
def test_each_version_of_trc_is_read_as_peak_describes_it(tmp_path: Path, version: str) -> None:
    columns, line = TRC[version]
    contents = [bytes(range(n % 9)) for n in range(40)]
    frames = (line.format(n=n + 1, ms=10.0 * n, size=len(data), data=data.hex(" ")) for n, data in enumerate(contents))
    path = tmp_path / "log.trc"
    head = f";$FILEVERSION={version.split()[0]}\n;$STARTTIME=39878.5;\n{columns};   C:\\TraceFile.trc\n"
    path.write_text(head + "\n".join([*frames, ""]))
    log = read_bus_log(path)
    assert read_frames(path) == [(0x300, data) for data in contents]
    np.testing.assert_allclose(np.diff(log.stamps), 0.01, atol=1e-6)


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".trc", ".mf4", ".csv", ".db"])
def test_every_format_gives_the_same_frames_and_its_suffix_says_nothing(tmp_path: Path, suffix: str) -> None:
    path = write(tmp_path / f"bus{suffix}", make_bench_messages())
    other = path.rename(tmp_path / "RECORD.DAT")
    assert read_frames(other) == WANTED
    log = read_bus_log(other)
    assert len(log.channels) == 1
    assert (log.damaged, log.cut, log.notes) == (0, "", [])
    assert np.allclose(np.diff(log.stamps), np.tile([1e-4, 9e-4], 40)[:-1], atol=2e-5)
    assert recognise(other).name == "bus log"


TEXTS: dict[str, bytes] = {
    "screen format": format_screen(make_bench_messages()).encode(),
    "comment": ("# recorded on bench 3\n" + format_candump(make_bench_messages())).encode(),
    "comment between": format_candump(make_bench_messages()).replace("\n", "\n# lunch\n\n", 3).encode(),
    "CRLF": format_candump(make_bench_messages()).replace("\n", "\r\n").encode(),
    "UTF-8 mark": b"\xef\xbb\xbf" + format_candump(make_bench_messages()).encode(),
    "UTF-16": format_candump(make_bench_messages()).encode("utf-16"),
    "lower case": format_candump(make_bench_messages()).lower().encode(),
    "direction": format_candump(make_bench_messages()).replace("\n", " R\n").encode(),
    "no end of the last line": format_candump(make_bench_messages()).rstrip().encode(),
    "ASC of a code page": ("// Prüfstand °C\n" + format_asc(make_bench_messages())).encode("cp1252"),
    "ASC without its events line": format_asc(
        make_bench_messages(), "date Wed Nov 25 03:01:09 2026\nbase hex  timestamps absolute\n"
    ).encode(),
    "ASC in decimal": format_asc(make_bench_messages(), ASC_HEAD.replace("hex", "dec"), "d").encode(),
    "ASC with relative times": format_asc(
        make_bench_messages(), ASC_HEAD.replace("absolute", "relative"), relative=True
    ).encode(),
    "ASC with requests to send": format_asc(make_bench_messages()).encode()
    + b"  9.0 1  100             TxRq   d 8 0 0 0 0 0 0 0 0\n",
    "ASC with statistics": format_asc(make_bench_messages()).encode()
    + b"  9.0 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\nEnd TriggerBlock\n",
}  # fmt: skip


@pytest.mark.parametrize("content", TEXTS.values(), ids=TEXTS)
def test_everyday_texts_are_read(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bus.txt"
    path.write_bytes(content)
    assert read_frames(path) == WANTED
    log = read_bus_log(path)
    assert (log.damaged, log.cut) == (0, "")
    assert np.allclose(np.diff(log.stamps), np.tile([1e-4, 9e-4], 40)[:-1], atol=2e-6)


@pytest.mark.parametrize(
    "line", ["9.0 1  J1939TP FEE3p 6 0 0 -   Rx d 23 01 02 03 ", "9.0 1  18FEF100p Rx d 8 00 11 22 33 44 55 66 77"]
)
def test_parameter_groups_of_j1939_in_asc_are_told(tmp_path: Path, line: str) -> None:
    path = tmp_path / "bus.asc"
    path.write_text(format_asc(make_bench_messages()) + f"  {line}\n")
    assert read_frames(path) == WANTED
    assert read_bus_log(path).notes == [
        "left out 1 parameter groups of J1939, not frames: record the frames themselves"
    ]


REFUSED: dict[str, tuple[bytes, str]] = {
    "no times": (
        format_screen(make_bench_messages()).replace("(", "").encode().replace(b"1700000000", b""),
        "known are candump",
    ),
    "screen without times": (
        b"".join(b"  can0  100   [2]  00 11\n" for _ in range(5)),
        "line 1 has no time; record with candump -L",
    ),
    "times between frames": (
        b"".join(b" (000.0%05d)  can0  100   [2]  00 11\n" % (n * 7919 % 9973) for n in range(100)),
        "times between frames",
    ),
    "times between frames, ASC": (
        b"base hex\n" + b"".join(b"0.0%05d 1  100 Rx d 2 00 11\n" % (n * 7919 % 9973) for n in range(100)),
        "times between frames, not times; write `timestamps relative`",
    ),
    "times between frames, ASC in dec": (
        b"base dec\n" + b"".join(b"0.0%05d 1  100 Rx d 2 00 11\n" % (n * 7919 % 9973) for n in range(100)),
        "times between frames, not times; write `timestamps relative`",
    ),
    "compressed": (b"\x1f\x8b" + bytes(100), "it is compressed; unpack it first"),
    "binary": (bytes(range(256)) * 4, "it begins with"),
    "other TRC": (b";$FILEVERSION=3.1\n;$STARTTIME=45000.5\n1 0.1 DT 0100 Rx 2 00 11\n", "version 3.1; known are 1.0"),
    "wrong TRC head": (
        b";$FILEVERSION=2.1\n;$STARTTIME=x\n;$COLUMNS=N,O,T,I,d,L,D\n1 0.1 DT 0100 Rx 2 00 11\n",
        "cannot be read",
    ),
    "no frame": (b"date Wed Nov 25 03:01:09.978 2026\nbase hex  timestamps absolute\n", "has no frame"),
    "names for identifiers": (
        b"base hex  timestamps absolute\n0.010000 1  100 Rx d 1 00\n0.020000 1  CLUTCH Rx   d 8 00 11 22 33 44 55 66 77\n",
        "line 3 has the name 'CLUTCH' where an identifier is needed",
    ),
}


@pytest.mark.parametrize(("content", "words"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_read_is_one_sentence(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "bus.log"
    path.write_bytes(content)
    with pytest.raises(InputError) as sentence:
        read_bus_log(path)
    assert words in str(sentence.value)
    assert str(path) in str(sentence.value)


def test_two_buses_that_are_not_in_order_have_times(tmp_path: Path) -> None:
    path = tmp_path / "bus.asc"
    pairs = ((0.01 * n + late, bus) for n in range(50) for bus, late in ((1, 0.009), (2, 0.0)))
    path.write_text("base hex\n" + "".join(f"{stamp:.6f} {bus}  100 Rx d 1 00\n" for stamp, bus in pairs))
    assert len(read_bus_log(path)) == 100


def test_frames_that_cantools_decoded_are_read(tmp_path: Path) -> None:
    path = tmp_path / "bus.txt"
    lines = format_screen(make_bench_messages()).splitlines()
    path.write_text("".join(f"{line} :: M(TORQUE: 1.5 Nm, SPEED: 2 rpm)\n" for line in lines))
    assert read_frames(path) == WANTED


def test_frames_are_ordered_by_time_and_it_is_told(tmp_path: Path) -> None:
    messages, path = make_bench_messages(), tmp_path / "bus.log"
    for one in messages:
        one.timestamp = round(one.timestamp, 3)  # the two of a sample have one time
    blocks = [messages[first : first + 20][::-1] for first in range(0, len(messages), 20)]
    path.write_text(format_candump([one for block in blocks for one in block]))
    assert read_frames(path) == WANTED
    (note,) = read_bus_log(path).notes
    assert "were not in order of time" in note
    mild = [*messages[:5], messages[8], *messages[5:8], *messages[9:]]  # one frame late
    path.write_text(format_candump(mild))
    assert read_frames(path) == WANTED


def test_frames_that_are_no_data_frames_are_marked(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text(
        "(1.0) can0 100#R\n(1.1) can0 100#R4\n(1.2) can0 100##1" + "AA" * 64 + "\n(1.3) can0 00000100#11\n"
        "(1.4) can0 20000088#0000000000000000\n(1.5) can0 100#\n"
    )
    log = read_bus_log(path)
    assert log.flags.tolist() == [2, 2, 8, 1, 4, 0] or log.flags.tolist() == [2, 2, 8, 1, 5, 0]
    assert log.lengths.tolist()[2:4] == [64, 1]


def test_a_second_recording_in_a_log_is_refused_where_it_begins(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    zero = make_bench_messages(start=0.0)
    for second in (zero, zero[:50], make_bench_messages(200, start=0.0005), [*zero, *zero]):
        path.write_text(format_candump(zero) + format_candump(second))
        with pytest.raises(
            InputError, match=r"second recording from line 81 on, .* from 0.0391 s to 0(.0005)? s; split"
        ):
            read_bus_log(path)
    path.write_text(format_screen(zero) + format_screen(zero))
    with pytest.raises(InputError, match="second recording from line 81 on"):
        read_bus_log(path)
    path.write_text(format_asc(make_bench_messages()) + format_asc(make_bench_messages(3)))  # told by its head
    with pytest.raises(InputError, match="second recording from line 84 on"):
        read_bus_log(path)
    relative = format_asc(make_bench_messages(), ASC_HEAD.replace("absolute", "relative"), relative=True)
    path.write_text(relative + relative)
    with pytest.raises(InputError, match="second recording from line 84 on, and its times count from the line before"):
        read_bus_log(path)
    with pytest.raises(InputError, match="second recording from frame 81 on"):
        read_bus_log(write(tmp_path / "bus.blf", [*make_bench_messages(), *make_bench_messages()]))


def test_blocks_of_one_recording_in_any_order_are_ordered(tmp_path: Path) -> None:
    messages, path = make_bench_messages(200), tmp_path / "bus.log"
    analog, encoder = messages[::2], messages[1::2]
    wanted = [(m.arbitration_id, bytes(m.data)) for m in messages]
    blocks = [messages[first : first + 40] for first in range(0, 400, 40)]
    turns = [sender[first : first + 20] for first in range(0, 200, 20) for sender in (encoder, analog)]
    halves = [block[part::2] for block in blocks for part in (1, 0)]
    two_buffers = [analog[first + part : first + 40 : 2] for first in range(0, 200, 40) for part in (0, 1)]
    random.Random(1).shuffle(shuffled := list(blocks))
    for order in (
        blocks[5:] + blocks[:5],
        blocks[1:2] + blocks[:1] + blocks[2:],
        shuffled,
        [encoder, analog],
        turns,
        halves,
    ):
        path.write_text(format_candump([one for block in order for one in block]))
        assert read_frames(path) == wanted
    path.write_text(format_candump([one for block in two_buffers for one in block]))
    assert read_frames(path) == wanted[::2]
    path.write_text(format_candump(messages) + format_candump(messages, "can1"))
    assert len(read_bus_log(path)) == 800


def move_back(messages: list[can.Message], first: int, last: int, step: float) -> list[can.Message]:
    """Messages of which those from `first` to `last` have times that are `step` [s] earlier."""
    moved = [can.Message(timestamp=m.timestamp - step, arbitration_id=m.arbitration_id, data=m.data,
                         is_extended_id=m.is_extended_id) for m in messages]  # fmt: skip
    return [*messages[:first], *moved[first:last], *messages[last:]]


def test_a_clock_that_is_set_back_is_no_disorder(tmp_path: Path) -> None:
    """As NTP does: the frames after it were put between those before, and a map with resample_hz read the mixture."""
    path = tmp_path / "bus.log"
    messages = make_bench_messages(400)
    path.write_text(format_candump(move_back(messages, 200, 400, 0.0207)))
    with pytest.raises(
        InputError, match=r"the clock was set back by 0.0198\d* s at line 201, so that .*; split the file"
    ):
        read_bus_log(path)


def test_late_frames_and_blocks_in_another_order_are_no_clock_that_was_set_back(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    messages = make_bench_messages(400)
    even, odd = (range(start, 400, 80) for start in (0, 40))
    blocks = [messages[k + row] for start in (even, odd) for k in start for row in range(40)]
    late = [*messages[:100], *messages[104:160], *messages[100:104], *messages[160:]]
    backwards = messages[::-1]
    for disorder in (blocks, late, backwards):
        path.write_text(format_candump(disorder))
        assert np.all(np.diff(read_bus_log(path).stamps) >= 0.0)
