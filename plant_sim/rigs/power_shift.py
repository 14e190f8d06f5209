"""The power-shift rig of fig 6.1: a speed-controlled motor, two clutches in two gears, one vehicle.

Equation        slip of a clutch  s = w_in - i w_out,  i its ratio
                J_m dw_in/dt = M_m - M_a - M_b;  J_v dw_out/dt = i_a M_a + i_b M_b - T_road
                T_road = J_v g/r (c_r cos(alpha) sign(w_out) + sin(alpha)) + rho/2 c_d A r^3 |w_out| w_out
                each clutch as in `clutch_unit`, motor and oil as in `wet_clutch`
Integration     steps of at most 0.1 ms; shafts by the midpoint rule, clutches as in `wet_clutch`. Work and heat are summed
                with the mean speed of a step, so that their balance holds to rounding
Assumptions     inputs constant over a call; shafts and wheels rigid, tyres without slip; gears without loss; rolling
                resistance is Coulomb friction: within a step it takes what brings the vehicle to rest, at most its level
                a clutch that sticks carries what keeps its slip at 0: `tied_shafts`
Valid range     slips within the maps, 250 rpm
Not modelled    inertia of gears and plates, engine map, torque converter; effects between motor and clutch (hook DRIVE)
References      Janssens 2010, sec. 6.2.1 and fig 6.1
"""

from collections.abc import Mapping
from dataclasses import replace
from math import atan, cos, sin
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numba import njit

from plant_sim.blocks import motor, oil
from plant_sim.effects.catalogue import find_effect
from plant_sim.effects.signals import DRIVE, RIG, SENSORS, SIGNALS, bind_laws, call, has_law, set_known
from plant_sim.effects.table import list_active_effects as effects_on
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.clutch_unit import actuate, friction_pressure, slide, stack_force, viscosity_ratio
from plant_sim.rigs.standstill import nearly_at_rest, torque_capacity
from plant_sim.rigs.tied_shafts import Shafts, Standing, present_torques, road_torque, step_at_standstill, stuck_torques
from plant_sim.rigs.wet_clutch import STATE, Whole, sense
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet, load_defaults, load_overlay

NAME = "power_shift"  # of the rig, in runs, calibrations and options of commands
DEFAULTS = Path(__file__).parents[1] / "parameters" / "power_shift.toml"
GRAVITY = 9.80665  # m/s^2, standard gravity, ISO 80000-3
AIR_DENSITY = 1.204  # kg/m^3, dry air at 20 degC and 1013.25 hPa, ISO 2533

T = TypeVar("T")


class Driveline(NamedTuple):
    """State and outputs of the driveline at `time`; works and heats since the start."""

    time: float  # s
    input_speed: float  # rad/s
    output_speed: float  # rad/s
    speed_integral: float  # rad, of the motor's speed controller
    input_acceleration: float  # rad/s^2
    output_acceleration: float  # rad/s^2
    motor_torque: float  # Nm
    output_torque: float  # Nm, i_a M_a + i_b M_b
    road_torque: float  # Nm, about the output shaft
    input_work: float  # J, of the motor
    road_work: float  # J, into the road
    heat_a: float  # J, of friction in clutch a
    heat_b: float  # J, of friction in clutch b


DRIVELINE = np.dtype([(name, np.float64) for name in Driveline._fields])  # a Driveline as the kernel takes it


class PowerShift(NamedTuple):
    """Everything that moves: the driveline, structured array (1,) of DRIVELINE, and each clutch as on the wet-clutch rig."""

    driveline: np.ndarray
    a: Whole
    b: Whole

    def read(self) -> Driveline:
        """Return the driveline as plain floats, quick to read."""
        return Driveline(*self.driveline.view(np.float64).tolist())


def load_nominal(changed: Path | None = None) -> ParameterSet:
    """Return the parameters of driveline, motor and both clutches, all effects off, changed by a user's file if given.

    Raises InputError.
    """
    single = wet_clutch.load_nominal()
    shared = {name: parameter for name, parameter in single.items() if is_motor(name)}
    clutches = {
        f"{clutch}.{name}": replace(parameter, name=f"{clutch}.{name}")
        for clutch in CLUTCHES
        for name, parameter in single.items()
        if not is_motor(name)
    }
    shipped = ParameterSet({**load_defaults(DEFAULTS), **shared, **clutches})
    return load_overlay(changed, shipped, rig=NAME) if changed else shipped


def select_clutch_parameters(parameters: ParameterSet, clutch: str) -> ParameterSet:
    """Return the parameters of one clutch, with the motor's, under the names of the wet-clutch rig."""
    own = select_clutch(parameters, clutch)
    return ParameterSet({name: replace(parameter, name=name) for name, parameter in own.items()})


