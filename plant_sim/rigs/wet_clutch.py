"""The wet-clutch rig of chapter 6: valve, cylinder, piston, clutch, oil, motor.

Equation        docs/rig.md, eq. 1 to 8: laws in `plant_sim.blocks`, clutch in `clutch_unit`, and the effects that are on
Integration     steps of at most 0.1 ms. Valve, cylinder and piston: classical Runge-Kutta of order 4. Friction state: exact
                exponential at the pressure of mid-step. Motor, oil, angle: midpoint rule. Against LSODA at rtol 1e-9
                (tests/plant_sim/test_wet_clutch.py) the pressure differs by less than an ADC step.
Assumptions     inputs constant over a call; viscosity ratio constant over a step
Not modelled    see each block; effects beside the baseline: `clutch-hil effects`
References      Janssens 2010, chapter 6
"""

from collections.abc import Mapping
from functools import cache
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, njit

from plant_sim.blocks import motor, oil
from plant_sim.effects.catalogue import load_effects as catalogue
from plant_sim.effects.signals import DRIVE, RIG, SENSORS, SIGNALS, bind_laws, call, has_law, set_known
from plant_sim.effects.table import compile_all, make_table, sum_added_rates
from plant_sim.rigs.clutch_unit import actuate, friction_pressure, slide, stack_force, viscosity_ratio
from plant_sim.rigs.sensors import Scales, Sensors
from plant_sim.rigs.standstill import LONGEST_STEP, hold, nearly_at_rest, step_near_standstill, torque_capacity
from protocols.can.size import Size, find_database, read_size
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet, load_defaults, load_overlay

DEFAULTS = Path(__file__).parents[1] / "parameters" / "janssens2010.toml"
STEP_LIMIT = 1e-4  # s, longest integration step: chosen; the stack on its damping has a time constant of 0.4 ms

_STABILITY_LIMIT = 2.5  # rate times step: Runge-Kutta 4 is stable up to 2.78 on the real axis, less a margin
_TORQUE_SENSITIVITIES = ("sensors.motor_torque_sensitivity", "sensors.clutch_torque_sensitivity")
_TORQUE_NOISE = "sensors.torque_noise"
_PRESSURE_SENSITIVITY, _PRESSURE_NOISE = "sensors.pressure_sensitivity", "sensors.pressure_noise"
_GROUPS = ("valve", "hydraulics", "piston", "clutch", "oil", "motor", "sensors", "standstill")


class State(NamedTuple):
    """State and outputs of the rig at `time`."""

    time: float  # s
    valve_pressure: float  # Pa
    valve_rate: float  # Pa/s
    pressure: float  # Pa, cylinder
    position: float  # m, piston, 0 at rest
    seal_force: float  # N, of effects against the piston's motion
    friction_state: float  # m of eq. 6.9, dimensionless
    temperature: float  # K, oil
    slip_speed: float  # rad/s
    speed_integral: float  # rad, of the motor's speed controller
    angle: float  # rad
    lead: float  # rad/s, speed of the motor less that of the turning plate; 0 on a rigid shaft
    acceleration: float  # rad/s^2, of the turning plate
    clutch_torque: float  # Nm, M
    motor_torque: float  # Nm, M_m
    normal_force: float  # N, on the plates
    sensed_pressure: float  # Pa
    sensed_temperature: float  # K
    sensed_motor_torque: float  # Nm
    sensed_clutch_torque: float  # Nm


STATE = np.dtype([(name, np.float64) for name in State._fields])  # a State as the kernel takes it


class Whole(NamedTuple):
    """Everything that moves: the rig `y`, structured array (1,) of STATE, and the states of its effects, (k,)."""

    y: np.ndarray
    effects: np.ndarray

    def read(self) -> State:
        """Return the rig's state as plain floats, quick to read."""
        return State(*self.y.view(np.float64).tolist())


def load_nominal(changed: Path | None = None) -> ParameterSet:
    """Return the nominal parameters (docs/rig.md, effects off), changed by a user's file if given. Raises InputError."""
    own = load_defaults(DEFAULTS)
    if taken := {name.partition(".")[0] for name in own} & set(catalogue()):
        raise InputError(f"effect {min(taken)} has the name of a parameter group of the rig; rename the effect")
    declared = {
        name: parameter for effect in catalogue().values() for name, parameter in effect.declare_parameters().items()
    }
    shipped = fit_sensors(ParameterSet({**own, **declared}), read_size(find_database()))
    return load_overlay(changed, shipped, rig="wet_clutch") if changed else shipped


