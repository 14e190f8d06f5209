"""Value tables: meaning of the names that a DBC gives to raw values (VAL_): states, numbers, or missing values.

Rule            A table names the states of a status if the signal has no unit, scale and offset, or if all its possible values
                are named. Otherwise it names single values of a number; those whose name says so are missing (SNA, error,
                reserved), the others stay numbers
"""

from collections.abc import Mapping
from math import ceil, floor

import numpy as np
from cantools.database.can import Signal

from clutch_hil.recordings.channel import simplify_unit
from clutch_hil.recordings.state_names import says_no_value

_ROUNDING = 1e-6  # tolerance of a raw value: limits in a database are decimal numbers


def is_status(signal: Signal) -> bool:
    """Return whether a signal is a status: one bit, or named states."""
    if signal.length == 1:
        return True
    if not signal.choices:
        return False
    plain = (signal.scale, signal.offset) == (1, 0) and simplify_unit(signal.unit or "") in ("", "1")
    return plain or _names_all(signal)


def list_missing(signal: Signal) -> Mapping[int, str]:
    """Return raw values of a numeric signal that its table marks as missing, with their names; empty for a status."""
    if not signal.choices or signal.is_float or is_status(signal):
        return {}
    return {_wrap(signal, raw): str(name) for raw, name in signal.choices.items() if says_no_value(str(name))}


def list_names(signal: Signal) -> Mapping[float, str]:
    """Return the names of the values of a status signal; empty for another signal."""
    if not signal.choices or signal.is_float or not is_status(signal):
        return {}
    scale, offset = float(signal.scale), float(signal.offset)
    return {scale * _wrap(signal, raw) + offset: str(name) for raw, name in signal.choices.items()}


def list_state_names(signal: Signal) -> Mapping[float, str]:
    """Return the names of the values of a status signal, without those for missing values; empty for another signal."""
    return {value: name for value, name in list_names(signal).items() if not says_no_value(name)}


def find_missing(signal: Signal, raw: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the raw values that a signal's table marks as missing."""
    mask = np.zeros(len(raw), bool)
    for number in list_missing(signal):
        if _find_lowest(signal) <= number <= _find_highest(signal):
            mask |= raw == raw.dtype.type(number)
    return mask


def _names_all(signal: Signal) -> bool:
    """Return whether a table names all raw values, or all within the limits in the database."""
    if signal.is_float or not signal.choices:
        return False
    named = {_wrap(signal, raw) for raw in signal.choices}
    least, most = _find_lowest(signal), _find_highest(signal)
    if signal.minimum is not None and signal.maximum is not None and signal.scale:
        ends = sorted((float(limit) - signal.offset) / signal.scale for limit in (signal.minimum, signal.maximum))
        least, most = max(least, ceil(ends[0] - _ROUNDING)), min(most, floor(ends[1] + _ROUNDING))
    return least <= most and sum(least <= raw <= most for raw in named) == most - least + 1


def _wrap(signal: Signal, raw: int) -> int:
    """Return a raw value of a table with the signal's sign: some databases write values of signed signals as unsigned."""
    return raw - (1 << signal.length) if signal.is_signed and raw > _find_highest(signal) else raw


def _find_lowest(signal: Signal) -> int:
    return -(1 << signal.length - 1) if signal.is_signed else 0


def _find_highest(signal: Signal) -> int:
    return (1 << signal.length - 1) - 1 if signal.is_signed else (1 << signal.length) - 1