def select_clutch(values: Mapping[str, T], clutch: str) -> dict[str, T]:
    """Return those of `values`, by dotted name, that belong to one clutch or the motor, under the wet-clutch rig's names."""
    return {
        name.removeprefix(f"{clutch}."): value
        for name, value in values.items()
        if name.startswith(f"{clutch}.") or is_motor(name)
    }


def list_active_effects(parameters: ParameterSet) -> list[str]:
    """Return the effects that are on, as `a.friction_level`."""
    return [
        f"{clutch}.{name}" for clutch in CLUTCHES for name in effects_on(select_clutch_parameters(parameters, clutch))
    ]


def is_motor(name: str) -> bool:
    """Return whether a parameter belongs to the motor, which both clutches share."""
    return name.partition(".")[0] == "motor"


def _make_clutch(parameters: ParameterSet, clutch: str, also: tuple[str, ...]) -> wet_clutch.Rig:
    """Return a clutch of the rig: its record and table of effects. Raises InputError."""
    try:
        rig = wet_clutch.Rig(select_clutch_parameters(parameters, clutch), also)
    except InputError as error:
        raise InputError(f"clutch {clutch}: {error}") from None
    for name in rig.table.names:
        if DRIVE in find_effect(name).laws:
            raise InputError(explain_refusal(clutch, name))
    return rig


def explain_refusal(clutch: str, name: str) -> str:
    """Return why an effect with the hook DRIVE is not possible, for a message."""
    return (
        f"effect {clutch}.{name} acts between motor and clutch of the wet-clutch rig, which the power-shift rig does not"
        " model; allowed are effects of valve, hydraulics, piston, friction and sensors"
    )


def make_driveline_record(parameters: ParameterSet) -> np.ndarray:
    """Return the gears, inertia [kg m^2] and road [Nm, Nm s^2/rad^2] about the output shaft as the kernels take them, (1,)."""
    p = parameters.list_si("driveline")
    weight = p["vehicle_inertia"] * GRAVITY / p["wheel_radius"]  # Nm, m g r with J_v = m r^2
    slope = atan(p["grade"])
    values = {
        "ratio_a": p["ratio_a"],
        "ratio_b": p["ratio_b"],
        "inertia": p["vehicle_inertia"],
        "rolling": weight * p["rolling_resistance"] * cos(slope),
        "grade": weight * sin(slope),
        "drag": 0.5 * AIR_DENSITY * p["drag_area"] * p["wheel_radius"] ** 3,
    }
    return np.array([tuple(values.values())], dtype=[(name, np.float64) for name in values])


class Rig:
    """The rig compiled from `parameters`; effects named in `also` are attached in both clutches even while off.

    `a` and `b` are its clutches; their motors, of the same parameters, are the driveline's. Raises InputError.
    """

    def __init__(self, parameters: ParameterSet, also: tuple[str, ...] = ()) -> None:
        self.parameters = parameters
        self.a, self.b = (_make_clutch(parameters, clutch, also) for clutch in CLUTCHES)
        self.record = make_driveline_record(parameters)

    def make_rest_state(self, input_speed: float, output_speed: float, temperature: float) -> PowerShift:
        """Return both clutches open, the shafts turning at their speeds [rad/s], all oil at `temperature` [K]."""
        y = np.zeros(1, dtype=DRIVELINE)
        y["input_speed"], y["output_speed"] = input_speed, output_speed
        states = []
        for rig, ratio in ((self.a, self.record["ratio_a"]), (self.b, self.record["ratio_b"])):
            clutch = np.zeros(1, dtype=STATE)
            clutch["slip_speed"], clutch["temperature"] = input_speed - ratio * output_speed, temperature
            states.append(Whole(clutch, rig.table.make_rest_states()))
        return self.advance(PowerShift(y, *states), (0.0, 0.0), input_speed, 0.0, 0.0, 0)

    def advance(
        self,
        before: PowerShift,
        voltages: tuple[float, float],
        speed_demand: float,
        torque_limit: float,
        duration: float,
        substeps: int,
    ) -> PowerShift:
        """Return the state after `duration` [s] in `substeps` steps with constant inputs. Changes no argument.

        voltages of the valves of a and b [V], speed_demand [rad/s], torque_limit [Nm]. With 0 steps nothing moves, but outputs
        are evaluated.
        """
        # tables are passed also when no effect is on: there is only one kernel
        kernel_a, kernel_b = self.a.table.attachments, self.b.table.attachments
        y, a, b, effects_a, effects_b = advance(
            before.driveline, *before.a, *before.b, *voltages, speed_demand, torque_limit,
            self.record, self.a.record, self.b.record, kernel_a, kernel_b, duration, substeps,
        )  # fmt: skip
        return PowerShift(y, Whole(a, effects_a), Whole(b, effects_b))


