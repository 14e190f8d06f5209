"""Dates that a file states in words, such as that of its start."""

from contextlib import suppress
from datetime import datetime

_DATES = ("%d-%b-%Y %H:%M:%S", "%d-%b-%Y %H:%M:%S.%f", "%Y/%m/%d %H:%M:%S")  # beside ISO 8601; others are ambiguous


def read_date(text: str) -> str:
    """A date and time of day as ISO 8601; "" for what is none, or could be read in two ways."""
    with suppress(ValueError):
        return datetime.fromisoformat(text.strip()).isoformat() if len(text.strip()) > 10 else ""
    for pattern in _DATES:
        with suppress(ValueError):
            return datetime.strptime(text.strip(), pattern).isoformat()
    return ""
