"""Stated scaling: attributes or properties of a channel that may turn its numbers into values, but that no standard applies.

`gain = 0.02` beside whole numbers says, probably, that these are counts of a converter. Beside other numbers it may as well be
that of an amplifier, which is in them already. So nothing is applied, and a person is asked, or told.
"""

from collections.abc import Iterable
from math import isfinite

# What a tool calls it, in lower case and without marks between words, and the number that changes nothing
_NEUTRAL = {
    **dict.fromkeys(
        ("gain", "scale", "scaling", "scalefactor", "scalingfactor", "factor", "slope", "multiplier", "sensitivity",
         "calibration", "calibrationfactor", "calfactor", "conversionfactor", "lsb"), 1.0,
    ),
    **dict.fromkeys(("offset", "addoffset", "bias", "intercept", "yintercept"), 0.0),
}  # fmt: skip


def is_scaling(key: str) -> bool:
    """Whether an attribute is called as a factor or an offset is."""
    return _simplify(key) in _NEUTRAL


def describe_scaling(entries: Iterable[tuple[str, object]]) -> str:
    """Factors and offsets among `entries` that change something, as `gain = 0.02, offset = -100`; "" where there are none."""
    told = []
    for key, value in sorted(entries, key=lambda entry: entry[0].lower()):
        neutral = _NEUTRAL.get(_simplify(key))
        if neutral is not None and (number := _read_number(value)) is not None and number != neutral:
            told.append(f"{key} = {number:g}")
    return ", ".join(told)


def _read_number(value: object) -> float | None:
    """The one number in a value, of a text too; None where there is none."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return None
    return number if isfinite(number) else None


def _simplify(key: str) -> str:
    return "".join(c for c in key.lower() if c.isalnum())
