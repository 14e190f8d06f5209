"""The null effect: what stands in for an effect that is off. It attaches to nothing and has neither parameters nor states."""

from collections.abc import Mapping
from typing import Any


class NoEffect:
    """Nothing happens, at no cost."""

    name = "none"
    laws: Mapping[int, Any] = {}
    rank = 0
    excludes: tuple[str, ...] = ()
    rate = None


NONE = NoEffect()