def fit_sensors(parameters: ParameterSet, size: Size) -> ParameterSet:
    """Return `parameters` with torque and pressure sensors for a bench of another `size`.

    Their output voltages at the scaled range, and their noise in volts, stay the same.
    """
    values = {name: parameters[name].value / size.torque for name in _TORQUE_SENSITIVITIES}
    values[_TORQUE_NOISE] = size.torque * parameters[_TORQUE_NOISE].value
    values[_PRESSURE_SENSITIVITY] = parameters[_PRESSURE_SENSITIVITY].value / size.pressure
    values[_PRESSURE_NOISE] = size.pressure * parameters[_PRESSURE_NOISE].value
    return parameters if size == Size() else parameters.with_values(values)


def list_values(parameters: ParameterSet) -> dict[str, float]:
    """Return the values of the kernel's record, SI, by `group_name`: parameters of the rig and derived ones.

    Raises InputError.
    """
    values = {f"{group}_{name}": v for group in _GROUPS for name, v in parameters.list_si(group).items()}
    for name, parameter in parameters.items():
        if name.startswith("sensors.") and name.endswith("_bits") and parameter.value % 1.0:
            raise InputError(f"parameter {name} = {parameter.value:g} bit must be a whole number of bits")
    area = values["piston_area"]
    # docs/rig.md, eq. 3: F_0 = A p_preload, and k_s such that F_spring(x_c) = A p_contact
    values["piston_preload"] = area * values["piston_preload_pressure"]
    rise = values["piston_contact_pressure"] - values["piston_preload_pressure"]
    if not rise > 0.0:
        contact, preload = (parameters[f"piston.{name}_pressure"] for name in ("contact", "preload"))
        raise InputError(
            f"parameter piston.contact_pressure = {contact.value:g} {contact.unit} is not above piston.preload_pressure ="
            f" {preload.value:g} {preload.unit}; the return springs would push the plates together"
        )
    values["piston_spring_stiffness"] = area * rise / values["piston_clearance"]
    values["oil_reference_coefficient"] = oil.friction_coefficient(
        *(values[f"oil_{name}"] for name in ("reference", "slope", "offset", "origin"))
    )
    _check_step(values, sum_added_rates(parameters, values))
    return values


def fastest_rate(values: Mapping[str, float], added: float) -> float:
    """Return the upper bound of the fastest eigenvalue [1/s] of docs/rig.md, eq. 2 and 3; `added` [1/s] comes from effects."""
    damping, capacity = values["piston_damping"], values["hydraulics_capacity"]
    piston_rate = (values["piston_spring_stiffness"] + values["piston_stack_stiffness"]) / damping
    return (
        piston_rate
        + values["piston_area"] ** 2 / (capacity * damping)
        + values["hydraulics_conductance"] / capacity
        + added
    )


def _check_step(values: Mapping[str, float], added: float) -> None:
    """Raise InputError if fluid, piston and the rates `added` by effects [1/s] are too fast for the integration step."""
    rate = fastest_rate(values, added)
    if not rate * STEP_LIMIT <= _STABILITY_LIMIT:
        effects = f", {added:.3g} of them by effects" if added else ""
        raise InputError(
            f"the rig is too fast to integrate: piston and cylinder together reach {rate:.3g} 1/s{effects}; allowed are"
            f" {_STABILITY_LIMIT / STEP_LIMIT:.3g} 1/s (raise piston.damping or hydraulics.capacity, or lower piston.area)"
        )


@cache
def _record_types(fields: tuple[str, ...]) -> tuple[np.dtype, Any]:
    """Return the NumPy and Numba type of a parameter record. Cached, because creating them dominates the time to make a Rig."""
    numpy_type = np.dtype([(name, np.float64) for name in fields])
    return numpy_type, from_dtype(numpy_type)


