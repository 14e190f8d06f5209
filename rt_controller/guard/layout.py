"""Layout: the frames and signals that the guard reads and writes, as its code has them, and whether a database has the same.

The guard has its own places of bits and its own factors, so that no error of the codecs, or of a database, reaches it. So a
database in which one of them is elsewhere cannot be used: the guard would compare other bits with its limits.
"""

from collections.abc import Iterator, Mapping
from math import isclose
from pathlib import Path
from typing import NamedTuple

from protocols.can.frames import FrameCodec
from protocols.errors import InputError
from rt_controller.guard.limits import (
    ANALOG_SENSORS,
    ANGLE_COUNTS,
    ENCODER,
    MOTOR_COMMAND,
    MOTOR_COUNTS,
    PRESSURE_COUNTS,
    TEMPERATURE_COUNTS,
    TORQUE_SETPOINT,
    VALVE_COMMAND,
    VALVE_COUNTS,
)

_PASCALS = 1e5  # Pa/bar: the database has bar
_SAME = 1e-9  # of a factor: databases are written with 10 digits and more


class Place(NamedTuple):
    """Where a signal is: first bit, length [bit], factor [unit of clutch_rig.dbc], signed or not; None: it does not matter."""

    start: int
    length: int
    factor: float = 1.0
    signed: bool | None = False


# Frame -> identifier of clutch a, bytes, and the signals whose bits the guard reads or writes
LAYOUT: Mapping[str, tuple[int, int, Mapping[str, Place]]] = {
    "VALVE_COMMAND": (VALVE_COMMAND, 6, {
        "VALVE_ENABLE": Place(12, 1), "VALVE_VOLTAGE": Place(16, 16, 1.0 / VALVE_COUNTS),
    }),
    "MOTOR_COMMAND": (MOTOR_COMMAND, 6, {
        "MOTOR_ENABLE": Place(12, 1), "SPEED_DEMAND": Place(16, 16, 1e-3, None),  # it writes 0 there
        "TORQUE_LIMIT": Place(32, 16, 1.0 / MOTOR_COUNTS),
    }),
    "ANALOG_SENSORS": (ANALOG_SENSORS, 8, {
        "CYLINDER_PRESSURE": Place(12, 12, 1.0 / (PRESSURE_COUNTS * _PASCALS), True),
        "OIL_TEMPERATURE": Place(24, 12, 1.0 / TEMPERATURE_COUNTS, True),
    }),
    "ENCODER": (ENCODER, 8, {"SHAFT_ANGLE": Place(16, 32, 1.0 / ANGLE_COUNTS, None), "SAMPLE_TICK": Place(48, 16)}),
    "TORQUE_SETPOINT": (TORQUE_SETPOINT, 8, {"REQUEST": Place(12, 4)}),
}  # fmt: skip


def check_layout(path: Path, frames: Mapping[str, FrameCodec]) -> None:
    """Raise InputError, with each signal, where the guard does not read what the database at `path` means.

    `frames`: those of the database for a single clutch, or clutch a, by name.
    """
    if problems := list(_find_problems(frames)):
        raise InputError(f"DBC {path}: the guard has its own layout, and would read other bits: {'; '.join(problems)}")


def _find_problems(frames: Mapping[str, FrameCodec]) -> Iterator[str]:
    for name, (can_id, length, places) in LAYOUT.items():
        codec = frames[name]
        if codec.can_id != can_id:
            yield f"frame {name} has the identifier 0x{codec.can_id:03X}; the guard's is 0x{can_id:03X}"
        if codec.length != length:
            yield f"frame {name} has {codec.length} bytes; the guard's has {length}"
        signals = {signal.name.upper(): signal for signal in codec.definitions}
        for signal_name, place in places.items():
            signal = signals[signal_name]
            if (signal.start, signal.length) != (place.start, place.length):
                there, here = f"{signal.start}|{signal.length}", f"{place.start}|{place.length}"
                yield f"{name}.{signal_name} is at {there}; the guard's is at {here}"
            if not isclose(float(signal.scale), place.factor, rel_tol=_SAME) or signal.offset != 0:
                yield (
                    f"{name}.{signal_name} has the factor {float(signal.scale):.10g} and offset {float(signal.offset):g}; the"
                    f" guard's are {place.factor:.10g} and 0"
                )
            if place.signed is not None and signal.is_signed != place.signed:
                yield f"{name}.{signal_name} is {_format_sign(signal.is_signed)}; the guard's is {_format_sign(place.signed)}"


def _format_sign(signed: bool) -> str:
    return "signed" if signed else "unsigned"
