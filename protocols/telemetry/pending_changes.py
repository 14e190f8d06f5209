"""Pending changes: injected parameter changes of a node that are planned or in progress, tracked by its rows and times."""

from collections.abc import Sequence
from typing import Any


class PendingChanges:
    """Changes as described in `protocols.telemetry.tuning.Injectable`: those `planned`, and ramps in progress."""

    def __init__(self, planned: Sequence[dict[str, Any]]) -> None:
        self.planned = list(planned)
        self._moving: dict[str, dict[str, Any]] = {}  # by parameter

    def plan(self, planned: Sequence[dict[str, Any]], row: int) -> None:
        """Replace the plan by the node's new one, which it made when its next row had the number `row`."""
        self.planned = [change for change in self.planned if change["row"] < row] + list(planned)

    def take_started(self, rows: int) -> list[dict[str, Any]]:
        """Remove and return the changes that have begun within the first `rows` rows."""
        started = [change for change in self.planned if change["row"] < rows]
        self.planned = [change for change in self.planned if change["row"] >= rows]
        for change in started:
            self.forget(change["name"])
            if change["ramp"] > 0.0:
                self._moving[change["name"]] = change
        return started

    def take_ended(self, time: float) -> list[dict[str, Any]]:
        """Remove and return the ramps that have ended by `time` [s]; a ramp that a later change has replaced never ends."""
        ended = [change for change in self._moving.values() if change["at"] + change["ramp"] <= time]
        for change in ended:
            self.forget(change["name"])
        return ended

    def compute_values(self, time: float) -> dict[str, float]:
        """Return the values at `time` [s] of parameters on a ramp, by name."""
        return {
            name: change["old"]
            + (change["new"] - change["old"]) * min(max(time - change["at"], 0.0) / change["ramp"], 1.0)
            for name, change in self._moving.items()
        }

    def forget(self, name: str) -> None:
        """Remove the ramp of a parameter, if there is one."""
        self._moving.pop(name, None)
