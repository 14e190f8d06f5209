"""Packing: storage of numbers by netCDF in an HDF5 file, and numbers that mark missing values."""

import contextlib
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import numpy as np

from clutch_hil.recordings.hdf5.file import Hdf5File

_NO_VALUE = ("_FillValue", "missing_value")  # netCDF (CF conventions, 2.5.1): numbers that mark missing values


@dataclass(frozen=True)
class Packing:
    """Packing of netCDF: value = scale * number + offset (CF conventions, 8.1).

    missing: numbers that mark missing values. unsigned_bits: size of unsigned integers that are stored as signed ones; 0 for
    others. lowest, highest: values outside are missing. of_values: whether these limits are for values, not for stored numbers.
    """

    scale: float = 1.0
    offset: float = 0.0
    missing: tuple[float, ...] = ()
    unsigned_bits: int = 0
    lowest: float = -inf
    highest: float = inf
    of_values: bool = False

    def unpack(self, stored: np.ndarray) -> tuple[np.ndarray, int]:
        """Return the values (n,), and the number of values that are missing because they are outside the limits."""
        numbers = np.where(stored < 0.0, stored + 2.0**self.unsigned_bits, stored) if self.unsigned_bits else stored
        values = self.scale * numbers + self.offset
        absent, limited = np.isin(numbers, self.missing), values if self.of_values else numbers
        outside = ((limited < self.lowest) | (limited > self.highest)) & ~absent
        return np.where(absent | outside, np.nan, values), int(np.count_nonzero(outside))


def read_packing(file: Hdf5File, data: Any) -> Packing | None:
    """Return the packing of a dataset from its attributes; None if it is not packed."""
    numbers = {}
    for key in ("scale_factor", "add_offset"):
        with contextlib.suppress(ValueError):
            numbers[key] = float(file.read_attribute(data, key))
    bits = 0
    if data.dtype.kind == "i" and file.read_attribute(data, "_Unsigned").strip().lower() == "true":
        bits = 8 * data.dtype.itemsize
    missing = [n for key in _NO_VALUE for n in file.read_numbers(data, key)]
    limits = file.read_numbers(data, "valid_range")
    if len(limits) != 2:
        ends = (file.read_numbers(data, key) for key in ("valid_min", "valid_max"))
        limits = [end[0] if len(end) == 1 else otherwise for end, otherwise in zip(ends, (-inf, inf), strict=True)]
    low, high = (_make_unsigned(n, bits) for n in limits)
    packing = Packing(
        numbers.get("scale_factor", 1.0),
        numbers.get("add_offset", 0.0),
        tuple(_make_unsigned(n, bits) for n in missing),
        bits,
        low,
        high,
        of_values=data.dtype.kind in "iu" and any(isinstance(n, float) and isfinite(n) for n in limits),
    )
    return None if packing == Packing() else packing


def _make_unsigned(number: float, bits: int) -> float:
    """Convert a number of `bits` bits that was stored as signed to unsigned; no change for 0 bits."""
    return float(number + 2**bits if bits and -(2 ** (bits - 1)) <= number < 0 else number)
