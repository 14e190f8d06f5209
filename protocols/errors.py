"""Errors that a person causes, each with a message of one sentence: wrong input, exit code 2, and an interruption, 130."""

import difflib
from collections.abc import Iterable


class InputError(Exception):
    """Input or a command is wrong. The message is one sentence: the thing, its value, what is allowed."""


class InterruptionError(Exception):
    """A person ended a command before there was a result. The message says which files are kept; exit code 130."""


def join_names(names: object) -> str:
    """Names as a sorted, comma-separated list for an error message; `-` when there are none."""
    return ", ".join(sorted(map(str, names))) or "-"  # type: ignore[call-overload]


def suggest_closest(name: str, known: Iterable[str]) -> str:
    """Hint for an unknown name: the most similar of the `known` ones, or all of them."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.4)
    return f"did you mean {' or '.join(close)}?" if close else f"known are {', '.join(names)}"
