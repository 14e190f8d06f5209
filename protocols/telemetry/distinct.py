"""Distinct messages: a node's messages arrive live and, after a late join, by query; each is kept once."""

import json
from collections.abc import Iterable
from typing import Any


class DistinctMessages:
    """JSON messages, each kept once, at most the newest `most`. The time to add one does not depend on their number."""

    def __init__(self, most: int) -> None:
        self._kept: dict[str, dict[str, Any]] = {}  # by their text, oldest first
        self._most = most

    def add(self, messages: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        """Keep those of `messages` that are new, and return them."""
        new = []
        for message in messages:
            if (text := json.dumps(message, sort_keys=True)) not in self._kept:
                self._kept[text] = message
                new.append(message)
                if len(self._kept) > self._most:
                    del self._kept[next(iter(self._kept))]
        return new

    @property
    def kept(self) -> list[dict[str, Any]]:
        """The kept messages, oldest first."""
        return list(self._kept.values())
