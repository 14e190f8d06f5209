"""Schedule: what the plant's parameters are at each time, as rigs that are made before they are needed.

Each parameter follows its own line of changes, so between two times at which a change begins or ends all of them move along
straight lines: a stretch. A rig is made for both ends of a stretch, with the same effects attached, and in between the
compiled numbers are interpolated. A cycle compiles nothing and checks nothing.
"""

from bisect import insort
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from math import ceil, inf
from typing import Any

import numpy as np

from plant_sim.effects.table import switched_on
from plant_sim.node.injection import Injection
from plant_sim.rigs.wet_clutch import Rig
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet

_EARLY = 1e-9  # s by which a sample may be early: times are sums of floats


@dataclass(frozen=True)
class Change:
    """One parameter's way from `old` to `new`, in `unit`, from `at` on [s] along a line of `ramp` [s]."""

    name: str
    unit: str
    old: float
    new: float
    at: float
    ramp: float

    @property
    def end(self) -> float:
        """When the parameter is `new` [s]."""
        return self.at + self.ramp

    def value(self, time: float) -> float:
        """The parameter at a time not before `at`."""
        if time >= self.end:
            return self.new
        return self.old + (self.new - self.old) * (time - self.at) / self.ramp

    def told(self, rate: int) -> dict[str, Any]:
        """The change for people and files; `row` is the first of the record with it, at a `rate` [Hz]."""
        return asdict(self) | {"row": ceil((self.at - _EARLY) * rate)}


class Stretch:
    """The rig until `end` [s]: from the parameters `first` at `begin` its numbers move along straight lines to `last`."""

    def __init__(self, begin: float, end: float, first: ParameterSet, last: ParameterSet) -> None:
        self.begin, self.end = begin, end
        self.rig = Rig(first, switched_on(last))
        goal = Rig(last, self.rig.table.names)
        self._numbers = self.rig.record.view(np.float64), self.rig.table.values
        self._start = [numbers.copy() for numbers in self._numbers]
        self._way = [goal.record.view(np.float64) - self._start[0], goal.table.values - self._start[1]]

    def move(self, time: float) -> bool:
        """Let the rig be what it is at `time` [s]; whether it has changed."""
        part = max((time - self.begin) / (self.end - self.begin), 0.0)
        for numbers, start, way in zip(self._numbers, self._start, self._way, strict=True):
            np.multiply(way, part, out=numbers)
            numbers += start
        return True


class Rest:
    """The rig until `end` [s]: nothing moves."""

    def __init__(self, end: float, parameters: ParameterSet) -> None:
        self.end = end
        self.rig = Rig(parameters)

    def move(self, time: float) -> bool:
        """Nothing changes."""
        return False