class Rig:
    """The rig compiled from `parameters`; effects named in `also` are attached even while they are off. Raises InputError.

    `record` holds the parameters as the kernel takes them, `table` the effects.
    """

    def __init__(self, parameters: ParameterSet, also: tuple[str, ...] = ()) -> None:
        self.parameters = parameters
        values = list_values(parameters)
        numpy_type, numba_type = _record_types(tuple(values))
        self.record = np.array([tuple(values.values())], dtype=numpy_type)
        self.table = make_table(parameters, numba_type, values, also)
        # plain numbers, read every cycle; during a ramp of these parameters they keep the initial values
        self.scales = Scales(*(values[name] for name in Scales._fields))
        self.phase_pressures = values["piston_preload_pressure"], values["piston_contact_pressure"]

    def make_rest_state(self, slip_speed: float, temperature: float) -> Whole:
        """Return the initial state: piston at rest, pressures 0, motor at `slip_speed` [rad/s], oil at `temperature` [K]."""
        y = np.zeros(1, dtype=STATE)
        y["slip_speed"], y["temperature"] = slip_speed, temperature
        return self.advance(Whole(y, self.table.make_rest_states()), 0.0, slip_speed, 0.0, 0.0, 0)

    def fill(self, slip_speed: float, temperature: float) -> Whole:
        """Make the state of a filled clutch: piston at the plates, contact pressure in valve and cylinder.

        Arguments as in `make_rest_state`.
        """
        y = self.make_rest_state(slip_speed, temperature).y
        y["position"] = self.record["piston_clearance"]
        for name in ("valve_pressure", "pressure"):
            y[name] = self.record["piston_contact_pressure"]
        return self.advance(Whole(y, self.table.make_rest_states()), 0.0, slip_speed, 0.0, 0.0, 0)

    def advance(
        self, before: Whole, voltage: float, speed_demand: float, torque_limit: float, duration: float, substeps: int
    ) -> Whole:
        """Return the state after `duration` [s] in `substeps` steps with constant inputs. Changes no argument.

        voltage [V], speed_demand [rad/s], torque_limit [Nm]. With 0 steps nothing moves, but outputs are evaluated.
        """
        effects = self.table.kernel
        return Whole(*advance(*before, voltage, speed_demand, torque_limit, self.record, effects, duration, substeps))


def warm() -> None:
    """Compile, or load from disk, every law and kernel of the rig, with and without effects, so that nothing compiles later."""
    parameters = load_nominal()
    values = list_values(parameters)
    compile_all(_record_types(tuple(values))[1], values)
    for name, effect in catalogue().items():
        if effect.rate:
            effect.rate(parameters.list_si(name), values)  # it may call compiled functions
    for also in ((), tuple(catalogue())[:1]):
        rig = Rig(parameters, also)
        state = rig.make_rest_state(0.0, parameters["oil.reference"].si)
        rig.advance(Sensors(seed=1).sample(rig, state, STEP_LIMIT)[1], 0.0, 0.0, 0.0, STEP_LIMIT, 1)


@njit(cache=True, error_model="numpy")
def advance(before, states_before, voltage, speed_demand, torque_limit, parameters, effects, duration, substeps):
    """Return the state as `Rig.advance` does; compiled. `effects` is the `kernel` of a `plant_sim.effects.table.Table`."""
    after, states, own = before.copy(), states_before.copy(), parameters.copy()
    e = bind_laws(effects, states)
    move(after, own, np.zeros(1, SIGNALS), e, voltage, speed_demand, torque_limit, duration, substeps)
    return after, states


@njit(error_model="numpy")
def move(state, own, signals, e, voltage, speed_demand, torque_limit, duration, substeps):
    """Advance the rig in place; inputs as in `Rig.advance`. For compiled code only.

    state: (1,) of STATE. own: the rig's parameters (1,), which effects at the hook RIG change. signals: (1,) of
    SIGNALS, overwritten. e: effects with their states, as `signals.bind_laws` returns them.
    """
    y, c, s = state[0], own[0], signals[0]
    h = duration / substeps if substeps > 0 else 0.0
    if has_law(RIG, e):
        set_known(e, s, y)
        call(RIG, e, s, c, duration)
    limit = min(torque_limit, c.motor_torque_limit)
    acceleration = y.acceleration
    for _ in range(substeps):
        set_known(e, s, y)
        s.time = y.time + 0.5 * h
        s.cylinder_speed = y.slip_speed  # the output shaft is fixed, the cylinder turns with the motor
        pressure = actuate(y, voltage, s, c, e, h)

        middle = y.slip_speed + 0.5 * h * acceleration
        pieces = ceil(h / LONGEST_STEP) if nearly_at_rest(pressure, y.slip_speed, middle) else 1
        for _ in range(pieces):
            acceleration = _step_slip(y, acceleration, pressure, speed_demand, limit, s, c, e, h / pieces)

    # outputs at the end: nothing moves
    set_known(e, s, y)
    y.normal_force = stack_force(y.position, s, c, e)
    pressure = friction_pressure(y.position, s, c, e)
    viscosity = viscosity_ratio(y.temperature, c)
    _, y.clutch_torque = slide(y.friction_state, pressure, y.slip_speed, viscosity, s, c, e, 0.0)
    error = speed_demand - (y.slip_speed + y.lead)
    asked = motor.torque_demand(error, y.speed_integral, c.motor_proportional_gain, c.motor_integral_gain)
    motor_torque = motor.limit_torque(asked, limit)
    y.motor_torque, drive_torque, inertia = _drive_torque(
        y, motor_torque, y.clutch_torque, y.slip_speed, False, s, c, e, 0.0
    )
    if pressure > 0.0 and y.slip_speed == 0.0:
        _, y.clutch_torque, _ = hold(y.friction_state, drive_torque, *torque_capacity(pressure, viscosity, s, c, e))
    y.acceleration = (drive_torque - y.clutch_torque) / inertia
    sense(y, y.motor_torque, y.clutch_torque, s, c, e, 0.0)


