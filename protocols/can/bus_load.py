"""Bus load: the share of the wire that the frames of the DBC take in the worst case.

Equation        bits = 8 n + 44 + floor((34 + 8 n - 1) / 4) + 3: standard data frame of n bytes, worst-case stuff bits,
                three bits between frames
References      Davis, Burns, Bril, Lukkien 2007, Controller Area Network (CAN) schedulability analysis, eq. 4
                (8 n + 47 includes the three bits between frames)
"""

from collections.abc import Iterable

from protocols.can.frames import FrameCodec

BITRATES = (500_000, 1_000_000)  # bit/s
_HIGHEST = 10_000  # Hz, where the search ends: the highest rate of the bench
_NOMINAL_RATE = 1000  # Hz: cycle times in the DBC are for this rate


def worst_bits(length: int) -> int:
    """Bits on the wire of a standard data frame with `length` bytes, stuffed as badly as can be."""
    return 8 * length + 44 + (34 + 8 * length - 1) // 4 + 3


def frame_rate(codec: FrameCodec, rate: int) -> float:
    """Frames a second when the loop runs at `rate` [Hz]: frames of every cycle follow it, slower ones keep their time."""
    cycle = codec.cycle_time
    if not cycle:
        return 0.0
    return float(rate) if cycle <= 1.0 / _NOMINAL_RATE else 1.0 / cycle


def bus_load(codecs: Iterable[FrameCodec], rate: int, bitrate: int) -> float:
    """Worst-case share of the wire at control `rate` [Hz] and `bitrate` [bit/s]; above 1 it does not fit."""
    return sum(frame_rate(codec, rate) * worst_bits(codec.length) for codec in codecs) / bitrate


def highest_rate(codecs: Iterable[FrameCodec], bitrate: int, load: float = 0.8) -> int:
    """Highest control rate [Hz], in steps of 10, whose worst-case load stays below `load`."""
    frames = list(codecs)
    rate = 0
    while rate < _HIGHEST and bus_load(frames, rate + 10, bitrate) < load:
        rate += 10
    return rate
