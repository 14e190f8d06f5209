"""Unknown unit: a channel's unit in the file that cannot be read, compared with the unit in the map.

An unknown spelling such as `Nmtr` does not contradict the map. `10 rpm`, `4-20 mA`, `%FS`, `counts`, `bar vac` and `kNm (rms)`
do: the numbers are not in the map's unit, and a factor would be lost without a message.
"""

import re

from clutch_hil.recordings.channel import says_absolute, simplify_unit
from protocols.errors import InputError
from protocols.files.units import contradict, have_same_quantity

# Words for raw numbers of a converter, an encoder or a timer, for numbers of rows, and for factors
_RAW = (
    "adc", "adu", "bits", "cnt", "cnts", "code", "codes", "count", "counts", "digit", "digits", "dn", "hex", "imp", "impulse",
    "inc", "incr", "increments", "index", "ink", "inkremente", "kilo", "lsb", "mega", "micro", "milli", "point", "points",
    "pulse", "pulses", "raw", "roh", "row", "rows", "sample", "samples", "sequence", "ticks",
)  # fmt: skip
_FACTOR = re.compile(r"[0-9%‰⁰-⁹]")
_EXPONENT = re.compile(r"(?<=[A-Za-z)])(?:\^?-?[1-4]|\^\(-?[1-4]\))(?![0-9])")  # exponent, as in lbm/ft3
_WORDS = re.compile(r"[^\W\d_]+")


def says_more(written: str, unit: str) -> bool:
    """Return whether the unknown unit `written` means that the numbers are not, or may not be, in `unit`."""
    words = _WORDS.findall(written)
    if says_absolute("", written) or _FACTOR.search(_EXPONENT.sub("", written)):
        return True
    return any(word.lower() in _RAW or _is_other(simplify_unit(word), unit) for word in words)


def _is_other(word: str, unit: str) -> bool:
    """Return whether a word is another unit of the same quantity as `unit`."""
    try:
        return have_same_quantity(word, unit) and contradict(word, unit)
    except InputError:
        return False
