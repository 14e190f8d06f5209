"""The plant as a node: commands in, sensor frames out, ground truth in its record."""

from collections.abc import Mapping, Sequence
from math import ceil, floor
from typing import Any

import numpy as np

from plant_sim.effects.catalogue import effects
from plant_sim.effects.table import switched_on
from plant_sim.node.injection import Injection, effect_on, requested
from plant_sim.node.interface import Interface
from plant_sim.node.plant_cycle import Refusal
from plant_sim.node.plant_record import COLUMNS, note_sample
from plant_sim.node.plant_rig import PlantRig
from plant_sim.node.plant_turn import PlantMemory, in_step, in_time, move
from plant_sim.node.schedule import Schedule
from plant_sim.profiles.profile import Profile, load_profile
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.wet_clutch import STATE, Whole
from protocols.buses.exchange import Exchange, empty_lines
from protocols.can.frame_batch import batch
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.units import ZERO_CELSIUS
from protocols.realtime.beat import Beat
from protocols.realtime.clock import Clock

_TEMPERATURES = 35.0, 150.0  # degC: valid range of eq. 6.3 (blocks/oil.py) and of fig 6.8
NO_SETPOINTS = np.zeros((0, 5, 0))  # tables of no profile, see `Interface`


class PlantNode(Interface):
    """The wet-clutch rig behind its data acquisition, with the profile player of the bench.

    rate [Hz]; `temperature` is the oil's at the start [degC]; `injections` change the plant while it runs, and `injected`
    tells those that have begun; a `blind` plant does not say what it is beyond its own parameters at the start. A step
    answers with the frames of the present tick and then advances the rig by one period; what it was sent acts from this
    tick on, so a command that answers tick k acts from tick k + 1.
    """

    columns = COLUMNS

    def __init__(
        self,
        rate: int = 1000,
        parameters: ParameterSet | None = None,
        profile: Profile | None = None,
        seed: int = 1,
        temperature: float | None = None,
        session: int = 1,
        injections: Sequence[Injection] = (),
        blind: bool = False,
    ) -> None:
        parameters = parameters or wet_clutch.nominal()
        kelvin = initial_temperature(parameters["oil.reference"].value if temperature is None else temperature)
        super().__init__(rate, [parameters], [seed], session, NO_SETPOINTS if profile is None else profile.table[None])
        self.profile = profile
        self._substeps = ceil(self._period / wet_clutch.STEP_LIMIT - 1e-9)
        self._schedule = Schedule(parameters)
        self.injected: list[dict[str, Any]] = []
        self._plain = parameters
        self._open = _without_effects(parameters) if blind else None  # what a blind plant says of itself
        self.inject(*injections)
        self._rig, _ = self._schedule.rig(0.0)
        speed = profile.at(0.0).speed if profile else 0.0
        y, states = self._rig.at_rest(speed, kelvin)
        # the very STATE: to tell that an equal type is this one takes Numba 8 us a call
        self._state = Whole(y.view(STATE), states)
        self._interface.speed_demand, self._interface.torque_limit = speed, self._rig.record["motor_torque_limit"][0]
        self._memory = self._new_memory()

    @staticmethod
    def warm() -> None:
        """Compile, or load from disk, all that a node runs, with effects and without: later nothing compiles."""
        wet_clutch.warm()
        for values in ({}, effect_on(next(iter(effects())))):
            node = PlantNode(parameters=wet_clutch.nominal().with_values(values))
            node.take(batch(1), 0)
            node.step([])
            node.slept(0)
            node._turns(Beat(Clock(1)), empty_lines(), batch(1), 0, 0, 0)
            node._in_step(Beat(Clock(1)), empty_lines(), batch(1), 0)

    def show(self) -> int:
        """See `Interface`."""
        sent = self._begin()
        time = self.tick * self._period
        self._follow(time)
        sent = self._show(0, self._rig, self._state, sent)
        note_sample(self.record, time, self._interfaces, self._state.y, *self._rig.phase_pressures)
        return sent

    def advance(self) -> None:
        """See `Interface`."""
        self._advance(self._period, self._substeps)

    @property
    def steady(self) -> bool:
        """See `Interface`."""
        return self.tick >= 0 and self._schedule.still(self._now) is self._rig

    def turns(self, line: Exchange, beat: Beat, changes: int, owed: int) -> int:
        """Wait for the next slot, advance, take what waits on the line, show, send, and so on: in one compiled call.

        `beat.most` samples at most; rows but the last are in the ring, and booked. Where slots were slept through, which the
        beat's clock leaves out, their samples come first, without waiting: `owed` are to come before the next wait, and it
        returns how many are after the last one. Raises InputError as `take`.
        """
        line.refresh()
        made, owed, count, sent, position = self._turns(beat, line.lines, line.inbox, line.count, changes, owed)
        self.tick += made
        if made > 1:
            line.count_settled()
        if sent < 0:
            raise InputError(self._refusal(Refusal(-sent)))
        line.finish_send(self.outbox, sent, position)
        line.discard_used(count)
        return owed

    def in_step(self, line: Exchange, beat: Beat, changes: int) -> bool:
        """Show, send, advance, wait for the answer and take it, and so on: in one compiled call.

        `beat.most` samples at most. Rows but the last are in the ring; it returns whether the last is, which may be unanswered
        either way. Raises InputError as `take`.
        """
        line.refresh()
        made, count, sent, position = self._in_step(beat, line.lines, line.inbox, changes)
        self.tick += made
        line.count_settled()
        if sent < 0:
            raise InputError(self._refusal(Refusal(-sent)))
        line.finish_send(self.outbox, sent, position)
        line.discard_used(count)
        return sent == 0

    def fixed(self, name: str) -> str | None:
        """Why a parameter cannot be changed while the plant runs; None when it can."""
        if name.partition(".")[0] == "sensors":
            return f"parameter {name} is fixed while the plant runs: its data acquisition is set up at the start"
        return None

    @property
    def blind(self) -> bool:
        """Whether the truth is kept from everybody but the recording."""
        return self._open is not None

    @property
    def parameters(self) -> ParameterSet:
        """What the plant says of its parameters: as they act from the next sample on, or, when blind, its own at the start."""
        return self._schedule.parameters(self._now) if self._open is None else self._open

    @property
    def planned(self) -> list[dict[str, Any]]:
        """Changes by injections that have not begun, as those `injected`."""
        return [change.told(self.rate) for change in self._schedule.planned]

    def tune(self, values: Mapping[str, float]) -> None:
        """Change parameters between two samples, each in its declared unit; states stay. All or none: raises InputError."""
        said = self._open if self._open is None else self._open.with_values(values)
        self._schedule = self._schedule.tuned(values, self._now)
        self._open = said
        self._follow(self._now)

    def inject(self, *injections: Injection) -> None:
        """Take changes of parameters at times to come; states stay. All or none: raises InputError."""
        for injection in injections:
            self._check_free(injection)
        self._schedule = self._schedule.extended(injections, self._now)

    def accept(self, values: Mapping[str, float], when: Mapping[str, float]) -> list[dict[str, Any]]:
        """Inject `values` when somebody from outside asks (`injection.requested`); return the changes planned for that.

        A blind plant tells neither what was before nor why it refuses what any other plant would take. Raises InputError.
        """
        injection = requested(values, when, self._now)
        if self._open is None:
            self.inject(injection)
            return self._told(injection, (injection.at, injection.until))
        self._check_free(injection)
        off = {name: value for effect in effects().values() for name, value in effect.switches}
        Schedule(self._plain.with_values(off)).extended([injection], self._now)  # what any plant would refuse is told
        try:
            self.inject(injection)
        except InputError:
            raise InputError(
                "the plant refuses this beside what it is already; being blind, it does not say why"
            ) from None
        return [told | {"old": None} for told in self._told(injection, (injection.at,))]

    @property
    def finished(self) -> bool:
        """Whether the profile has been played to its end."""
        return self.profile is not None and (self.tick + 1) * self._period >= self.profile.duration

    def _check_free(self, injection: Injection) -> None:
        if reasons := [reason for name in injection.values if (reason := self.fixed(name))]:
            raise InputError(reasons[0])

    def _told(self, injection: Injection, times: Sequence[float]) -> list[dict[str, Any]]:
        """What is planned at `times` [s] because of an injection: later ones come last."""
        planned = {(c.name, c.at): c for c in self._schedule.planned if c.name in injection.values and c.at in times}
        return [change.told(self.rate) for change in planned.values()]

    @property
    def _now(self) -> float:
        """Time of the next sample [s]."""
        return (self.tick + 1) * self._period

    def _follow(self, time: float) -> None:
        """Let the rig be what it is to be at `time` [s], of the next sample or of this one; its outputs follow."""
        rig, moved = self._schedule.rig(time)
        if rig is not self._rig or moved:
            states = rig.table.carried(self._state.effects, self._rig.table)
            self._rig = rig
            self._state = self._state._replace(effects=states)
            self._memory = self._new_memory()
            self._advance(0.0, 0)
        if self._schedule.planned:
            self.injected += [change.told(self.rate) for change in self._schedule.begin(time)]

    def _turns(
        self, beat: Beat, lines: np.ndarray, inbox: np.ndarray, count: int, changes: int, owed: int
    ) -> tuple[int, int, int, int, int]:
        """The samples of the next ticks by the kernel `in_time`, whose result this is."""
        done: tuple[int, int, int, int, int] = in_time(
            tuple(beat.memory), lines, inbox, count, self._memory, self.tick + 1, self._most(beat), changes, owed
        )
        return done

    def _in_step(self, beat: Beat, lines: np.ndarray, inbox: np.ndarray, changes: int) -> tuple[int, int, int, int]:
        """The same by the kernel `in_step`."""
        done: tuple[int, int, int, int] = in_step(
            tuple(beat.memory), lines, inbox, self._memory, self.tick + 1, self._most(beat), changes
        )
        return done

    def _new_memory(self) -> tuple[Any, ...]:
        """What compiled turns work on, until the rig changes: a PlantMemory as a plain tuple."""
        rig = self._rig
        memory = PlantMemory(
            self._interfaces, self._settings, self._setpoints, *self._state, rig.record, rig.table.kernel,
            *rig.phase_pressures, self._period, self._substeps, self.outbox, self.record,
        )  # fmt: skip
        return tuple(memory)

    def _most(self, beat: Beat) -> int:
        """Samples that one call may make: up to the next change of the rig and the profile's end."""
        most, end = beat.most, self._schedule.until
        if self.profile and not self.finished:
            end = min(end, self.profile.duration)
        left = (end - self._now) / self._period
        return most if left >= most else max(1, floor(left + 1e-6))  # times are sums of floats

    def _advance(self, duration: float, substeps: int) -> None:
        rig = self._rig
        move(self._interfaces, *self._state, rig.record, rig.table.kernel, duration, substeps)


def initial_temperature(celsius: float) -> float:
    """The oil's temperature at the start [K] from that in degC. Raises InputError."""
    low, high = _TEMPERATURES
    if not low <= celsius <= high:
        raise InputError(f"oil temperature {celsius:g} degC is outside {low:g}..{high:g} degC")
    return celsius + ZERO_CELSIUS


def _without_effects(parameters: ParameterSet) -> ParameterSet:
    return ParameterSet({name: p for name, p in parameters.items() if name.partition(".")[0] not in effects()})


RIG = PlantRig(
    name="wet_clutch",
    node=PlantNode,
    nominal=wet_clutch.nominal,
    load_profile=load_profile,
    switched_on=switched_on,
)
