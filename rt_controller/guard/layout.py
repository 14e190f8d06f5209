"""Layout: the frames and signals that the guard reads and writes. `check_layout` compares them with a database.

The guard has its own bit positions and factors, so that an error in the codecs or in a database does not affect it. A database
with other positions or factors is refused, because the guard would compare the wrong bits with its limits. A database of
version 1 is compared with the positions in the shipped database of version 1.
"""

from collections.abc import Iterator, Mapping
from math import isclose
from pathlib import Path
from typing import NamedTuple

from protocols.can.frames import DBC_1, FrameCodec, load_frames
from protocols.can.version import VERSION_1
from protocols.errors import InputError
from rt_controller.guard.limits import (
    ANALOG_SENSORS,
    ANGLE_COUNTS,
    BYTES,
    DATA_ID,
    ENCODER,
    MOTOR_COMMAND,
    MOTOR_COUNTS,
    PRESSURE_COUNTS,
    SUPERVISOR_CLAIM,
    TEMPERATURE_COUNTS,
    TORQUE_SETPOINT,
    VALVE_COMMAND,
    VALVE_COUNTS,
)

# Signal whose factor depends on the bench's size -> the guard's limit with its full range, the unit, the counts of this range
_OF_SIZE = {
    "TORQUE_LIMIT": ("motor_range", "Nm", MOTOR_COUNTS), "CYLINDER_PRESSURE": ("pressure_range", "bar", PRESSURE_COUNTS),
}  # fmt: skip
_KEY = "data_key"
LAYOUT_VALUES = (*(limit for limit, _, _ in _OF_SIZE.values()), _KEY)  # limits with which a database must agree
_SAME = 1e-9  # of a factor: databases are written with 10 digits and more


class Place(NamedTuple):
    """Position of a signal: first bit, length [bit], factor [unit of clutch_rig.dbc], signed. None: not checked.

    zero: whether 0 counts must mean 0, whatever the factor is.
    """

    start: int
    length: int
    factor: float | None = 1.0
    signed: bool | None = False
    zero: bool = False


# Frame -> identifier of clutch a, and the signals whose bits the guard reads or writes
LAYOUT: Mapping[str, tuple[int, Mapping[str, Place]]] = {
    "VALVE_COMMAND": (VALVE_COMMAND, {
        "VALVE_ENABLE": Place(24, 1), "VALVE_VOLTAGE": Place(32, 16, 1.0 / VALVE_COUNTS),
    }),
    "MOTOR_COMMAND": (MOTOR_COMMAND, {
        "MOTOR_ENABLE": Place(24, 1), "SPEED_DEMAND": Place(32, 16, None, None, zero=True),  # it writes 0 there
        "TORQUE_LIMIT": Place(48, 16, None),
    }),
    "ANALOG_SENSORS": (ANALOG_SENSORS, {
        "CYLINDER_PRESSURE": Place(24, 12, None, True),
        "OIL_TEMPERATURE": Place(36, 12, 1.0 / TEMPERATURE_COUNTS, True),
    }),
    "ENCODER": (ENCODER, {
        "SHAFT_ANGLE": Place(24, 18, 1.0 / ANGLE_COUNTS, None), "SAMPLE_TICK": Place(42, 10),
        "MOTOR_TORQUE": Place(52, 12, None, True),  # only the ends of its range are checked
    }),
    "TORQUE_SETPOINT": (TORQUE_SETPOINT, {"REQUEST": Place(24, 3)}),
    "SUPERVISOR_CLAIM": (SUPERVISOR_CLAIM, {"CLAIM": Place(24, 1), "SESSION": Place(32, 16)}),
}  # fmt: skip


class _Expected(NamedTuple):
    """Expected properties of a frame: identifier, number of bytes, data ID, places of the signals."""

    can_id: int
    length: int
    data_id: int
    places: Mapping[str, Place]


