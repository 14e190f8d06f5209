"""Journal: rows that were appended are read back after any end of the writer, up to the first piece that is not whole."""

import errno
import os
import random
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.recovery import recover_folder
from protocols.errors import InputError
from protocols.files import journal as journal_module
from protocols.files.journal import Journal, JournalReader, find_run, list_journals, make_journal_path
from protocols.files.runs import RunWriter
from protocols.node import Column

COLUMNS = [Column("time_s", "s", "time"), Column("x_nm", "Nm", "a torque")]
PIECES = 20
ROWS = 50  # of a piece
METADATA = {"rig": "wet_clutch", "parameters": {"a": 1.5}}


def make_piece(k: int) -> np.ndarray:
    time = np.arange(ROWS * k, ROWS * (k + 1)) / 1000.0
    return np.column_stack([time, np.sin(time)])


def write(run: Path) -> Path:
    journal = Journal(run, COLUMNS, METADATA)
    for k in range(PIECES):
        journal.append(make_piece(k))
    journal.close()
    return journal.path


def read(path: Path) -> np.ndarray:
    with JournalReader(path) as journal:
        assert journal.metadata == METADATA
        assert journal.columns == COLUMNS
        return np.concatenate([np.empty((0, len(COLUMNS))), *journal])


def test_all_rows_come_back(tmp_path: Path) -> None:
    path = write(tmp_path / "run.parquet")
    assert list_journals(tmp_path) == [path] == [make_journal_path(tmp_path / "run.parquet")]
    assert find_run(path) == tmp_path / "run.parquet"
    np.testing.assert_array_equal(read(path), np.concatenate([make_piece(k) for k in range(PIECES)]))


def test_a_killed_writer_leaves_every_row_it_had_appended(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "run.parquet", COLUMNS, METADATA)
    child = os.fork()
    if not child:
        journal.append(make_piece(0))
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    with pytest.raises(InputError, match="is being written"):
        JournalReader(journal.path)
    journal._file.close()
    np.testing.assert_array_equal(read(journal.path), make_piece(0))


def test_a_journal_that_is_taken_for_a_dead_one_before_it_is_locked_is_created_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second bench starts in the same folder between the creation and the lock, and recovers what has no lock."""
    lock = journal_module.fcntl.flock

    def lock_late(file: object, how: int) -> None:
        monkeypatch.setattr(journal_module.fcntl, "flock", lock)
        (done,) = recover_folder(tmp_path, lambda text: None)
        assert done.file is None
        lock(file, how)

    with RunWriter(run := tmp_path / "run.parquet", COLUMNS) as writer:
        monkeypatch.setattr(journal_module.fcntl, "flock", lock_late)
        journal = Journal(run, COLUMNS, METADATA)
        journal.append(make_piece(0))
        journal.close()
        writer.append(make_piece(0))
        writer.finish(METADATA)
    np.testing.assert_array_equal(read(journal.path), make_piece(0))
    assert run.exists()


def test_a_cut_file_gives_its_whole_pieces(tmp_path: Path) -> None:
    path = write(tmp_path / "run.parquet")
    content = path.read_bytes()
    with JournalReader(path) as journal:
        start = content.index(b"x_nm") + 600  # behind the schema
        assert len(journal.columns) == 2
    for cut in range(start, len(content), 97):
        path.write_bytes(content[:cut])
        rows = read(path)
        assert len(rows) % ROWS == 0
        whole = ROWS * int((cut - start) / (len(content) - start) * PIECES)
        assert whole - 2 * ROWS <= len(rows) <= whole + 2 * ROWS
        np.testing.assert_array_equal(
            rows, np.concatenate([np.empty((0, 2)), *map(make_piece, range(PIECES))])[: len(rows)]
        )


def test_a_damaged_file_is_read_up_to_the_damage_or_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "run.parquet")
    content, chance = path.read_bytes(), random.Random(1)
    refused: list[str] = []
    for _ in range(300):
        damaged = bytearray(content)
        for _ in range(chance.choice([1, 1, 4, 20])):
            damaged[chance.randrange(len(damaged))] = chance.randrange(256)
        path.write_bytes(damaged)
        try:
            with JournalReader(path) as journal:
                rows = sum(len(rows) for rows in journal)
            assert rows <= PIECES * ROWS
        except InputError as error:
            refused.append(str(error))
    assert 0 < len(refused) < 300
    assert all(str(path) in sentence for sentence in refused)


def test_an_empty_file_has_no_rows(tmp_path: Path) -> None:
    path = make_journal_path(tmp_path / "run.parquet")
    path.touch()
    with JournalReader(path) as journal:
        assert list(journal) == []


@pytest.mark.parametrize("content", [b"x", b"PAR1" * 20, b"\xff" * 200, b"\0" * 200])
def test_another_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.parquet.journal"
    path.write_bytes(content)
    with pytest.raises(InputError, match="journal"):
        JournalReader(path)


def test_a_name_is_taken_once(tmp_path: Path) -> None:
    write(tmp_path / "run.parquet")
    with pytest.raises(InputError, match="another recorder writes it"):
        Journal(tmp_path / "run.parquet", COLUMNS, METADATA)
    with pytest.raises(InputError, match="not a journal of a run"):
        find_run(tmp_path / "run.parquet")


@contextmanager
def files_end_at(size: int) -> Iterator[None]:
    """No file grows beyond `size` [bytes], as where the disk is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("missing", [1, 8, 100])
def test_a_piece_of_which_the_disk_takes_a_part_is_refused(missing: int, tmp_path: Path) -> None:
    sound = Journal(tmp_path / "sound.parquet", COLUMNS, METADATA)
    sound.append(make_piece(0))
    size = sound.path.stat().st_size
    journal = Journal(tmp_path / "run.parquet", COLUMNS, METADATA)
    with files_end_at(size - missing), pytest.raises(InputError, match="cannot be written: File too large"):
        journal.append(make_piece(0))
    journal.append(make_piece(1))  # when there is place again
    journal.close()
    assert read(journal.path).tolist() == [*make_piece(0).tolist(), *make_piece(1).tolist()]


def test_a_journal_that_cannot_be_begun_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a network drive that locks nothing."""

    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", refuse)
    with pytest.raises(InputError, match="cannot be written: No locks available"):
        Journal(tmp_path / "run.parquet", COLUMNS, METADATA)
    assert list(tmp_path.iterdir()) == []
