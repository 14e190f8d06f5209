"""Stated unit: the attribute, property or field of a channel that tells its unit, whatever a tool calls it."""

from collections.abc import Iterable, Sequence

from clutch_hil.recordings.channel import simplify_unit
from protocols.files.units import contradict

# In lower case, without marks between words. The first one that a channel has counts
_KEYS = (
    "unit", "units", "unitstring", "unitname", "unitsymbol", "unittext", "physicalunit", "physunit", "engineeringunit",
    "engineeringunits", "eu", "einheit", "einheiten", "niunitdescription", "yunit", "yunits", "yunitlabel",
)  # fmt: skip


def list_unit_keys(keys: Iterable[str]) -> Sequence[str]:
    """Those of `keys` that tell a unit, the likeliest first."""
    ranks = {key: _KEYS.index(plain) for key in keys if (plain := _simplify(key)) in _KEYS}
    return sorted(ranks, key=lambda key: ranks[key])


def join_units(texts: Iterable[str]) -> str:
    """The first text that is not empty; where another one is a different unit, both with `or` between, which no unit is."""
    given = [text for text in map(str.strip, texts) if text]
    units = [simplify_unit(text) for text in given]
    other = next((text for text, unit in zip(given, units, strict=True) if contradict(unit, units[0])), "")
    return f"{given[0]} or {other}" if other else "".join(given[:1])


def _simplify(key: str) -> str:
    return "".join(c for c in key.lower() if c.isalnum())
