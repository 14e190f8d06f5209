"""The one exception a person causes: wrong input, told in one sentence, exit code 2."""

import difflib
from collections.abc import Iterable


class InputError(Exception):
    """Input or a command is wrong. The message is one sentence: the thing, its value, what is allowed."""


def listing(names: object) -> str:
    """Names as a sorted, comma-separated list for an error message; `-` when there are none."""
    return ", ".join(sorted(map(str, names))) or "-"  # type: ignore[call-overload]


def closest(name: str, known: Iterable[str]) -> str:
    """Hint for an unknown name: what comes closest, or all that is known."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.4)
    return f"did you mean {' or '.join(close)}?" if close else f"known are {', '.join(names)}"
