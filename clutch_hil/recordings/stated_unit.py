"""Stated unit: the attribute, property or field of a channel that tells its unit, whatever a tool calls it."""

from collections.abc import Iterable, Sequence

# In lower case, without marks between words. The first one that a channel has counts
_KEYS = (
    "unit", "units", "unitstring", "unitname", "unitsymbol", "unittext", "physicalunit", "physunit", "engineeringunit",
    "engineeringunits", "eu", "einheit", "einheiten", "niunitdescription", "yunit", "yunits", "yunitlabel",
)  # fmt: skip


def list_unit_keys(keys: Iterable[str]) -> Sequence[str]:
    """Those of `keys` that tell a unit, the likeliest first."""
    told = {key: _KEYS.index(plain) for key in keys if (plain := _simplify(key)) in _KEYS}
    return sorted(told, key=lambda key: told[key])


def _simplify(key: str) -> str:
    return "".join(c for c in key.lower() if c.isalnum())
