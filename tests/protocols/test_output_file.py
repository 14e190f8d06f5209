"""Output files: one rule for what may be replaced, and nothing half-written."""

import errno
import os
from pathlib import Path

import pytest

from protocols.errors import InputError
from protocols.files.output_file import check_new_file, check_new_files, make_folder, whole_file, whole_files


def test_a_folder_whose_name_is_taken_is_told_what_has_it(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nowhere")
    for name, kind in (("file", "a file"), ("link", "a link to nowhere, which does not exist,")):
        with pytest.raises(InputError, match=f"{name} cannot be made: {kind} has this name"):
            make_folder(tmp_path / name)


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


@pytest.mark.parametrize("name", [".", "/"])
def test_a_folder_without_a_name_is_no_file(name: str) -> None:
    for write in (lambda path: check_new_file(path, overwrite=True), lambda path: whole_file(path).__enter__()):
        with pytest.raises(InputError, match=f"^file {name} cannot be written: "):
            write(Path(name))


def test_a_name_that_is_no_text_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    odd = tmp_path / os.fsdecode(b"b\xffad.csv")
    for write in (check_new_file, lambda path: whole_file(path).__enter__()):
        with pytest.raises(InputError, match="has a name that is not UTF-8 text; rename it"):
            write(odd)
    assert list(tmp_path.iterdir()) == []


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


def test_a_file_is_written_by_one_command_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "new.csv"
    with whole_file(path) as part:
        part.write_text("first")
        with pytest.raises(InputError, match=r"new\.csv is being written by another command"), whole_file(path):
            raise AssertionError
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_command_has_left_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "new.csv.part").write_text("half of an older and longer file")
    with whole_file(tmp_path / "new.csv") as part, part.open("r+") as file:
        file.write("new")
    assert (tmp_path / "new.csv").read_text() == "new"
    assert list(tmp_path.iterdir()) == [tmp_path / "new.csv"]


@pytest.mark.parametrize("folder", ["there", "missing"])
def test_a_file_that_another_command_wrote_meanwhile_stays(folder: str, tmp_path: Path) -> None:
    path = tmp_path / folder / "new.csv"
    (tmp_path / "there").mkdir()
    check_new_files(path.parent, [path.name])
    path.parent.mkdir(exist_ok=True)
    path.write_text("of another")
    with (
        pytest.raises(InputError, match=r"new\.csv was written by another command meanwhile"),
        whole_file(path) as part,
    ):
        part.write_text("mine")
    assert path.read_text() == "of another"
    assert list(path.parent.iterdir()) == [path]
    check_new_files(path.parent, [path.name], overwrite=True)
    with whole_file(path) as part:
        part.write_text("mine")
    assert path.read_text() == "mine"


def test_a_command_may_write_its_file_twice(tmp_path: Path) -> None:
    path = check_new_file(tmp_path / "new.csv")
    for text in ("first", "second"):
        with whole_file(path) as part:
            part.write_text(text)
    assert path.read_text() == "second"


def test_a_folder_that_a_killed_command_has_left_is_removed(tmp_path: Path) -> None:
    """But none of a command that lives, none that is new, and none of anybody else."""
    with whole_files(tmp_path) as lives:
        names = [".abcd1234.part", ".new_1234.part", ".notes.part"]
        for name in names:
            (tmp_path / name).mkdir()
            (tmp_path / name / "report.html").touch()
        for old in (lives, tmp_path / names[0], tmp_path / names[2]):
            os.utime(old, (0.0, 0.0))
        with whole_files(tmp_path) as other:
            (other / "one").touch()
        assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*names[1:], lives.name, "one"])
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*names[1:], "one"])


def test_files_appear_together(tmp_path: Path) -> None:
    with whole_files(tmp_path / "out") as folder:
        for name in ("a", "b"):
            (folder / name).write_text(name)
        assert not [path for path in (tmp_path / "out").iterdir() if path != folder]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a", "b"]


@pytest.mark.parametrize("why", ["interrupted", "one cannot be written", "one is there meanwhile"])
def test_none_of_several_files_is_left_of_an_exception(why: str, tmp_path: Path) -> None:
    check_new_files(tmp_path, ["a", "b"])

    def write_all() -> None:
        with whole_files(tmp_path) as folder:
            (folder / "a").write_text("a")
            if why == "interrupted":
                raise KeyboardInterrupt
            if why == "one cannot be written":
                (folder / "b.part").mkdir()
            if why == "one is there meanwhile":
                (tmp_path / "b").write_text("of another")
            with whole_file(folder / "b") as part:
                part.write_text("b")

    with pytest.raises((InputError, KeyboardInterrupt)) as error:
        write_all()
    assert why == "interrupted" or f"file {tmp_path / 'b'} " in str(error.value)
    assert [path.read_text() for path in tmp_path.iterdir()] == (["of another"] if "meanwhile" in why else [])


@pytest.mark.parametrize("write", [whole_files, lambda folder: whole_file(folder / "a")])
def test_no_new_folder_is_left_of_an_exception_unless_it_has_something(write, tmp_path: Path) -> None:
    """As on a full disk, which refuses the file but not the folder."""
    folder = tmp_path / "above" / "new"

    def fail(kept: Path | None) -> None:
        with write(folder):
            if kept:
                kept.write_text("of another")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(InputError, match="No space left on device"):
        fail(None)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="No space left on device"):
        fail(folder / "kept")
    assert [path.name for path in folder.iterdir()] == ["kept"]
