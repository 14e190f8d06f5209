"""IsolatedRecording: a recording that is opened and read in a process of its own (protocols/files/child_reader.py)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from importlib import import_module
from pathlib import Path
from typing import Any

from clutch_hil.recordings.channel import Channel, Recording, Signal
from protocols.files.child_reader import MOST_SECONDS, ChildReader


class IsolatedRecording:
    """See Recording. opener: what opens the file in the other process, a function of its path, as `module:function`.

    most_seconds: of computing, for opening and reading together.
    """

    def __init__(self, path: Path, opener: str, most_seconds: int = MOST_SECONDS) -> None:
        self.child = ChildReader(f"recording {path}", f"{__name__}:serve", str(path), opener, most_seconds=most_seconds)
        channels, numbers, self.notes, self.start = self.child.ask()
        self.channels: Sequence[Channel] = [Channel(*fields) for fields in channels]
        self.numbers: Mapping[str, float] = numbers

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """See Recording.read."""
        signals, notes = self.child.ask([astuple(channel) for channel in channels])
        self.notes += [note for note in notes if note not in self.notes]
        return [Signal(Channel(*fields), *arrays) for fields, *arrays in signals]


def serve(path: str, opener: str) -> Callable[[list[list[Any]] | None], Any]:
    """In the other process: open a recording; return what tells its contents, asked for nothing, or the signals of channels."""
    module, function = opener.split(":")
    recording: Recording = getattr(import_module(module), function)(Path(path))

    def answer(channels: list[list[Any]] | None) -> Any:
        if channels is None:
            described = [astuple(channel) for channel in recording.channels]
            return described, dict(recording.numbers), recording.notes, recording.start
        signals = recording.read([Channel(*fields) for fields in channels])
        return [(astuple(s.channel), s.values, s.time, s.whole) for s in signals], recording.notes

    return answer
