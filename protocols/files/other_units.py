"""Other units in which a user may give a parameter, such as `34 psi`, or in which a refused number may have been meant."""

import re
from collections.abc import Callable
from math import pi
from typing import Any

from protocols.errors import InputError
from protocols.files.units import space_unit

# Unit of a parameter -> factors from units that people have on their data sheets, the usual ones first. Not by pint: a running
# service refuses numbers as well, and must not load it. A test compares them with pint
_OTHERS: dict[str, dict[str, float]] = {
    "bar": {"Pa": 1e-5, "kPa": 1e-2, "MPa": 10.0, "mbar": 1e-3, "psi": 0.06894757293168362},
    "bar/V": {"Pa/V": 1e-5, "kPa/V": 1e-2, "MPa/V": 10.0, "mbar/V": 1e-3, "psi/V": 0.06894757293168362, "bar/mV": 1e3},
    "V/bar": {"V/Pa": 1e5, "V/MPa": 0.1, "mV/bar": 1e-3, "V/psi": 14.503773773020923},
    "Nm/bar": {"Nm/Pa": 1e5, "Nm/MPa": 0.1, "Nm/kPa": 1e2, "Nm/psi": 14.503773773020923},
    "V/Nm": {"mV/Nm": 1e-3},
    "rad/s": {"rpm": pi / 30.0, "Hz": 2.0 * pi},
    "s": {"ms": 1e-3, "us": 1e-6},
    "ms": {"s": 1e3, "us": 1e-3},
    "m": {"mm": 1e-3, "um": 1e-6},
    "m^2": {"mm^2": 1e-6, "cm^2": 1e-4},
    "m^3/bar": {"cm^3/bar": 1e-6, "mm^3/bar": 1e-9, "l/bar": 1e-3},
    "m^3/(s bar)": {"l/(min bar)": 1e-3 / 60.0, "cm^3/(s bar)": 1e-6, "l/(s bar)": 1e-3},
    "N/m": {"N/mm": 1e3, "kN/mm": 1e6},
    "Ns/m": {"Ns/mm": 1e3},
    "Nm": {"kNm": 1e3, "N mm": 1e-3},
    "kg m^2": {"kg cm^2": 1e-4, "g m^2": 1e-3, "kg mm^2": 1e-6, "g cm^2": 1e-7},
    "rad": {"deg": pi / 180.0},
    "1": {"%": 0.01},
}
_KELVIN, _CELSIUS, _ZERO = "K", "degC", 273.15
_QUANTITY = re.compile(
    r"\s*(?P<number>[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(?P<unit>[^\s\d.].*?)\s*"
)
_LONGEST = 100  # characters of a number with a unit


def split_quantity(text: str) -> tuple[float, str] | None:
    """Return number and unit of a text such as `34 psi`; None for another text."""
    match = _QUANTITY.fullmatch(text) if len(text) <= _LONGEST else None
    return (float(match["number"]), match["unit"]) if match else None


def parse_number(name: str, text: str, find_unit: Callable[[], str]) -> float | None:
    """Return the number in a `text` of the command line, such as `8` or `34 psi`, for the parameter `name`; None for no number.

    The result is in the declared unit of the parameter. `find_unit` returns it, and is called only where `text` has a unit.
    Raises InputError for a unit that is not of _OTHERS.
    """
    try:
        return float(text)
    except ValueError:
        if (quantity := split_quantity(text)) is None:
            return None
    number, unit = quantity
    value: float = convert_fields(name, {"value": number, "unit": unit}, find_unit())["value"]
    return value


def refuse_unit_alone(word: str) -> None:
    """Raise InputError if a word of the command line is a unit: `34 psi` without quotes is two words."""
    if word in {_KELVIN, _CELSIUS, *_OTHERS, *(other for others in _OTHERS.values() for other in others)} - {"1"}:
        raise InputError(f"{word!r} is a unit without a number; write both as one word, such as NAME=34{word}")


def convert_fields(name: str, fields: dict[str, Any], unit: str) -> dict[str, Any]:
    """Return the `fields` of a parameter in its declared `unit`: value, bounds and uncertainty, as far as they are there.

    fields: with the `unit` in which they are, if it is another one. What is no number stays as it is. Raises InputError for a
    unit that is not of _OTHERS.
    """
    given = fields.get("unit", unit)
    if given == unit:
        return fields
    factor, zero = _OTHERS.get(unit, {}).get(given) if isinstance(given, str) else None, 0.0
    if (given, unit) == (_KELVIN, _CELSIUS):
        factor, zero = 1.0, -_ZERO
    if factor is None:
        others = [*_OTHERS.get(unit, {}), *([_KELVIN] if unit == _CELSIUS else [])]
        also = f"; allowed {'are' if len(others) > 1 else 'is'} also {', '.join(others)}" if others else ""
        raise InputError(f"{name} is given in {given!r}; its unit is {unit!r}{also}")
    if not fields.keys() & {"value", "bounds", "uncertainty"}:
        raise InputError(f"{name} has the unit {given!r} and no value; give a value in it")
    converted = fields | {"unit": unit}
    for field, offset in (("value", zero), ("uncertainty", 0.0)):
        if field in fields:
            converted[field] = _scale(fields[field], factor, offset)
    if isinstance(bounds := fields.get("bounds"), list):
        converted["bounds"] = [_scale(bound, factor, zero) for bound in bounds]
    return converted


def _scale(number: Any, factor: float, offset: float) -> Any:
    is_number = isinstance(number, int | float) and not isinstance(number, bool)
    return factor * number + offset if is_number else number


def describe_other_unit(value: float, unit: str, low: float, high: float) -> str:
    """Return `; 235000 Pa would be 2.35 bar` where a refused `value` fits in another unit; otherwise an empty text.

    value and its bounds `low` and `high` in `unit`.
    """
    if unit == _CELSIUS and low <= value - _ZERO <= high:
        return _say(value, _KELVIN, value - _ZERO, unit)
    for other, factor in _OTHERS.get(unit, {}).items():
        if low <= factor * value <= high:
            return _say(value, other, factor * value, unit)
    return ""


def _say(value: float, other: str, converted: float, unit: str) -> str:
    return f"; {value:g} {other} would be {converted:.4g}{space_unit(unit)}"
