"""Wording: numbers, units and names of columns as text, for every page and its pictures."""

import math
from collections.abc import Sequence

NO_NUMBER = "–"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_UNITS = {
    "_rad_s": "rad/s", "_m_s": "m/s", "_degc": "degC", "_bar": "bar", "_rpm": "rpm", "_rad": "rad", "_nm": "Nm",
    "_mm": "mm", "_um": "um", "_hz": "Hz", "_pa": "Pa", "_v": "V", "_a": "A", "_n": "N", "_m": "m", "_k": "K", "_s": "s",
}  # fmt: skip  # by the end of a column's name (docs/rig.md), the longest first


def format_number(value: float, digits: int = 3) -> str:
    """Return `value` with `digits` significant digits."""
    if not math.isfinite(value):
        return NO_NUMBER if math.isnan(value) else ("∞" if value > 0.0 else "−∞")
    if value == 0.0:
        return "0"
    power = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    return format_fixed(value, digits - 1 - power, power)


def trim_zeros(value: float, digits: int = 3) -> str:
    """Return `value` with at most `digits` significant digits, without trailing zeros: for settings, not for measurements."""
    text, times, power = format_number(value, digits).partition(" · ")
    return (text.rstrip("0").rstrip(".") if "." in text else text) + times + power


def format_fixed(value: float, decimals: int, power: int | None = None) -> str:
    """Return `value` rounded to `decimals` places, which may be negative; very large or small values with a power of ten.

    power: exponent of the leading digit, computed where it is not given.
    """
    power = math.floor(math.log10(abs(value))) if power is None and value else power or 0
    if -3 <= power < 6:
        return f"{round(value, decimals):.{max(decimals, 0)}f}".replace("-", "−")
    mantissa = f"{value / 10.0**power:.{max(decimals + power, 0)}f}".replace("-", "−")
    return f"{mantissa} · 10{str(power).translate(_SUPERSCRIPT)}"


def format_interval(value: float, ci95: tuple[float, float]) -> tuple[str, str, str]:
    """Return a value and the ends of its 95 % interval, rounded to two digits of the interval's half-width.

    A value that this would round to 0 has two digits of its own.
    """
    low, high = ci95
    half = 0.5 * (high - low)
    if not (math.isfinite(half) and half > 0.0):
        return format_number(value, 4), format_number(low, 4), format_number(high, 4)
    decimals = 1 - math.floor(math.log10(half))
    largest = max(abs(value), abs(low), abs(high))
    power = math.floor(math.log10(largest)) if largest > 0.0 else 0
    shown, below, above = (format_fixed(v, decimals, power) for v in (value, low, high))
    if value and round(value, decimals) == 0.0:
        shown = format_number(value, 2)
    return shown, below, above


def format_percent(share: float, decimals: int = 0) -> str:
    """Return `share` of 1 in percent."""
    return f"{100.0 * share:.{decimals}f} %".replace("-", "−") if math.isfinite(share) else NO_NUMBER


def format_unit(unit: str) -> str:
    """Return a unit as people write it; empty for a pure number."""
    return {"1": "", "degC": "°C"}.get(unit, unit).replace("^2", "²").replace("^3", "³")


def format_with_unit(value: float, unit: str, digits: int = 3) -> str:
    """Return a number and its unit."""
    return f"{format_number(value, digits)} {format_unit(unit)}".rstrip()


def format_column(column: str, unit: str | None = None) -> str:
    """Return the name of a column without its unit, for people."""
    endings = [f"_{unit.lower().replace('/', '_').replace('^', '')}"] if unit else []
    ending = next((e for e in (*endings, *_UNITS) if column.endswith(e) and len(e) < len(column)), "")
    return column.removesuffix(ending).replace("_", " ")


def format_axis_label(column: str, unit: str | None = None) -> str:
    """Return the name of a column with its unit; the unit is read from the name where it is not given."""
    known = unit or next((u for e, u in _UNITS.items() if column.endswith(e) and len(e) < len(column)), "1")
    shown = format_unit(known)
    return f"{format_column(column, unit)} [{shown}]" if shown else format_column(column, unit)


def list_words(names: Sequence[str], last: str = "and") -> str:
    """Return names as text: 'a, b and c'."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"
