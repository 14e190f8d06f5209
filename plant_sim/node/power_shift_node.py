"""The power-shift rig as a node: commands of two controllers in, sensor frames of two clutches out, true state recorded."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil
from typing import Any

from numba import njit

from plant_sim.effects.catalogue import load_effects
from plant_sim.effects.signals import DRIVE
from plant_sim.node.change import Change
from plant_sim.node.injection import Injection, parse_injection
from plant_sim.node.interface import Interface
from plant_sim.node.plant_node import NO_SETPOINTS, PlantNode, convert_initial_temperature
from plant_sim.node.plant_rig import PlantRig
from plant_sim.node.power_shift_record import COLUMNS, note_sample
from plant_sim.node.schedule import Schedule
from plant_sim.profiles.shift_profile import ShiftProfile, load_shift_profile
from plant_sim.rigs import power_shift
from plant_sim.rigs.power_shift import DRIVELINE, PowerShift
from plant_sim.rigs.wet_clutch import STATE, STEP_LIMIT, Whole
from protocols.can.frame_batch import make_batch
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet


class PowerShiftNode(Interface):
    """The power-shift rig with the data acquisition of its clutches and the profile player of the bench.

    Arguments and steps are those of `PlantNode`. Each clutch has its own frames (`two_clutches`), sensors and noise. The
    controller of clutch a commands the motor. Injections name parameters with the prefix of the clutch. It cannot run blind.
    """

    columns = COLUMNS

    def __init__(
        self,
        rate: int = 1000,
        parameters: ParameterSet | None = None,
        profile: ShiftProfile | None = None,
        seed: int = 1,
        temperature: float | None = None,
        session: int = 1,
        injections: Sequence[Injection] = (),
        blind: bool = False,
    ) -> None:
        RIG.check_blind(blind)
        self.blind = blind
        self._initial_parameters = parameters = parameters or power_shift.load_nominal()
        own = [power_shift.select_clutch_parameters(parameters, clutch) for clutch in CLUTCHES]
        seeds = [len(CLUTCHES) * seed + k for k in range(len(CLUTCHES))]
        super().__init__(rate, own, seeds, session, profile.table if profile else NO_SETPOINTS)
        self.profile = profile
        self._substeps = ceil(self._period / STEP_LIMIT - 1e-9)
        self._rig = power_shift.Rig(parameters)
        self._radius = parameters["driveline.wheel_radius"].si
        self._schedules = [Schedule(each) for each in own]
        self.inject(*injections)
        kelvin = convert_initial_temperature(
            parameters["a.oil.reference"].value if temperature is None else temperature
        )
        speed = profile.interpolate(0.0)[0].speed if profile else 0.0
        line, a, b = self._rig.make_rest_state(speed, 0.0, kelvin)
        self._state = PowerShift(  # the same type objects as in `PlantNode`
            line.view(DRIVELINE), *(Whole(clutch.y.view(STATE), clutch.effects) for clutch in (a, b))
        )
        self._interface.speed_demand, self._interface.torque_limit = speed, self._rig.a.record["motor_torque_limit"][0]

    @staticmethod
    def warm() -> None:
        """Compile, or load from disk, all kernels of this node and of `PlantNode`."""
        PlantNode.warm()
        node = PowerShiftNode()
        node.take(make_batch(1), 0)
        node.step([])

    def show(self) -> int:
        """See `Interface`."""
        sent = self._begin()
        time = self.tick * self._period
        self._update_rigs(time)
        sent = self._show(0, self._rig.a, self._state.a, sent)
        sent = self._show(1, self._rig.b, self._state.b, sent)
        line, (a, _), (b, _) = self._state
        note_sample(self.record, time, self._interfaces, line, a, b, self._radius)
        return self._pass_samples(sent)

    def advance(self) -> None:
        """See `Interface`."""
        self._advance(self._period, self._substeps)

    @property
    def parameters(self) -> ParameterSet:
        """Parameters that act from the next sample on."""
        values: dict[str, float] = {}
        for clutch, schedule in zip(CLUTCHES, self._schedules, strict=True):
            present = schedule.list_parameters(self._now)
            values |= {_make_whole_name(name, clutch): p.value for name, p in present.items()}
        return self._initial_parameters.with_values(values)

    @property
    def planned_changes(self) -> list[dict[str, Any]]:
        """Changes by injections that have not begun, in the form of `injected_changes`."""
        parts = zip(CLUTCHES, self._schedules, strict=True)
        changes = [change for clutch, schedule in parts for change in self._describe_changes(schedule.planned, clutch)]
        return [*changes, *(change.to_dict(self.rate) for change in self.bus.planned)]

    def explain_fixed(self, name: str) -> str | None:
        """Return why a parameter cannot change while the plant runs; None when it can."""
        group, _, rest = name.partition(".")
        part = rest.partition(".")[0] if group in CLUTCHES else group
        if part in ("driveline", "sensors"):
            return f"parameter {name} is fixed while the plant runs: driveline and data acquisition are set up at the start"
        if group in CLUTCHES and part in load_effects() and DRIVE in load_effects()[part].laws:
            return power_shift.explain_refusal(group, part)
        return None

    def tune(self, values: Mapping[str, float]) -> None:
        """Change parameters between two samples, each in its declared unit; states are unchanged.

        All values are taken or, with an InputError, none.
        """
        self._check_free(values)
        parts = [power_shift.select_clutch(values, clutch) for clutch in CLUTCHES]
        self._schedules = [
            schedule.with_values(part, self._now) if part else schedule
            for schedule, part in zip(self._schedules, parts, strict=True)
        ]
        self._update_rigs(self._now)

    def inject(self, *injections: Injection) -> None:
        """Plan changes of parameters, and faults of the bus, at future times. All are taken or, with an InputError, none."""
        rig, bus = self._split_injections(injections)
        for injection in rig:
            self._check_free(injection.values)
        schedules = []
        for clutch, schedule in zip(CLUTCHES, self._schedules, strict=True):
            parts = [(i, power_shift.select_clutch(i.values, clutch)) for i in rig]
            own = [replace(injection, values=part) for injection, part in parts if part]
            schedules.append(schedule.with_injections(own, self._now) if own else schedule)
        self._schedules = schedules
        self.bus.plan(bus)

    def accept(self, values: Mapping[str, float], when: Mapping[str, float]) -> list[dict[str, Any]]:
        """Inject `values` by a telemetry request (`parse_injection`); return the planned changes. Raises InputError."""
        known = self.planned_changes
        self.inject(parse_injection(values, when, self._now))
        accepted = self.planned_changes
        for change in known:  # removes one of several equal changes
            if change in accepted:
                accepted.remove(change)
        return accepted

    @property
    def finished(self) -> bool:
        """Whether the profile has ended."""
        return self.profile is not None and self._now >= self.profile.duration

    def _check_free(self, values: Mapping[str, float]) -> None:
        """Raise InputError for impossible values, and for parameters that cannot change while the plant runs."""
        self._initial_parameters.with_values(values)
        if reasons := [reason for name in values if (reason := self.explain_fixed(name))]:
            raise InputError(reasons[0])

    def _advance(self, duration: float, substeps: int) -> None:
        """Advance the rig by `duration` [s] in `substeps`."""
        rig, (line, a, b) = self._rig, self._state
        parameters = rig.record, rig.a.record, rig.b.record
        effects = rig.a.table.attachments, rig.b.table.attachments
        _move(self._interfaces, (line, *a, *b), parameters, effects, duration, substeps)

    def _update_rigs(self, time: float) -> None:
        """Set both clutches to their parameters at `time` [s]; outputs follow."""
        driveline, *wholes = self._state
        rigs = [self._rig.a, self._rig.b]
        changed = False
        for k, (clutch, schedule) in enumerate(zip(CLUTCHES, self._schedules, strict=True)):
            rig, moved = schedule.make_rig(time)
            if rig is not rigs[k] or moved:
                states = rig.table.carry_over(wholes[k].effects, rigs[k].table)
                rigs[k], wholes[k] = rig, wholes[k]._replace(effects=states)
                changed = True
            if schedule.planned:
                self.injected_changes += self._describe_changes(schedule.begin(time), clutch)
        if changed:
            self._rig.a, self._rig.b = rigs
            self._state = PowerShift(driveline, *wholes)
            self._advance(0.0, 0)

    def _describe_changes(self, changes: Sequence[Change], clutch: str) -> list[dict[str, Any]]:
        """Return changes of a clutch as dictionaries. Both schedules have those of the motor: only clutch a lists them."""
        return [
            change.to_dict(self.rate) | {"name": _make_whole_name(change.name, clutch)}
            for change in changes
            if clutch == CLUTCHES[0] or not power_shift.is_motor(change.name)
        ]


@njit(cache=True, nogil=True)
def _move(interfaces: Any, state: Any, parameters: Any, effects: Any, duration: Any, substeps: Any) -> None:
    """Advance the rig in place by `duration` [s] (`power_shift.advance`), with the inputs of the interface.

    `state` has the driveline, then rig and effects of clutch a and of b; `parameters` has those of the driveline, of a and of
    b; `effects` has those of a and of b. All are plain tuples: a named one costs 1 us more a call.
    """
    interface, (line, a, states_a, b, states_b) = interfaces[0], state
    (driveline, parameters_a, parameters_b), (effects_a, effects_b) = parameters, effects
    line_after, a_after, b_after, states_a_after, states_b_after = power_shift.advance(
        line, a, states_a, b, states_b, interface.clutches[0].voltage, interface.clutches[1].voltage,
        interface.speed_demand, interface.torque_limit, driveline, parameters_a, parameters_b, effects_a, effects_b,
        duration, substeps,
    )  # fmt: skip
    line[0], a[0], b[0] = line_after[0], a_after[0], b_after[0]
    states_a[:], states_b[:] = states_a_after, states_b_after


def _make_whole_name(name: str, clutch: str) -> str:
    """Return the name of a parameter of clutch or motor among those of the power-shift rig."""
    return name if power_shift.is_motor(name) else f"{clutch}.{name}"


RIG = PlantRig(
    name=power_shift.NAME,
    node=PowerShiftNode,
    nominal=power_shift.load_nominal,
    load_profile=load_shift_profile,
    list_active_effects=power_shift.list_active_effects,
    clutches=CLUTCHES,
    not_blind="a run of two clutches cannot be blind: its verdict needs the true output torque, which no sensor measures",
)
