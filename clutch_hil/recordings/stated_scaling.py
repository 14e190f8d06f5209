"""Stated scaling: attributes or properties of a channel that may be a scaling of its numbers, but belong to no standard.

`gain = 0.02` with integers probably means counts of a converter. With other numbers it may be the gain of an amplifier, which
is already applied. So nothing is applied: the user must decide, or is informed.
"""

import re
from collections.abc import Iterable, Mapping
from math import isfinite

_MOST_NUMBERS = 10  # longest list of numbers: a polynomial has fewer
_MOST_TOLD = 4  # largest number in a sentence
_SAME = [0.0, 1.0]  # coefficients of the identity polynomial
# Names in tools, in lower case and without separators -> neutral value
_NEUTRAL = {
    **dict.fromkeys(
        ("gain", "scale", "scaling", "scalefactor", "scalingfactor", "factor", "slope", "multiplier", "sensitivity",
         "calibration", "calibrationfactor", "calfactor", "conversionfactor", "lsb", "c1", "coefficient", "coefficients",
         "coeffs", "unitsperbit", "unitspercount", "voltspercount", "countsperunit", "datascale", "verticalgain", "yincrement",
         "yincr", "verticalscale"), 1.0,
    ),
    **dict.fromkeys(
        ("offset", "addoffset", "bias", "intercept", "yintercept", "dataoffset", "yoffset", "c0"), 0.0,
    ),
}  # fmt: skip


def is_scaling(key: str) -> bool:
    """Return whether the name of an attribute is that of a factor or an offset."""
    return _simplify(key) in _NEUTRAL


def describe_scaling(entries: Iterable[tuple[str, object]]) -> str:
    """Return the effective factors and offsets among `entries`, as `gain = 0.02, offset = -100`; "" if there are none."""
    parts = []
    for key, value in sorted(entries, key=lambda entry: entry[0].lower()):
        neutral = _NEUTRAL.get(_simplify(key))
        numbers = [] if neutral is None else _read_numbers(value)
        if numbers and numbers not in ([neutral], _SAME):
            parts.append(f"{key} = {', '.join(f'{number:g}' for number in numbers)}")
    return ", ".join(parts)


def describe_scaling_beside(name: str, numbers: Mapping[str, float]) -> str:
    """Return factors and offsets for the channel `name` among a file's single `numbers`, as `torque_gain = 0.02`; "" if
    none."""
    own, parts = _simplify(name), []
    for key, value in numbers.items():
        if name.lower() not in key.lower():  # fast test first: a file may have very many
            continue
        last = _simplify(re.split(r"[/.]", key)[-1])
        rest = last.removeprefix(own) if last.startswith(own) else last.removesuffix(own) if last.endswith(own) else ""
        if own and _NEUTRAL.get(rest, value) != value:
            parts.append(f"{key} = {value:g}")
    return ", ".join(parts[:_MOST_TOLD])


def is_scaling_beside(key: str) -> bool:
    """Return whether the name of a number may be that of a factor or offset of a channel, as `torque_gain`."""
    words = re.split(r"[\W_]+", key)
    return len(words) > 1 and any(_simplify("".join(part)) in _NEUTRAL for part in (words[:1], words[-1:], words[-2:]))


def _read_numbers(value: object) -> list[float]:
    """Return the number in a value or text, or the numbers of a list; empty for other values."""
    try:
        numbers = [float(one) for one in (value if isinstance(value, list) else [value])]  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return []
    return numbers if len(numbers) <= _MOST_NUMBERS and all(map(isfinite, numbers)) else []


def _simplify(key: str) -> str:
    return "".join(c for c in key.lower() if c.isalnum())
