"""Stated rate: single numbers of a file that give the sampling rate of its rows, under the names of various tools.

`sample_rate = 100`, `fs`, `Abtastrate`, `dt = 0.01`, `SampleTime[ms]`. They are not used to read data: they are compared with
the times of a map.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isclose

from clutch_hil.recordings.channel import Channel

_LONGEST_NAME = 100  # characters of a name that are examined
_WORDS = re.compile(r"(?<=[a-zäöü])(?=[A-ZÄÖÜ])|[\W_]+")  # where a name is split into words
# Names of rates and of periods, as words in lower case: those of recorders, MATLAB, LabVIEW, oscilloscopes and tools in German,
# French, Italian and Spanish
_TAKEN = r"(?:sampl(?:e|ing)|acquisition|scan|logging|recording|storage)"
_TAKEN_GERMAN = r"(?:abtast|mess|aufzeichnungs|erfassungs|speicher)"
_RATE = re.compile(
    rf"(?:.* )?(?:{_TAKEN} ?(?:rate|freq\w*)|samples (?:per )?s(?:ec(?:ond)?)?|{_TAKEN_GERMAN} ?(?:rate|frequenz)|fs"
    r"|fréquence d ?échantillonnage|frequenza di campionamento|frecuencia de muestreo)(?P<rest>(?: .*)?)"
    r"|rate(?P<hertz>(?: k?hz)?)"
)
_PERIOD = re.compile(
    rf"(?:(?:.* )?(?:{_TAKEN} ?(?:time|interval|period|step)|time ?step|delta ?[tx]|abtast ?(?:zeit|periode)"
    rf"|{_TAKEN_GERMAN} ?intervall|période d ?échantillonnage"
    r"|(?:[htx]|time|horiz(?:ontal)?) ?(?:incr?|increment|interval)|h ?resolution)|increment)"
    r"(?P<rest>(?: .*)?)|(?:dt|dx|ts|tinterval)(?P<seconds>(?: [munµ]?s)?)|(?:clock|intervall?)(?P<stated> [munµ]?s)"
)
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "ghz": 1e9}
_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "µs": 1e-6, "usec": 1e-6, "ns": 1e-9}
_UNKNOWN_HERTZ = [1.0, 1e3]  # possible units of a rate without unit, in Hz
_UNKNOWN_SECONDS = [1.0, 1e-3, 1e-6]  # possible units of a period without unit, in s
# A number with its unit in one text: oscilloscopes write rates as 2.5MSa/s
_VALUE = re.compile(
    r"(?P<number>[0-9.]+(?:[eE][+-]?[0-9]+)?)\s*"
    r"(?:(?P<prefix>[kKMG]?)(?:Hz|SPS|S(?:a|amples?)?/s(?:ec)?)|(?P<period>[munµ]?[sS]|m?sec))"
)
_VALUES = (1e-30, 1e30)  # range of rates and periods
_SAME = 0.01  # relative tolerance of a rate, for errors of a clock and rounded numbers


@dataclass(frozen=True)
class StatedRate:
    """A rate or period in the file, by its name. rates [Hz]: possible values, most likely first; several if it has no unit."""

    name: str
    text: str
    rates: Sequence[float]

    def agrees(self, rate: float) -> bool:
        """Return whether it may mean `rate` [Hz]."""
        return any(isclose(one, rate, rel_tol=_SAME) for one in self.rates)

    def __str__(self) -> str:
        """Return a clause for a sentence."""
        return f"{self.name} is {self.text}"


def read_stated_rate(name: str, value: float) -> StatedRate | None:
    """Return the rate that a number called `name` states; None if it is neither a rate nor a period."""
    words = _split(name)
    if not _VALUES[0] < value < _VALUES[1]:
        return None
    if match := _RATE.fullmatch(words):
        unit = _find_unit(match["rest"] or match["hertz"] or "", _HERTZ)
        factors = [_HERTZ[unit]] if unit else _UNKNOWN_HERTZ
        return StatedRate(name, f"{value * factors[0]:g} Hz", [value * factor for factor in factors])
    if match := _PERIOD.fullmatch(words):
        unit = _find_unit(match["rest"] or match["seconds"] or match["stated"] or "", _SECONDS)
        factors = [_SECONDS[unit]] if unit else _UNKNOWN_SECONDS
        return StatedRate(name, f"{value * factors[0]:g} s", [1.0 / (value * factor) for factor in factors])
    return None


def list_stated_rates(numbers: Mapping[str, float], channels: Sequence[Channel]) -> list[StatedRate]:
    """Return the rates in the single `numbers` of a file that apply to `channels`: of the channels, their groups, or the
    file."""
    places = {place for c in channels for place in (c.path, c.raster, f"{c.raster}/{c.path}")}
    rates = []
    for name, value in numbers.items():
        group = name.rpartition("/")[0]
        if not group or any(place == group or place.startswith(f"{group}/") for place in places):
            rates += [one] if (one := read_stated_rate(name, value)) else []
    return rates


def is_rate_name(name: str) -> bool:
    """Return whether a name is that of a sampling rate or period."""
    return read_stated_rate(name, 1.0) is not None


def split_value(name: str, text: str) -> tuple[str, float] | None:
    """Return name with unit, and number, of a rate written as `10 ms` or `2 kHz`; None for other texts."""
    match = _VALUE.fullmatch(text.strip()) if len(text) <= _LONGEST_NAME else None
    try:
        named = f"{name} [{(match['period'] or '').lower() or match['prefix'] + 'Hz'}]" if match else ""
        return (named, float(match["number"])) if match and is_rate_name(named) else None
    except ValueError:  # 1.2.3
        return None


def _split(name: str) -> str:
    """Return the words of the last part of a name, in lower case, separated by blanks."""
    last = name[-_LONGEST_NAME:].rpartition("/")[2]
    words = " ".join(_WORDS.split(last)).strip().lower()
    return re.sub(r"\b([kmg]) hz\b", r"\1hz", words)


def _find_unit(words: str, units: Mapping[str, float]) -> str:
    return next((word for word in words.split() if word in units), "")