@njit(cache=True, error_model="numpy")
def advance(
    before, before_a, states_a, before_b, states_b, voltage_a, voltage_b, speed_demand, torque_limit,
    driveline, parameters_a, parameters_b, effects_a, effects_b, duration, substeps,
):  # fmt: skip
    """Return the state as `Rig.advance` does; compiled."""
    after, after_a, after_b = before.copy(), before_a.copy(), before_b.copy()
    own_a, own_b, states_a, states_b = parameters_a.copy(), parameters_b.copy(), states_a.copy(), states_b.copy()
    signals = np.zeros(2, SIGNALS)
    y, a, b, d = after[0], after_a[0], after_b[0], driveline[0]
    sa, sb, ca, cb = signals[0], signals[1], own_a[0], own_b[0]
    ea, eb = bind_laws(effects_a, states_a), bind_laws(effects_b, states_b)
    h = duration / substeps if substeps > 0 else 0.0
    if has_law(RIG, ea):
        set_known(ea, sa, a)
        call(RIG, ea, sa, ca, duration)
    if has_law(RIG, eb):
        set_known(eb, sb, b)
        call(RIG, eb, sb, cb, duration)
    limit = min(torque_limit, ca.motor_torque_limit)
    inertia = ca.motor_inertia
    for _ in range(substeps):
        sa.cylinder_speed = sb.cylinder_speed = y.input_speed  # the cylinders turn with the input
        k = 0.5 * h
        w_in, w_out = y.input_speed + k * y.input_acceleration, y.output_speed + k * y.output_acceleration
        slip_a, slip_b = w_in - d.ratio_a * w_out, w_in - d.ratio_b * w_out
        pressure_a, pressure_b = _move(a, voltage_a, sa, ca, ea, h), _move(b, voltage_b, sb, cb, eb, h)
        rests_a = nearly_at_rest(pressure_a, a.slip_speed, slip_a)
        rests_b = nearly_at_rest(pressure_b, b.slip_speed, slip_b)
        error = speed_demand - w_in
        asked = motor.torque_demand(
            error, y.speed_integral + k * error, ca.motor_proportional_gain, ca.motor_integral_gain
        )
        motor_torque = motor.limit_torque(asked, limit)
        if asked == motor_torque:
            y.speed_integral += h * error

        # the torques: of plates that slide, then of those nearly at rest, which may stick
        torque_a = 0.0 if rests_a else _slides(a, pressure_a, slip_a, sa, ca, ea, h)
        torque_b = 0.0 if rests_b else _slides(b, pressure_b, slip_b, sb, cb, eb, h)
        sticks_a = sticks_b = False
        if rests_a or rests_b:
            shafts = Shafts(motor_torque, y.input_speed, y.output_speed, inertia)
            va, vb = viscosity_ratio(a.temperature, ca), viscosity_ratio(b.temperature, cb)
            one = Standing(rests_a, a.friction_state, a.slip_speed, torque_a, pressure_a, va, d.ratio_a)
            two = Standing(rests_b, b.friction_state, b.slip_speed, torque_b, pressure_b, vb, d.ratio_b)
            torque_a, torque_b, sticks_a, sticks_b = _nearly_at_rest(
                shafts, one, two, a, b, d, sa, ca, ea, sb, cb, eb, h
            )

        # both shafts, and the work on their mean speeds
        w_in, w_out = y.input_speed, y.output_speed
        output = d.ratio_a * torque_a + d.ratio_b * torque_b
        road = road_torque(w_out, output, d, h)
        y.input_acceleration = (motor_torque - torque_a - torque_b) / inertia
        y.output_acceleration = (output - road) / d.inertia
        y.input_speed += h * y.input_acceleration
        y.output_speed += h * y.output_acceleration
        if sticks_a and sticks_b:
            y.input_speed = y.output_speed = 0.0  # they differ from 0 only by rounding
        elif sticks_a or sticks_b:
            y.input_speed = (d.ratio_a if sticks_a else d.ratio_b) * y.output_speed
        w_in, w_out = 0.5 * (w_in + y.input_speed), 0.5 * (w_out + y.output_speed)
        y.input_work += h * motor_torque * w_in
        y.road_work += h * road * w_out
        y.heat_a += _slip(a, torque_a, w_in - d.ratio_a * w_out, y, d.ratio_a, ca, h)
        y.heat_b += _slip(b, torque_b, w_in - d.ratio_b * w_out, y, d.ratio_b, cb, h)
        y.time += h
        if has_law(SENSORS, ea):
            sense(a, motor_torque, torque_a, sa, ca, ea, h)
        if has_law(SENSORS, eb):
            sense(b, motor_torque, torque_b, sb, cb, eb, h)

    # outputs at the end: nothing moves
    torque_a, pressure_a = _set_torque(a, sa, ca, ea)
    torque_b, pressure_b = _set_torque(b, sb, cb, eb)
    error = speed_demand - y.input_speed
    y.motor_torque = motor.limit_torque(
        motor.torque_demand(error, y.speed_integral, ca.motor_proportional_gain, ca.motor_integral_gain), limit
    )
    rests_a, rests_b = pressure_a > 0.0 and a.slip_speed == 0.0, pressure_b > 0.0 and b.slip_speed == 0.0
    if rests_a or rests_b:
        ends_a = (
            torque_capacity(pressure_a, viscosity_ratio(a.temperature, ca), sa, ca, ea)
            if rests_a
            else (torque_a, torque_a)
        )
        ends_b = (
            torque_capacity(pressure_b, viscosity_ratio(b.temperature, cb), sb, cb, eb)
            if rests_b
            else (torque_b, torque_b)
        )
        shafts = Shafts(y.motor_torque, y.input_speed, y.output_speed, inertia)
        torque_a, torque_b = present_torques(shafts, rests_a, rests_b, ends_a, ends_b, d)
        a.clutch_torque, b.clutch_torque = torque_a, torque_b
    y.output_torque = d.ratio_a * torque_a + d.ratio_b * torque_b
    y.road_torque = road_torque(y.output_speed, y.output_torque, d, 0.0)
    y.input_acceleration = (y.motor_torque - torque_a - torque_b) / inertia
    y.output_acceleration = (y.output_torque - y.road_torque) / d.inertia
    a.acceleration = y.input_acceleration - d.ratio_a * y.output_acceleration
    b.acceleration = y.input_acceleration - d.ratio_b * y.output_acceleration
    sense(a, y.motor_torque, torque_a, sa, ca, ea, 0.0)
    sense(b, y.motor_torque, torque_b, sb, cb, eb, 0.0)
    a.motor_torque, b.motor_torque = y.motor_torque, y.motor_torque
    return after, after_a, after_b, states_a, states_b


