"""Channel: description of a signal in a file; Signal: its values; Recording: an open file of any format.

A raster is a set of channels with common rows: row i of each was sampled at the same time.
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

    number: of the channel in the file, from 1, as for `number` in an import map. path: unique name in the file. unit: as
    written in the file, "" for none. raster: name of the set of channels with the same rows. rows: number of samples. rate_hz
    [Hz]: mean rate; start_s, end_s [s]: times of the first and last sample; NaN: not known. kind: "number"; "status" for
    numbers with names (gear, phase, flag); "time" for a time axis, whose values are in seconds; "text", which cannot become a
    column. scaling: factors and offsets stated in the file and not yet applied, as a text. states: numbers of its words by an
    import map, which a reader that uses them removes.
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
    states: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Signal:
    """Values (n,) of a `channel`; NaN where the file has none, or marks one as invalid.

    time: (n,) in s from the start of the recording, from the file's own time axis; None where the file has none for it.
    whole: (n,) the values as integers, where float64 would lose the last digits, as for ns since 1970; else None.
    """

    channel: Channel
    values: np.ndarray
    time: np.ndarray | None = None
    whole: np.ndarray | None = None


class Recording(Protocol):
    """An open file. Opening it reads the description of its contents, not the values.

    channels: all, in the order of the file. numbers: single numbers by name. notes: decisions of the reader, and statements of
    the file about itself, a sentence each. start: time of day of time 0, ISO 8601, "" if not known.
    """

    channels: Sequence[Channel]
    numbers: Mapping[str, float]
    notes: list[str]
    start: str

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """Read the values of `channels`, and of no others. Raises InputError."""


def keep_whole(numbers: np.ndarray) -> np.ndarray | None:
    """Return integers (n,) for `Signal.whole` if float64 cannot represent all of them exactly, else None."""
    if numbers.dtype.kind not in "iu" or numbers.dtype.itemsize < 8 or not len(numbers):
        return None
    if not EXACT < max(int(numbers.max()), -int(numbers.min())) <= np.iinfo(np.int64).max:
        return None
    return numbers.astype(np.int64)


def simplify_unit(text: str) -> str:
    """Convert a unit as written in files to the form that `protocols/files/units.py` reads.

    Brackets are removed, a dash means no unit, and spellings of tools and languages are replaced: `Grad C` by degC. Marks of
    absolute or gauge pressure are removed.
    """
    unit = text.strip()
    if len(unit) > 1 and unit[0] + unit[-1] in ("[]", "()", "{}"):
        unit = unit[1:-1].strip()
    unit = _ABSOLUTE_UNIT.sub(r"\1", _ABSOLUTE_END.sub(r"\1\2", unit))
    unit = _GAUGE.sub(r"\1", unit)
    unit = _DEGREE.sub(r"deg\1", unit)
    unit = _POWER.sub(r"\1^\2", _PER.sub(r"\1/\2", unit))
    if torque := _TORQUE.fullmatch(unit):
        return _write_torque(*torque.groups(""))
    return _SPELLINGS.get(unit) or _SPELLINGS_OF_ANY_CASE.get(" ".join(unit.split()).lower(), unit)


def _write_torque(arm: str, weight: str, other_weight: str, other_arm: str, length: str, other_length: str) -> str:
    """Return a torque unit as a product: imperial, or a weight in kg on an arm."""
    if length or other_length:
        return f"kgf*{length or other_length}"
    force = "ozf" if (weight or other_weight).lower().startswith("o") else "lbf"
    return f"{'ft' if (arm or other_arm).lower().startswith('f') else 'in'}*{force}"


def says_absolute(name: str, unit: str) -> bool:
    """Return whether name or unit mark a pressure as absolute: `bar(a)`, `psia`, `bar a`, `p_abs`."""
    text = f"{name} {unit}"
    return bool(_ABSOLUTE_UNIT.search(text) or _ABSOLUTE.search(text) or _ABSOLUTE_END.match(unit.strip()))


def is_time_name(name: str) -> bool:
    """Return whether a channel's name means time, in one of the languages of tools."""
    return name.lower() in TIME_NAMES or name.lower().startswith("time")


def name_first(names: Sequence[str]) -> str:
    """Return the first names for a note, and the number of others."""
    shown = ", ".join(names[:_MOST_NOTED])
    return shown if len(names) <= _MOST_NOTED else f"{shown} and {len(names) - _MOST_NOTED} more"


