"""Sliding contact: friction force along a measured path, and the reading of a force sensor, at each sample.

Equation        F = (mu N + F_c) m + F_v v;  m follows sign(v) at the rate C  (the clutch's law, `plant_sim.rigs.clutch_unit`)
                reading: F + F_o,  F_o: other forces on the sensor (inertia, pressure on a rod)
Effects         those of the simulator at a lever of 1 m: the force is their torque channel, a rod's seal that of the piston
Assumptions     constant speed within a sample; the path is the measured one, whatever the friction is
Not modelled    noise
References      Armstrong-Helouvry, Dupont and Canudas de Wit 1994, Automatica 30(7): Coulomb and viscous friction with sign(v),
                which m reaches within one sample
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from numba import from_dtype, njit

from clutch_hil.discrepancy.models.linear_motion import STRIBECK_DEPTH, Scale, convert_law_values
from clutch_hil.discrepancy.models.ripple_starts import find_ripple_starts
from clutch_hil.fitting.model import Candidate, Columns, Output, Values
from clutch_hil.recordings.checks.knowledge import Implied, Limits
from clutch_hil.recordings.measured_motion import Motion
from plant_sim.effects.catalogue import find_effect
from plant_sim.effects.signals import DRIVE, PISTON, SENSORS, SIGNALS, bind_laws, call, has_law
from plant_sim.effects.start import StrongestOrder
from plant_sim.effects.table import make_table_of
from plant_sim.rigs.clutch_unit import slide
from protocols.files.parameters import ParameterSet, load_defaults
from protocols.files.units import ZERO_CELSIUS

_PARAMETERS = Path(__file__).parent
ROOM_TEMPERATURE = 20.0 + ZERO_CELSIUS  # K: these rigs measure no temperature, and no candidate depends on it

# Fields of the clutch's parameters that its friction law and the laws of the candidates read
_FIELDS = (
    "clutch_coulomb_slope", "clutch_coulomb_intercept", "clutch_viscous_slope", "clutch_viscous_intercept",
    "clutch_viscous_exponent", "clutch_beta_inf", "clutch_beta_onset", "clutch_beta_scale", "clutch_stribeck_speed",
    "clutch_attraction", "piston_contact_pressure",
)  # fmt: skip
_SPEED = "speed_m_s"  # column that a run may have
_SLIDING = 0.3  # of the greatest speed: chosen; pre-sliding and the dip of friction at a reversal occur below
_RECORD = np.dtype([(name, np.float64) for name in _FIELDS])
_RECORD_TYPE = from_dtype(_RECORD)
_CONSTANT = {
    "clutch_viscous_exponent": 1.0,
    "clutch_beta_onset": -1e9, "clutch_beta_scale": 1.0,  # beta does not depend on the load
    "clutch_stribeck_speed": 1.0,  # m/s, of which stribeck_change.speed is a multiple
    "clutch_attraction": 1e4,  # 1/s: sign(v) within a sample of 1 ms; friction_lag reduces it
}  # fmt: skip


class Drive(NamedTuple):
    """Loads of a contact, each (n,): normal force N [N], pressure on a seal [Pa], other forces F_o on the sensor [N]."""

    load: np.ndarray
    pressure: np.ndarray
    other: np.ndarray


class SlidingContact(ABC):
    """A `Model` of a rig with friction along a measured path; subclasses define its motion and its loads.

    parameters: as changed by a model file (`--model`), None for those of the rig. An effect that is on in them belongs to the
    baseline.
    """

    name: str
    inputs: tuple[str, ...]
    output: ClassVar[Output]
    scale: ClassVar[Scale]
    known: ClassVar[tuple[Candidate, ...]]  # every candidate of the rig
    defaults: ClassVar[str]  # file of plant_sim/parameters
    lag: ClassVar[float] = Limits.delay  # s: largest delay of friction; larger for far deflection in slow strokes
    load: ClassVar[str] = ""  # column of the normal load, which a run may have

    def __init__(self, parameters: ParameterSet | None = None) -> None:
        whole = self.list_nominal_parameters() if parameters is None else parameters
        on = [c for c in self.known if any(whole[f"{c.name}.{s.name}"].value != s.off for s in c.strengths)]
        self._always = {f"{c.name}.{p.name}": whole[f"{c.name}.{p.name}"].value for c in on for p in c.parameters}
        self.parameters = ParameterSet({n: p for n, p in whole.items() if n.partition(".")[0] not in self._names()})
        self.candidates = tuple(c for c in self.known if c not in on)
        self.outputs = (replace(self.output, resolution=self.parameters["sensor.repeatability"].si),)

    @classmethod
    def list_nominal_parameters(cls) -> ParameterSet:
        """Return the parameters of the baseline and of every candidate, switched off."""
        own = load_defaults(_PARAMETERS / cls.defaults)
        return ParameterSet({**own, **{name: p for c in cls.known for name, p in c.declare_parameters().items()}})

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        """See `Model`."""
        own = self.parameters.with_values(parameters)
        values = {**self._always, **effects}
        on = [c for c in self.known if any(f"{c.name}.{s.name}" in values for s in c.strengths)]
        period = float(run["time_s"][1] - run["time_s"][0])
        moved = self._track_motion(run, own, period)
        drive = self._list_loads(run, own, moved)
        table = make_table_of(
            [find_effect(c.name) for c in on], [v for c in on for v in convert_law_values(c, values)], _RECORD_TYPE
        )
        record = self._record(own, on)
        column = self.output.column
        m = 0.0  # initial friction as a share of its level, as measured
        level = record["clutch_coulomb_slope"] * drive.load[0] + record["clutch_coulomb_intercept"]
        if column in run and level > 0.0:
            m = min(max((float(run[column][0]) - drive.other[0]) / level, -1.0), 1.0)
        states = table.make_rest_states()
        if "presliding" in table.spans:  # initial deflection, which gives the full level in sliding
            states[slice(*table.spans["presliding"])] = m
            m = float(np.sign(m))
        c = np.array([tuple(record[name] for name in _FIELDS)], dtype=_RECORD)
        force = np.empty(moved.position.size)
        play(*moved[:2], *drive, m, period, c, table.kernel, states, force)
        return {column: force}

    def suggest_starts(self, candidate: Candidate, run: Columns, residuals: Columns) -> list[dict[str, float]]:
        """See `Hinting`: periods in the residual over the path; sizes of pre-sliding and of Stribeck speed."""
        typical, start = candidate.list_typical_values(), find_effect(candidate.name).start
        if isinstance(start, StrongestOrder):
            period = float(run["time_s"][1] - run["time_s"][0])
            moved, left = self._track_motion(run, self.parameters, period), residuals[self.output.column]
            carrier = np.ones(left.size)
            if start.share_of == "clutch_torque_nm":  # a share of the friction
                carrier = np.sign(moved.speed) * self._compute_level(run, moved)
            elif start.share_of == "motor_torque_nm":  # the drive must be commanded to supply what the motor lacks
                carrier = left - run[self.output.column]
            return find_ripple_starts(candidate, moved, left, carrier)
        tried: list[dict[str, float]] = [{}]
        for name, shares in _START_SHARES.get(candidate.name, {}).items():
            low, high = next(p.bounds for p in candidate.parameters if p.name == name)
            values = [low + share * (high - low) for share in shares]
            tried = [one | {f"{candidate.name}.{name}": value} for one in tried for value in values]
        return [typical | one for one in tried if one]

    def _compute_level(self, run: Columns, moved: Motion) -> np.ndarray:
        """Return the Coulomb friction [N] (n,) of the baseline as declared."""
        contact = self._list_contact(self.parameters)
        load = self._list_loads(run, self.parameters, moved).load
        return contact.get("clutch_coulomb_slope", 0.0) * load + contact.get("clutch_coulomb_intercept", 0.0)

    def list_limits(self) -> Mapping[str, Limits]:
        """See `Ranged`: the path and the force for which the rig is designed; the first input is the position."""
        return {
            self.inputs[0]: Limits(span=self.scale.path),
            self.output.column: Limits(span=self.scale.force, delay=self.lag),
        }

    def from_others(self, run: Columns) -> Mapping[str, tuple[str, np.ndarray]]:
        """See `Redundant`: a recorded speed must be the derivative of the position."""
        if _SPEED not in run or "motion.window" not in self.parameters:
            return {}
        moved = self._track_motion(run, self.parameters, float(run["time_s"][1] - run["time_s"][0]))
        return {_SPEED: (self.inputs[0], moved.speed)}

    def imply_inputs(self, run: Columns, floors: Mapping[str, float]) -> Mapping[str, Implied]:
        """See `Implying`: friction has the sign of the speed, and gives the load to which it is proportional."""
        own, column = self.parameters, self.output.column
        moved = self._track_motion(run, own, float(run["time_s"][1] - run["time_s"][0]))
        friction = run[column] - self._list_loads(run, own, moved).other
        implied = {self.inputs[0]: Implied(column, floors[column], friction=friction, speed=moved.speed)}
        contact = self._list_contact(own)
        slope = contact.get("clutch_coulomb_slope", 0.0)
        if self.load in run and slope > 0.0:
            speed = np.abs(moved.speed)
            rest = contact.get("clutch_coulomb_intercept", 0.0) + contact.get("clutch_viscous_intercept", 0.0) * speed
            slides = speed > _SLIDING * float(speed.max())
            load = np.where(slides, (friction * np.sign(moved.speed) - rest) / slope, np.nan)
            implied[self.load] = Implied(column, floors[column] / slope, values=load)
        return implied

    @abstractmethod
    def _track_motion(self, run: Columns, own: ParameterSet, period: float) -> Motion:
        """Return the motion at the samples of a run; `own`: parameters of the baseline, period [s]."""

    @abstractmethod
    def _list_loads(self, run: Columns, own: ParameterSet, moved: Motion) -> Drive:
        """Return the loads of the contact at the samples of a run; `own`: parameters of the baseline, `moved`: the motion."""

    @abstractmethod
    def _list_contact(self, own: ParameterSet) -> Mapping[str, float]:
        """Return friction mu [1] (`clutch_coulomb_slope`), F_c [N] and F_v [Ns/m]: fields of the record that are not 0."""

    def _record(self, own: ParameterSet, on: list[Candidate]) -> dict[str, float]:
        falls = any(c.name == "stribeck_change" for c in on)
        beta = 1.0 - STRIBECK_DEPTH if falls else 1.0  # depth 0 and no candidate are equivalent
        return dict.fromkeys(_FIELDS, 0.0) | _CONSTANT | {"clutch_beta_inf": beta, **self._list_contact(own)}

    @classmethod
    def _names(cls) -> set[str]:
        return {c.name for c in cls.known}


_DECADES = (1e-3, 1e-2, 1e-1)
_START_SHARES: Mapping[str, Mapping[str, tuple[float, ...]]] = {  # initial values of the fits, as shares of the bounds
    "presliding": {"angle": _DECADES, "spread": (0.0, 1.0 / 3.0)},
    "stribeck_change": {"speed": _DECADES},
}


@njit(cache=True, nogil=True, error_model="numpy")
def play(position, speed, load, pressure, other, m, period, parameters, effects, states, force):
    """Write the sensor's `force` [N] (n,) along `position` [m] at `speed` [m/s]; `m` [1] and `states` are the initial values.

    load [N], pressure [Pa], other [N]: (n,), see `Drive`; period [s].
    """
    signals = np.zeros(1, SIGNALS)
    c, s = parameters[0], signals[0]
    e = bind_laws(effects, states)
    s.temperature = ROOM_TEMPERATURE
    for k in range(position.size):
        moved = period * speed[k]
        s.time, s.angle = k * period, position[k] - 0.5 * moved  # beginning of the step; its middle is at `position`
        m, friction = slide(m, load[k], speed[k], 1.0, s, c, e, period)
        if has_law(PISTON, e):
            s.pressure, s.displacement, s.piston_force = pressure[k], moved, 0.0
            call(PISTON, e, s, c, period)
            friction += s.piston_force
        shown = friction + other[k]
        if has_law(DRIVE, e):
            s.motor_torque, s.drive_torque = 1.0, 1.0
            call(DRIVE, e, s, c, period)
            shown /= s.drive_torque  # force to command, so that this force is delivered
        if has_law(SENSORS, e):
            s.sensed_clutch_torque = shown
            call(SENSORS, e, s, c, period)
            shown = s.sensed_clutch_torque
        force[k] = shown
