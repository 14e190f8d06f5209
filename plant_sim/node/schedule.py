"""Schedule: the parameters of the plant over time, as rigs that are prepared before they are needed.

Each parameter is a piecewise linear function of time. So all of them are linear between two times at which a change begins or
ends: a segment. A rig is prepared for both ends of a segment, with the same effects attached. In between its compiled numbers
are interpolated, so that a cycle compiles and checks nothing.
"""

from bisect import insort
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf

import numpy as np

from plant_sim.effects.table import list_active_effects
from plant_sim.node.change import TIME_TOLERANCE, Change
from plant_sim.node.injection import Injection
from plant_sim.rigs.wet_clutch import Rig
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet

_MOST_PLANNED = 64  # planned changes of a running plant: its answer to a request lists all of them, in 64 kB
# Highest number of later injections when a change is inserted in a running plant: each of them is prepared again in the same
# cycle, in up to 0.7 ms (measured), and after 5 ms the controller faults
_MOST_LATER = 4


class RampSegment:
    """The rig from `begin` to `end` [s]: its numbers change linearly from the parameters `first` to `last`."""

    def __init__(self, begin: float, end: float, first: ParameterSet, last: ParameterSet) -> None:
        self.begin, self.end = begin, end
        self.rig = Rig(first, list_active_effects(last))
        goal = Rig(last, self.rig.table.names)
        self._numbers = self.rig.record.view(np.float64), self.rig.table.values
        self._start = [numbers.copy() for numbers in self._numbers]
        self._increments = [goal.record.view(np.float64) - self._start[0], goal.table.values - self._start[1]]

    def move(self, time: float) -> bool:
        """Set the rig to its state at `time` [s]; return whether it has changed."""
        share = max((time - self.begin) / (self.end - self.begin), 0.0)
        for numbers, start, increment in zip(self._numbers, self._start, self._increments, strict=True):
            np.multiply(increment, share, out=numbers)
            numbers += start
        return True


class ConstantSegment:
    """The rig until `end` [s] with constant parameters."""

    def __init__(self, end: float, rig: Rig) -> None:
        self.end, self.rig = end, rig

    def move(self, time: float) -> bool:
        """Do nothing; return False, as nothing has changed."""
        return False


