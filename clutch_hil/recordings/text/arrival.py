"""Times at which lines arrived, which a serial monitor writes before them: `14:05:07.010 -> 0,1.25,6.1` of Arduino.

They become a column of their own, parted as the others are. Its name is put before lines that begin with a word, such as names.
"""

import re

ARRIVAL = "arrival_time"  # name of the column
_TIME, _ARROW = rb"[0-9]{2}:[0-9]{2}:[0-9]{2}\.[0-9]{3}", rb" -> "
STAMP = _TIME + _ARROW  # pattern of what stands before a line
_STAMPED = re.compile(rb"(?m)^(" + _TIME + rb")" + _ARROW + rb"(?=([^\n]?))")
_JUDGED_LINES = 100  # that tell whether lines have such times
_DELIMITERS = (b"\t", b";", b",")


def find_delimiter_of_stamps(lines: bytes) -> bytes:
    """Return what parts the cells of whole lines if each has the time of its arrival, b"" if not all have one,
    or words follow it also in the last one."""
    given = [line for line in lines.split(b"\n") if line.strip()][:_JUDGED_LINES]
    found = [_STAMPED.match(line) for line in given]
    if len(given) < 2 or not all(found) or (found[-1] and found[-1][2].isalpha()):
        return b""
    return next((mark for mark in _DELIMITERS if mark in given[-1]), b" ")


def part_stamps(lines: bytes, delimiter: bytes) -> bytes:
    """Return whole lines with the times of arrival as their first cells."""

    def part(found: re.Match[bytes]) -> bytes:
        return (ARRIVAL.encode() if found[2].isalpha() else found[1]) + delimiter

    return _STAMPED.sub(part, lines)
