"""Channel: what a file says about one of its signals; Signal: its values; Recording: an open file, whatever its format.

A raster is a set of channels whose rows belong together: row i of one was taken at the time of row i of the other.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from protocols.errors import InputError, suggest_closest


@dataclass(frozen=True)
class Channel:
    """One signal of a file, without its values.

    number: of the channel in the file, from 1, as an import map's `number` counts. path: name that is unique in the file.
    unit: as the file writes it, "" where it writes none. raster: name of the channels with the same rows.
    rows: number of samples. rate_hz [Hz]: mean rate; start_s, end_s [s]: times of the first and last sample; NaN: not known.
    kind: "number"; "status" for numbers with names (gear, phase, flag); "time" for a time axis, whose values are in seconds;
    "text", which cannot become a column. scaling: factors and offsets that the file states and nobody has applied, as a text.
    """

    name: str
    number: int
    path: str
    unit: str = ""
    raster: str = ""
    rows: int = 0
    rate_hz: float = float("nan")
    start_s: float = float("nan")
    end_s: float = float("nan")
    kind: str = "number"
    comment: str = ""
    scaling: str = ""


@dataclass(frozen=True)
class Signal:
    """Values (n,) of a `channel`; not-a-number where the file has none, or calls one invalid.

    time: (n,) in s from the start of the recording, from the file's own time axis; None where the file has none for it.
    whole: (n,) the values as whole numbers, where float64 has lost their last digits, as of ns since 1970; else None.
    """

    channel: Channel
    values: np.ndarray
    time: np.ndarray | None = None
    whole: np.ndarray | None = None


class Recording(Protocol):
    """An open file. Opening one reads what is in it, not its values.

    channels: all, in the order of the file. numbers: single numbers with a name. notes: what was decided while the file was
    read, and what the file says about itself, a sentence each. start: time of day of time 0, ISO 8601, "" where not known.
    """

    channels: Sequence[Channel]
    numbers: Mapping[str, float]
    notes: list[str]
    start: str

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """Values of `channels`, of which no other one is read. Raises InputError."""


def keep_whole(numbers: np.ndarray) -> np.ndarray | None:
    """Whole numbers (n,) for `Signal.whole`: themselves where one is above what float64 has exactly, None elsewhere."""
    if numbers.dtype.kind not in "iu" or numbers.dtype.itemsize < 8 or not len(numbers):
        return None
    if not EXACT < max(int(numbers.max()), -int(numbers.min())) <= np.iinfo(np.int64).max:
        return None
    return numbers.astype(np.int64)


def simplify_unit(text: str) -> str:
    """A unit as `protocols/files/units.py` reads it, from the form in which files write it.

    Brackets go, a dash is no unit, and spellings of tools and languages become the usual one: `Grad C` is degC. So does what
    says that a pressure is absolute.
    """
    unit = text.strip()
    if len(unit) > 1 and unit[0] + unit[-1] in ("[]", "()", "{}"):
        unit = unit[1:-1].strip()
    unit = _ABSOLUTE_UNIT.sub(r"\1", _ABSOLUTE_END.sub(r"\1\2", unit))
    unit = _GAUGE.sub(r"\1", unit)
    unit = _POWER.sub(r"\1^\2", _PER.sub(r"\1/\2", unit))
    if torque := _TORQUE.fullmatch(unit):
        return _write_torque(*torque.groups(""))
    return _SPELLINGS.get(unit) or _SPELLINGS_OF_ANY_CASE.get(" ".join(unit.split()).lower(), unit)


def _write_torque(arm: str, weight: str, other_weight: str, other_arm: str, mass: str, length: str) -> str:
    """A torque of the imperial system, or of a weight in kg on an arm, as a product of units."""
    if mass:
        return f"kgf*{length}"
    force = "ozf" if (weight or other_weight).lower().startswith("o") else "lbf"
    return f"{'ft' if (arm or other_arm).lower().startswith('f') else 'in'}*{force}"


def says_absolute(name: str, unit: str) -> bool:
    """Whether the name or unit of a pressure says that it counts from vacuum: `bar(a)`, `psia`, `bar a`, `p_abs`."""
    text = f"{name} {unit}"
    return bool(_ABSOLUTE_UNIT.search(text) or _ABSOLUTE.search(text) or _ABSOLUTE_END.match(unit.strip()))


def is_time_name(name: str) -> bool:
    """Whether a channel is called time, in the language of a tool."""
    return name.lower() in TIME_NAMES or name.lower().startswith("time")


def name_first(names: Sequence[str]) -> str:
    """Names for a note: the first ones, and how many there are beside them."""
    shown = ", ".join(names[:_MOST_NOTED])
    return shown if len(names) <= _MOST_NOTED else f"{shown} and {len(names) - _MOST_NOTED} more"


def choose_channel(file: Path, channels: Sequence[Channel], wanted: str | int) -> Channel:
    """The channel with the name, path or number `wanted`. Raises InputError where there is none, or more than one.

    Time axes of several rasters with one name are one choice, as each signal brings its own. `time_s` is the name of any.
    """
    if isinstance(wanted, int):
        for channel in channels:
            if channel.number == wanted:
                return channel
        raise InputError(f"recording {file} has {len(channels)} columns; column number {wanted} is asked for")
    if exact := [channel for channel in channels if channel.path == wanted]:
        return exact[0]
    spaced = " ".join(
        wanted.split()
    )  # `Time  1 - default sample rate` of catman: names of text files have single blanks
    chosen = [channel for channel in channels if channel.name in (wanted, spaced)]
    if not chosen and wanted == "time_s":
        chosen = [channel for channel in channels if channel.kind == "time"]
    if chosen and all(channel.kind == "time" for channel in chosen):
        return max(chosen, key=lambda channel: channel.rows > 0)  # the first with rows
    if len(chosen) > 1:
        paths, numbers = (
            ", ".join(texts) for texts in zip(*((repr(c.path), str(c.number)) for c in chosen), strict=True)
        )
        raise InputError(
            f"recording {file} has {len(chosen)} columns {wanted!r}; ask for one by `from`: {paths}, or by `number`: {numbers}"
        )
    if not chosen:
        known = dict.fromkeys(name for channel in channels for name in (channel.name, channel.path))
        raise InputError(
            f"recording {file} has no column {wanted!r}; {suggest_closest(wanted, list(known)[:_MOST_NAMES])}"
        )
    return chosen[0]


NO_VALUES = "no value in the first and last rows"  # comment of a column of a text file that may be empty
TIME_NAMES = (
    "time_s", "time", "t", "zeit", "timestamp", "tid", "temps", "tempo", "tiempo", "currenttime", "時間", "時刻", "时间",
)  # fmt: skip
# How files write units that pint does not know, or takes for others: no rig measures coulomb, farad, siemens, gigaradian, or
# kilograms times or over a length. A pressure of a clutch is one above that of the air: what says so (`barg`) is no other unit
_SPELLINGS = {
    "-": "1", "--": "1", "–": "1", "C": "degC", "F": "degF", "Grad": "deg", "GRAD": "deg", "Grad/s": "deg/s", "KN": "kN",
    "%%": "%", "Mpa": "MPa", "MPA": "MPa", "NM": "Nm", "V DC": "V", "VDC": "V", "Vdc": "V", "Adc": "A",
    "PS": "metric_horsepower", "mBar": "mbar", "min-1": "1/min", "min⁻¹": "1/min", "s-1": "1/s", "s⁻¹": "1/s",
    "rad.s-1": "rad/s", "rad·s⁻¹": "rad/s", "S": "s", "mS": "ms", "uS": "us", "µS": "us", "mBAR": "mbar", "/min": "1/min",
    "kg/cm^2": "kgf/cm^2", "kg/cm²": "kgf/cm^2", "kp/cm^2": "kgf/cm^2", "kp/cm²": "kgf/cm^2", "Nxm": "Nm", "oC": "degC",
    "秒": "s", "ミリ秒": "ms", "毫秒": "ms", "度": "deg",
}  # fmt: skip
_SPELLINGS_OF_ANY_CASE = {
    "volt": "V", "volts": "V", "amp": "A", "amps": "A", "ampere": "A", "kelvin": "K", "celsius": "degC", "deg c": "degC",
    "deg. c": "degC", "degree c": "degC", "degrees c": "degC", "gradc": "degC", "grad c": "degC", "grad celsius": "degC",
    "ºc": "degC", "℃": "degC", "deg": "deg", "degree": "deg", "degrees": "deg", "rpm": "rpm", "u/min": "rpm", "upm": "rpm",
    "umdr/min": "rpm", "tr/min": "rpm", "r/min": "rpm", "rev/min": "rpm", "bar": "bar", "psi": "psi", "hpa": "hPa",
    "kpa": "kPa", "n-m": "Nm", "kn-m": "kNm", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "sec.": "s",
    "sek": "s", "sek.": "s", "sekunden": "s", "msec": "ms", "prozent": "%", "percent": "%", "pct": "%", "lpm": "l/min",
    "l/min": "l/min", "kg": "kg", "newton": "N", "newtonmeter": "Nm", "newton-meter": "Nm", "rad/s": "rad/s",
    "degc": "degC", "deg.c": "degC", "deg_c": "degC", "degree celsius": "degC", "degrees celsius": "degC", "c°": "degC",
    "° c": "degC", "°c": "degC", "˚c": "degC", "degf": "degF", "deg f": "degF", "deg. f": "degF", "ºf": "degF",
    "°f": "degF", "℉": "degF", "fahrenheit": "degF", "kw": "kW", "knm": "kNm", "rev/s": "rps", "r/s": "rps", "u/s": "rps",
    "tr/s": "rps", "torr": "torr", "pascal": "Pa", "r.p.m.": "rpm", "revs/min": "rpm", "rev./min": "rpm",
    "rev per min": "rpm", "rotations/min": "rpm", "giri/min": "rpm", "omw/min": "rpm", "ot/min": "rpm", "obr/min": "rpm",
    "об/мин": "rpm", "回転/分": "rpm", "转/分": "rpm", "dps": "deg/s", "deg/sec": "deg/s", "kmph": "km/h", "kmh": "km/h",
    "km/hr": "km/h", "watt": "W", "watts": "W", "newton metre": "Nm", "newton meter": "Nm", "newton-metre": "Nm",
    "newton metres": "Nm", "newton meters": "Nm", "newton-meters": "Nm", "°celsius": "degC", "degree_c": "degC",
    "degrees f": "degF", "deg k": "K", "km/h": "km/h", "hp": "hp", "lb/in2": "psi", "lbf/in2": "psi", "a dc": "A",
    "ma dc": "mA", "v dc": "V", "mm hg": "mmHg", "n-cm": "N*cm", "mn-m": "mNm", "нм": "Nm", "н·м": "Nm", "бар": "bar",
    "кпа": "kPa", "мпа": "MPa", "牛米": "Nm", "牛·米": "Nm", "摄氏度": "degC", "unitless": "1", "rev": "turn",
}  # fmt: skip
_ABSOLUTE = re.compile(r"(?<![^\W_])abs(olute?)?(?![^\W_])", re.IGNORECASE)
# Units of pressure that tools mark as above the air or above vacuum
_PRESSURE = r"(?<![^\W_])(m?bar|psi|[hkM]?Pa|kgf?/cm(?:\^?2|²)|(?:mm|in)Hg|torr)"
_ABSOLUTE_UNIT = re.compile(
    rf"{_PRESSURE}(?:a|[\s_-]*(?:\(a\)|\[a\]|\(?(?:abs|vac)(?:\.|olute?)?\)?))(?![^\W_])", re.IGNORECASE
)
_ABSOLUTE_END = re.compile(
    rf"\A(?:{_PRESSURE}[\s_-]a|(at)a)\Z", re.IGNORECASE
)  # a whole unit: `p_bar_a` may be of clutch a
_GAUGE = re.compile(
    rf"{_PRESSURE}[\s_-]*(?:g|\(g\)|\[g\]|gauge|ü|\(ü\)|\(?rel(?:\.|ativ|ative)?\)?)(?![^\W_])", re.IGNORECASE
)
_MARK = r"[\s.·⋅*×_-]?"  # between the units of a product
_ARM, _WEIGHT = r"(in|inch|ft|foot|feet)", r"(lbf?s?|pounds?|ozf?)"
_TORQUE = re.compile(rf"(?i:{_ARM}{_MARK}{_WEIGHT}|{_WEIGHT}{_MARK}{_ARM})|(kgf?|kp){_MARK}(c?m)")
_PER = re.compile(r"(\w)[\s.·⋅*](s|min)(?:\^-1|-1|⁻¹)$")  # rad s-1
_POWER = re.compile(r"(?<![\w^])([cdm]?m|s)([23])(?!\w)")  # m3/h, m/s2
_MOST_NAMES = 1000  # names that are compared with an unknown one: each costs about 10 us
EXACT = 1 << 53  # above, float64 has no longer every whole number
_MOST_NOTED = 5  # names in a note
