"""Errors that a person causes, each with a message of one sentence: wrong input, exit code 2, and an interruption, 130."""

import difflib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import SupportsInt

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")  # they would break a line or move the terminal's cursor
_LONG_WORD = re.compile(r"\S{601,}")  # longer than a path is in practice: a value from a damaged file
_SHOWN = 60  # characters of such a word
_LONGEST, _END = 990, 250  # characters of a message, and of its end, which names the allowed values
_MOST_HINTS, _LIKENESS = 3, 0.5  # of names: half of the letters are the same, in the same order
_MOST_NAMES = 30  # names listed in a hint; the first ones if there are more


class InputError(Exception):
    """Input or a command is wrong. The message is one sentence: the thing, its value, what is allowed.

    The message is printed unchanged: control characters, which a value may contain, are escaped, and long texts are shortened.
    """

    def __init__(self, message: str = "") -> None:
        text = _LONG_WORD.sub(_shorten_word, _CONTROL.sub(lambda found: repr(found.group())[1:-1], str(message)))
        if len(text) > _LONGEST:
            text = f"{text[: _LONGEST - _END - 5]} ... {text[-_END:]}"
        super().__init__(text)


class InterruptionError(Exception):
    """A person ended a command before there was a result. The message names the files that are kept; exit code 130."""


def tell_reason(error: Exception) -> str:
    """Return another library's error message on one line. For a missing entry (KeyError) the message is only its name."""
    reason = " ".join(str(error).split()) or type(error).__name__
    return f"it has no entry {reason}" if isinstance(error, KeyError) else reason


@contextmanager
def name_file_in_errors(kind: str, path: Path | None) -> Iterator[None]:
    """Put `kind` and path of a file before an InputError raised within, unless it names the file; None for no file."""
    try:
        yield
    except InputError as error:
        if path is None or str(path) in str(error):
            raise
        raise InputError(f"{kind} {path}: {error}") from None


def join_names(names: object) -> str:
    """Return the names as a sorted, comma-separated list for an error message; `-` if there are none."""
    return ", ".join(sorted(map(str, names))) or "-"  # type: ignore[call-overload]


def _shorten_word(match: re.Match[str]) -> str:
    return f"{match.group()[:_SHOWN]}... ({len(match.group())} characters)"


def suggest_closest(name: str, known: Iterable[str]) -> str:
    """Return a hint for an unknown name: the most similar `known` names, those that begin with it, or the first ones."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=_MOST_HINTS, cutoff=_LIKENESS)
    close = close or [one for one in names if name and one.startswith(name)][:_MOST_HINTS]
    if close:
        return f"did you mean {' or '.join(close)}?"
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"known are {', '.join(names[:_MOST_NAMES])}{more}"


def name_run(name: str) -> str:
    """Return the name of a run in messages: `run mine.parquet`; unchanged for a run in memory that is already named `run 2`."""
    return f"run {name.removeprefix('run ')}"


def format_count(count: SupportsInt, noun: str) -> str:
    """Return a count with its noun: `1 value`, `2 values`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
