"""A recording format of another package is read like those of the bench; one that is wrong is told in one sentence."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from clutch_hil.recordings.channel import Signal
from clutch_hil.recordings.format import GROUP, load_formats, open_recording
from protocols.errors import InputError
from tests.clutch_hil.commands.test_foreign_commands import install

GOOD = """
from clutch_hil.recordings.channel import Channel, Signal

class Dots:
    name, keys, order = "dots", {}, 0

    def recognises(self, head, path):
        return head.startswith(b"DOTS")

    def open(self, path, options):
        return Opened(path)

class Opened:
    numbers, notes, start = {}, [], ""

    def __init__(self, path):
        self.channels = [Channel("dots", 1, "dots", rows=2)]

    def read(self, channels):
        return [Signal(one, [1.0, 2.0]) for one in channels]
"""
WHAT = "recording format dots of the package lab_dots"
WRONG = {  # what is replaced in the module, by what, and what is told of it
    "fails": ("class Dots:", "1 / 0\nclass Dots:", "dots cannot be loaded from .* lab_dots: ZeroDivisionError"),
    "no class": ("class Opened", "Dots = 5\nclass Opened", f"{WHAT} cannot be made: it raises TypeError: 'int' object is not"),
    "not made": ("def recognises", "def __init__(self): 1 / 0\n    def recognises", f"{WHAT} cannot be made: it raises Zero"),
    "lacking": (", order", ", rank", f"{WHAT} lacks order; name, keys, order, recognises, open are needed"),
    "order": ('"dots", {}, 0', '"dots", {}, "0"', f"{WHAT} has the order '0'; allowed are 0, 1 and 2"),
    "recognises": ("return head", "return head.no", rf"{WHAT}: recognises\(\S+\) raises AttributeError: 'bytes' object"),
    "opens": ("return Opened(path)", "exit(3)", rf"{WHAT}: open\(\S+\) raises SystemExit: 3"),
    "opens nothing": ("return Opened(path)", "return 5", rf"{WHAT}: what open\(\S+\) returns lacks channels;"),
    "reads": ("return [Signal", "raise KeyError\n        [Signal", rf"{WHAT}: what open\(\S+\) returns: read raises KeyError"),
    "reads less": ("in channels]", "in channels[1:]]", "read does not return one Signal for each of the 1 channels"),
}  # fmt: skip


@pytest.fixture
def recorded(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A recording, and the package of its format, in which a part is replaced."""
    old, new = request.param
    assert old in GOOD
    site = tmp_path / "site"
    install(site, "lab_dots", {"dots": "lab_dots:Dots"}, GROUP)
    (site / "lab_dots.py").write_text(GOOD.replace(old, new), encoding="utf-8")
    path = tmp_path / "a.dots"
    path.write_bytes(b"DOTS")
    monkeypatch.syspath_prepend(str(site))
    load_formats.cache_clear()
    yield path
    load_formats.cache_clear()
    sys.modules.pop("lab_dots", None)


def read_all(path: Path) -> list[Signal]:
    recording = open_recording(path)
    return recording.read(recording.channels)


@pytest.mark.parametrize("recorded", [("dots", "dots")], indirect=True)
def test_it_is_read_like_those_of_the_bench(recorded: Path) -> None:
    (signal,) = read_all(recorded)
    assert (signal.channel.name, list(signal.values)) == ("dots", [1.0, 2.0])


@pytest.mark.parametrize(
    ("recorded", "sentence"),
    [((old, new), sentence) for old, new, sentence in WRONG.values()],
    ids=WRONG,
    indirect=["recorded"],
)
def test_one_that_is_wrong_is_told_in_one_sentence(recorded: Path, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        read_all(recorded)
