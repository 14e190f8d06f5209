"""Texts in MATLAB values: char arrays, cells of them, objects of the class string."""

from collections.abc import Iterator
from itertools import pairwise
from math import prod

import numpy as np

from clutch_hil.recordings.matlab.objects import Object
from clutch_hil.recordings.matlab.value import Cell, Numbers, Struct, Text, Value

_MOST_NUMBERS = 1 << 18  # of the array in which a string array is stored
_MOST_AXES = 16


def read_texts(value: Value) -> list[str]:
    """The texts in a value, none where it holds anything else."""
    if isinstance(value, Text):
        return [row.strip(" \t\r\n\0") for row in value.rows]  # Dymola ends names with a zero byte
    if isinstance(value, Cell):
        items = [read_texts(item) for item in value.items[:100_000]]
        return [item[0] for item in items] if all(len(item) == 1 for item in items) else []
    if isinstance(value, Object) and value.class_name == "string":
        stored = value.fields.get("any")
        return _read_strings(stored) if isinstance(stored, Numbers) else []
    return []


def to_text(value: Value) -> str:
    """The text in a value, "" where it holds none or several."""
    texts = read_texts(value)
    return texts[0] if len(texts) == 1 else ""


def _read_strings(stored: Numbers) -> list[str]:
    """Strings as MATLAB saves them: version, number of axes, sizes, lengths, then all characters in UTF-16, as uint64."""
    if not 3 < stored.size <= _MOST_NUMBERS or max(stored.shape) != stored.size:
        return []
    words = [int(word) for word in stored.block.read_exact(stored.size)]
    axes = words[1]
    if axes > _MOST_AXES or len(words) < 2 + axes:
        return []
    count = prod(words[2 : 2 + axes])
    lengths = words[2 + axes : 2 + axes + count]
    if len(lengths) < count or sum(lengths) > 4 * len(words):
        return []
    text = np.array(words[2 + axes + count :], np.uint64).astype("<u8").tobytes().decode("utf-16-le", "replace")
    ends = np.cumsum([0, *lengths])
    return [text[begin:end] for begin, end in pairwise(ends)]


def list_remarks(value: Value, label: str, depth: int = 0) -> Iterator[tuple[str, str]]:
    """Texts and single numbers inside a value, each with where it stands: `Capture.SamplingPeriod`, `0.001`."""
    if depth > 6:  # real ones have three
        return
    if isinstance(value, Numbers) and (scalar := value.scalar) is not None:
        yield label, f"{scalar:g}"
    elif text := to_text(value):
        yield label, text
    elif isinstance(value, Struct) and value.size == 1:
        for name, inside in value.read_element(0).items():
            yield from list_remarks(inside, f"{label}.{name}", depth + 1)