@njit
def _nearly_at_rest(shafts, one, two, a, b, d, sa, ca, ea, sb, cb, eb, h):
    """Advance the friction of plates nearly at rest by a step; return the torque of each clutch [Nm] and whether it sticks."""
    torque_a, torque_b = one.torque, two.torque
    (m_a, slip_a, sticks_a), (m_b, slip_b, sticks_b), torques = step_at_standstill(
        shafts, one, two, d, sa, ca, ea, sb, cb, eb, h
    )
    if one.rests:
        a.friction_state = m_a
        torque_a = _slides(a, one.pressure, slip_a, sa, ca, ea, h)
    if two.rests:
        b.friction_state = m_b
        torque_b = _slides(b, two.pressure, slip_b, sb, cb, eb, h)
    torque_a, torque_b = stuck_torques(shafts, torque_a, torque_b, sticks_a, sticks_b, torques, d, h)
    return torque_a, torque_b, sticks_a, sticks_b


@njit(inline="always")
def _move(y, voltage, s, c, e, h):
    """Advance a clutch's valve and piston by a step; return the friction pressure [Pa] at mid-step."""
    set_known(e, s, y)
    s.time = y.time + 0.5 * h
    return actuate(y, voltage, s, c, e, h)


@njit(inline="always")
def _slides(y, pressure, slip, s, c, e, h):
    """Advance a clutch's friction by a step at `slip` [rad/s]; return its torque [Nm]."""
    y.friction_state, torque = slide(y.friction_state, pressure, slip, viscosity_ratio(y.temperature, c), s, c, e, h)
    return torque


@njit
def _set_torque(y, s, c, e):
    """Set a clutch's present normal force and, if it slides, its torque; return the torque [Nm] and pressure [Pa]."""
    set_known(e, s, y)
    y.normal_force = stack_force(y.position, s, c, e)
    pressure = friction_pressure(y.position, s, c, e)
    viscosity = viscosity_ratio(y.temperature, c)
    _, y.clutch_torque = slide(y.friction_state, pressure, y.slip_speed, viscosity, s, c, e, 0.0)
    return y.clutch_torque, pressure


@njit(inline="always")
def _slip(y, torque, slip, line, ratio, c, h):
    """Advance a clutch's slip, angle and oil by a step at its mean `slip` [rad/s]; return the heat of friction [J]."""
    y.slip_speed = line.input_speed - ratio * line.output_speed
    y.angle += h * slip
    y.temperature += h * oil.heating_rate(
        y.temperature, abs(torque * slip), c.oil_heat_capacity, c.oil_heat_transfer, c.oil_sump_temperature
    )
    y.time += h
    return h * torque * slip
