"""Dry call: the compiled laws of a user's effect are called outside of a rig, so that what is wrong with them is told.

In a rig nobody would see it: compiled code ignores an exception that a law raises, and a rig clips or ignores what it is not
to be given. The effect is called at its typical values, in a clutch that slips under pressure. Effects of this package are not
called: tests do that (tests/plant_sim/effects/test_dry_call.py).
"""

import ctypes
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from plant_sim.effects.effect import Effect
from plant_sim.effects.signals import (
    ACQUISITION,
    COMMAND,
    DRIVE,
    FRICTION,
    HOOKS,
    HYDRAULICS,
    PISTON,
    RIG,
    SENSORS,
    SIGNALS,
    STACK,
    TORQUE,
)  # fmt: skip
from protocols.errors import InputError, describe_error
from protocols.files.units import to_si

_CHANGEABLE = {  # signals that a law may change, by hook: the table of signals.py
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
_FIXED = "sensors_"  # fields of `c` that no law may change begin so
# SI, of a clutch that slips under pressure; see signals.py. None is at an edge where a law may divide by it
_SLIPPING = {
    "time": 1.0, "voltage": 2.0, "demand": 4e5, "supply_pressure": 2.5e6, "valve_pressure": 4e5, "pressure": 4e5,
    "thrust_pressure": 4e5, "flow": 1e-6, "capacity": 1e-11, "position": 2e-3, "displacement": 1e-8, "stack_force": 500.0,
    "piston_force": 10.0, "temperature": 343.15, "cylinder_speed": 5.0, "slip": 10.0, "angle": 1.0, "contact": 1.0,
    "friction_pressure": 1e5, "coulomb": 5.0, "viscous": 0.5, "beta": 0.5, "stribeck_speed": 1.0, "attraction": 100.0,
    "friction_state": 0.5, "torque": 5.0, "viscous_share": 0.1, "motor_torque": 5.0, "drive_torque": 5.0, "inertia": 0.05,
    "still": 0.0, "lead": 0.0, "sensed_pressure": 4e5, "sensed_temperature": 343.15, "sensed_motor_torque": 5.0,
    "sensed_clutch_torque": 5.0, "encoder_angle": 1.0, "pressure_voltage": 2.0, "temperature_voltage": 2.0,
    "motor_torque_voltage": 2.0, "clutch_torque_voltage": 2.0,
}  # fmt: skip
_STEP = 1e-4  # s
_STEPS = 3  # so that a state that moves in the first one acts
_WITHOUT_STEP = {
    HYDRAULICS: (0.0,),
    STACK: (0.0,),
    TORQUE: (_STEP, 0.0),
    SENSORS: (_STEP, 0.0),
}  # h there; elsewhere _STEP
_LAW = ctypes.PYFUNCTYPE(None, *4 * [ctypes.c_void_p], ctypes.c_double)


def call_dry(effect: Effect, rig: Any, c: Mapping[str, float]) -> None:
    """Call the laws of an effect at its typical values.

    rig: Numba type of the rig's parameter record. c: the record's values in SI by field. Raises InputError for a law that
    raises, that returns what is not finite, or that changes what it may not.
    """
    signals = np.array([tuple(_SLIPPING[name] for name in SIGNALS.names or ())], dtype=SIGNALS)
    own = np.array([tuple(c.values())], dtype=[(name, np.float64) for name in c])
    parameters = np.array([tuple(to_si(p.typical, p.unit) for p in effect.parameters)], dtype=effect.parameter_type)
    states = np.zeros(1, dtype=effect.state_type)
    for _ in range(_STEPS):
        now = own.copy()  # in a rig, what RIG changes lasts as long as a call of the kernel
        for hook in sorted(effect.laws):
            for step in _WITHOUT_STEP.get(hook, (_STEP,)):
                records = {"s": signals.copy(), "c": now.copy(), "p": parameters.copy(), "x": states}
                _call(effect, hook, effect.find_address(hook, rig), [*records.values()], step)
                for name, record in records.items():
                    _check_finite(effect, hook, name, record)
                _check_changes(effect, hook, "s", signals, records["s"], _CHANGEABLE[hook])
                free = tuple(name for name in c if hook == RIG and not name.startswith(_FIXED))
                _check_changes(effect, hook, "c", now, records["c"], free)
                _check_changes(effect, hook, "p", parameters, records["p"], ())
                now = records["c"]


def _call(effect: Effect, hook: int, address: int, records: list[np.ndarray], step: float) -> None:
    """Call a compiled law. Raises InputError where it raises, which compiled code hands to `sys.unraisablehook`."""
    raised: list[BaseException] = []
    before = sys.unraisablehook
    sys.unraisablehook = lambda about: raised.append(about.exc_value or about.exc_type())
    try:
        _LAW(address)(*(record.ctypes.data for record in records), step)
    finally:
        sys.unraisablehook = before
    if raised:
        raise InputError(f"{_describe(effect, hook)} raises {describe_error(raised[0])}; no exception is allowed there")


def _check_finite(effect: Effect, hook: int, name: str, record: np.ndarray) -> None:
    for field in record.dtype.names or ():
        if not np.all(np.isfinite(record[field])):
            value = record[field].ravel()[~np.isfinite(record[field].ravel())][0]
            raise InputError(
                f"{_describe(effect, hook)} makes {name}.{field} {value} at typical values; finite values are allowed"
            )


def _check_changes(
    effect: Effect, hook: int, name: str, before: np.ndarray, after: np.ndarray, allowed: tuple[str, ...]
) -> None:
    for field in before.dtype.names or ():
        if field not in allowed and np.any(before[field] != after[field]):
            signals = ", ".join(f"s.{signal}" for signal in _CHANGEABLE[hook])
            raise InputError(
                f"{_describe(effect, hook)} changes {name}.{field}; allowed there are"
                f" {signals or f'fields of c, but for {_FIXED}...'}"
            )


def _describe(effect: Effect, hook: int) -> str:
    return f"effect {effect.name} ({effect.path}): its law at {HOOKS[hook]}"
