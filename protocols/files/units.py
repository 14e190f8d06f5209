"""Units people write and the SI values the code computes with.

Bar and degC stand in TOML, frames, run files and on screens; inside, everything is SI (Pa, K, N, m, s, rad).
"""

from protocols.errors import InputError, listing

BAR = 1e5  # Pa, by definition
ZERO_CELSIUS = 273.15  # K, by definition
RPM = 0.10471975511965977  # rad/s, 2 pi / 60

# unit -> (factor, offset): SI value = factor * value + offset
_SI = (
    *("1", "bit", "cycles", "counts/rev", "s", "1/s", "Hz", "m", "m^2", "rad", "rad/s", "rad/s^2", "V", "V/s", "V/K"),
    *("V/Nm", "K", "J/K", "W/K", "N", "N/m", "Ns/m", "Nm", "Nm/s", "Nm/rad", "Nm s/rad", "Nm/(rad/s)^gamma", "kg m^2"),
    *(
        "A",
        "N/A",
        "Nm/V",
        "kg",
        "m/s",
        "s/m",
        "m^3",
        "1/m",
        "1/K",
        "1/rad",
        "1/Nm",
        "N/K",
        "Nm/K",
        "J",
        "W",
        "K/W",
        "K/J",
    ),
    *("Pa s", "kg/m^3", "Nm/(rad/s)", "rad/Nm", "1/J", "1/W", "m/N"),
)
_TO_SI: dict[str, tuple[float, float]] = dict.fromkeys(_SI, (1.0, 0.0)) | {
    "bar": (BAR, 0.0),
    "bar/V": (BAR, 0.0),
    "bar/Nm": (BAR, 0.0),
    "bar/(Nm s)": (BAR, 0.0),
    "bar/s": (BAR, 0.0),
    "Nm/bar": (1 / BAR, 0.0),
    "Nm/(bar (rad/s)^gamma)": (1 / BAR, 0.0),
    "V/bar": (1 / BAR, 0.0),
    "m^3/bar": (1 / BAR, 0.0),
    "m^3/(s bar)": (1 / BAR, 0.0),
    "N/bar": (1 / BAR, 0.0),
    "1/bar": (1 / BAR, 0.0),
    "bar s": (BAR, 0.0),
    "bar s/m^3": (BAR, 0.0),
    "bar/(rad/s)^2": (BAR, 0.0),
    "bar/K": (BAR, 0.0),
    "ms": (1e-3, 0.0),
    "us": (1e-6, 0.0),
    "mm": (1e-3, 0.0),
    "um": (1e-6, 0.0),
    "uN": (1e-6, 0.0),
    "kN": (1e3, 0.0),
    "mV": (1e-3, 0.0),
    "Pa": (1.0, 0.0),
    "kPa": (1e3, 0.0),
    "MPa": (1e6, 0.0),
    "deg": (0.017453292519943295, 0.0),  # rad, pi / 180
    "degC": (1.0, ZERO_CELSIUS),
    "rpm": (RPM, 0.0),
}  # fmt: skip


def to_si(value: float, unit: str) -> float:
    """Return `value` given in `unit` as an SI value.

    Raises InputError for a unit that is not in the table.
    """
    try:
        factor, offset = _TO_SI[unit]
    except KeyError:
        raise InputError(f"unit {unit!r} is unknown; known are {listing(_TO_SI)}") from None
    return factor * value + offset


def from_si(value: float, unit: str) -> float:
    """Return the SI `value` in `unit`; the inverse of `to_si`. Raises InputError."""
    offset = to_si(0.0, unit)
    return (value - offset) / (to_si(1.0, unit) - offset)
