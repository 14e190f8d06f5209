"""Other units: the one in which a refused number may have been meant, such as 235000 Pa for 2.35 bar."""

from math import pi

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
}
_KELVIN, _CELSIUS, _ZERO = "K", "degC", 273.15


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
    return f"; {value:g} {other} would be {converted:.4g} {unit}"
