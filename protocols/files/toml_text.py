"""TOML text: strings and comments of files that the bench writes, whatever the names in them contain."""

import json
import re

_CONTROL = re.compile(r"[\x00-\x1f\x7f]")  # allowed neither in a comment nor, unescaped, in a string


def quote_text(text: str) -> str:
    """Return `text` as a TOML string on one line."""
    return json.dumps(_replace_undecodable(text), ensure_ascii=False).replace("\x7f", "\\u007f")


def make_comment(text: str) -> str:
    """Return `text` as a comment line, with spaces for control characters."""
    return f"# {_CONTROL.sub(' ', _replace_undecodable(text))}"


def _replace_undecodable(text: str) -> str:
    """Return `text` with U+FFFD for bytes of a file name that are no UTF-8; Python has them as lone surrogates."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
