"""The wet-clutch plant as a node: it takes command frames, sends sensor frames and records the true state."""

from collections.abc import Mapping, Sequence
from math import ceil, floor
from typing import Any

import numpy as np

from plant_sim.effects.catalogue import load_effects
from plant_sim.effects.table import list_active_effects
from plant_sim.node.injection import Injection, parse_injection, switch_on
from plant_sim.node.interface import Interface
from plant_sim.node.plant_record import COLUMNS, note_sample
from plant_sim.node.plant_rig import PlantRig
from plant_sim.node.plant_turn import PlantMemory, move, run_lockstep, run_real_time
from plant_sim.node.schedule import Schedule
from plant_sim.profiles.profile import Profile, load_profile
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.wet_clutch import STATE, Whole
from protocols.buses.exchange import Exchange, make_empty_lines
from protocols.can.frame_batch import make_batch
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.units import ZERO_CELSIUS
from protocols.realtime.beat import Beat
from protocols.realtime.clock import Clock

_OIL_TEMPERATURES = 35.0, 150.0  # degC: valid range of eq. 6.3 (blocks/oil.py) and of fig 6.8
STEPS = ("take", "show", "advance")  # methods that make a sample
NO_SETPOINTS = np.zeros((0, 5, 0))  # set-points without a profile: no clutch has a table, see `Interface`


