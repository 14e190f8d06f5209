"""Usage errors: what is wrong with the words of a command line, in one sentence."""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from protocols.errors import suggest_closest

# Plain words for errors of pydantic, by type
_PLAIN = {
    "float_parsing": "not a number",
    "int_parsing": "not a whole number",
    "bool_parsing": "neither true nor false",
    "greater_than_equal": "allowed is {ge} or more",
    "greater_than": "allowed is more than {gt}",
    "less_than_equal": "allowed is {le} or less",
    "less_than": "allowed is less than {lt}",
}
_EXTRA_WORD = re.compile(r"Got unexpected extra argument\(?s?\)? \((.*?)\)")


def describe_usage_error(error: Any, command: str) -> str:
    """Return one sentence that names the wrong option or argument, and its value where typer provides it.

    command: that was typed, where the error does not name it.
    """
    what = " ".join(error.format_message().split()).rstrip(".?").replace(". Did you mean", "; did you mean")
    causes = error.__cause__.errors() if hasattr(error.__cause__, "errors") else []
    if causes:
        given, kind = causes[0]["input"], causes[0]["type"]
        plain = _PLAIN[kind].format(**causes[0].get("ctx", {})) if kind in _PLAIN else causes[0]["msg"]
        what = what.replace("Invalid value for", f"Invalid value {given!r} for", 1).replace(causes[0]["msg"], plain)
        if str(given).startswith("--") and error.ctx:  # typer takes an unknown option for the value of an argument
            what = f"No such option: {given}; {_suggest_option(str(given), error.ctx.command)}"
    what = _EXTRA_WORD.sub(r"Unexpected word: \1", what)
    command = error.ctx.command_path if error.ctx else command
    return f"{command}: {what[0].lower()}{what[1:]}; {command} --help shows what is allowed"


def _suggest_option(given: str, command: Any) -> str:
    """Return what may be meant by the unknown option `given`: an argument of this name, or the closest options."""
    names = {name for param in command.params for name in param.opts}
    if (argument := given.removeprefix("--")) in names:
        return f"{argument} is a value without a name before it"
    return suggest_closest(given, [name for name in names if name.startswith("--")]).rstrip("?")


def find_empty_word(words: Sequence[str]) -> str | None:
    """Return the first empty option or word after the name of the command; None if there is none."""
    for before, word in pairwise(words):
        if not word.strip():
            return before if before.startswith("-") else f"a word after {before!r}"
        if word.startswith("--") and word.endswith("="):
            return word.removesuffix("=")
    return None
