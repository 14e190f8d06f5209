"""Packing: how netCDF stores numbers in an HDF5 file, and which of them stand for no value."""

import contextlib
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import numpy as np

from clutch_hil.recordings.hdf5_file import Hdf5File

_NO_VALUE = ("_FillValue", "missing_value")  # netCDF (CF conventions, 2.5.1): the number that stands for none


@dataclass(frozen=True)
class Packing:
    """How netCDF packs numbers: value = scale * number + offset (CF conventions, 8.1), and numbers that stand for none.

    unsigned_bits: of whole numbers that are stored as signed ones and are not; 0 for others. What is below `lowest` or above
    `highest` is missing; of_values: these two are values, not the numbers that are stored.
    """

    scale: float = 1.0
    offset: float = 0.0
    missing: tuple[float, ...] = ()
    unsigned_bits: int = 0
    lowest: float = -inf
    highest: float = inf
    of_values: bool = False

    def unpack(self, stored: np.ndarray) -> tuple[np.ndarray, int]:
        """Values (n,), and how many are missing as they are outside of the limits."""
        numbers = np.where(stored < 0.0, stored + 2.0**self.unsigned_bits, stored) if self.unsigned_bits else stored
        values = self.scale * numbers + self.offset
        absent, limited = np.isin(numbers, self.missing), values if self.of_values else numbers
        outside = ((limited < self.lowest) | (limited > self.highest)) & ~absent
        return np.where(absent | outside, np.nan, values), int(np.count_nonzero(outside))


def read_packing(file: Hdf5File, data: Any) -> Packing | None:
    """How a dataset is packed, by its attributes; None where it is not."""
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
    """A number of `bits` bits that was stored as a signed one; for 0 bits as it is."""
    return float(number + 2**bits if bits and -(2 ** (bits - 1)) <= number < 0 else number)
