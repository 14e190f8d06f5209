"""Dry call: the compiled laws of a user's effect are called outside of a rig, to report their errors.

In a rig the errors would stay hidden: compiled code ignores an exception of a law, and a rig clips or ignores values that
it must not get. The effect is called at its typical values, in a clutch that slips under pressure. Effects of this package are
called only by tests (tests/plant_sim/effects/test_dry_call.py).
"""

import ctypes
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from plant_sim.effects.effect import Effect
from plant_sim.effects.signals import CHANGEABLE, FIELDS, HOOKS, HYDRAULICS, RIG, SENSORS, SIGNALS, STACK, TORQUE
from protocols.errors import InputError
from protocols.files.units import to_si
from protocols.user_code import describe_error

_FIXED = "sensors_"  # fields of `c` that no law may change begin so
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
    raises, that returns what is not finite, that changes what it may not, or that moves a state where h is 0.
    """
    signals = np.array([tuple(signal.slipping for signal in FIELDS)], dtype=SIGNALS)
    own = np.array([tuple(c.values())], dtype=[(name, np.float64) for name in c])
    parameters = np.array([tuple(to_si(p.typical, p.unit) for p in effect.parameters)], dtype=effect.parameter_type)
    states = np.zeros(1, dtype=effect.state_type)
    for _ in range(_STEPS):
        now = own.copy()  # in a rig, what RIG changes lasts as long as a call of the kernel
        for hook in sorted(effect.laws):
            for step in _WITHOUT_STEP.get(hook, (_STEP,)):
                records = {"s": signals.copy(), "c": now.copy(), "p": parameters.copy(), "x": states.copy()}
                _call(effect, hook, effect.find_address(hook, rig), [*records.values()], step)
                for name, record in records.items():
                    _check_finite(effect, hook, name, record)
                _check_changes(effect, hook, "s", signals, records["s"], CHANGEABLE[hook])
                free = tuple(name for name in c if hook == RIG and not name.startswith(_FIXED))
                _check_changes(effect, hook, "c", now, records["c"], free)
                _check_changes(effect, hook, "p", parameters, records["p"], ())
                if step == 0.0:
                    _check_still(effect, hook, states, records["x"])
                now, states = records["c"], records["x"]


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
                f"{_describe(effect, hook)} makes {name}.{field} {value} at typical values; the values must be finite"
            )


def _check_changes(
    effect: Effect, hook: int, name: str, before: np.ndarray, after: np.ndarray, allowed: tuple[str, ...]
) -> None:
    for field in before.dtype.names or ():
        if field not in allowed and np.any(before[field] != after[field]):
            signals = ", ".join(f"s.{signal}" for signal in CHANGEABLE[hook])
            raise InputError(
                f"{_describe(effect, hook)} changes {name}.{field}; it may change only"
                f" {signals or f'fields of c, except {_FIXED}...'}"
            )


def _check_still(effect: Effect, hook: int, before: np.ndarray, after: np.ndarray) -> None:
    for field in before.dtype.names or ():
        if np.any(before[field] != after[field]):
            raise InputError(
                f"{_describe(effect, hook)} changes x.{field} in a call with h = 0; no state may change there"
            )


def _describe(effect: Effect, hook: int) -> str:
    return f"effect {effect.name} ({effect.path}): its law at {HOOKS[hook]}"
