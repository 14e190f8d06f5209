"""Multiplexing in the text of a DBC, completed so that cantools reads it correctly.

SG_MUL_VAL_     multiplexer values for which a frame contains a signal. cantools makes a list of them: they are counted before
m3              without such an entry, `m3` means 3 of the one multiplexer `M` of the message. If a message has further
                multiplexers (`m2M`), cantools treats such a signal as always present: the entry is added
"""

import re
from pathlib import Path

from protocols.errors import InputError

_MOST_NUMBERS = 1_000_000  # of all entries: fifteen multiplexers of 16 bits; 8 MB
_MESSAGE_OR_SIGNAL = re.compile(
    r"^[ \t]*(?:BO_[ \t]+(?P<frame>\d+)[ \t]|SG_[ \t]+(?P<signal>\w+)[ \t]+(?P<mark>M|m(?P<number>\d+)M?)[ \t]*:)",
    re.MULTILINE,
)
_ENTRY = re.compile(
    r"^[ \t]*SG_MUL_VAL_\s+(?P<frame>\d+)\s+(?P<signal>\w+)\s+\w+\s+(?P<ranges>[\d\s,-]*);", re.MULTILINE
)
_RANGE = re.compile(r"(\d+)\s*-\s*(\d+)")


def complete_multiplexing(path: Path, text: str) -> str:
    """Return the text of a DBC with missing entries added. Raises InputError if its entries have too many values."""
    entries: set[tuple[str, str]] = set()
    count = 0
    for entry in _ENTRY.finditer(text):
        entries.add((entry["frame"], entry["signal"]))
        count += sum(max(int(last[:20]) - int(first[:20]) + 1, 0) for first, last in _RANGE.findall(entry["ranges"]))
        if count > _MOST_NUMBERS:
            raise InputError(
                f"DBC {path}: SG_MUL_VAL_ of {entry['signal']} and others have {count} numbers of multiplexers; allowed are"
                f" {_MOST_NUMBERS}"
            )
    frame, signals = "", dict[str, list[re.Match[str]]]()
    for line in _MESSAGE_OR_SIGNAL.finditer(text):
        frame = line["frame"] or frame
        if line["signal"]:
            signals.setdefault(frame, []).append(line)
    missing = []
    for frame, marked in signals.items():
        roots = [one["signal"] for one in marked if one["mark"] == "M"]
        if len(roots) == 1 and sum(one["mark"].endswith("M") for one in marked) > 1:
            missing += [
                f"SG_MUL_VAL_ {frame} {one['signal']} {roots[0]} {one['number']}-{one['number']};"
                for one in marked
                if one["number"] and (frame, one["signal"]) not in entries
            ]
    return "\n".join([text, *missing, ""]) if missing else text
