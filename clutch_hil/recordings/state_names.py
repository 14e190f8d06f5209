"""Names of states: those that are values, such as `3` for a gear and `on` for a brake, or say that there is no value."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from clutch_hil.recordings.channel import Channel, Signal
from protocols.errors import InputError

_MOST_TOLD = 5  # largest number of names in a note
_LONGEST = 6  # largest number of digits in a name
_FLAG_NUMBERS = ("0", "1")
_WORDS = re.compile(r"(?<=[a-zäöü])(?=[A-ZÄÖÜ])|(?<=[^\W\d_])(?=\d)|[\W_]+")  # where a name is split into words
_NO_VALUE = re.compile(
    r"\b(sna|snv|na|n a|not ?avail\w*|nicht verf\w*|unavail\w*|no (value|signal|data)|missing|unknown|timeout"
    r"|invalid\w*|not valid|ung(ü|ue)ltig\w*|implausible|err|errors?|fehler\w*|faults?|faulty|fail|failed|failure|defect\w*"
    r"|init|(un)?initiali[sz]\w*|undef\w*|not defined|reserved?|rsvd|not used|unused)\b"
)
_SOUND = re.compile(
    r"\b(no|not|without|kein|keine|ohne) (err|errors?|fehler|faults?|faulty|fail|failed|failure|defect)\b|\bfree\b"
)


def value_states(names: Sequence[str | None]) -> np.ndarray | None:
    """Return the values (n,) of names that are all numbers, or all on and off, in any language of `Cells`; else None.

    Names for a missing value, such as an empty one, are NaN.
    """
    if not any(names):
        return None
    # Loading Arrow takes 50 ms of CPU in each process that reads a file; few channels have names
    from clutch_hil.recordings.text.cells import Cells
    from protocols.files.arrow import from_texts

    cells = Cells()
    given = [name for name in names if name is not None and not cells.is_missing(name)]
    numbers = all(cells.is_number(name) for name in given)
    if not given or not (numbers or all(cells.is_flag(name) or name in _FLAG_NUMBERS for name in given)):
        return None
    return cells.parse_flags(from_texts([name or "" for name in names])).values


def name_states(channel: Channel) -> Channel:
    """Return a channel whose words a reader has replaced by the numbers that an import map gives them."""
    return replace(channel, kind="status", unit="", states=())


def number_by_states(path: Path, channel: Channel, values: np.ndarray, names: Mapping[float, str]) -> Signal:
    """Return the signal of a status by the numbers that an import map gives the `names` of its `values` (n,).

    A name that says that there is no value needs no number. Raises InputError for another one without a number.
    """
    given = {word.strip().lower(): number for word, number in channel.states}
    taken = np.full(len(values), np.nan)
    for value in np.unique(values[np.isfinite(values)]):
        name = names.get(value, "").strip()
        if name.lower() in given:
            taken[values == value] = given[name.lower()]
        elif not says_no_value(name):
            what = f"{name!r} for {value:g}" if name else f"{value:g}, which has no name"
            raise InputError(f"recording {path}: {channel.path!r} holds {what}; give its number in `states` of the map")
    return Signal(name_states(channel), taken)


def take_names(values: np.ndarray, names: Mapping[float, str]) -> tuple[np.ndarray, str] | None:
    """Return values (n,) according to the names of the numbers, and a text on them, if they differ from the numbers; else None.

    Numbers without a name become NaN. names: by number, without those for missing values.
    """
    parsed = value_states(list(names.values()))
    if parsed is None:
        return None
    numbers = np.array(list(names), float)
    if not np.any((numbers != parsed) & np.isfinite(parsed)):
        return None
    order = np.argsort(numbers)
    at = np.minimum(np.searchsorted(numbers[order], values), len(numbers) - 1)
    taken = np.where(numbers[order][at] == values, parsed[order][at], np.nan)
    examples = [f"{number:g} is {name}" for number, name in list(names.items())[:_MOST_TOLD]]
    return taken, ", ".join(examples) + (", ..." if len(names) > _MOST_TOLD else "")


def note_other_numbers(path: str, names: Mapping[float, str]) -> str:
    """Return a note if names such as `Gear 2` contain other numbers than those they name, else "".

    The meaning of the numbers in the names is not known, so the numbers of the file are kept.
    """
    inside = {number: re.findall(r"\d+", name) for number, name in names.items()}
    numbers = {
        number: float(words[0]) for number, words in inside.items() if len(words) == 1 and len(words[0]) <= _LONGEST
    }
    other = [number for number in numbers if numbers[number] != number]
    if len({re.sub(r"\d+", "", names[number]) for number in numbers}) != 1 or len(numbers) < 2 or not other:
        return ""
    examples = ", ".join(f"{number:g} is {names[number]!r}" for number in other[:_MOST_TOLD])
    return f"{path}: the numbers of the file are used, although its names contain others: {examples}"


def note_names(path: str, text: str) -> str:
    """Return a note that the values in the names are used."""
    return f"{path}: its names differ from its numbers, and the names are used: {text}"


def says_no_value(name: str) -> bool:
    """Return whether the name of a raw value says that it stands for no value, such as SNA or Error."""
    words = " ".join(_WORDS.split(name)).strip().lower()
    return bool(_NO_VALUE.search(words)) and not _SOUND.search(words)
