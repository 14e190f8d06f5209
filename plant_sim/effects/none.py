"""The null effect: it replaces an effect that is off. It has no laws, parameters or states."""

from collections.abc import Mapping
from typing import Any


class NoEffect:
    """An effect that changes nothing and costs nothing."""

    name = "none"
    laws: Mapping[int, Any] = {}
    rank = 0
    excludes: tuple[str, ...] = ()
    rate = None


NONE = NoEffect()
