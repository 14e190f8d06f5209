"""Conversions of an MDF channel: from raw to physical numbers, if the result is a number.

Simple conversions are computed by asammdf. Formulas are computed here, because text from a file is never run as code. If a
conversion gives words for some values and numbers for others, words become NaN; if it gives only words, raw numbers are kept:
as a status if the words are for single values. A conversion from text gives numbers or other text.
"""

from typing import Any, Final

import numpy as np

from protocols.files.formula import Formula

NUMBER, STATUS, TEXT = "number", "status", "text"  # kinds of a channel after its conversion

_SIMPLE_4: Final = (0, 1, 2, 4, 5)  # MDF 4: none, linear, rational, table with and without interpolation
_RANGES: Final = 6  # MDF 4: a number for each range
# MDF 3: none, linear, tables, polynomial, exponential, logarithmic, rational
_SIMPLE_3: Final = (65535, 0, 1, 2, 6, 7, 8, 9)
_FORMULA: Final = {4: 3, 3: 10}  # version of MDF -> kind of a conversion by a formula
_WORDS: Final = {4: (7, 8), 3: (11, 12)}  # value to text, range to text
_BITS: Final = {4: 11}  # texts for bits
_TEXT_TO_NUMBER, _TEXT_TO_TEXT = 9, 10  # MDF 4
_MOST_WORDS = 1000  # of a conversion that also gives numbers: each word needs a search in all rows


def find_kind(conversion: Any, version: int) -> str:
    """Return what an asammdf `conversion` (None for none) gives: number, status or text."""
    if conversion is None:
        return NUMBER
    kind = conversion.conversion_type
    if kind in ((*_SIMPLE_4, _RANGES) if version == 4 else _SIMPLE_3) or kind == _FORMULA[version]:
        return NUMBER
    if kind in _WORDS[version]:
        # words for wide ranges are classes of a measured quantity
        return NUMBER if _has_numbers(conversion, version) or not list_names(conversion, version) else STATUS
    return STATUS if kind == _BITS.get(version) else TEXT


def list_names(conversion: Any, version: int) -> dict[float, str]:
    """Return the words for single raw values by a `conversion` to words.

    Empty for another conversion, or if one word stands for several values. A range such as 1 to 1, or 1 to 1.9 of integers, is
    one value.
    """
    if conversion is None or conversion.conversion_type not in _WORDS[version]:
        return {}
    ranged = conversion.conversion_type == _WORDS[version][1]
    single = "val" if version == 4 else "param_val"
    texts, names = conversion.referenced_blocks or {}, {}
    for k in range(_MOST_WORDS):
        ends: list[Any] = [
            getattr(conversion, f"{key}_{k}", None) for key in (("lower", "upper") if ranged else (single,))
        ]
        if None in ends:
            break
        low, high = float(ends[0]), float(ends[-1])
        if high != low and not (low == round(low) and low <= high < low + 1.0):
            return {}
        word = texts.get(f"text_{k}") or getattr(conversion, f"text_{k}", None)
        if isinstance(word, bytes):
            names[low] = _decode(word)
    return names


