"""Damaged bus logs: what is damaged is counted, or refused in one sentence, in bounded time and memory."""

import random
import struct
import time
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from protocols.files.bus_logs.bus_log import read_bus_log
from tests.clutch_hil.recordings.bus_logs import (
    WANTED,
    format_asc,
    format_candump,
    format_screen,
    make_bench_messages,
    read_frames,
    write,
)
from tests.clutch_hil.recordings.memory_taken import less_memory_than


@pytest.mark.parametrize(
    "bad", ["(1.0) can0 100#123\n", "garbage\n", "(x) can0 100#11\n", "(1.0) can0 9FF#11\n", "A" * 10_000 + "\n"]
)
def test_a_damaged_line_is_counted_and_left_out(tmp_path: Path, bad: str) -> None:
    lines = format_candump(make_bench_messages()).splitlines(keepends=True)
    path = tmp_path / "bus.log"
    path.write_text("".join([*lines[:9], bad, *lines[9:]]))
    assert read_frames(path) == WANTED
    assert read_bus_log(path).damaged == 1


@pytest.mark.parametrize(
    "bad", ["0.5 1  100 Rx d 8 11 22\n", "0.5 1  100 Rx d 2 11 XY\n", "0.5 CANFD  1 Rx 100\n", "0.5 1 9ff Rx d 1 11\n"]
)
def test_a_damaged_line_of_asc_is_counted_and_left_out(tmp_path: Path, bad: str) -> None:
    lines = format_asc(make_bench_messages()).splitlines(keepends=True)
    path = tmp_path / "bus.asc"
    path.write_text("".join([*lines[:9], bad, *lines[9:]]))
    assert read_frames(path) == WANTED
    assert read_bus_log(path).damaged == 1


@pytest.mark.parametrize(
    "text",
    [
        format_candump(make_bench_messages()),
        format_candump(make_bench_messages()).replace("\n", " R\n"),
        format_screen(make_bench_messages()),
        format_asc(make_bench_messages()),
    ],
)
def test_a_text_that_ends_within_a_line_is_cut(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bus.log"
    short = text.rstrip()
    path.write_text(short[:-5])
    assert read_frames(path) == WANTED[:-1]
    log = read_bus_log(path)
    assert log.damaged == 0
    assert "ends within line" in log.cut


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.999])
def test_a_blf_that_is_cut_gives_what_is_there(tmp_path: Path, share: float) -> None:
    messages = make_bench_messages(4000)
    with can.BLFWriter(str(tmp_path / "whole.blf")) as writer:
        for one in messages:
            writer(one)
    whole = (tmp_path / "whole.blf").read_bytes()
    path = tmp_path / "bus.blf"
    path.write_bytes(whole[: int(share * len(whole))])
    log = read_bus_log(path)
    assert "cut" in log.cut or "ends within" in log.cut
    assert 0.2 * share * len(messages) < len(log) < len(messages)
    assert [log.read_data(row) for row in range(len(log))] == [bytes(one.data) for one in messages[: len(log)]]


def make_blf(content: bytes, packed: bool = True) -> bytes:
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
    path.write_bytes(make_blf(content))
    with pytest.raises(InputError, match="has no frame"):
        read_bus_log(path)


def test_a_container_that_unpacks_to_very_much_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "bus.blf"
    path.write_bytes(make_blf(bytes(200 << 20)))
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
    monkeypatch.setattr("protocols.files.bus_logs.bus_frames.MOST_FRAMES", 50)
    for name in ("bus.blf", "bus.asc", "bus.mf4"):
        with pytest.raises(InputError, match="frames"):
            read_bus_log(write(tmp_path / name, make_bench_messages()))


def _cut(data: bytearray, draw: random.Random) -> bytearray:
    return data[: draw.randrange(len(data))]


def _flip(data: bytearray, draw: random.Random) -> bytearray:
    for _ in range(draw.choice((1, 5, 50))):
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    return data


def _make_huge(data: bytearray, draw: random.Random) -> bytearray:
    at = draw.randrange(len(data) - 8)
    data[at : at + 8] = draw.choice((b"\xff" * 8, b"99999999", bytes(8), struct.pack("<Q", 1 << 40)))
    return data


def _shuffle(data: bytearray, draw: random.Random) -> bytearray:
    a, b = sorted(draw.randrange(len(data)) for _ in range(2))
    return data[:a] + data[b:] + data[a:b]


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".trc", ".mf4"])
def test_damaged_files_are_read_or_refused_in_one_sentence(tmp_path: Path, suffix: str) -> None:
    draw = random.Random(suffix)
    seed = write(tmp_path / f"seed{suffix}", make_bench_messages(60)).read_bytes()
    path = tmp_path / "bus.bin"
    changes: list[Callable[[bytearray, random.Random], bytearray]] = [_cut, _flip, _make_huge, _shuffle]
    for number in range(60):
        path.write_bytes(bytes(changes[number % 4](bytearray(seed), draw)))
        began = time.monotonic()
        sentence = ""
        with less_memory_than(1 << 28):
            try:
                recording = open_recording(path)
                recording.read(recording.channels)
            except InputError as error:
                sentence = str(error)
        assert "\n" not in sentence
        assert time.monotonic() - began < 20.0


def test_a_channel_of_an_mf4_outside_of_its_record_is_refused(tmp_path: Path) -> None:
    """Read there, a library in C ends the process."""
    path = write(tmp_path / "a.mf4", make_bench_messages())
    content = bytearray(path.read_bytes())
    last = content.rindex(b"##CN")
    (links,) = struct.unpack_from("<Q", content, last + 16)
    struct.pack_into("<I", content, last + 24 + 8 * links + 4, 1_000_000)  # its place in the record
    path.write_bytes(content)
    with pytest.raises(InputError, match="lies outside of its record"):
        open_recording(path)
    with pytest.raises(InputError, match="lies outside of its record"):
        read_bus_log(path)


def test_zero_bytes_of_a_power_loss_do_not_hide_a_log(tmp_path: Path) -> None:
    frame = b"(1.250000) can0 100#0011\n"
    path = tmp_path / "bus.log"
    path.write_bytes(frame * 5 + bytes(600) + b"\n" + frame.replace(b"1.25", b"1.75") * 5)
    log = read_bus_log(path)
    assert (len(log), log.damaged) == (10, 1)
