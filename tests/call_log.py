"""Call log: made-up parts of a program that note what is asked of them, for tests of what uses the parts."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

NEVER = 10_000  # steps after which a test has gone wrong: a loop does not end


class Opened(SimpleNamespace):
    """What a `with` statement opens."""

    def __enter__(self) -> "Opened":
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing to close."""


class CallLog:
    """Calls in `log`, in their order: name, arguments, and a dict of the named ones if there are any.

    `stops`: after so many looks at `asked` a stop is asked for.
    """

    def __init__(self, stops: int = NEVER) -> None:
        self.log, self.stops, self.looks = list[tuple[Any, ...]](), stops, 0

    @property
    def asked(self) -> bool:
        """Of the stop of a program."""
        self.looks += 1
        assert self.looks < NEVER
        return self.looks > self.stops

    def note(self, name: str, *results: Any) -> Callable[..., Any]:
        """A function that notes its calls; it returns the results in turn, and the last one from then on."""
        left = list(results)

        def call(*arguments: Any, **named: Any) -> Any:
            self.log.append((name, *arguments, *([named] if named else [])))
            assert len(self.log) < NEVER
            return (left.pop(0) if len(left) > 1 else left[0]) if left else None

        return call

    def list_calls(self, *names: str) -> list[tuple[Any, ...]]:
        return [call for call in self.log if call[0] in names]
