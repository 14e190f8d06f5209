"""Unknown unit: a channel's unit in the file that cannot be read, compared with the unit in the map.

An unknown spelling such as `Nmtr` does not contradict the map. `10 rpm`, `4-20 mA`, `%FS`, `counts`, `bar vac` and `kNm (rms)`
do: the numbers are not in the map's unit, and a factor would be lost without a message.
"""

import re

from clutch_hil.recordings.channel import says_absolute, simplify_unit
from clutch_hil.recordings.unit_in_name import is_unit
from protocols.errors import InputError
from protocols.files.units import contradict, have_same_quantity

# Words for raw numbers of a converter, an encoder or a timer, for numbers of rows, and for factors
_RAW = (
    "adc", "adu", "bits", "cnt", "cnts", "code", "codes", "count", "counts", "digit", "digits", "dn", "hex", "imp", "impulse",
    "inc", "incr", "increments", "index", "ink", "inkremente", "kilo", "lsb", "mega", "micro", "milli", "mue", "my", "point",
    "points", "pulse", "pulses", "raw", "roh", "row", "rows", "sample", "samples", "sequence", "ticks",
)  # fmt: skip
# Those that stand in a line of units, and are no names of columns
_RAW_ALONE = ("adc", "counts", "digit", "digits", "lsb", "ticks", "%fs", "% fs", "%f.s.", "%fso")
_FACTOR = re.compile(r"[0-9%‰⁰-⁹]")
_EXPONENT = re.compile(r"(?<=[A-Za-z)])(?:\^?-?[1-4]|\^\(-?[1-4]\))(?![0-9])")  # exponent, as in lbm/ft3
# In place of a letter of another code page, or the micro sign in cp437, UTF-8, Shift-JIS, GBK and EUC, read as cp1252
_LOST = ("?", "\ufffd", "æ", "Âµ", "Î¼", "ƒÊ", "¦Ì", "¥ì")
_NUMBER = r"(?:[0-9.]+(?:E[+-]?[0-9]+)?|E[+-]?[0-9]+|[0-9.]+\^-?[0-9]+|[0-9]+/[0-9]+)"  # a factor
_BEFORE = re.compile(
    rf"[x×*]?\s*(?:{_NUMBER}(?:\s*[x×*]\s*|\s+)|[0-9]*\.[0-9]+)(?P<unit>[^\W\d].*|[°%].*)"
)  # not 5V, a name
_BEHIND = re.compile(rf"(?P<unit>.*?[^\W\d])\s*[x×*]\s*{_NUMBER}")
_MANY_A_TIME = re.compile(r"[1-9][0-9]+\s*/\s*(?:min|s)")
_WORDS = re.compile(r"[^\W\d_]+")


def says_more(written: str, unit: str) -> bool:
    """Return whether the unknown unit `written` means that the numbers are not, or may not be, in `unit`."""
    words = _WORDS.findall(written)
    if (
        _has_factor(written)
        or written.startswith(_LOST)
        or says_absolute("", written)
        or _FACTOR.search(_EXPONENT.sub("", written))
    ):
        return True
    return any(word.lower() in _RAW or _is_other(simplify_unit(word), unit) for word in words)


def names_unit(cell: str) -> bool:
    """Return whether a cell in a line of units is one: known, with a factor, with a lost letter, or of raw numbers."""
    lost = any(is_unit(cell.removeprefix(sign)) for sign in _LOST if cell.startswith(sign))
    return is_unit(cell) or lost or _has_factor(cell) or cell.lower() in _RAW_ALONE


def _has_factor(text: str) -> bool:
    """Return whether a text is a known unit with a factor: `0.001 Nm`, `rpm x 100`, `1000/min`."""
    if _MANY_A_TIME.fullmatch(text):
        return True
    match = _BEFORE.fullmatch(text) or _BEHIND.fullmatch(text)
    return match is not None and is_unit(match["unit"])


def _is_other(word: str, unit: str) -> bool:
    """Return whether a word is another unit of the same quantity as `unit`."""
    try:
        return have_same_quantity(word, unit) and contradict(word, unit)
    except InputError:
        return False
