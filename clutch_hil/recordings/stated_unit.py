"""Stated unit: the attribute, property or field with a channel's unit, under the names of various tools."""

from collections.abc import Iterable, Sequence

from clutch_hil.recordings.channel import simplify_unit
from protocols.files.units import contradict

# In lower case, without separators. The first one that a channel has is used
_KEYS = (
    "unit", "units", "unitstring", "unitname", "unitsymbol", "unittext", "physicalunit", "physunit", "engineeringunit",
    "engineeringunits", "eu", "einheit", "einheiten", "niunitdescription", "yunit", "yunits", "yunitlabel",
)  # fmt: skip


def list_unit_keys(keys: Iterable[str]) -> Sequence[str]:
    """Return those of `keys` that name a unit, the most likely first."""
    ranks = {key: _KEYS.index(plain) for key in keys if (plain := _simplify(key)) in _KEYS}
    return sorted(ranks, key=lambda key: ranks[key])


def join_units(texts: Iterable[str]) -> str:
    """Return the first text that is not empty; if another one is a different unit, both joined by `or`, which is no valid
    unit."""
    given = [text for text in map(str.strip, texts) if text]
    units = [simplify_unit(text) for text in given]
    other = next((text for text, unit in zip(given, units, strict=True) if contradict(unit, units[0])), "")
    return f"{given[0]} or {other}" if other else "".join(given[:1])


def _simplify(key: str) -> str:
    return "".join(c for c in key.lower() if c.isalnum())
