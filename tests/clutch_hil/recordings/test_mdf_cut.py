"""A finished MDF that was cut: rows are read as far as its blocks reach, and told; other damage is refused."""

import struct
import zlib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from tests.clutch_hil.recordings.mdf_files import (
    FORCE,
    POSITION,
    ROWS,
    TIME,
    make_block,
    make_plain_signals,
    read_values,
    write,
    write_unsorted,
)

ROW = 16  # bytes
HALF = ROWS // 2


def write_rows_last(path: Path, data: Callable[[int], bytes]) -> Path:
    """MDF 4 as loggers write it: what describes the rows stands before them. data: blocks of the rows, at their address."""
    content = bytearray(b"MDF     4.10    by hand ".ljust(64, b"\0"))
    struct.pack_into("<H", content, 28, 410)
    content += bytes(104)

    def add(kind: bytes, links: list[int], fields: bytes) -> int:
        content.extend(bytes(-len(content) % 8))
        at = len(content)
        content.extend(make_block(kind, links, fields))
        return at

    following = 0
    for name, kind, place in (("pos", 0, 8), ("time", 2, 0)):
        text = add(b"TX", [], name.encode().ljust(8, b"\0"))
        fields = struct.pack("<BBBBIIIIBxH6d", kind, kind // 2, 4, 0, place, 64, 0, 0, 0, 0, *[0.0] * 6)
        following = add(b"CN", [following, 0, text, 0, 0, 0, 0, 0], fields)
    group = add(b"CG", [0, following, 0, 0, 0, 0], struct.pack("<QQHHIII", 0, ROWS, 0, 0, 0, ROW, 0))
    history = add(b"FH", [0, 0], struct.pack("<QhhB3x", 0, 0, 0, 0))
    data_at = -(-(len(content) + 64) // 8) * 8
    data_group = add(b"DG", [0, group, data_at, 0], bytes(8))
    content.extend(bytes(data_at - len(content)))
    content.extend(data(data_at))
    header = make_block(
        b"HD", [data_group, history, 0, 0, 0, 0], struct.pack("<QhhBBBBdd", 0, 0, 0, 0, 0, 0, 0, 0.0, 0.0)
    )
    content[64 : 64 + len(header)] = header
    path.write_bytes(content)
    return path


def make_records() -> bytes:
    return np.column_stack([TIME, POSITION]).tobytes()


def make_one_block(_: int) -> bytes:
    return make_block(b"DT", [], make_records())


def list_of_blocks(equal: bool) -> Callable[[int], bytes]:
    """A list of four blocks of 100, 100, 50 and 50 rows, or of 75 each, in the order of the file."""
    sizes = (75, 75, 75, 75) if equal else (100, 100, 50, 50)

    def make_blocks(at: int) -> bytes:
        edges = np.cumsum([0, *sizes])
        parts = [make_block(b"DT", [], make_records()[ROW * a : ROW * b]) for a, b in pairwise(edges)]
        fields = [ROW * sizes[0]] if equal else (ROW * edges[:-1]).tolist()
        data = struct.pack(f"<B3xI{len(fields)}Q", int(equal), 4, *fields)
        first = at + 24 + 8 * 5 + len(data)
        links = [first + sum(map(len, parts[:k])) for k in range(4)]
        return make_block(b"DL", [0, *links], data) + b"".join(parts)

    return make_blocks


@pytest.mark.parametrize("data", [make_one_block, list_of_blocks(True), list_of_blocks(False)])
def test_the_file_is_read_whole_where_it_is_whole(tmp_path: Path, data: Callable[[int], bytes]) -> None:
    path = write_rows_last(tmp_path / "a.mf4", data)
    _, read, time = read_values(path, "pos")
    np.testing.assert_array_equal(read, POSITION)
    np.testing.assert_array_equal(time, TIME)
    assert not [note for note in open_recording(path).notes if "cut" in note]


@pytest.mark.parametrize("data", [make_one_block, list_of_blocks(True), list_of_blocks(False)])
@pytest.mark.parametrize("bytes_off", [1, ROW, 7 * ROW + 5, 20 * ROW, 50 * ROW, 75 * ROW + 30, 160 * ROW, 290 * ROW])
def test_a_cut_file_is_read_as_far_as_its_rows_reach(
    tmp_path: Path, data: Callable[[int], bytes], bytes_off: int
) -> None:
    path = write_rows_last(tmp_path / "a.mf4", data)
    content = path.read_bytes()[:-bytes_off]
    path.write_bytes(content)
    heads = 24 * (4 if data is not make_one_block else 1)
    _, read, time = read_values(path, "pos")
    rows = len(read)
    assert ROWS - 1 - bytes_off // ROW <= rows <= ROWS - 1 - (bytes_off - heads) // ROW
    np.testing.assert_array_equal(read, POSITION[:rows])
    np.testing.assert_array_equal(time, TIME[:rows])
    assert f"read as far as its blocks reach: {rows} of {ROWS} rows" in " ".join(open_recording(path).notes)
    assert path.read_bytes() == content


@pytest.mark.parametrize("data", [make_one_block, list_of_blocks(True)])
def test_a_file_without_one_row_is_refused(tmp_path: Path, data: Callable[[int], bytes]) -> None:
    path = write_rows_last(tmp_path / "a.mf4", data)
    path.write_bytes(path.read_bytes()[: path.read_bytes().index(b"##DT") + 30])
    with pytest.raises(InputError, match=r"it is cut or damaged: it ends at byte [0-9]+, before its first row"):
        open_recording(path)


@pytest.mark.parametrize("data", [None, list_of_blocks(True), list_of_blocks(False)])
def test_a_length_beyond_the_end_is_no_cut_where_blocks_stand_behind(
    tmp_path: Path, data: Callable[[int], bytes] | None
) -> None:
    path = tmp_path / "a.mf4"
    if data:
        write_rows_last(path, data)
    else:
        write(path, make_plain_signals())  # of asammdf, which writes what describes the rows behind them
    content = bytearray(path.read_bytes())
    struct.pack_into("<Q", content, content.index(b"##DT") + 8, 1 << 40)
    path.write_bytes(content)
    with pytest.raises(InputError, match="no whole block of data at byte"):
        open_recording(path)


@pytest.mark.parametrize("bytes_off", [1, 24, 24 * 100 + 5])
def test_a_cut_mdf_3_is_read_as_far_as_its_rows_reach(tmp_path: Path, bytes_off: int) -> None:
    path = write(tmp_path / "a.dat", make_plain_signals(), version="3.30")
    content = bytearray(path.read_bytes())
    (group,) = struct.unpack_from("<I", content, 68)
    (rows_at,) = struct.unpack_from("<I", content, group + 16)
    struct.pack_into("<I", content, group + 16, len(content))  # the rows at the end, as INCA writes them
    content += content[rows_at : rows_at + 24 * ROWS]
    path.write_bytes(content[:-bytes_off])
    rows = ROWS - -(-bytes_off // 24)
    for name, wanted in (("pos", POSITION), ("force", FORCE)):
        _, read, time = read_values(path, name)
        np.testing.assert_array_equal(read, wanted[:rows])
        np.testing.assert_array_equal(time, TIME[:rows])
    assert f"{rows} of {ROWS} rows" in " ".join(open_recording(path).notes)


def cut_unsorted(path: Path, bytes_off: int) -> Path:
    """A file of a logger whose rows stand in the order of time, cut."""
    content = write_unsorted(path).read_bytes()
    end = content.index(b"##FH") // 8 * 8  # the rows come last here: what stands behind them is put before
    data = content.index(b"##DT")
    (length,) = struct.unpack_from("<Q", content, data + 8)
    moved = bytearray(content + content[data : data + length])
    data_group = content.index(b"##DG")
    struct.pack_into("<Q", moved, data_group + 24 + 16, len(content))
    assert end > data
    path.write_bytes(moved[: len(moved) - bytes_off])
    return path


@pytest.mark.parametrize("bytes_off", [1, 16, 17, 18, 17 * 40 + 3, 17 * 250])
def test_cut_rows_that_must_be_sorted_are_read_as_far_as_they_reach(tmp_path: Path, bytes_off: int) -> None:
    path = cut_unsorted(tmp_path / "a.mf4", bytes_off)
    whole = (17 * (ROWS + ROWS // 10) - bytes_off) // 17  # rows of both groups
    second = -(-whole // 11) if whole % 11 != 1 else whole // 11
    first = whole - second
    _, read, time = read_values(path, "pos")
    np.testing.assert_array_equal(read, np.sin(TIME)[:first])
    np.testing.assert_array_equal(time, TIME[:first])
    _, read, _ = read_values(path, "force")
    np.testing.assert_array_equal(read, np.cos(TIME[::10])[:second])
    notes = " ".join(open_recording(path).notes)
    assert f"{first} of {ROWS} rows" in notes
    assert f"{second} of {ROWS // 10} rows" in notes


def test_a_row_of_no_group_is_damage(tmp_path: Path) -> None:
    path = cut_unsorted(tmp_path / "a.mf4", 5)
    content = bytearray(path.read_bytes())
    at = content.rindex(b"##DT") + 24 + 17 * 100
    content[at] = 77
    path.write_bytes(content)
    with pytest.raises(InputError, match="it is cut or damaged: a row is of group 77; the groups are 1, 2"):
        open_recording(path)


@pytest.mark.parametrize("transposed", [False, True])
def test_of_cut_compressed_rows_the_whole_blocks_are_read(tmp_path: Path, transposed: bool) -> None:
    path = write_unsorted(tmp_path / "a.mf4")
    content = bytearray(path.read_bytes())
    data = content.index(b"##DT")
    (length,) = struct.unpack_from("<Q", content, data + 8)
    rows, blocks = bytes(content[data + 24 : data + length]), []
    for part in (rows[: 17 * 110], rows[17 * 110 : 17 * 220 + 9], rows[17 * 220 + 9 :]):
        even = len(part) // 17 * 17
        turned = np.frombuffer(part[:even], np.uint8).reshape(-1, 17).T.tobytes() + part[even:] if transposed else part
        packed = zlib.compress(turned)
        fields = struct.pack("<2sBxIQQ", b"DT", int(transposed), 17 if transposed else 0, len(part), len(packed))
        packed_block = make_block(b"DZ", [], fields + packed)
        blocks.append(packed_block + bytes(-len(packed_block) % 8))
    content += bytes(-len(content) % 8)
    at = len(content)
    fields = struct.pack("<B3xI3Q", 0, 3, 0, 17 * 110, 17 * 220 + 9)
    first = at + 24 + 8 * 4 + len(fields)
    content += make_block(b"DL", [0, *(first + sum(map(len, blocks[:k])) for k in range(3))], fields) + b"".join(blocks)
    struct.pack_into("<Q", content, content.index(b"##DG") + 24 + 16, at)
    for bytes_off, force in ((0, ROWS // 10), (9, 20)):
        path.write_bytes(content[: len(content) - bytes_off])
        _, read, _ = read_values(path, "force")
        np.testing.assert_array_equal(read, np.cos(TIME[::10])[:force])
        _, read, _ = read_values(path, "pos")
        np.testing.assert_array_equal(read, np.sin(TIME)[: 10 * force])


@pytest.mark.parametrize("id_bytes", [1, 2])
def test_cut_mdf_3_whose_rows_must_be_sorted(tmp_path: Path, id_bytes: int) -> None:
    path = write(tmp_path / "a.dat", make_plain_signals(), version="3.30")
    content = bytearray(path.read_bytes())
    (group,) = struct.unpack_from("<I", content, 68)
    (channels,) = struct.unpack_from("<I", content, group + 8)
    (rows_at,) = struct.unpack_from("<I", content, group + 16)
    struct.pack_into("<I", content, group + 16, len(content))
    struct.pack_into("<H", content, group + 22, id_bytes)
    struct.pack_into("<H", content, channels + 16, 7)
    for k in range(ROWS):
        row = content[rows_at + 24 * k : rows_at + 24 * (k + 1)]
        content += b"\7" + row + b"\7" * (id_bytes - 1)
    for bytes_off in (0, 1, 30, (24 + id_bytes) * 100):
        path.write_bytes(content[: len(content) - bytes_off])
        rows = ROWS - -(-bytes_off // (24 + id_bytes))
        _, read, time = read_values(path, "pos")
        np.testing.assert_array_equal(read, POSITION[:rows])
        np.testing.assert_array_equal(time, TIME[:rows])
        assert (f"{rows} of {ROWS} rows" in " ".join(open_recording(path).notes)) == (bytes_off > 0)
