"""Call log: stand-ins for parts of a program that record their calls, for tests of the code that uses these parts."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

NEVER = 10_000  # steps after which a test fails, because a loop does not end


class Opened(SimpleNamespace):
    """Object for a `with` statement."""

    def __enter__(self) -> "Opened":
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing."""


class CallLog:
    """Record of calls: `log` has one tuple per call, in their order: name, arguments, and a dict of keyword arguments if any.

    stops: number of reads of `asked` that return False; all later ones return True.
    """

    def __init__(self, stops: int = NEVER) -> None:
        self.log, self.stops, self.looks = list[tuple[Any, ...]](), stops, 0

    @property
    def asked(self) -> bool:
        """Whether a stop was requested, as of a program's `Stop`. Each read counts."""
        self.looks += 1
        assert self.looks < NEVER
        return self.looks > self.stops

    def note(self, name: str, *results: Any) -> Callable[..., Any]:
        """Return a function that records its calls under `name`. It returns `results` in turn, then always the last one."""
        left = list(results)

        def call(*arguments: Any, **named: Any) -> Any:
            self.log.append((name, *arguments, *([named] if named else [])))
            assert len(self.log) < NEVER
            return (left.pop(0) if len(left) > 1 else left[0]) if left else None

        return call

    def list_calls(self, *names: str) -> list[tuple[Any, ...]]:
        return [call for call in self.log if call[0] in names]
