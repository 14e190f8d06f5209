"""Allowed limits: units and ranges of the values in limits.toml. A wrong unit or an unlimited range would not protect."""

from collections.abc import Mapping
from typing import Protocol

from protocols.errors import InputError

# Unit and widest range of each limit; the guard accepts no other, whatever limits.toml declares. A range ends at the end of
# the signal's range, or where the limit would no longer protect: 100 cycles are 0.1 s at 1 kHz. slip_speed also depends on the
# rate, see `check_speed`. motor_range, pressure_range: ranges that frames of any size can carry; data_key: 14 bits
ALLOWED: Mapping[str, tuple[str, float, float]] = {
    "stale_cycles": ("cycles", 1.0, 100.0), "confirm_samples": ("1", 1.0, 100.0), "pressure": ("bar", 1.0, 59.4),
    "temperature": ("degC", 40.0, 190.0), "slip_speed": ("rad/s", 1.0, 1000.0), "voltage": ("V", 0.1, 9.9998),
    "motor_torque": ("Nm", 0.0, 3500.0), "motor_range": ("Nm", 65.536, 4600.0), "pressure_range": ("bar", 10.0, 60.0),
    "data_key": ("1", 0.0, 16383.0), "temperature_low": ("degC", -100.0, 30.0),
    "temperature_step": ("K", 1.0, 50.0), "frozen_voltage": ("V", 0.02, 1.0), "frozen_dwell": ("s", 0.01, 0.5),
}  # fmt: skip
# Of the pressure's range: at its end the converter is full, and a higher pressure reads the same
_HIGHEST_PRESSURE = 0.99
# rad from one sample to the next. A frame has 2^18 counts of the angle, 163840 a turn: from 5.03 rad on a fast shaft looks slow
_FARTHEST_TURN = 5.0


class Limit(Protocol):
    """A limit as a file declares it: value and bounds in `unit`."""

    @property
    def value(self) -> float:
        """See the class."""

    @property
    def unit(self) -> str:
        """See the class."""

    @property
    def bounds(self) -> tuple[float, float]:
        """See the class."""


def check_limits(limits: Mapping[str, Limit]) -> None:
    """Raise InputError if one of `limits` (by dotted name) is missing, has another unit or is outside ALLOWED."""
    names = {name.partition(".")[2]: one for name, one in limits.items() if name.startswith("guard.")}
    for name, (unit, low, high) in ALLOWED.items():
        if (limit := names.get(name)) is None:
            raise InputError(f"the guard has no limit guard.{name}; it is needed in {unit}, {low:g} to {high:g}")
        if limit.unit != unit:
            raise InputError(f"the guard's limit guard.{name} is in {limit.unit!r}; it is needed in {unit}")
        for value in (limit.value, *limit.bounds):
            if not low <= value <= high:
                raise InputError(
                    f"the guard's limit guard.{name} has {value:g} {unit}; allowed are {low:g} to {high:g} {unit}"
                )
    torque, most = names["motor_torque"].value, names["motor_range"].value
    if torque >= most:
        raise InputError(
            f"the guard's limit guard.motor_torque has {torque:g} Nm; allowed is less than guard.motor_range, {most:g} Nm"
        )
    pressure, most = names["pressure"].value, _HIGHEST_PRESSURE * names["pressure_range"].value
    if pressure > most:
        raise InputError(
            f"the guard's limit guard.pressure has {pressure:g} bar; allowed is up to {most:g} bar, {_HIGHEST_PRESSURE:.0%} of"
            " guard.pressure_range"
        )
    if not (key := names["data_key"].value).is_integer():
        raise InputError(f"the guard's limit guard.data_key has {key:g}; allowed is the whole number of the database")
    if more := sorted(set(names) - set(ALLOWED)):
        raise InputError(f"the guard does not know the limit guard.{more[0]}; it knows {', '.join(ALLOWED)}")


def check_speed(limits: Mapping[str, Limit], rate: int) -> None:
    """Raise InputError if a faster slip than the limit could not be seen, at `rate` samples per second: the angle wraps."""
    speed, most = limits["guard.slip_speed"].value, _FARTHEST_TURN * rate
    if speed > most:
        raise InputError(
            f"the guard's limit guard.slip_speed has {speed:g} rad/s; at {rate} Hz allowed is up to {most:g} rad/s, because the"
            " angle wraps around between two samples"
        )
