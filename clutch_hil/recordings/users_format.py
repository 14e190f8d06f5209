"""User's format: wrapper that checks a recording format of another package, and the recordings it opens.

A user's code may raise any exception and return any object. An InputError then names the format and the error.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from clutch_hil.recordings.channel import Channel, Recording, Signal
from protocols.errors import InputError
from protocols.user_code import describe_error

_FORMAT = ("name", "keys", "order", "recognises", "open")  # members of `RecordingFormat`
_RECORDING = ("channels", "numbers", "notes", "start", "read")  # members of `Recording`


class UsersFormat:
    """The format that the function `make` returns. what: its name in errors. Raises InputError where it is no format."""

    def __init__(self, make: Any, what: str) -> None:
        self._what = what
        with _tell(f"{what} cannot be made: it"):
            self._own = make()
        _check_members(self._own, _FORMAT, self._what)
        self.name: str = self._own.name
        self.keys: Mapping[str, type] = self._own.keys
        self.order: int = self._own.order
        if not isinstance(self.order, int):
            raise InputError(f"{self._what} has the order {self.order!r}; allowed are 0, 1 and 2")

    def recognises(self, head: bytes, path: Path) -> bool:
        """See `RecordingFormat`."""
        with _tell(f"{self._what}: recognises({path})"):
            return bool(self._own.recognises(head, path))

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        """See `RecordingFormat`."""
        with _tell(f"{self._what}: open({path})"):
            opened = self._own.open(path, options)
        what = f"{self._what}: what open({path}) returns"
        _check_members(opened, _RECORDING, what)
        return _UsersRecording(opened, what)


class _UsersRecording:
    """A recording that a user's format has opened; see `Recording`."""

    def __init__(self, own: Any, what: str) -> None:
        self._own, self._what = own, what
        self.channels: Sequence[Channel] = own.channels
        self.numbers: Mapping[str, float] = own.numbers
        self.notes: list[str] = own.notes
        self.start: str = own.start

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """See `Recording`."""
        with _tell(f"{self._what}: read"):
            signals = list(self._own.read(channels))
        if len(signals) != len(channels) or not all(isinstance(signal, Signal) for signal in signals):
            raise InputError(f"{self._what}: read does not return one Signal for each of the {len(channels)} channels")
        return signals


def _check_members(thing: Any, needed: Sequence[str], what: str) -> None:
    if lacking := [name for name in needed if not hasattr(thing, name)]:
        raise InputError(f"{what} lacks {lacking[0]}; {', '.join(needed)} are needed")


@contextmanager
def _tell(what: str) -> Iterator[None]:
    """Convert any exception of a user's code to InputError."""
    try:
        yield
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        raise InputError(f"{what} raises {describe_error(error)}") from None