def convert_texts(conversion: Any, texts: list[str]) -> list[str]:
    """Return the texts (n,) that an MDF 4 `conversion` makes of `texts` (n,): numbers as text, or other texts.

    Raises ValueError for another conversion.
    """
    blocks = conversion.referenced_blocks or {}
    if conversion.conversion_type == _TEXT_TO_NUMBER:
        keys, values = "text_{}", [repr(float(conversion[f"val_{k}"])) for k in range(conversion.val_param_nr - 1)]
        otherwise = repr(float(conversion.val_default))
    elif conversion.conversion_type == _TEXT_TO_TEXT:
        keys, values = (
            "input_{}_addr",
            [_decode(blocks.get(f"output_{k}_addr")) for k in range((conversion.ref_param_nr - 1) // 2)],
        )
        otherwise = _decode(blocks.get("default_addr"))
    else:
        raise ValueError("it is one from numbers")
    table: dict[str, str] = {}
    for k, value in enumerate(values):
        table.setdefault(_decode(blocks.get(keys.format(k))), value)
    if conversion.conversion_type == _TEXT_TO_TEXT and not otherwise:
        return [table.get(text, text) for text in texts]  # without a default a text stays as it is
    return [table.get(text, otherwise) for text in texts]


def _decode(word: Any) -> str:
    return word.decode("utf-8", "replace").strip(" \0") if isinstance(word, bytes) else ""


def to_physical(conversion: Any, version: int, raw: np.ndarray) -> np.ndarray:
    """Return physical values (n,) of `raw` (n,) numbers; for a status the raw ones.

    Raises ValueError for an unknown conversion.
    """
    values = raw.astype(float)
    if conversion is None or find_kind(conversion, version) != NUMBER:
        return values
    kind = conversion.conversion_type
    if kind == _FORMULA[version]:
        return compute(conversion.formula, values)
    if kind in _WORDS[version] and not _has_numbers(conversion, version):
        return values
    if kind in _WORDS[4] and version == 4:
        return _convert_beside_words(conversion, raw)
    if kind == _RANGES and version == 4:
        return _convert_ranges(conversion, raw)
    try:
        return np.asarray(conversion.convert(raw.copy())).astype(float)
    except Exception as error:  # asammdf raises many exception types
        raise ValueError(f"its conversion is not known ({error})") from None


def compute(formula: str, x: np.ndarray) -> np.ndarray:
    """Return the values of a `formula` of X, or X1, with X = `x` (n,). Raises ValueError for an invalid formula."""
    try:
        number = Formula(formula.strip(" \0\n\r\t").lower()).compute({"x": x, "x1": x, "pi": np.pi, "e": np.e})
        return np.broadcast_to(np.asarray(number, float), x.shape).copy()
    except (KeyError, ValueError):
        shown = formula if len(formula) < 60 else formula[:60] + "..."
        raise ValueError(f"its formula {shown!r} is not known") from None


def _has_numbers(conversion: Any, version: int) -> bool:
    """Return whether a conversion to words also gives physical numbers, by a nested conversion."""
    if version == 3:
        default = conversion.referenced_blocks.get("default_addr") if conversion.referenced_blocks else None
        return isinstance(default, bytes) and b"{X}" in default
    return any(_is_numeric(inner) for inner in conversion.referenced_blocks.values())


def _is_numeric(inner: Any) -> bool:
    return inner is not None and not isinstance(inner, bytes) and find_kind(inner, 4) == NUMBER


def _convert_beside_words(conversion: Any, raw: np.ndarray) -> np.ndarray:
    """Return the values of an MDF 4 conversion to words with nested conversions to numbers; NaN for a word."""
    blocks, values = conversion.referenced_blocks, np.full(len(raw), np.nan)
    free = np.ones(len(raw), bool)
    ranges = conversion.conversion_type == _WORDS[4][1]
    count = conversion.val_param_nr // 2 if ranges else conversion.val_param_nr
    if count > _MOST_WORDS:
        raise ValueError(f"its conversion has {count} words; allowed are {_MOST_WORDS}")
    for k in range(count):
        if ranges:
            low, high = conversion[f"lower_{k}"], conversion[f"upper_{k}"]
            inside = (raw >= low) & (raw <= high if raw.dtype.kind in "iu" else raw < high)
        else:
            inside = raw == conversion[f"val_{k}"]
        inside &= free
        free &= ~inside
        if _is_numeric(inner := blocks.get(f"text_{k}")):
            values[inside] = to_physical(inner, 4, raw[inside])
    if _is_numeric(default := blocks.get("default_addr")):
        values[free] = to_physical(default, 4, raw[free])
    return values


def _convert_ranges(conversion: Any, raw: np.ndarray) -> np.ndarray:
    """Return the values of an MDF 4 conversion with a number for each range.

    asammdf assigns integers at the end of a range to the next range.
    """
    count = (conversion.val_param_nr - 1) // 3
    rows = [[conversion[f"{key}_{k}"] for key in ("upper", "lower", "phys")] for k in range(count)]
    table = np.array(sorted(rows, key=lambda row: row[0])).reshape(-1, 3)
    # first range whose upper end is >= the number (integers) or > the number (floats): only integer ranges include their end
    at = np.searchsorted(table[:, 0], raw, side="left" if raw.dtype.kind in "iu" else "right")
    containing = np.minimum(at, max(count - 1, 0))
    inside = (at < count) & (raw >= table[containing, 1]) if count else np.zeros(len(raw), bool)
    values = np.full(len(raw), float(conversion["default"]))
    values[inside] = table[containing[inside], 2]
    return values
