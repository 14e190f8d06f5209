"""Disturbed bus: passes the frames of a plant in both directions, with planned faults."""

from collections.abc import Mapping, Sequence
from math import inf
from random import Random

from plant_sim.bus_faults.bus_fault import COMMANDS, SAMPLES, BusFault, Surroundings
from plant_sim.bus_faults.catalogue import BUS_FAULTS, PARAMETERS
from plant_sim.node.change import TIME_TOLERANCE, Change
from plant_sim.node.injection import Injection
from protocols.can.frames import Frame, FrameCodec
from protocols.errors import InputError

# Bus faults in a run, begun or planned: with this number a cycle with a fault takes 0.14 ms longer (measured)
_MOST_CHANGES = 256


class DisturbedBus:
    """A bus at a `rate` [Hz] with `frames`; `seed` of its random numbers. Without a fault it passes all frames on.

    `planned` are the changes that have not begun, in order of time.
    """

    def __init__(self, rate: int, seed: int, frames: Sequence[FrameCodec]) -> None:
        by_id, by_name = {f.can_id: f for f in frames}, {f.name: f for f in frames}
        self._around = {
            direction: Surroundings(direction, rate, by_id, by_name, Random(f"{direction} {seed}"))
            for direction in (COMMANDS, SAMPLES)
        }
        self._period = 1.0 / rate
        self._changes: list[Change] = []  # in order of time
        self._reported = 0  # how many of them `begin` has returned
        self._faults: dict[tuple[str, str], BusFault] = {}  # those that are on, by name and direction

    def check(self, injections: Sequence[Injection], now: float) -> None:
        """Raise InputError for an unknown parameter, a value out of bounds, a time before `now` [s], or too many changes."""
        for injection in injections:
            PARAMETERS.with_values(injection.values)
            if injection.at < now - TIME_TOLERANCE:
                raise InputError(f"injection at {injection.at:g} s is too late: the rig is at {now:g} s")
        count = len(self._changes) + sum(2 * len(injection.values) for injection in injections)
        if count > _MOST_CHANGES:
            raise InputError(f"the bus would have {count} changes of faults; allowed are {_MOST_CHANGES} in one run")

    def plan(self, injections: Sequence[Injection]) -> None:
        """Plan changes that `check` has passed, in order of time: a later change returns to the value set by an earlier one."""
        for injection in sorted(injections, key=lambda one: one.at):
            added = []
            for name, value in injection.values.items():
                unit, before = PARAMETERS[name].unit, self._compute_value(name, injection.at)
                added.append(Change(name, unit, before, value, injection.at, injection.ramp))
                if injection.until < inf:
                    added.append(Change(name, unit, value, before, injection.until, injection.ramp))
            self._changes = sorted([*self._changes, *added], key=lambda change: change.at)

    @property
    def planned(self) -> list[Change]:
        """Changes that have not begun, in order of time."""
        return self._changes[self._reported :]

    def begin(self, time: float) -> list[Change]:
        """Return the changes that begin up to `time` [s] and have not been returned before."""
        begun = [change for change in self.planned if change.at <= time + TIME_TOLERANCE]
        self._reported += len(begun)
        return begun

    def is_clear(self, time: float) -> bool:
        """Return whether no fault is on, begins or ends at `time` [s]."""
        if not self._changes:
            return True
        waits = any(change.at <= time + TIME_TOLERANCE for change in self.planned)
        moves = any(change.at <= time + TIME_TOLERANCE and time < change.end for change in self._changes)
        return not (waits or moves or self._list_values(time))

    def find_next(self, time: float) -> float:
        """Return the time [s] of the next change after `time`; infinity if there is none."""
        return next((change.at for change in self.planned if change.at > time + TIME_TOLERANCE), inf)

    def pass_commands(self, tick: int, frames: list[Frame]) -> list[Frame]:
        """Return the frames that arrive at the plant before its sample `tick`, out of the controllers' `frames`."""
        return self._pass_on(COMMANDS, tick, frames)

    def pass_samples(self, tick: int, frames: list[Frame]) -> list[Frame]:
        """Return the frames that arrive at the controllers, out of the `frames` of the sample `tick`."""
        return self._pass_on(SAMPLES, tick, frames)

    def _pass_on(self, direction: str, tick: int, frames: list[Frame]) -> list[Frame]:
        on = self._list_values(tick * self._period)
        for name in BUS_FAULTS:
            if name not in on or on[name].get(direction, 1.0) == 0.0:  # off, or only in the other direction
                self._faults.pop((name, direction), None)
                continue
            if (name, direction) not in self._faults:
                self._faults[name, direction] = BUS_FAULTS[name](self._around[direction])
            frames = self._faults[name, direction].pass_on(tick, frames, on[name])
        return frames

    def _list_values(self, time: float) -> Mapping[str, Mapping[str, float]]:
        """Return the parameters by short name of each fault that is on at `time` [s]."""
        on = {}
        for name in dict.fromkeys(change.name.partition(".")[0] for change in self._changes):
            values = {p.name: self._compute_value(f"{name}.{p.name}", time) for p in BUS_FAULTS[name].parameters}
            if any(values[strength.name] != strength.off for strength in BUS_FAULTS[name].list_strengths()):
                on[name] = values
        return on

    def _compute_value(self, name: str, time: float) -> float:
        """Return the value of a parameter at `time` [s], in its unit."""
        begun = [change for change in self._changes if change.name == name and change.at <= time + TIME_TOLERANCE]
        return begun[-1].compute_value(time) if begun else PARAMETERS[name].value