class Schedule:
    """Parameters and rig from the time `now` [s] on.

    `parameters` hold before all changes. `begun` are changes in progress, `pending` are future injections. `earlier` is the
    schedule of a running plant that this one replaces; both are equal before `since` [s], and nothing is prepared again
    there. Raises InputError for an unknown parameter, a value out of bounds, effects that exclude each other, a rig too fast to
    integrate, a time in the past, or more than a running plant can take.
    """

    def __init__(
        self,
        parameters: ParameterSet,
        pending: Sequence[Injection] = (),
        begun: Sequence[Change] = (),
        now: float = 0.0,
        earlier: "Schedule | None" = None,
        since: float = -inf,
    ) -> None:
        self._base = parameters
        kept = [change for change in earlier.planned if change.at < since - TIME_TOLERANCE] if earlier else []
        self._lines: dict[str, list[Change]] = {}
        for change in (*begun, *kept):
            self._lines.setdefault(change.name, []).append(change)
        # s: changes up to this time have begun and were returned by `begin`
        self._reported_until = max((change.at for change in begun), default=-inf)
        self._pending = [injection for injection in pending if injection.at < since - TIME_TOLERANCE]
        later = [injection for injection in pending if injection.at >= since - TIME_TOLERANCE]
        self.planned: list[Change] = [
            *kept,
            *self._plan_changes(later),
        ]  # changes that have not begun, in order of time
        if (
            earlier and now > 0.0 and len(self.planned) > _MOST_PLANNED
        ):  # before its first sample the plant has no time limit
            raise InputError(
                f"the plant would have {len(self.planned)} planned changes; allowed are {_MOST_PLANNED} while it runs"
            )
        self._segments: list[RampSegment | ConstantSegment] = self._build_segments(now, earlier, since)

    def with_injections(self, injections: Sequence[Injection], now: float) -> "Schedule":
        """Return this schedule from `now` [s] on with more injections. Raises InputError; this schedule is unchanged."""
        for injection in injections:
            if injection.at < now - TIME_TOLERANCE:
                raise InputError(f"injection at {injection.at:g} s is too late: the rig is at {now:g} s")
        if not injections:
            return self
        since = min(injection.at for injection in injections)
        self._check_later(since, now)
        base, begun = self._split_changes(now)
        return Schedule(base, [*self._list_pending(), *injections], begun, now, self, since)

    def with_values(self, values: Mapping[str, float], now: float) -> "Schedule":
        """Return this schedule with `values` from `now` [s] on; ramps of these parameters end. Raises InputError."""
        self._check_later(now, now)
        base, begun = self._split_changes(now)
        moving = [change for change in begun if change.name not in values]
        return Schedule(base.with_values(values), self._list_pending(), moving, now, self, now)

    def list_parameters(self, time: float) -> ParameterSet:
        """Return the parameters at `time` [s], which is not before the start of the schedule."""
        return self._compute_values(time, time)

    def make_rig(self, time: float) -> tuple[Rig, bool]:
        """Return the rig at `time` [s], and whether its numbers have changed. Times must not decrease."""
        while time >= self._segments[0].end - TIME_TOLERANCE:
            self._segments.pop(0)
        return self._segments[0].rig, self._segments[0].move(time)

    def make_constant_rig(self, time: float) -> Rig | None:
        """Return the rig at `time` [s] if no parameter changes then, otherwise None."""
        segment = self._segments[0]
        if isinstance(segment, RampSegment) or time >= segment.end - TIME_TOLERANCE:
            return None
        return None if self.planned and self.planned[0].at <= time + TIME_TOLERANCE else segment.rig

    @property
    def until(self) -> float:
        """Time [s] until which the rig of `make_constant_rig` stays constant."""
        return min([self._segments[0].end, *(change.at for change in self.planned[:1])])

    def begin(self, time: float) -> list[Change]:
        """Return the changes that begin up to `time` [s] and have not been returned before."""
        self._reported_until = time
        count = sum(change.at <= time + TIME_TOLERANCE for change in self.planned)
        begun, self.planned = self.planned[:count], self.planned[count:]
        return begun

    def _plan_changes(self, pending: Sequence[Injection]) -> list[Change]:
        """Return the changes by injections; the return to the old value becomes a separate injection. Raises InputError."""
        planned = []
        queue = sorted(pending, key=_read_start)
        for injection in queue:  # the loop appends to it
            self._base.with_values(injection.values)
            present = self._compute_values(injection.at, injection.at)
            before = {name: present[name].value for name in injection.values}
            for name, new in injection.values.items():
                change = Change(name, self._base[name].unit, before[name], float(new), injection.at, injection.ramp)
                self._lines.setdefault(name, []).append(change)
                planned.append(change)
            self._pending.append(replace(injection, until=inf))
            if injection.until < inf:
                insort(queue, Injection(before, injection.until, injection.ramp), key=_read_start)
        return planned

    def _check_later(self, since: float, now: float) -> None:
        """Raise InputError if more injections follow a change at `since` [s] than can be prepared again in a cycle.

        Before the plant has begun (`now` is 0 s) there is no limit.
        """
        if (
            now > 0.0
            and (count := sum(injection.at > since + TIME_TOLERANCE for injection in self._list_pending()))
            > _MOST_LATER
        ):
            raise InputError(
                f"the change would come before {count} planned injections, and a running plant can recompute no more than"
                f" {_MOST_LATER}; plan injections in order of their time"
            )

    def _build_segments(
        self, now: float, earlier: "Schedule | None", since: float
    ) -> list[RampSegment | ConstantSegment]:
        """Build the segments from `now` [s] on; those of `earlier` that end before `since` [s] stay. Raises InputError."""
        before = earlier._segments if earlier else []
        segments = [segment for segment in before if segment.end <= since + TIME_TOLERANCE]
        cut = before[len(segments)] if len(segments) < len(before) else None
        start = max(now, segments[-1].end) if segments else now
        times = {time for line in self._lines.values() for change in line for time in (change.at, change.end)}
        begins = [start, *sorted(time for time in times if time > start + TIME_TOLERANCE)]
        for begin, end in pairwise([*begins, inf]):
            if isinstance(cut, ConstantSegment) and end <= since + TIME_TOLERANCE:
                segments.append(ConstantSegment(end, cut.rig))  # the new changes come after it
                continue
            first = self._compute_values(begin, begin)
            if any(change.end > begin + TIME_TOLERANCE for change in self._find_active(begin)):
                segments.append(RampSegment(begin, end, first, self._compute_values(begin, end)))
            else:
                segments.append(ConstantSegment(end, Rig(first)))
        return segments

    def _split_changes(self, now: float) -> tuple[ParameterSet, list[Change]]:
        """Return the parameters with the changes that have ended by `now` [s], and the changes in progress."""
        begun = self._find_active(self._reported_until)
        moving = [change for change in begun if change.end > now]
        return self._base.with_values({change.name: change.new for change in begun if change.end <= now}), moving

    def _list_pending(self) -> list[Injection]:
        """Return the injections that have not begun."""
        return [injection for injection in self._pending if injection.at > self._reported_until + TIME_TOLERANCE]

    def _compute_values(self, begin: float, time: float) -> ParameterSet:
        """Return the parameters at `time` [s] by the changes that have begun at `begin` [s]."""
        return self._base.with_values({change.name: change.compute_value(time) for change in self._find_active(begin)})

    def _find_active(self, time: float) -> list[Change]:
        """Return the newest change of each parameter that has begun by `time` [s]."""
        lines = ([change for change in line if change.at <= time + TIME_TOLERANCE] for line in self._lines.values())
        return [line[-1] for line in lines if line]


def _read_start(injection: Injection) -> float:
    """Return the start of an injection [s], to sort by."""
    return injection.at
