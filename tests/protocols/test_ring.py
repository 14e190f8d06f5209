"""The ring between a loop that never waits and readers that may be slow."""

import json
import multiprocessing
import struct
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest

from protocols.errors import InputError
from protocols.node import Column
from protocols.realtime.ring import RingCollector, RingReader, RingWriter

COLUMNS = (Column("n", "1", "number of the row"), Column("twice", "1", "2 n"), Column("square", "1", "n^2"))
CAPACITY = 8
ROWS = 200_000  # written while another process reads
BIG = 512  # rows of that ring: the reader is overtaken now and then
PATIENCE_S = 15.0  # for the other process to start and to end


def make_row(n: int) -> tuple[float, ...]:
    return n, 2.0 * n, float(n) * n


def make_rows(numbers: range) -> np.ndarray:
    return np.array([make_row(n) for n in numbers]).reshape(-1, len(COLUMNS))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "test.ring"


@pytest.fixture
def writer(path: Path) -> RingWriter:
    return RingWriter(path, COLUMNS, CAPACITY)


def write(writer: RingWriter, numbers: range) -> None:
    for n in numbers:
        writer.write(make_row(n))


def test_rows_come_back_in_order(path: Path, writer: RingWriter) -> None:
    reader = RingReader(path)
    for start in range(0, 50, 5):
        write(writer, range(start, start + 5))
        np.testing.assert_array_equal(reader.read(), make_rows(range(start, start + 5)))
    assert reader.lost == 0


def test_an_empty_ring_gives_no_rows(path: Path, writer: RingWriter) -> None:
    reader = RingReader(path)
    assert reader.read().shape == (0, len(COLUMNS))
    write(writer, range(1))
    assert len(reader.read()) == 1
    assert reader.read().shape == (0, len(COLUMNS))
    assert reader.lost == 0


def test_the_reader_learns_the_columns(path: Path, writer: RingWriter) -> None:
    assert RingReader(path).columns == COLUMNS


@pytest.mark.parametrize("written", range(3 * CAPACITY + 2))
def test_a_slow_reader_counts_exactly_what_it_missed(path: Path, writer: RingWriter, written: int) -> None:
    reader = RingReader(path)
    write(writer, range(written))
    lost = max(0, written - CAPACITY)
    np.testing.assert_array_equal(reader.read(), make_rows(range(lost, written)))
    assert reader.lost == lost


@pytest.mark.parametrize("missed", range(2 * CAPACITY + 2))
def test_missed_rows_add_up_over_reads(path: Path, writer: RingWriter, missed: int) -> None:
    reader = RingReader(path)
    got = n = 0
    for _ in range(5):
        write(writer, range(n, n + missed))
        n += missed
        got += len(reader.read())
        assert got + reader.lost == n


def test_a_writer_knows_what_its_collector_has_not_read(path: Path, writer: RingWriter) -> None:
    write(writer, range(2))
    RingReader(path).read()
    assert writer.backlog == 0  # nobody collects
    collector = RingCollector(path)
    assert writer.backlog == 2
    assert len(collector.read()) == 2
    assert writer.backlog == 0
    write(writer, range(CAPACITY + 2))
    RingReader(path).read()
    assert writer.backlog == CAPACITY + 2
    assert len(collector.read()) == CAPACITY
    assert (writer.backlog, collector.lost) == (0, 2)


def test_rows_are_copies_that_later_writes_do_not_change(path: Path, writer: RingWriter) -> None:
    reader = RingReader(path)
    write(writer, range(3))
    kept = reader.read()
    write(writer, range(3, 30))
    np.testing.assert_array_equal(kept, make_rows(range(3)))


def test_two_readers_do_not_disturb_each_other(path: Path, writer: RingWriter) -> None:
    first, second = RingReader(path), RingReader(path)
    write(writer, range(4))
    assert len(first.read()) == 4
    write(writer, range(4, 6))
    assert len(first.read()) == 2
    np.testing.assert_array_equal(second.read(), make_rows(range(6)))
    write(writer, range(6, 40))
    assert len(second.read()) == CAPACITY
    assert (first.lost, second.lost) == (0, 34 - CAPACITY)
    first.read()
    assert first.lost == second.lost


def test_a_reader_that_comes_late_gets_the_newest_rows_and_knows_what_was_before(
    path: Path, writer: RingWriter
) -> None:
    write(writer, range(100))
    late = RingReader(path)
    got = late.read()
    np.testing.assert_array_equal(got, make_rows(range(100 - len(got), 100)))
    assert late.lost == 100 - len(got)


def test_a_reader_keeps_what_it_can_see_after_the_writer_has_closed(path: Path, writer: RingWriter) -> None:
    reader = RingReader(path)
    write(writer, range(5))
    writer.close()
    path.unlink()
    np.testing.assert_array_equal(reader.read(), make_rows(range(5)))


