"""Units people write and the SI values the code computes with.

Bar and degC stand in TOML, frames, run files and on screens; inside, everything is SI (Pa, K, N, m, s, rad). What a unit is, is
known by pint. A unit is looked at where a file is loaded, once a unit and process; no loop converts.
"""

import re
from decimal import Decimal
from functools import cache

import pint

from protocols.errors import InputError, closest

BAR = 1e5  # Pa, by definition
ZERO_CELSIUS = 273.15  # K, by definition
RPM = 0.10471975511965977  # rad/s, 2 pi / 60

_LONGEST = 80  # characters of a unit; what is longer is none
# Things are counted: one cycle of a loop or one line of an encoder is no angle, as pint has it.
_COUNTED = ("counts/rev", "cycles")
# Units by which a wrong one is explained
_COMMON = (
    "1", "%", "bar", "mbar", "Pa", "kPa", "MPa", "psi", "degC", "degF", "K", "Nm", "N", "kN", "V", "mV", "A", "mA", "s", "ms",
    "us", "min", "Hz", "rad", "deg", "rad/s", "rpm", "m", "mm", "um", "m/s", "l/min", "kg", "W", "kW", "J", "kg m^2", "Pa s",
)  # fmt: skip
_TEXT = re.compile(r"[\w%°/*^().-][\w %°/*^().-]*")
_PRODUCT = re.compile(
    r"\b([kMmun]?N)(mm|m|(?=s))(s?)\b"
)  # Nm is a product; in pint it would be a number of textile metres
_CELSIUS = re.compile(r"degC|°C")  # in a product or quotient it is a difference, of 1 K
_GAMMA = "(rad/s)^gamma"  # SI whatever gamma is; a unit of friction maps


def to_si(value: float, unit: str) -> float:
    """Return `value` given in `unit` as an SI value. Raises InputError for what is no unit."""
    factor, offset, _ = _meaning(unit)
    return factor * value + offset


def from_si(value: float, unit: str) -> float:
    """Return the SI `value` in `unit`; the inverse of `to_si`. Raises InputError."""
    factor, offset, _ = _meaning(unit)
    return (value - offset) / factor


def same_quantity(unit: str, other: str) -> bool:
    """Whether values in the two units can be converted into each other. Raises InputError.

    An angle counts: 1 Hz is no 1 rad/s.
    """
    return _meaning(unit)[2] == _meaning(other)[2]


@cache
def _meaning(unit: str) -> tuple[float, float, str]:
    """Factor and offset, with SI value = factor * value + offset, and the SI base units."""
    if unit in _COUNTED:
        return 1.0, 0.0, unit
    text = unit.replace(_GAMMA, "rad")
    text = _PRODUCT.sub(lambda found: "*".join(filter(None, found.groups())), text)
    if not _CELSIUS.fullmatch(text):
        text = _CELSIUS.sub("delta_degC", text)
    try:
        if len(unit) > _LONGEST or not _TEXT.fullmatch(text):
            raise ValueError
        one, zero = (_registry().Quantity(Decimal(number), text).to_base_units() for number in (1, 0))
        factor, offset = float(one.magnitude - zero.magnitude), float(zero.magnitude)
        known = 0.0 < factor < float("inf")
    except Exception:  # pint raises many kinds, those of Python's tokenizer among them
        known = False
    if not known:
        shown = unit if len(unit) <= _LONGEST else unit[:_LONGEST] + "..."
        hint = f"{closest(unit, _COMMON)}; products and quotients such as kg m^2/s are allowed"
        raise InputError(f"unit {shown!r} is unknown; {hint}")
    return factor, offset, str(one.units)


@cache
def _registry() -> pint.UnitRegistry:
    """Decimal numbers: a factor is the float next to it, as if it were written down."""
    return pint.UnitRegistry(non_int_type=Decimal, autoconvert_offset_to_baseunit=True)
