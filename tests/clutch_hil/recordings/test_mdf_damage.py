"""Damaged MDF files are read as far as they can be believed, or refused in one sentence."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from benchmarks.mutations import check_damaged
from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.maps import find_refusal
from tests.clutch_hil.recordings.mdf_files import (
    GEARS,
    MAP,
    ROWS,
    TIME,
    make_plain_signals,
    make_signal,
    read_values,
    write,
)


def find_field(content: bytearray, block: bytes, offset: int) -> int:
    """Place of the data of the first `block`, and from there `offset`."""
    at = content.index(block)
    (links,) = struct.unpack_from("<Q", content, at + 16)
    return at + 24 + 8 * links + offset


def test_rows_that_are_not_there_are_told(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", make_plain_signals())
    content = bytearray(path.read_bytes())
    struct.pack_into("<Q", content, find_field(content, b"##CG", 8), 10**12)
    path.write_bytes(content)
    assert "1e+12 rows" in find_refusal(tmp_path, path, MAP)
    struct.pack_into("<Q", content, find_field(content, b"##CG", 8), ROWS + 1)
    path.write_bytes(content)
    assert "has 301 rows of 24 bytes by its header, and 7200 bytes of data" in find_refusal(tmp_path, path, MAP)


def test_blocks_in_a_circle_end(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", make_plain_signals())
    content = bytearray(path.read_bytes())
    for block in (b"##CN", b"##CG", b"##DG"):
        damaged = bytearray(content)
        at = damaged.index(block)
        struct.pack_into("<Q", damaged, at + 24, at)  # the next one is itself
        path.write_bytes(damaged)
        assert "its blocks form a circle" in find_refusal(tmp_path, path, MAP)


def test_blocks_of_mdf_3_in_a_circle_end(tmp_path: Path) -> None:
    path = write(tmp_path / "a.dat", make_plain_signals(), version="3.30")
    content = bytearray(path.read_bytes())
    at = struct.unpack_from("<I", content, 68)[0]  # the first data group
    struct.pack_into("<I", content, at + 4, at)
    path.write_bytes(content)
    assert "its blocks form a circle" in find_refusal(tmp_path, path, MAP)


def test_compressed_data_that_grow_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", make_plain_signals(), compression=1)
    content = bytearray(path.read_bytes())
    size_at = find_field(content, b"##DZ", 8)
    (packed_size,) = struct.unpack_from("<Q", content, size_at + 8)
    packed = zlib.compress(bytes(40 * packed_size))
    assert len(packed) < packed_size
    content[size_at + 16 : size_at + 16 + len(packed)] = packed
    path.write_bytes(content)
    assert "its compressed data at byte" in find_refusal(tmp_path, path, MAP)
    struct.pack_into("<Q", content, size_at, 1 << 40)
    path.write_bytes(content)
    assert "expand to 1099511627776" in find_refusal(tmp_path, path, MAP)


def test_a_channel_outside_of_its_record_is_left_out(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", make_plain_signals())
    content = bytearray(path.read_bytes())
    last = content.rindex(b"##CN")
    (links,) = struct.unpack_from("<Q", content, last + 16)
    struct.pack_into("<I", content, last + 24 + 8 * links + 4, 1_000_000)  # its place in the record
    path.write_bytes(content)
    assert any(note.startswith("left out as outside of its record") for note in open_recording(path).notes)


@pytest.mark.parametrize(("version", "compression"), [("4.10", 0), ("4.10", 2), ("3.30", 0)])
def test_damaged_files_are_read_or_refused_in_a_sentence(
    tmp_path: Path, version: str, compression: int, capfd: pytest.CaptureFixture[str]
) -> None:
    gear = make_signal("gear", np.arange(ROWS, dtype="u1") % 3, conversion=GEARS)
    path = write(
        tmp_path / "a.mf4",
        [*make_plain_signals(), gear],
        [make_signal("more", TIME)],
        version=version,
        compression=compression,
    )
    read, refused = check_damaged(path, path.read_bytes(), 60)
    assert read
    assert refused
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("compression", [0, 2])
def test_a_group_without_rows_beside_data_has_none(tmp_path: Path, compression: int) -> None:
    """asammdf gives parts of it without end."""
    path = write(tmp_path / "a.mf4", make_plain_signals(), compression=compression)
    content = bytearray(path.read_bytes())
    at = content.index(b"##CG")
    (links,) = struct.unpack_from("<Q", content, at + 16)
    struct.pack_into("<Q", content, at + 24 + 8 * links + 8, 0)
    path.write_bytes(content)
    _, read, _ = read_values(path, "pos")
    assert len(read) == 0
