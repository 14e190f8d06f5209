"""Stated scaling: attributes or properties of a channel that may turn its numbers into values, but that no standard applies.

`gain = 0.02` beside whole numbers says, probably, that these are counts of a converter. Beside other numbers it may as well be
that of an amplifier, which is in them already. So nothing is applied, and a person is asked, or told.
"""

import re
from collections.abc import Iterable, Mapping
from math import isfinite

_MOST_NUMBERS = 10  # in a list of them: a polynomial has fewer
_MOST_TOLD = 4  # in a sentence
_SAME = [0.0, 1.0]  # coefficients of a polynomial that changes nothing
# What a tool calls it, in lower case and without marks between words, and the number that changes nothing
_NEUTRAL = {
    **dict.fromkeys(
        ("gain", "scale", "scaling", "scalefactor", "scalingfactor", "factor", "slope", "multiplier", "sensitivity",
         "calibration", "calibrationfactor", "calfactor", "conversionfactor", "lsb", "c1", "coefficient", "coefficients",
         "coeffs", "unitsperbit", "unitspercount", "voltspercount", "countsperunit", "datascale", "verticalgain", "yincrement",
         "yincr"), 1.0,
    ),
    **dict.fromkeys(
        ("offset", "addoffset", "bias", "intercept", "yintercept", "dataoffset", "yoffset", "c0"), 0.0,
    ),
}  # fmt: skip


def is_scaling(key: str) -> bool:
    """Whether an attribute is called as a factor or an offset is."""
    return _simplify(key) in _NEUTRAL


def describe_scaling(entries: Iterable[tuple[str, object]]) -> str:
    """Factors and offsets among `entries` that change something, as `gain = 0.02, offset = -100`; "" where there are none."""
    parts = []
    for key, value in sorted(entries, key=lambda entry: entry[0].lower()):
        neutral = _NEUTRAL.get(_simplify(key))
        numbers = [] if neutral is None else _read_numbers(value)
        if numbers and numbers not in ([neutral], _SAME):
            parts.append(f"{key} = {', '.join(f'{number:g}' for number in numbers)}")
    return ", ".join(parts)


def describe_scaling_beside(name: str, numbers: Mapping[str, float]) -> str:
    """Factors and offsets of the channel `name` among the single `numbers` of a file, as `torque_gain = 0.02`; "" for none."""
    own, parts = _simplify(name), []
    for key, value in numbers.items():
        if name.lower() not in key.lower():  # a file may have very many
            continue
        last = _simplify(re.split(r"[/.]", key)[-1])
        rest = last.removeprefix(own) if last.startswith(own) else last.removesuffix(own) if last.endswith(own) else ""
        if own and _NEUTRAL.get(rest, value) != value:
            parts.append(f"{key} = {value:g}")
    return ", ".join(parts[:_MOST_TOLD])


def is_scaling_beside(key: str) -> bool:
    """Whether a number may be called as a factor or an offset of another one, as `torque_gain` is."""
    words = re.split(r"[\W_]+", key)
    return len(words) > 1 and any(_simplify("".join(part)) in _NEUTRAL for part in (words[:1], words[-1:], words[-2:]))


def _read_numbers(value: object) -> list[float]:
    """The one number in a value, of a text too, or those of a list; none where there are others."""
    try:
        numbers = [float(one) for one in (value if isinstance(value, list) else [value])]  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return []
    return numbers if len(numbers) <= _MOST_NUMBERS and all(map(isfinite, numbers)) else []


def _simplify(key: str) -> str:
    return "".join(c for c in key.lower() if c.isalnum())
