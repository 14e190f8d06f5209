"""Signals of CAN frames: decode all frames of a message at once, with the result of cantools for each; a test compares them.

Equation        value = raw scale + offset. Bits are numbered as in the DBC: bit b of byte a is 8 a + b. A little-endian signal
                goes up from its lowest bit; a big-endian one begins at its highest and goes down, byte by byte
"""

from collections.abc import Iterator

import numpy as np
from cantools.database.can import Message, Signal

from clutch_hil.recordings.value_tables import find_missing

_ROWS = 1 << 16  # frames decoded at once: with 64 bytes each, 34 MB of bits
_FLOATS = {16: np.float16, 32: np.float32, 64: np.float64}


def list_bit_places(signal: Signal) -> list[int]:
    """Return the bit positions of a signal, lowest bit first."""
    if signal.byte_order == "little_endian":
        return list(range(signal.start, signal.start + signal.length))
    places = [signal.start]
    for _ in range(signal.length - 1):
        places.append(places[-1] - 1 if places[-1] % 8 else places[-1] + 15)
    return places[::-1]


def read_raw_values(signal: Signal, payloads: np.ndarray) -> np.ndarray:
    """Return the raw numbers (n,) of a signal in `payloads`, shape (n, bytes): integers, or floats for a float signal."""
    places = list_bit_places(signal)
    parts = []
    for first in range(0, len(payloads), _ROWS):
        bits = np.unpackbits(payloads[first : first + _ROWS], axis=1, bitorder="little")
        number = np.zeros(len(bits), np.uint64)
        for power, place in enumerate(places):
            number |= bits[:, place].astype(np.uint64) << np.uint64(power)
        parts.append(number)
    number = np.concatenate(parts) if parts else np.zeros(0, np.uint64)
    if signal.is_float:
        return number.astype(f"u{signal.length // 8}").view(_FLOATS[signal.length])
    if signal.is_signed:
        shift = np.uint64(64 - signal.length)
        signed: np.ndarray = (number << shift).view(np.int64) >> np.int64(64 - signal.length)
        return signed
    return number


def read_physical_values(signal: Signal, payloads: np.ndarray) -> np.ndarray:
    """Return the physical values (n,) of a signal in the database's unit; NaN where its value table marks a missing value."""
    raw = read_raw_values(signal, payloads)
    with np.errstate(invalid="ignore", over="ignore"):  # a float may be any pattern of bits
        values: np.ndarray = raw.astype(np.float64) * float(signal.scale) + float(signal.offset)
    if signal.choices:
        values[find_missing(signal, raw)] = np.nan
    return values


def find_rows_with_signal(message: Message, signal: Signal, payloads: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the frames that contain a signal: all, except for a multiplexed signal."""
    rows = np.ones(len(payloads), bool)
    by_name = {one.name: one for one in message.signals}
    for multiplexer, ids in list_multiplexers(signal, by_name):
        rows &= np.isin(read_raw_values(multiplexer, payloads).astype(np.int64), ids)
    return rows


def list_multiplexers(signal: Signal, by_name: dict[str, Signal]) -> Iterator[tuple[Signal, list[int]]]:
    """Yield the multiplexers of a signal, each with the numbers that select it."""
    seen: set[str] = set()
    while signal.multiplexer_signal and signal.multiplexer_ids is not None and signal.name not in seen:
        seen.add(signal.name)
        parent = by_name[signal.multiplexer_signal]
        yield parent, list(signal.multiplexer_ids)
        signal = parent
