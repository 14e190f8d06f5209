"""Signals and hooks: where an effect attaches to a rig, which values it gets there and which it may change.

A hook is a place in the rig's integration step. There the rig writes the known values into a record of SIGNALS, calls the laws
of the effects, and continues with the values that they leave in the record. A hook without a law costs two loads.

At every hook a law may read time, valve_pressure, pressure, position, temperature, slip and angle: those of the step's
beginning, or later ones where the rig has them already. A law may also read what its hook may change. Further signals are set
at a hook and stay until the step ends: voltage and cylinder_speed from COMMAND, displacement at PISTON, friction_pressure from
FRICTION, contact and viscous_share at TORQUE, torque from TORQUE to DRIVE, still at DRIVE. At earlier hooks they are 0, or
those of the step before.

    hook         called                               an effect may change
    RIG          once a call, h its length            fields of `c`, the rig's own parameters, except sensors_...
    COMMAND      every step                           demand, supply_pressure
    HYDRAULICS   every stage of a step, h = 0         flow, capacity, thrust_pressure
    STACK        every stage of a step, h = 0         stack_force, a function of `position`
    PISTON       every step, once it has moved        piston_force
    FRICTION     every step, in contact               coulomb, viscous, beta, stribeck_speed, attraction,
                                                      friction_state
    TORQUE       every step; at its end with h = 0    torque; in contact and out of it
    DRIVE        every step                           motor_torque, drive_torque, inertia, lead
    SENSORS      every step; at a sample with h = 0   sensed_...
    ACQUISITION  every sample, after the noise        ..._voltage, encoder_angle; h is the time since the sample before

A law is called with h = 0 where the rig only needs the present value of the effect: no state may change then. In a step (h > 0)
SENSORS has the torques of mid-step, but pressure and temperature of the step's end.
"""

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.extending import intrinsic, overload


class Signal(NamedTuple):
    """A field of SIGNALS: its name, unit and meaning, and its value in a clutch that slips under pressure (`dry_call`)."""

    name: str
    unit: str
    meaning: str
    slipping: float


HOOKS = (
    "RIG", "COMMAND", "HYDRAULICS", "STACK", "PISTON", "FRICTION", "TORQUE", "DRIVE", "SENSORS", "ACQUISITION",
)  # fmt: skip
RIG, COMMAND, HYDRAULICS, STACK, PISTON, FRICTION, TORQUE, DRIVE, SENSORS, ACQUISITION = range(len(HOOKS))

CHANGEABLE = {  # signals that a law may change, by hook: the table above
    RIG: (),
    COMMAND: ("demand", "supply_pressure"),
    HYDRAULICS: ("flow", "capacity", "thrust_pressure"),
    STACK: ("stack_force",),
    PISTON: ("piston_force",),
    FRICTION: ("coulomb", "viscous", "beta", "stribeck_speed", "attraction", "friction_state"),
    TORQUE: ("torque",),
    DRIVE: ("motor_torque", "drive_torque", "inertia", "lead"),
    SENSORS: ("sensed_pressure", "sensed_temperature", "sensed_motor_torque", "sensed_clutch_torque"),
    ACQUISITION: (
        "pressure_voltage", "temperature_voltage", "motor_torque_voltage", "clutch_torque_voltage", "encoder_angle",
    ),
}  # fmt: skip

FIELDS = tuple(
    Signal(*signal)
    for signal in (
        ("time", "s", "since the run's start, at mid-step; at SENSORS at its end", 1.0),
        ("voltage", "V", "at the valve's amplifier", 2.0),
        ("demand", "Pa", "pressure demanded from the valve, before it is limited to 0..supply", 4e5),
        ("supply_pressure", "Pa", "of the valve's supply", 2.5e6),
        ("valve_pressure", "Pa", "after the valve", 4e5),
        ("pressure", "Pa", "in the cylinder", 4e5),
        ("thrust_pressure", "Pa", "that drives the piston", 4e5),
        ("flow", "m^3/s", "into the cylinder", 1e-6),
        ("capacity", "m^3/Pa", "of oil and line", 1e-11),
        ("position", "m", "of the piston, 0 at rest", 2e-3),
        ("displacement", "m", "of the piston in the step", 1e-8),
        ("stack_force", "N", "on the plates, F_n", 500.0),
        ("piston_force", "N", "against the piston's motion, held over the next step", 10.0),
        ("temperature", "K", "of the oil", 343.15),
        ("cylinder_speed", "rad/s", "speed of the turning cylinder", 5.0),
        ("slip", "rad/s", "slip speed, at mid-step", 10.0),
        ("angle", "rad", "of the turning plate", 1.0),
        ("contact", "1", "1 when the plates are pressed, else 0", 1.0),
        ("friction_pressure", "Pa", "p* of docs/rig.md, 4; 0 out of contact", 1e5),
        ("coulomb", "Nm", "M_C", 5.0),
        ("viscous", "Nm/(rad/s)^gamma", "C_v r_T", 0.5),
        ("beta", "1", "eq. 6.6", 0.5),
        ("stribeck_speed", "rad/s", "V_S", 1.0),
        ("attraction", "1/s", "C", 100.0),
        ("friction_state", "1", "m of eq. 6.9, before the step", 0.5),
        ("torque", "Nm", "clutch torque M, positive against positive slip", 5.0),
        ("viscous_share", "1", "of the torque before TORQUE, in contact: C_v r_T |omega|^gamma / |M|", 0.1),
        ("motor_torque", "Nm", "M_m", 5.0),
        ("drive_torque", "Nm", "on the turning plate; the motor's where the shaft is rigid", 5.0),
        ("inertia", "kg m^2", "that drive and clutch torque accelerate", 0.05),
        ("still", "1", "1 where the plate stays at rest in the step, whatever the torques; else 0", 0.0),
        ("lead", "rad/s", "speed of the motor minus that of the plate; 0 where the shaft is rigid", 0.0),
        ("sensed_pressure", "Pa", "of the pressure sensor", 4e5),
        ("sensed_temperature", "K", "of the temperature sensor", 343.15),
        ("sensed_motor_torque", "Nm", "of the motor's drive", 5.0),
        ("sensed_clutch_torque", "Nm", "of the torque sensor", 5.0),
        ("encoder_angle", "rad", "of the encoder", 1.0),
        ("pressure_voltage", "V", "at the converter, with noise", 2.0),
        ("temperature_voltage", "V", "at the converter, with noise", 2.0),
        ("motor_torque_voltage", "V", "at the converter, with noise", 2.0),
        ("clutch_torque_voltage", "V", "at the converter, with noise", 2.0),
    )
)
SIGNALS = np.dtype([(signal.name, np.float64) for signal in FIELDS])
SIGNALS_TYPE = from_dtype(SIGNALS)