class Schedule:
    """Parameters and rig over the time from `now` [s] on.

    `begun` are changes under way: their parameters are not those of `parameters`; `pending` are injections to come. Raises
    InputError when one of them cannot be: an unknown parameter, one out of bounds, effects that exclude each other, a rig too
    fast to integrate, a time that is past.
    """

    def __init__(
        self,
        parameters: ParameterSet,
        pending: Sequence[Injection] = (),
        begun: Sequence[Change] = (),
        now: float = 0.0,
    ) -> None:
        self._base = parameters
        self._lines = {change.name: [change] for change in begun}
        self._pending: list[Injection] = []
        self._told = max((change.at for change in begun), default=-inf)  # s, by which changes have begun
        self.planned = self._plan(pending)  # changes that have not begun, in the order in which they will
        self._stretches = self._stretched(now)

    def extended(self, injections: Sequence[Injection], now: float) -> "Schedule":
        """This schedule from `now` [s] on with further injections. Raises InputError and leaves this one as it is."""
        for injection in injections:
            if injection.at < now - _EARLY:
                raise InputError(f"injection at {injection.at:g} s is too late: the rig is at {now:g} s")
        base, begun = self._so_far(now)
        return Schedule(base, [*self._left(), *injections], begun, now)

    def tuned(self, values: Mapping[str, float], now: float) -> "Schedule":
        """This schedule with `values` from `now` [s] on; a ramp of such a parameter ends. Raises InputError as `extended`."""
        base, begun = self._so_far(now)
        moving = [change for change in begun if change.name not in values]
        return Schedule(base.with_values(values), self._left(), moving, now)

    def parameters(self, time: float) -> ParameterSet:
        """The parameters at `time` [s], not before the schedule's beginning."""
        return self._values(time, time)

    def rig(self, time: float) -> tuple[Rig, bool]:
        """The rig at `time` [s], and whether its numbers have moved. Times must not go back."""
        while time >= self._stretches[0].end - _EARLY:
            self._stretches.pop(0)
        return self._stretches[0].rig, self._stretches[0].move(time)

    def still(self, time: float) -> Rig | None:
        """The rig at `time` [s] where nothing begins, ends or moves; None where something does."""
        stretch = self._stretches[0]
        if isinstance(stretch, Stretch) or time >= stretch.end - _EARLY:
            return None
        return None if self.planned and self.planned[0].at <= time + _EARLY else stretch.rig

    @property
    def until(self) -> float:
        """Up to when it stays as it is where it is `still` [s]."""
        return min([self._stretches[0].end, *(change.at for change in self.planned[:1])])

    def begin(self, time: float) -> list[Change]:
        """Changes that begin by `time` [s] and have not been told."""
        self._told = time
        count = sum(change.at <= time + _EARLY for change in self.planned)
        begun, self.planned = self.planned[:count], self.planned[count:]
        return begun

    def _plan(self, pending: Sequence[Injection]) -> list[Change]:
        """Changes of injections; what goes back joins the injections to come. Raises InputError."""
        planned = []
        queue = sorted(pending, key=_time)
        for injection in queue:  # which grows behind
            self._base.with_values(injection.values)
            there = self._values(injection.at, injection.at)
            before = {name: there[name].value for name in injection.values}
            for name, new in injection.values.items():
                change = Change(name, self._base[name].unit, before[name], float(new), injection.at, injection.ramp)
                self._lines.setdefault(name, []).append(change)
                planned.append(change)
            self._pending.append(replace(injection, until=inf))
            if injection.until < inf:
                insort(queue, Injection(before, injection.until, injection.ramp), key=_time)
        return planned

    def _stretched(self, now: float) -> list[Stretch | Rest]:
        """What the rig is from `now` [s] on. Raises InputError."""
        times = {time for line in self._lines.values() for change in line for time in (change.at, change.end)}
        begins = [now, *sorted(time for time in times if time > now + _EARLY)]
        stretches: list[Stretch | Rest] = []
        for begin, end in pairwise([*begins, inf]):
            first = self._values(begin, begin)
            if any(change.end > begin + _EARLY for change in self._active(begin)):
                stretches.append(Stretch(begin, end, first, self._values(begin, end)))
            else:
                stretches.append(Rest(end, first))
        return stretches

    def _so_far(self, now: float) -> tuple[ParameterSet, list[Change]]:
        """Parameters with the changes that have ended by `now` [s], and the changes under way."""
        begun = self._active(self._told)
        moving = [change for change in begun if change.end > now]
        return self._base.with_values({change.name: change.new for change in begun if change.end <= now}), moving

    def _left(self) -> list[Injection]:
        """Injections that have not begun."""
        return [injection for injection in self._pending if injection.at > self._told + _EARLY]

    def _values(self, begin: float, time: float) -> ParameterSet:
        """Parameters at `time` [s] by the changes that have begun at `begin` [s]."""
        return self._base.with_values({change.name: change.value(time) for change in self._active(begin)})

    def _active(self, time: float) -> list[Change]:
        """The change of each parameter that began last by `time` [s], where one has."""
        lines = ([change for change in line if change.at <= time + _EARLY] for line in self._lines.values())
        return [line[-1] for line in lines if line]


def _time(injection: Injection) -> float:
    return injection.at