@njit(inline="always")
def _step_slip(y, acceleration, pressure, speed_demand, limit, s, c, e, h):
    """Advance clutch, motor and oil of `y` by a step at friction pressure p* [Pa]; return its acceleration [rad/s^2].

    acceleration: that of the step before. Torques are taken at mid-step; those of plates nearly at rest at the start of
    the step.
    """
    before_step = y.slip_speed
    slip = before_step + 0.5 * h * acceleration
    resting, sticks = nearly_at_rest(pressure, before_step, slip), False
    if resting:
        slip = before_step
    error = speed_demand - (slip + y.lead)
    asked = motor.torque_demand(
        error, y.speed_integral + 0.5 * h * error, c.motor_proportional_gain, c.motor_integral_gain
    )
    motor_torque = motor.limit_torque(asked, limit)
    if asked == motor_torque:
        y.speed_integral += h * error
    viscosity = viscosity_ratio(y.temperature, c)
    if resting:
        _, drive_torque, inertia = _drive_torque(y, motor_torque, y.clutch_torque, slip, False, s, c, e, 0.0)
        y.friction_state, slip, sticks = step_near_standstill(
            y.friction_state, before_step, drive_torque, inertia, pressure, viscosity, s, c, e, h
        )
    y.friction_state, torque = slide(y.friction_state, pressure, slip, viscosity, s, c, e, h)
    if sticks:
        torque = drive_torque + inertia * before_step / h
    still = sticks and before_step == 0.0
    motor_torque, drive_torque, inertia = _drive_torque(y, motor_torque, torque, slip, still, s, c, e, h)
    if sticks:
        torque = drive_torque + inertia * before_step / h  # brings the plates to rest and keeps them there
        if has_law(DRIVE, e):  # an impact within the step may exceed their capacity
            ends = torque_capacity(pressure, viscosity, s, c, e)
            y.friction_state, torque, sticks = hold(y.friction_state, torque, ends[0], ends[1])
    y.temperature += h * oil.heating_rate(
        y.temperature, abs(torque * slip), c.oil_heat_capacity, c.oil_heat_transfer, c.oil_sump_temperature
    )
    acceleration = (drive_torque - torque) / inertia  # docs/rig.md, eq. 8
    y.slip_speed = 0.0 if sticks else before_step + h * acceleration
    if resting and y.slip_speed * slip < 0.0:
        y.slip_speed = 1e-6 * slip  # rounding must neither reverse nor stop plates that creep: they would stick
    acceleration = 0.0 if sticks else acceleration
    y.angle += 0.5 * h * (before_step + y.slip_speed)
    y.time += h
    if has_law(SENSORS, e):
        sense(y, motor_torque, torque, s, c, e, h)
    return acceleration


@njit(inline="always")
def _drive_torque(y, motor_torque, torque, slip, still, s, c, e, h):
    """Return the motor torque [Nm], torque that drives the turning plate [Nm], and its inertia [kg m^2]; sets `y.lead`.

    still: the plate stays at rest, whatever the torques.
    """
    drive_torque, inertia, lead = motor_torque, c.motor_inertia, 0.0
    if has_law(DRIVE, e):
        s.motor_torque, s.drive_torque, s.inertia, s.lead = motor_torque, drive_torque, inertia, lead
        s.torque, s.slip, s.still = torque, slip, 1.0 if still else 0.0
        call(DRIVE, e, s, c, h)
        motor_torque, drive_torque, inertia, lead = s.motor_torque, s.drive_torque, s.inertia, s.lead
    y.lead = lead
    return motor_torque, drive_torque, inertia


@njit(inline="always")
def sense(y, motor_torque, torque, s, c, e, h):
    """Set the signals of the analog sensors, `y.sensed_...`; torques [Nm] as in the rig."""
    s.sensed_pressure, s.sensed_temperature = y.pressure, y.temperature
    s.sensed_motor_torque, s.sensed_clutch_torque = motor_torque, torque
    if has_law(SENSORS, e):
        set_known(e, s, y)
        call(SENSORS, e, s, c, h)
    y.sensed_pressure, y.sensed_temperature = s.sensed_pressure, s.sensed_temperature
    y.sensed_motor_torque, y.sensed_clutch_torque = s.sensed_motor_torque, s.sensed_clutch_torque
