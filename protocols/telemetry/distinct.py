"""Distinct messages: what a node tells comes live and, for those who join late, by query. Of both each is kept once."""

import json
from collections.abc import Iterable
from typing import Any


class DistinctMessages:
    """Messages in JSON, each once, the newest `most` of them. To add one takes as long however many there are."""

    def __init__(self, most: int) -> None:
        self._kept: dict[str, dict[str, Any]] = {}  # by their text, oldest first
        self._most = most

    def add(self, messages: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        """Keep those of `messages` that are not kept yet, and return them."""
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
        """Those that are kept, oldest first."""
        return list(self._kept.values())