@intrinsic
def _invoke(typing_context, address, s, c, p, x, h):
    """Call the law at `address` with the records `s`, `c`, the addresses of the records `p`, `x`, and `h`."""
    signature = types.void(types.intp, s, c, types.intp, types.intp, types.float64)

    def codegen(context, builder, signature, arguments):
        pointer = ir.IntType(8).as_pointer()
        law = ir.FunctionType(ir.VoidType(), [pointer] * 4 + [ir.DoubleType()])
        address, s, c, p, x, h = arguments
        records = [builder.bitcast(s, pointer), builder.bitcast(c, pointer)]
        records += [builder.inttoptr(p, pointer), builder.inttoptr(x, pointer)]
        builder.call(builder.inttoptr(address, law.as_pointer()), [*records, h])
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def _word(typing_context, address, index):
    """The 64-bit integer number `index` at `address`."""
    signature = types.int64(types.intp, types.intp)

    def codegen(context, builder, signature, arguments):
        address, index = arguments
        words = builder.inttoptr(address, ir.IntType(64).as_pointer())
        return builder.load(builder.gep(words, [index]))

    return signature, codegen


def bind_laws(effects, states):
    """Addresses that `has_law` and `call` take as `e`, from a table's `kernel` and the effects' states (k,).

    They are addresses, since counting the references to an array takes longer than a law. So the caller must keep `effects` and
    `states` as long as `e` is in use. Raises ValueError for states of another size: laws would write beyond them. For compiled
    code only.
    """


def has_law(hook, e):
    """Whether any law is attached to `hook`. `e` is None where no effect is on. For compiled code only."""


def call(hook, e, s, c, h):
    """Call the laws of `hook` with signals `s`, the rig's parameters `c` and the step `h` [s]. For compiled code only."""


def set_known(e, s, y):
    """Set the signals that every law may read from the state `y` of a clutch. For compiled code only."""


# Where no effect is on, `e` is None. That is known when the kernel is compiled, so that kernel has no hooks in it.


@overload(bind_laws, inline="always")
def _bind_laws(effects, states):
    if isinstance(effects, types.NoneType):
        return lambda effects, states: None

    def bind(effects, states):
        calls, begins, values, size = effects
        if states.size != size:
            raise ValueError("states are not those of this table of effects")
        return calls.ctypes.data, begins.ctypes.data, values.ctypes.data, states.ctypes.data

    return bind


@overload(has_law, inline="always")
def _has_law(hook, e):
    if isinstance(e, types.NoneType):
        return lambda hook, e: False
    return lambda hook, e: _word(e[1], hook) < _word(e[1], hook + 1)  # type: ignore[call-arg]


@overload(call, inline="always")
def _call(hook, e, s, c, h):
    if isinstance(e, types.NoneType):
        return lambda hook, e, s, c, h: None

    def call_each(hook, e, s, c, h):
        calls, begins, values, states = e
        for i in range(_word(begins, hook), _word(begins, hook + 1)):  # type: ignore[call-arg]
            law = _word(calls, 3 * i)
            parameter = _word(calls, 3 * i + 1)
            state = _word(calls, 3 * i + 2)
            _invoke(law, s, c, values + 8 * parameter, states + 8 * state, h)

    return call_each


@overload(set_known, inline="always")
def _set_known(e, s, y):
    if isinstance(e, types.NoneType):
        return lambda e, s, y: None

    def set_each(e, s, y):
        s.time, s.valve_pressure, s.pressure, s.position = y.time, y.valve_pressure, y.pressure, y.position
        s.temperature, s.slip, s.angle = y.temperature, y.slip_speed, y.angle

    return set_each
