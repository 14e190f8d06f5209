"""Bus load: share of the bus time that the frames of the DBC need in the worst case.

Equation        bits = 8 n + g + 10 + floor((g + 8 n - 1) / 4) + 3: data frame of n bytes, worst-case stuff bits, three bits
                between frames; g = 34 for a standard identifier, 54 for an extended one
References      Davis, Burns, Bril, Lukkien 2007, Controller Area Network (CAN) schedulability analysis, eq. 4
                (8 n + 47 includes the three bits between frames)
"""

from collections.abc import Iterable
from typing import Protocol

BITRATES = (500_000, 1_000_000)  # bit/s: usual rates of high-speed CAN
_HIGHEST_RATE = 10_000  # Hz: highest control rate of the bench; the search ends there
_NOMINAL_RATE = 1000  # Hz: the cycle times in the DBC hold for this control rate
_STANDARD_BITS, _EXTENDED_BITS = 34, 54  # stuffed bits of a frame without data: g of eq. 4


class Cyclic(Protocol):
    """A frame: its payload of `length` [bytes], sent every `cycle_time` [s], 0 where not known. extended: its identifier."""

    @property
    def length(self) -> int: ...

    @property
    def cycle_time(self) -> float: ...

    @property
    def extended(self) -> bool: ...


def count_worst_bits(length: int, extended: bool = False) -> int:
    """Return the bits of a data frame with `length` bytes, with the most stuff bits possible."""
    stuffed = _EXTENDED_BITS if extended else _STANDARD_BITS
    return 8 * length + stuffed + 10 + (stuffed + 8 * length - 1) // 4 + 3


def compute_frame_rate(codec: Cyclic, rate: int) -> float:
    """Return frames per second at the control `rate` [Hz]: frames of every cycle follow it, slower ones keep their period."""
    cycle = codec.cycle_time
    if not cycle:
        return 0.0
    return float(rate) if cycle <= 1.0 / _NOMINAL_RATE else 1.0 / cycle


def compute_bus_load(codecs: Iterable[Cyclic], rate: int, bitrate: int) -> float:
    """Return the worst-case bus load at control `rate` [Hz] and `bitrate` [bit/s]; above 1 the bus is overloaded."""
    return (
        sum(compute_frame_rate(codec, rate) * count_worst_bits(codec.length, codec.extended) for codec in codecs)
        / bitrate
    )


def find_highest_rate(codecs: Iterable[Cyclic], bitrate: int, load: float = 0.8) -> int:
    """Return the highest control rate [Hz], a multiple of 10, with a worst-case bus load below `load`."""
    frames = list(codecs)
    rate = 0
    while rate < _HIGHEST_RATE and compute_bus_load(frames, rate + 10, bitrate) < load:
        rate += 10
    return rate