def test_a_reader_overtaken_while_it_copies_drops_the_rows_that_may_be_torn(
    path: Path, writer: RingWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader = RingReader(path)
    write(writer, range(6))
    count = reader._count_written

    def overtaken() -> int:
        """The writer goes on between the two looks at its count."""
        before = count()
        write(writer, range(before, before + 5))
        return before

    monkeypatch.setattr(reader, "_count_written", overtaken)
    got = reader.read()
    monkeypatch.undo()
    # 11 rows were written at the second look (16 after it): rows 0 and 1 are gone, row 2 may be half overwritten by row 11.
    np.testing.assert_array_equal(got, make_rows(range(3, 6)))
    assert reader.lost == 3
    np.testing.assert_array_equal(reader.read(), make_rows(range(8, 16)))
    assert reader.lost + 3 + 8 == 16


def read_elsewhere(path: Path, total: int, channel: Connection) -> None:
    """In another process: read until every row is read or lost; tell what was wrong."""
    reader = RingReader(path)
    channel.send("ready")
    got, last, wrong = 0, -1.0, ""
    while got + reader.lost < total and not wrong:
        table = reader.read()
        if not len(table):
            continue
        n = table[:, 0]
        if not (np.array_equal(table[:, 1], 2.0 * n) and np.array_equal(table[:, 2], n * n)):
            wrong = "the columns of a row do not belong together"
        elif n[0] <= last or np.any(np.diff(n) != 1.0):
            wrong = f"rows out of order: {n[0]:g} after {last:g}"
        got, last = got + len(n), n[-1]
    channel.send((got, reader.lost, last, wrong))


def test_a_reader_in_another_process_gets_whole_rows_and_misses_none_silently(path: Path) -> None:
    writer = RingWriter(path, COLUMNS, BIG)
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=read_elsewhere, args=(path, ROWS, there), daemon=True)
    process.start()
    try:
        assert here.poll(PATIENCE_S)
        assert here.recv() == "ready"
        write(writer, range(ROWS))
        assert here.poll(PATIENCE_S)
        got, lost, last, wrong = here.recv()
    finally:
        process.kill()
        process.join()
    assert not wrong
    assert got > 0
    assert got + lost == ROWS
    assert last == ROWS - 1


def test_the_count_of_rows_never_goes_back_for_a_reader_in_between(path: Path) -> None:
    """A count that is stored in pieces, or zeroed before it is stored, is caught here in about half of the runs."""
    writer = RingWriter(path, COLUMNS[:1], BIG)
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=watch_elsewhere, args=(path, ROWS, there), daemon=True)
    process.start()
    try:
        assert here.poll(PATIENCE_S)
        assert here.recv() == "ready"
        for n in range(ROWS):
            writer.write((n,))
        assert here.poll(PATIENCE_S)
        assert here.recv() == 0
    finally:
        process.kill()
        process.join()


def watch_elsewhere(path: Path, total: int, channel: Connection) -> None:
    """In another process: how often the count of rows written went back."""
    reader = RingReader(path)
    channel.send("ready")
    last = back = 0
    while last < total:
        now = reader._count_written()
        back += now < last
        last = now
    channel.send(back)


def read_good_bytes(folder: Path) -> bytes:
    path = folder / "good.ring"
    RingWriter(path, COLUMNS, CAPACITY).close()
    return path.read_bytes()


def with_header(data: bytes, header: object) -> bytes:
    text = json.dumps(header).encode()
    return data[:8] + struct.pack("<Q", len(text)) + text + data[16:]


SPOILT: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda data: b"",
    "short": lambda data: data[:10],
    "another magic": lambda data: b"elsewhat" + data[8:],
    "text": lambda data: b"time_s,valve_voltage_v\n0,1\n",
    "header is no JSON": lambda data: data[:16] + b"{" * 8 + data[24:],
}
UNGUARDED: dict[str, Callable[[bytes], bytes]] = {
    "header without columns": lambda data: with_header(data, {"capacity": 8}),
    "header is a list": lambda data: with_header(data, [1, 2]),
    "rows cut off": lambda data: data[:-8],
}


def expect_refusal(tmp_path: Path, spoil: Callable[[bytes], bytes]) -> None:
    path = tmp_path / "spoilt.ring"
    path.write_bytes(spoil(read_good_bytes(tmp_path)))
    with pytest.raises(InputError) as sentence:
        RingReader(path)
    assert str(path) in str(sentence.value)
    assert "\n" not in str(sentence.value)


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
def test_a_bad_file_is_refused_by_name(tmp_path: Path, spoil: Callable[[bytes], bytes]) -> None:
    expect_refusal(tmp_path, spoil)


@pytest.mark.parametrize("spoil", UNGUARDED.values(), ids=UNGUARDED)
def test_a_damaged_ring_is_refused_by_name(tmp_path: Path, spoil: Callable[[bytes], bytes]) -> None:
    expect_refusal(tmp_path, spoil)


def test_a_missing_ring_is_refused_by_name(path: Path) -> None:
    with pytest.raises(InputError, match=str(path)):
        RingReader(path)
