"""Frames of the usual lines of a text log, parsed by a compiled loop: 0.1 us a frame; a reader in Python needs 9 us.

Usual           candump -L: `(1.25) can0 123#0011 R`, classic data frames only; ASC in hex: `1.25 1 123x Rx d 2 00 11 ...`
Others          every other line is left to python-can's reader (`bus_log.py`): remarks, remote, error and FD frames, damaged
                lines, and the last line of a file that does not end with a line break
Exact           a time is an integer of less than 2^53 over a power of ten of at most 22: one division, rounded as float() does
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit

_PART = 1 << 24  # bytes that are parsed at once
_MOST_CHANNELS = 64  # distinct names; a log with more is left to the reader, which refuses it
_LONGEST_NAME = 32  # characters of a channel
_MOST_DATA = 8  # bytes of a classic frame
_MANTISSA, _MOST_POWER = 1 << 53, 22  # see Exact
_HIGHEST_STANDARD, _HIGHEST_EXTENDED = 0x7FF, 0x1FFFFFFF
_HEX = np.full(256, 255, np.uint8)  # value of a hexadecimal digit
for _digit in range(16):
    _HEX[ord(f"{_digit:x}")] = _HEX[ord(f"{_digit:X}")] = _digit
_POWERS = 10.0 ** np.arange(_MOST_POWER + 1)
FRAME = np.dtype([("line", "i8"), ("stamp", "f8"), ("can_id", "u4"), ("extended", "u1"), ("channel", "u2"), ("length", "u1"),
                  ("data", "u1", (_MOST_DATA,))])  # fmt: skip


@dataclass(frozen=True)
class UsualLines:
    """`frames` (n,) of FRAME, in the order of the file; `channels`: names by number; `others`: text of the other lines.

    numbers: of the other lines in the file, from 1. before_last: the line before an incomplete last line, else empty.
    """

    frames: np.ndarray
    channels: tuple[str, ...]
    others: bytes
    numbers: np.ndarray
    before_last: bytes


def read_usual_lines(path: Path, kind: str, most: int) -> UsualLines:
    """Parse the usual lines of a candump or ASC log (`kind`); stop after the part in which `most` frames are exceeded."""
    names = np.zeros((_MOST_CHANNELS, _LONGEST_NAME), np.uint8)
    frames, others, numbers, lines, last, before_last = [], [], [], 0, b"", b""
    for part in _read_parts(path):
        text = np.frombuffer(part, np.uint8)
        count = part.count(b"\n")
        into, ends = np.zeros(count, FRAME), np.zeros(count, np.int64)
        usual = _parse(text, lines, kind == "asc", names, into, ends)
        frames.append(into[usual])
        odd = np.flatnonzero(~usual)
        begins = np.concatenate([[0], ends[:-1] + 1]) if count else ends
        others += [part[begin : end + 1] for begin, end in zip(begins[odd].tolist(), ends[odd].tolist(), strict=True)]
        numbers.append(odd + lines + 1)
        lines += count
        last = part[begins[-1] : ends[-1]] if count else last
        if not part.endswith(b"\n"):
            others.append(part[ends[-1] + 1 :] if count else part)
            numbers.append(np.array([lines + 1]))
            before_last = last
        if sum(map(len, frames)) > most:
            break
    channels = tuple(bytes(name).rstrip(b"\0").decode() for name in names)
    return UsualLines(
        np.concatenate([np.zeros(0, FRAME), *frames]), channels, b"".join(others),
        np.concatenate([np.zeros(0, np.int64), *numbers]), before_last,
    )  # fmt: skip


def _read_parts(path: Path) -> Iterator[bytes]:
    """Yield the file in parts that end with a line break, except the last part."""
    with path.open("rb") as file:
        before = b""
        while part := file.read(_PART):
            end = part.rfind(b"\n") + 1
            if end:
                yield before + part[:end]
                before = part[end:]
            else:
                before += part
        if before:
            yield before


@njit(cache=True, nogil=True)
def _parse(text, first_line, is_asc, names, into, ends):
    """Parse each line that ends with a line break into `into` (lines,), its end into `ends`. Return which lines are usual."""
    usual = np.zeros(ends.size, np.bool_)
    line, begin = 0, 0
    for at in range(text.size):
        if text[at] == 10:
            ends[line] = at
            end = at - 1 if at > begin and text[at - 1] == 13 else at
            usual[line] = (
                _parse_asc(text, begin, end, names, into[line])
                if is_asc
                else _parse_candump(text, begin, end, names, into[line])
            )
            into[line].line = first_line + line + 1
            line, begin = line + 1, at + 1
    return usual


@njit(cache=True, nogil=True)
def _parse_candump(text, at, end, names, frame):
    """Parse `(TIME) CHANNEL ID#DATA [R|T]`, the whole line `text[at:end]`, into `frame`; return whether it is usual."""
    if at >= end or text[at] != 40:
        return False
    at, frame.stamp = _parse_time(text, at + 1, end)
    if at < 0 or at >= end or text[at] != 41:
        return False
    at = _skip_blanks(text, at + 1, end)
    if at < 0:
        return False
    at, frame.channel = _parse_channel(text, at, end, names)
    if at < 0:
        return False
    at = _skip_blanks(text, at, end)
    if at < 0:
        return False
    begin = at
    at, frame.can_id = _parse_hex(text, at, end, 8)
    digits = at - begin
    if at >= end or text[at] != 35 or (digits != 3 and digits != 8):
        return False
    frame.extended = digits == 8
    if frame.can_id > (_HIGHEST_EXTENDED if frame.extended else _HIGHEST_STANDARD):
        return False
    at += 1
    count = 0
    while at + 1 < end and count < _MOST_DATA and _HEX[text[at]] < 16 and _HEX[text[at + 1]] < 16:
        frame.data[count] = 16 * _HEX[text[at]] + _HEX[text[at + 1]]
        at, count = at + 2, count + 1
    frame.length = count
    if at == end:
        return True
    at = _skip_blanks(text, at, end)
    return at == end - 1 and (text[at] == 82 or text[at] == 84)  # R, T


@njit(cache=True, nogil=True)
def _parse_asc(text, at, end, names, frame):
    """Parse `TIME CHANNEL ID[x] Rx|Tx d LENGTH DATA`, then any text after a blank. Return whether the line is usual.

    The line is `text[at:end]`; the result is `frame`.
    """
    while at < end and text[at] == 32:
        at += 1
    at, frame.stamp = _parse_time(text, at, end)
    if at < 0:
        return False
    at = _skip_blanks(text, at, end)
    if at < 0 or text[at] < 49 or text[at] > 57:  # channels are counted from 1
        return False
    begin = at
    at, frame.channel = _parse_channel(text, at, end, names)
    if at < 0:
        return False
    for k in range(begin, at):
        if text[k] < 48 or text[k] > 57:
            return False
    at = _skip_blanks(text, at, end)
    if at < 0:
        return False
    begin = at
    at, frame.can_id = _parse_hex(text, at, end, 8)
    if at == begin or at >= end:
        return False
    frame.extended = text[at] == 120 or text[at] == 88  # x
    at += frame.extended
    if frame.can_id > (_HIGHEST_EXTENDED if frame.extended else _HIGHEST_STANDARD):
        return False
    at = _skip_blanks(text, at, end)
    if at < 0 or at + 2 > end or (text[at] != 82 and text[at] != 84) or text[at + 1] != 120:  # Rx, Tx
        return False
    at = _skip_blanks(text, at + 2, end)
    if at < 0 or text[at] != 100:  # d
        return False
    at = _skip_blanks(text, at + 1, end)
    if at < 0 or text[at] < 48 or text[at] > 56:
        return False
    frame.length = text[at] - 48
    at += 1
    for count in range(frame.length):
        at = _skip_blanks(text, at, end)
        if at < 0 or at + 2 > end or _HEX[text[at]] > 15 or _HEX[text[at + 1]] > 15:
            return False
        frame.data[count] = 16 * _HEX[text[at]] + _HEX[text[at + 1]]
        at += 2
    return at == end or text[at] == 32


@njit(cache=True, nogil=True)
def _skip_blanks(text, at, end):
    """Return the position after at least one blank, before the end; -1 if there is none."""
    begin = at
    while at < end and text[at] == 32:
        at += 1
    return at if begin < at < end else -1


@njit(cache=True, nogil=True)
def _parse_time(text, at, end):
    """Return the position after a time with a decimal point, and the time; position -1 if there is none."""
    number, power, digits, point = np.int64(0), 0, 0, False
    while at < end:
        code = text[at]
        if 48 <= code <= 57:
            number, digits, power = 10 * number + (code - 48), digits + 1, power + point
            if number >= _MANTISSA:
                return -1, 0.0
        elif code == 46 and not point and digits:
            point = True
        else:
            break
        at += 1
    if power == 0 or power > _MOST_POWER:
        return -1, 0.0
    return at, number / _POWERS[power]


@njit(cache=True, nogil=True)
def _parse_hex(text, at, end, most):
    """Return the position after at most `most` hexadecimal digits, and their number."""
    number, begin = np.int64(0), at
    while at < end and at - begin < most and _HEX[text[at]] < 16:
        number = 16 * number + _HEX[text[at]]
        at += 1
    return at, number


@njit(cache=True, nogil=True)
def _parse_channel(text, at, end, names):
    """Return the position after a channel name, and its number in `names`; -1 if it is missing or unusual."""
    size = 0
    while at + size < end and text[at + size] != 32:
        code = text[at + size]
        if size >= _LONGEST_NAME or code < 33 or code > 126 or code == 40:
            return -1, 0
        size += 1
    if size == 0 or (text[at] == 48 and size > 1):  # python-can reads 00 as the number 0
        return -1, 0
    for number in range(names.shape[0]):
        same = names[number, 0] == 0  # a free place
        if same:
            names[number, :size] = text[at : at + size]
        else:
            same = size == _LONGEST_NAME or names[number, size] == 0
            for k in range(size):
                same = same and names[number, k] == text[at + k]
        if same:
            return at + size, number
    return -1, 0