class PlantNode(Interface):
    """The wet-clutch rig with its data acquisition and the profile player of the bench.

    rate [Hz]; `temperature` [degC] of the oil at the start. `injections` change parameters while the plant runs;
    `injected_changes` lists those that have begun. A `blind` plant shows only its initial parameters without effects.
    `memory` is the PlantMemory of the present rig, for compiled calls.

    A step returns the frames of the present tick and then advances the rig by one period. Commands given to a step act from its
    tick on, so a command that answers tick k acts from tick k + 1.

    A subclass may replace the steps `take`, `show` and `advance`, and append to `columns`: its `show` then fills the last
    entries of `record`. Its samples are made in Python, one by one.
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
        parameters = parameters or wet_clutch.load_nominal()
        kelvin = convert_initial_temperature(parameters["oil.reference"].value if temperature is None else temperature)
        super().__init__(rate, [parameters], [seed], session, NO_SETPOINTS if profile is None else profile.table[None])
        self.profile = profile
        self._substeps = ceil(self._period / wet_clutch.STEP_LIMIT - 1e-9)
        self._schedule = Schedule(parameters)
        self._initial_parameters = parameters
        self._shown_parameters = _remove_effects(parameters) if blind else None  # of a blind plant
        self.inject(*injections)
        self._rig, _ = self._schedule.make_rig(0.0)
        speed = profile.interpolate(0.0).speed if profile else 0.0
        y, states = self._rig.make_rest_state(speed, kelvin)
        # The same type object as STATE: for an equal but other object Numba compares types, 8 us a call
        self._state = Whole(y.view(STATE), states)
        self._interface.speed_demand, self._interface.torque_limit = speed, self._rig.record["motor_torque_limit"][0]
        self.memory = self._make_memory()
        # Compiled calls would pass over the steps and columns of a subclass
        self._compiled = all(getattr(type(self), name) is getattr(PlantNode, name) for name in ("columns", *STEPS))

    @staticmethod
    def warm() -> None:
        """Compile, or load from disk, all kernels of a node, with effects and without: nothing compiles later."""
        wet_clutch.warm()
        for values in ({}, switch_on(next(iter(load_effects())))):
            node = PlantNode(parameters=wet_clutch.load_nominal().with_values(values))
            node.take(make_batch(1), 0)
            node.step([])
            node.skip_periods(0)
            node._run_real_time(Beat(Clock(1)), make_empty_lines(), make_batch(1), 0, 0, 0)
            node._run_lockstep(Beat(Clock(1)), make_empty_lines(), make_batch(1), 0)

    def show(self) -> int:
        """See `Interface`."""
        sent = self._begin()
        time = self.tick * self._period
        self._update_rig(time)
        sent = self._show(0, self._rig, self._state, sent)
        note_sample(self.record[: len(COLUMNS)], time, self._interfaces, self._state.y, *self._rig.phase_pressures)
        return self._pass_samples(sent)

    def advance(self) -> None:
        """See `Interface`."""
        self._advance(self._period, self._substeps)

    @property
    def steady(self) -> bool:
        """See `Interface`."""
        return (
            self._compiled
            and self.tick >= 0
            and self._schedule.make_constant_rig(self._now) is self._rig
            and self.bus.is_clear(self._now)
        )

    def run_real_time(self, line: Exchange, beat: Beat, changes: int, owed: int) -> int:
        """Make samples in one compiled call: wait for the slot, advance, take the frames on the line, show, send; repeat.

        It makes at most `beat.most` samples. All rows but the last are written to the ring and timed. Missed slots, which the
        beat's clock skips, have samples too: they are sent without waiting. `owed` is the number of such samples before the
        next wait; then the line's inbox must be empty. The return value is their number after the last sample. Raises
        InputError as `take`.
        """
        line.refresh()
        samples, owed, count, sent, position = self._run_real_time(
            beat, line.lines, line.inbox, line.count, changes, owed
        )
        self.tick += samples
        if samples > 1:
            line.count_settled()
        if sent < 0:
            self._refuse(-sent)
        line.finish_send(self.outbox, sent, position)
        line.discard_used(count)
        return owed

    def run_lockstep(self, line: Exchange, beat: Beat, changes: int) -> bool:
        """Make samples in one compiled call: show, send, advance, wait for the answer, take it; repeat.

        It makes at most `beat.most` samples. All rows but the last are written to the ring; returns whether the last row is
        written as well. The last sample may be unanswered in both cases. Raises InputError as `take`.
        """
        line.refresh()
        samples, count, sent, position = self._run_lockstep(beat, line.lines, line.inbox, changes)
        self.tick += samples
        line.count_settled()
        if sent < 0:
            self._refuse(-sent)
        line.finish_send(self.outbox, sent, position)
        line.discard_used(count)
        return sent == 0

    def explain_fixed(self, name: str) -> str | None:
        """Return why a parameter cannot change while the plant runs; None when it can."""
        if name.partition(".")[0] == "sensors":
            return f"parameter {name} is fixed while the plant runs: its data acquisition is set up at the start"
        return None

    @property
    def blind(self) -> bool:
        """Whether the plant hides its true parameters and states from all but the recording."""
        return self._shown_parameters is not None

    @property
    def parameters(self) -> ParameterSet:
        """Parameters as the plant shows them: those of the next sample or, when blind, the initial ones without effects."""
        return self._schedule.list_parameters(self._now) if self._shown_parameters is None else self._shown_parameters

    @property
    def planned_changes(self) -> list[dict[str, Any]]:
        """Changes by injections that have not begun, in the form of `injected_changes`."""
        return [change.to_dict(self.rate) for change in (*self._schedule.planned, *self.bus.planned)]

    def tune(self, values: Mapping[str, float]) -> None:
        """Change parameters between two samples, each in its declared unit; states are unchanged.

        All values are taken or, with an InputError, none.
        """
        shown = self._shown_parameters if self._shown_parameters is None else self._shown_parameters.with_values(values)
        self._schedule = self._schedule.with_values(values, self._now)
        self._shown_parameters = shown
        self._update_rig(self._now)

    def inject(self, *injections: Injection) -> None:
        """Plan changes of parameters, and faults of the bus, at future times. All are taken or, with an InputError, none."""
        rig, bus = self._split_injections(injections)
        for injection in rig:
            self._check_free(injection)
        self._schedule = self._schedule.with_injections(rig, self._now)
        self.bus.plan(bus)

    def accept(self, values: Mapping[str, float], when: Mapping[str, float]) -> list[dict[str, Any]]:
        """Inject `values` by a telemetry request (`parse_injection`); return the planned changes.

        A blind plant hides the old values. It gives a reason for a refusal only if every plant would refuse. Raises InputError.
        """
        injection = parse_injection(values, when, self._now)
        if self._shown_parameters is None:
            self.inject(injection)
            return self._list_planned(injection, (injection.at, injection.until))
        rig, _ = self._split_injections([injection])
        for part in rig:
            self._check_free(part)
        off = {name: value for effect in load_effects().values() for name, value in effect.switches}
        # Raises for requests that every plant refuses, whatever its effects: this reason may be reported
        Schedule(self._initial_parameters.with_values(off)).with_injections(rig, self._now)
        try:
            self.inject(injection)
        except InputError:
            raise InputError(
                "the plant refuses this in its present state; a blind plant does not give the reason"
            ) from None
        return [change | {"old": None} for change in self._list_planned(injection, (injection.at,))]

    @property
    def finished(self) -> bool:
        """Whether the profile has ended."""
        return self.profile is not None and (self.tick + 1) * self._period >= self.profile.duration

    def _check_free(self, injection: Injection) -> None:
        """Raise InputError for a parameter that cannot change while the plant runs."""
        if reasons := [reason for name in injection.values if (reason := self.explain_fixed(name))]:
            raise InputError(reasons[0])

    def _list_planned(self, injection: Injection, times: Sequence[float]) -> list[dict[str, Any]]:
        """Return the changes planned at `times` [s] for the parameters of an injection; of two at the same time, the newer."""
        changes = *self._schedule.planned, *self.bus.planned
        planned = {(c.name, c.at): c for c in changes if c.name in injection.values and c.at in times}
        return [change.to_dict(self.rate) for change in planned.values()]

    def _update_rig(self, time: float) -> None:
        """Set the rig to its parameters at `time` [s], of this sample or the next; outputs follow."""
        rig, moved = self._schedule.make_rig(time)
        if rig is not self._rig or moved:
            states = rig.table.carry_over(self._state.effects, self._rig.table)
            self._rig = rig
            self._state = self._state._replace(effects=states)
            self.memory = self._make_memory()
            self._advance(0.0, 0)
        if self._schedule.planned:
            self.injected_changes += [change.to_dict(self.rate) for change in self._schedule.begin(time)]

    def _run_real_time(
        self, beat: Beat, lines: np.ndarray, inbox: np.ndarray, count: int, changes: int, owed: int
    ) -> tuple[int, int, int, int, int]:
        """Call the kernel `run_real_time` for the samples of the next ticks; return its result."""
        done: tuple[int, int, int, int, int] = run_real_time(
            tuple(beat.memory), lines, inbox, count, self.memory, self.tick + 1, self.limit_samples(beat.most), changes,
            owed,
        )  # fmt: skip
        return done

    def _run_lockstep(
        self, beat: Beat, lines: np.ndarray, inbox: np.ndarray, changes: int
    ) -> tuple[int, int, int, int]:
        """Call the kernel `run_lockstep` for the samples of the next ticks; return its result."""
        done: tuple[int, int, int, int] = run_lockstep(
            tuple(beat.memory), lines, inbox, self.memory, self.tick + 1, self.limit_samples(beat.most), changes
        )
        return done

    def _make_memory(self) -> tuple[Any, ...]:
        """Return the PlantMemory of the present rig as a plain tuple."""
        rig = self._rig
        memory = PlantMemory(
            self._interfaces, self._settings, self._setpoints, *self._state, rig.record, rig.table.kernel,
            *rig.phase_pressures, self._period, self._substeps, self.outbox, self.record,
        )  # fmt: skip
        return tuple(memory)

    def limit_samples(self, most: int) -> int:
        """Return how many samples, up to `most`, one call may make: until the rig changes or the profile ends, at least 1."""
        end = min(self._schedule.until, self.bus.find_next(self._now))
        if self.profile and not self.finished:
            end = min(end, self.profile.duration)
        remaining = (end - self._now) / self._period
        return most if remaining >= most else max(1, floor(remaining + 1e-6))  # tolerance for rounding of the times

    def _advance(self, duration: float, substeps: int) -> None:
        """Advance the rig by `duration` [s] in `substeps`."""
        rig = self._rig
        move(self._interfaces, *self._state, rig.record, rig.table.kernel, duration, substeps)


def convert_initial_temperature(celsius: float) -> float:
    """Convert the initial oil temperature from degC to K. Raises InputError when it is out of range."""
    low, high = _OIL_TEMPERATURES
    if not low <= celsius <= high:
        raise InputError(f"oil temperature {celsius:g} degC is outside {low:g}..{high:g} degC")
    return celsius + ZERO_CELSIUS


def _remove_effects(parameters: ParameterSet) -> ParameterSet:
    """Return the parameters of the rig alone."""
    return ParameterSet({name: p for name, p in parameters.items() if name.partition(".")[0] not in load_effects()})


RIG = PlantRig(
    name="wet_clutch",
    node=PlantNode,
    nominal=wet_clutch.load_nominal,
    load_profile=load_profile,
    list_active_effects=list_active_effects,
)
