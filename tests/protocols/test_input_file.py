"""Input files: what is no file, too large or no text is one sentence; nothing waits for a pipe."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from protocols.errors import InputError
from protocols.input_file import read_head, read_json, read_raw, read_text, read_toml

ROOT = Path(__file__).parents[2]
READERS: list[Callable[[Path, str], Any]] = [read_head, read_json, read_raw, read_text, read_toml]


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_folder(path: Path) -> None:
    path.mkdir()


def link_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def make_unreadable_name(path: Path) -> None:
    pass


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize(
    ("make", "words"),
    [(make_pipe, "it is a pipe or a device"), (link_device, "it is a pipe or a device"), (make_folder, "it is a folder"),
     (make_unreadable_name, "does not exist")],
)  # fmt: skip
def test_what_is_no_file_is_refused(
    tmp_path: Path, read: Callable[[Path, str], Any], make: Callable[[Path], None], words: str
) -> None:
    make(tmp_path / "x")
    with pytest.raises(InputError, match=f"thing .*x.*{words}"):
        read(tmp_path / "x", "thing")


def test_a_name_with_a_null_character_is_refused() -> None:
    with pytest.raises(InputError, match="null"):
        read_text(Path("a\0b"), "thing")


def test_a_name_that_is_no_text_is_refused(tmp_path: Path) -> None:
    odd = tmp_path / os.fsdecode(b"b\xffad")
    odd.write_text("text")
    with pytest.raises(InputError, match="has a name that is not UTF-8 text; rename it"):
        read_text(odd, "thing")


def test_a_name_that_the_locale_cannot_read_is_told_with_the_locale(tmp_path: Path) -> None:
    (tmp_path / "Prüfstand.toml").write_text("a = 1")
    code = "import sys, pathlib, protocols.input_file as f; f.read_toml(pathlib.Path(sys.argv[1]), 'thing')"
    words = [sys.executable, "-X", "utf8=0", "-c", code, str(tmp_path / "Prüfstand.toml")]
    done = subprocess.run(words, capture_output=True, text=True, env={**os.environ, "LC_ALL": "C"}, check=False)
    assert "letters in its name that the locale of this shell does not know; set LC_ALL=C.UTF-8" in done.stderr


@pytest.mark.parametrize("read", [read_json, read_raw, read_text, read_toml])
def test_a_large_file_is_not_read(tmp_path: Path, read: Callable[[Path, str], Any]) -> None:
    with (tmp_path / "x").open("wb") as file:
        file.truncate(1 << 40)  # sparse: it takes no disk
    with pytest.raises(InputError, match="has 1099512 MB; allowed are 4"):
        read(tmp_path / "x", "thing")


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"a = \xe9"])
@pytest.mark.parametrize("read", [read_json, read_text, read_toml])
def test_what_is_no_utf8_is_refused(tmp_path: Path, read: Callable[[Path, str], Any], content: bytes) -> None:
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(InputError, match="not UTF-8 text"):
        read(tmp_path / "x", "thing")


@pytest.mark.parametrize(
    ("read", "content"),
    [
        (read_json, "[" * 100_000), (read_json, "1" * 5000), (read_json, "{"), (read_json, ""), (read_json, '{"a": 1}{'),
        (read_toml, "a = " + "[" * 50_000), (read_toml, "a = " + "1" * 5000), (read_toml, "a = 0x" + "f" * 9), (read_toml, "="),
    ],
)  # fmt: skip
def test_what_no_parser_takes_is_one_sentence(tmp_path: Path, read: Callable[[Path, str], Any], content: str) -> None:
    (tmp_path / "x").write_text(content)
    if content == "a = 0xfffffffff":
        assert read(tmp_path / "x", "thing") == {"a": 0xFFFFFFFFF}
        return
    with pytest.raises(InputError, match=r"thing .*x cannot be read: ") as sentence:
        read(tmp_path / "x", "thing")
    assert len(str(sentence.value)) < 500


def test_a_mark_at_the_beginning_is_no_part_of_the_text(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"\xef\xbb\xbfa = 1")
    assert read_toml(tmp_path / "x", "thing") == {"a": 1}


def test_nobody_else_parses_toml() -> None:
    packages = ("clutch_hil", "plant_sim", "protocols", "rt_controller")
    files = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    users = [path.relative_to(ROOT) for path in files if "tomllib" in path.read_text(encoding="utf-8")]
    assert users == [Path("protocols/input_file.py")]
