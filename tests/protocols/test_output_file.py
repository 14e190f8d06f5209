"""Output files: one rule for what may be replaced, and nothing half-written."""

import os
from pathlib import Path

import pytest

from protocols.errors import InputError
from protocols.files.output_file import check_new_file, check_new_files, whole_file


def test_a_new_name_is_free_and_stays_free(tmp_path: Path) -> None:
    assert check_new_file(tmp_path / "new.csv") == tmp_path / "new.csv"
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_replaced_only_where_it_was_said(tmp_path: Path) -> None:
    old = tmp_path / "old.csv"
    old.write_text("kept")
    with pytest.raises(InputError, match=r"old\.csv exists already; give another name, or --overwrite to replace it"):
        check_new_file(old)
    assert check_new_file(old, overwrite=True) == old
    assert old.read_text() == "kept"
    assert list(tmp_path.iterdir()) == [old]


@pytest.mark.parametrize("way", ["same", "symbolic link", "hard link", "relative", "what is written first"])
def test_an_input_is_never_replaced(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "a.csv"
    target = tmp_path / "b.csv"
    if way == "what is written first":
        source = tmp_path / "b.csv.part"
    source.write_text("measured")
    if way == "same":
        target = source
    elif way == "symbolic link":
        target.symlink_to(source)
    elif way == "hard link":
        os.link(source, target)
    elif way == "relative":
        monkeypatch.chdir(tmp_path)
        target = Path("a.csv")
    with pytest.raises(InputError, match="is read by this command and would be lost"):
        check_new_file(target, overwrite=True, inputs=[source])
    assert source.read_text() == "measured"


@pytest.mark.parametrize("kind", ["folder", "fifo"])
def test_what_is_no_file_is_never_replaced(kind: str, tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir() if kind == "folder" else os.mkfifo(there)
    with pytest.raises(InputError, match="cannot be written: it is"):
        check_new_file(there, overwrite=True)
    with pytest.raises(InputError, match="cannot be written: it is no file"):
        check_new_file(Path("/dev/null"), overwrite=True)


def test_all_files_of_a_folder_are_checked_before_any_is_written(tmp_path: Path) -> None:
    check_new_files(tmp_path / "missing", ["a", "b"])
    (tmp_path / "b").touch()
    with pytest.raises(InputError, match=r"b exists already"):
        check_new_files(tmp_path, ["a", "b"])
    check_new_files(tmp_path, ["a", "b"], overwrite=True)


def test_an_exception_leaves_the_old_file(tmp_path: Path) -> None:
    old = tmp_path / "old.csv"
    old.write_text("kept")

    def fail() -> None:
        with whole_file(old) as part:
            part.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert old.read_text() == "kept"
    assert list(tmp_path.iterdir()) == [old]