def choose_channel(file: Path, channels: Sequence[Channel], wanted: str | int) -> Channel:
    """Return the channel with the name, path or number `wanted`. Raises InputError where there is none, or more than one.

    Time axes of several rasters with one name count as one, because each signal has its own time. `time_s` selects any time
    axis.
    """
    if isinstance(wanted, int):
        for channel in channels:
            if channel.number == wanted:
                return channel
        raise InputError(f"recording {file} has no column number {wanted}; it has {len(channels)} columns")
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
            f"recording {file} has {len(chosen)} columns {wanted!r}; select one by `from`: {paths}, or by `number`: {numbers}"
        )
    if not chosen:
        known = dict.fromkeys(name for channel in channels for name in (channel.name, channel.path))
        raise InputError(
            f"recording {file} has no column {wanted!r}; {suggest_closest(wanted, list(known)[:_MOST_NAMES])}"
        )
    return chosen[0]


NO_VALUES = "no value in the first and last rows"  # comment for a column of a text file that may be empty
TIME_NAMES = (
    "time_s", "time", "t", "zeit", "timestamp", "tid", "temps", "tempo", "tiempo", "currenttime", "x_value", "tout", "時間",
    "時刻", "时间", "시간", "время", "czas", "čas", "idő", "aika", "zaman",
)  # fmt: skip
# Spellings of units that pint does not know, or misunderstands: no rig measures coulomb, farad, siemens, gigaradian, or
# kilograms times or over a length. Pressures of a clutch are relative to the atmosphere: a mark of this (`barg`) does not
# change the unit
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
    "l/min": "l/min", "kg": "kg", "newton": "N", "newtons": "N", "newtonmeter": "Nm", "newton-meter": "Nm", "rad/s": "rad/s",
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
    "1/minute": "1/min", "tr/mn": "rpm", "rounds/min": "rpm", "kp": "kgf",
}  # fmt: skip
_ABSOLUTE = re.compile(r"(?<![^\W_])abs(olute?)?(?![^\W_])", re.IGNORECASE)
# Units of pressure that tools mark as gauge or absolute
_PRESSURE = r"(?<![^\W_])(m?bar|psi|[hkM]?Pa|kgf?/cm(?:\^?2|²)|(?:mm|in)Hg|torr)"
_ABSOLUTE_UNIT = re.compile(
    rf"{_PRESSURE}(?:a|[\s_-]*(?:\(a\)|\[a\]|\(?(?:abs|vac)(?:\.|olute?)?\)?))(?![^\W_])", re.IGNORECASE
)
_ABSOLUTE_END = re.compile(
    rf"\A(?:{_PRESSURE}[\s_-]a|(at)a)\Z", re.IGNORECASE
)  # must be the complete unit: `p_bar_a` may be of clutch a
_GAUGE = re.compile(
    rf"{_PRESSURE}[\s_-]*(?:g|\(g\)|\[g\]|gauge|ü|\(ü\)|\(?rel(?:\.|ativ|ative)?\)?)(?![^\W_])", re.IGNORECASE
)
_MARK = r"[\s.·⋅*×_-]?"  # between the factors of a product
_ARM, _WEIGHT = r"(in|inch|ft|foot|feet)", r"(lbf?s?|pounds?|ozf?)"
_TORQUE = re.compile(
    rf"(?i:{_ARM}{_MARK}{_WEIGHT}|{_WEIGHT}{_MARK}{_ARM})|(?:kgf?|kp){_MARK}(c?m)|(c?m){_MARK}(?:kgf?|kp)"
)
_PER = re.compile(r"(\w)[\s.·⋅*](s|min)(?:\^-1|-1|⁻¹)$")  # rad s-1
# A degree sign in a wrong code page: UTF-8, DOS or Mac as cp1252, or replaced
_DEGREE = re.compile("(?:Â°|[ø¡\ufffd])\\s?([CF])$")
_POWER = re.compile(r"(?<![\w^])([cdm]?m|s)([23])(?!\w)")  # m3/h, m/s2
_MOST_NAMES = 1000  # largest number of names that are compared with an unknown one: each takes about 10 us
EXACT = 1 << 53  # above it, float64 cannot represent every integer
_MOST_NOTED = 5  # largest number of names in a note
