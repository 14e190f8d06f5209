"""IsolatedRecording: a recording that is opened and read in its own process (protocols/files/child_reader.py)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from importlib import import_module
from pathlib import Path
from typing import Any

from clutch_hil.recordings.channel import Channel, Recording, Signal
from protocols.files.child_reader import MOST_SECONDS, ChildReader


class IsolatedRecording:
    """A `Recording` in another process.

    opener: function of the path that opens the file there, as `module:function`. most_seconds: limit of computing time [s] for
    opening and reading together.
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
    """Open a recording in the other process. Return a function that gives its contents for None, else the signals of
    channels."""
    module, function = opener.split(":")
    recording: Recording = getattr(import_module(module), function)(Path(path))

    def answer(channels: list[list[Any]] | None) -> Any:
        if channels is None:
            described = [astuple(channel) for channel in recording.channels]
            return described, dict(recording.numbers), recording.notes, recording.start
        signals = recording.read([Channel(*fields) for fields in channels])
        return [(astuple(s.channel), s.values, s.time, s.whole) for s in signals], recording.notes

    return answer
