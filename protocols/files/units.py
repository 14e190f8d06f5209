"""Units: conversion between the units that people write and the SI values that the code computes with.

Bar and degC are used in TOML files, frames, run files and on screens; inside, everything is SI (Pa, K, N, m, s, rad). Units are
parsed by pint, once for each unit and process, when a file is loaded. No loop converts. Pint takes long to load, so it is
loaded only for a unit that is not in the table `unit_table`.
"""

import re
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING

from protocols.errors import InputError, suggest_closest
from protocols.files.unit_table import CONVERSIONS

if TYPE_CHECKING:
    import pint

BAR = 1e5  # Pa, by definition
ZERO_CELSIUS = 273.15  # K, by definition
RPM = 0.10471975511965977  # rad/s, 2 pi / 60

_LONGEST_UNIT = 80  # characters: a longer text is refused
# Counts of things. Pint would treat them as angles.
_COUNTED_UNITS = ("counts/rev", "cycles")
# Units that pint misreads, and what to write instead: gon, 1e6 bar, 1e6 m, 1e6 s, 1e9 rad, 1e6 A, 1e6 V
_MISLEADING = {
    "grad": "deg or gon", "Mbar": "mbar", "Mm": "mm", "Ms": "ms", "Grad": "deg", "MA": "mA", "MV": "mV",
}  # fmt: skip
# The same, only if it is the whole unit: 1e-3 Pa, mostly meant as MPa, and in mPa s, a viscosity, correct; an angle, mostly
# meant as a thousandth of an inch
_MISLEADING_ALONE = {"mPa": "MPa or Pa", "mil": "thou or mrad"}
_PRODUCT_DOTS = str.maketrans(dict.fromkeys("·⋅∙•×・･", "*"))
# Units that are suggested for an unknown one
_COMMON_UNITS = (
    "1", "%", "bar", "mbar", "Pa", "kPa", "MPa", "psi", "degC", "degF", "K", "Nm", "N", "kN", "V", "mV", "A", "mA", "s", "ms",
    "us", "min", "Hz", "rad", "deg", "rad/s", "rpm", "m", "mm", "um", "m/s", "l/min", "kg", "W", "kW", "J", "kg m^2", "Pa s",
)  # fmt: skip
_UNIT_TEXT = re.compile(r"[\w%°/*^().-][\w %°/*^().-]*")
_FORCE_PRODUCT = re.compile(
    r"\b((?:[kMmuncdµμ]|da)?N)(mm|cm|m|(?=s))(s?)\b"
)  # Nm is a product; in pint it would be a number of textile metres
_CELSIUS = re.compile(r"degC|°C")  # in a product or quotient it is a difference, of 1 K
_GAMMA = "(rad/s)^gamma"  # SI for any gamma; a unit of friction maps


def to_si(value: float, unit: str) -> float:
    """Return the SI value of `value` in `unit`. Raises InputError for an unknown unit."""
    factor, offset, _ = _find_conversion(unit)
    return factor * value + offset


def from_si(value: float, unit: str) -> float:
    """Return the SI value `value` in `unit`: the inverse of `to_si`. Raises InputError for an unknown unit."""
    factor, offset, _ = _find_conversion(unit)
    return (value - offset) / factor


def space_unit(unit: str) -> str:
    """Return a unit as it is written after a number: ` bar`; `` for a pure number."""
    return "" if unit == "1" else f" {unit}"


def have_same_quantity(unit: str, other: str) -> bool:
    """Return whether two units are of one quantity, so that values can be converted. Raises InputError for an unknown unit.

    Angle is a separate quantity: Hz and rad/s differ.
    """
    return _find_conversion(unit)[2] == _find_conversion(other)[2]


def contradict(unit: str, other: str) -> bool:
    """Return whether two units are known and differ in quantity or scale. An unknown unit contradicts none."""
    try:
        return unit != other and _find_conversion(unit) != _find_conversion(other)
    except InputError:
        return False


@cache
def _find_conversion(unit: str) -> tuple[float, float, str]:
    """Return factor, offset and SI base units of a unit: SI value = factor * value + offset. Raises InputError."""
    return CONVERSIONS.get(unit) or parse_unit(unit)


def parse_unit(unit: str) -> tuple[float, float, str]:
    """Return factor, offset and SI base units of a unit, by pint. Raises InputError for an unknown unit."""
    if unit in _COUNTED_UNITS:
        return 1.0, 0.0, unit
    if misread := next((word for word in re.findall(r"[A-Za-z]+", unit) if word in _MISLEADING), None):
        raise InputError(f"unit {unit!r} is not allowed, as {misread} can be misread; write {_MISLEADING[misread]}")
    if unit in _MISLEADING_ALONE:
        raise InputError(f"unit {unit!r} is not allowed, as it can be misread; write {_MISLEADING_ALONE[unit]}")
    text = unit.replace(_GAMMA, "rad").translate(_PRODUCT_DOTS)
    text = _FORCE_PRODUCT.sub(lambda product: "*".join(filter(None, product.groups())), text)
    if not _CELSIUS.fullmatch(text):
        text = _CELSIUS.sub("delta_degC", text)
    try:
        if len(unit) > _LONGEST_UNIT or not _UNIT_TEXT.fullmatch(text):
            raise ValueError
        one, zero = (_make_registry().Quantity(Decimal(number), text).to_base_units() for number in (1, 0))
        factor, offset = float(one.magnitude - zero.magnitude), float(zero.magnitude)
        known = 0.0 < factor < float("inf")
    except Exception:  # pint raises many exception types, including those of Python's tokenizer
        known = False
    if not known:
        shown = unit if len(unit) <= _LONGEST_UNIT else unit[:_LONGEST_UNIT] + "..."
        hint = f"{suggest_closest(unit, _COMMON_UNITS)}; products and quotients such as kg m^2/s are allowed"
        raise InputError(f"unit {shown!r} is unknown; {hint}")
    return factor, offset, str(one.units)


@cache
def _make_registry() -> "pint.UnitRegistry":
    """Return a pint registry with decimal numbers, so that a factor is the float nearest to its decimal value."""
    import pint

    return pint.UnitRegistry(non_int_type=Decimal, autoconvert_offset_to_baseunit=True)
