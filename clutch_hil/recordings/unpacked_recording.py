"""UnpackedRecording: a recording that is read from a temporary file beside the one that the user named."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from clutch_hil.recordings.channel import Channel, Recording, Signal
from protocols.errors import InputError


class UnpackedRecording:
    """A Recording in the file `target`, which is `shown` as another one in errors, with further changes by `reword`."""

    def __init__(self, own: Recording, target: Path, shown: str, reword: Callable[[str], str] = str) -> None:
        self._own, self._target, self._shown, self._reword = own, target, shown, reword
        self.channels: Sequence[Channel] = own.channels
        self.numbers: Mapping[str, float] = own.numbers
        self.notes: list[str] = own.notes
        self.start: str = own.start
        self.units_rows: int = getattr(own, "units_rows", 0)

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """See `Recording`."""
        with shown_as(self._target, self._shown, self._reword):
            return self._own.read(channels)


@contextmanager
def shown_as(target: Path, shown: str, reword: Callable[[str], str] = str) -> Iterator[None]:
    """Name another file in place of `target` in errors."""
    try:
        yield
    except InputError as error:
        raise InputError(reword(str(error)).replace(str(target), shown)) from None
