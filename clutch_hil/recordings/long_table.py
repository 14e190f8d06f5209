"""Long table: one value per row, of the signal that a text column names, as databases export it.

Read as an ordinary table, the values of all signals would be mixed in one column. So it is refused.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from clutch_hil.recordings.channel import Channel, name_first
from clutch_hil.recordings.state_names import value_states
from protocols.errors import InputError

_NAMES = re.compile(
    r"[_ ]?(signal|channel|var|variable|series|tag|sensor|parameter|metric|topic|quantity|field|measurement|name|key|item|id"
    r"|kanal|messstelle|messgr(ö|oe)(ß|ss)e|grandeur|voie)([_ ]?(name|id))?",
    re.IGNORECASE,
)
_FEWEST_ROWS = 10  # least rows for a decision
_MOST_WORDS = 1000  # largest number of signal names; more are remarks, or times
_CHANGES = 1.0 / 3.0  # share of the rows: a status changes less often
_MOST_NUMBERS = 2  # numeric columns, if the text column has another name: a time and a value
_NUMBER = re.compile(r"(0x)?[0-9a-f.,]+h?", re.IGNORECASE)  # a number, decimal or as hexadecimal of a bus


def names_signals(words: Sequence[str]) -> bool:
    """Return whether the words of a column, in the order of the rows, are signal names: they change often and recur.

    Numbers, and words for on and off, do not count.
    """
    distinct = set(words)
    if len(words) < _FEWEST_ROWS or not 1 < len(distinct) <= min(_MOST_WORDS, len(words) // 2):
        return False
    if value_states(sorted(distinct)) is not None or any(
        not word.strip() or _NUMBER.fullmatch(word) for word in distinct
    ):
        return False
    return sum(one != other for one, other in pairwise(words)) >= _CHANGES * len(words)


def can_name_signals(channel: Channel, channels: Sequence[Channel]) -> bool:
    """Return whether a text column may name the signal of each row, from its name and the other columns."""
    numbers = sum(other.kind in ("number", "time") for other in channels)
    return bool(_NAMES.fullmatch(channel.name)) or numbers <= _MOST_NUMBERS


def make_refusal(path: Path, channel: Channel, words: Sequence[str]) -> InputError:
    return InputError(
        f"recording {path} has one value a row, of the signal that column {channel.path!r} names"
        f" ({name_first(list(dict.fromkeys(words)))}); write a column for each signal, as the pivot of pandas or Excel does"
    )