def check_layout(path: Path, frames: Mapping[str, FrameCodec], values: Mapping[str, float]) -> None:
    """Raise InputError, naming each signal, if the guard would misread frames of the database at `path`.

    `frames`: those of the database for a single clutch, or clutch a, by name. `values`: the guard's values of LAYOUT_VALUES.
    """
    if problems := list(_find_problems(frames, values)):
        raise InputError(f"DBC {path}: the guard has its own layout, and would read other bits: {'; '.join(problems)}")


def _find_problems(frames: Mapping[str, FrameCodec], values: Mapping[str, float]) -> Iterator[str]:
    key = int(values[_KEY])
    expected = _list_expected(frames, key)
    differences = {frames[name].data_id ^ one.data_id for name, one in expected.items() if name in frames}
    other_key = len(differences) == 1 and 0 not in differences
    if other_key:  # one key for all frames, so the database and the limits are of two benches
        yield (
            f"the key of its data IDs is {key ^ differences.pop()}; guard.{_KEY} is {key}: CLUTCH_HIL_LIMITS must name the"
            " limits of this database, whose first lines `clutch-hil frames --write` prints"
        )
    for name, (can_id, length, data_id, places) in expected.items():
        if (codec := frames.get(name)) is None:
            continue  # a claim, which databases from before 26 November 2026 lack
        if codec.can_id != can_id:
            yield f"frame {name} has the identifier 0x{codec.can_id:03X}; the guard's is 0x{can_id:03X}"
        if codec.length != length:
            yield f"frame {name} has {codec.length} bytes; the guard's has {length}"
        if codec.data_id != data_id and not other_key:
            yield f"frame {name} has the data ID {codec.data_id}; the guard's is {data_id}, as guard.{_KEY} is {key}"
        signals = {signal.name.upper(): signal for signal in codec.definitions}
        for signal_name, place in places.items():
            signal = signals[signal_name]
            if (signal.start, signal.length) != (place.start, place.length):
                there, here = f"{signal.start}|{signal.length}", f"{place.start}|{place.length}"
                yield f"{name}.{signal_name} is at {there}; the guard's is at {here}"
            factor, why = place.factor, ""
            if of_size := _OF_SIZE.get(signal_name):
                limit, unit, counts = of_size
                factor, why = values[limit] / counts, f", as guard.{limit} is {values[limit]:.10g} {unit}"
            if factor is not None and not (isclose(float(signal.scale), factor, rel_tol=_SAME) and signal.offset == 0):
                yield (
                    f"{name}.{signal_name} has the factor {float(signal.scale):.10g} and offset {float(signal.offset):g}; the"
                    f" guard's are {factor:.10g} and 0{why}"
                )
            if place.zero and signal.offset != 0:
                yield f"{name}.{signal_name} has the offset {float(signal.offset):g}; the guard's is 0"
            if place.signed is not None and signal.is_signed != place.signed:
                yield f"{name}.{signal_name} is {_format_sign(signal.is_signed)}; the guard's is {_format_sign(place.signed)}"


def _list_expected(frames: Mapping[str, FrameCodec], key: int) -> Mapping[str, _Expected]:
    """Return the expected properties of each frame, for the database version of `frames`."""
    if all(codec.version is not VERSION_1 for codec in frames.values()):
        return {
            name: _Expected(can_id, BYTES, (can_id + DATA_ID) ^ key, places)
            for name, (can_id, places) in LAYOUT.items()
        }
    reference = load_frames(DBC_1)
    return {name: _read_expected(reference[name], places) for name, (_, places) in LAYOUT.items() if name in reference}


def _read_expected(codec: FrameCodec, places: Mapping[str, Place]) -> _Expected:
    """Return the expected properties of a frame of version 1, with the signals that the guard reads or writes."""
    signals = {signal.name: signal for signal in codec.definitions if signal.name in places}
    return _Expected(
        codec.can_id, codec.length, codec.data_id,
        {
            name: Place(
                signal.start, signal.length, None if places[name].factor is None else float(signal.scale),
                None if places[name].signed is None else signal.is_signed, places[name].zero,
            )
            for name, signal in signals.items()
        },
    )  # fmt: skip


def _format_sign(signed: bool) -> str:
    return "signed" if signed else "unsigned"
