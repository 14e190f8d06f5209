"""Coming: changes of a node's parameters that are planned or under way, seen from its record: rows and times alone."""

from collections.abc import Sequence
from typing import Any


class Coming:
    """Changes as `protocols.telemetry.tuning.Injectable` tells them: those `planned`, and those under way."""

    def __init__(self, planned: Sequence[dict[str, Any]]) -> None:
        self.planned = list(planned)
        self._moving: dict[str, dict[str, Any]] = {}  # by parameter

    def plan(self, planned: Sequence[dict[str, Any]], row: int) -> None:
        """Take what the node plans anew, which it did when its next row had this number."""
        self.planned = [change for change in self.planned if change["row"] < row] + list(planned)

    def started(self, rows: int) -> list[dict[str, Any]]:
        """Changes that have begun now that there are so many rows, and not before."""
        started = [change for change in self.planned if change["row"] < rows]
        self.planned = [change for change in self.planned if change["row"] >= rows]
        for change in started:
            self.forget(change["name"])
            if change["ramp"] > 0.0:
                self._moving[change["name"]] = change
        return started

    def ended(self, time: float) -> list[dict[str, Any]]:
        """Changes along a ramp that have ended by `time` [s], and not before; those that another took over never end."""
        ended = [change for change in self._moving.values() if change["at"] + change["ramp"] <= time]
        for change in ended:
            self.forget(change["name"])
        return ended

    def values(self, time: float) -> dict[str, float]:
        """Parameters that are under way at `time` [s]."""
        return {
            name: change["old"]
            + (change["new"] - change["old"]) * min(max(time - change["at"], 0.0) / change["ramp"], 1.0)
            for name, change in self._moving.items()
        }

    def forget(self, name: str) -> None:
        """A parameter is no longer under way."""
        self._moving.pop(name, None)
