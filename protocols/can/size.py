"""Size: how much torque and speed the frames of a bench carry, by the factors of its database.

A bench of another size has a database of its own, which the environment variable DATABASE names in every process of it. It is
the shipped one with other factors of the torques, all in one ratio, and of the speeds, all in one. Everything else must be as
shipped, as the loops are compiled for it. Pressures, voltages and temperatures have no other size.
"""

import os
import re
from collections.abc import Iterator
from functools import cache
from math import isclose
from pathlib import Path
from typing import NamedTuple

from cantools.database.can import Message, Signal

from protocols.can.database import read_data_id, read_database, read_text
from protocols.errors import InputError

DATABASE = "CLUTCH_HIL_DATABASE"
SHIPPED = Path(__file__).with_name("clutch_rig.dbc")
# Signals whose factor is of the bench's size. The angle of the encoder is none: it wraps
TORQUES = frozenset({
    ("MOTOR_COMMAND", "TORQUE_LIMIT"), ("ANALOG_SENSORS", "CLUTCH_TORQUE"), ("ENCODER", "MOTOR_TORQUE"),
    ("TORQUE_SETPOINT", "TORQUE_DEMAND"), ("CONTROLLER_STATUS", "TORQUE_ESTIMATE"),
})  # fmt: skip
SPEEDS = frozenset({("MOTOR_COMMAND", "SPEED_DEMAND"), ("TORQUE_SETPOINT", "SPEED_DEMAND")})
SENSOR_TORQUE = 50.0  # Nm, what the torque channels of the shipped frames carry either way
SPEED = 32.768  # rad/s, what the speed demands of the shipped frames carry either way
_LARGEST = 2000.0, 250.0  # Nm: the largest motor of janssens2010.toml; rad/s: the guard's at 50 Hz
_SAME = 1e-9  # of a factor
_MOST_PROBLEMS = 5  # told in one sentence
_SIGNAL = re.compile(
    r"(?P<head> SG_ (?P<name>\w+) : \S+ )\((?P<factor>[^,]+),0\) \[(?P<low>[^|]+)\|(?P<high>[^\]]+)\](?P<rest>.*)"
)
_SENSITIVITY = re.compile(r'(CM_ SG_ \d+ \w+ "[^"]*?)([0-9.]+) V/Nm')


class Size(NamedTuple):
    """Torques and speeds that a bench carries, over those of the shipped one."""

    torque: float = 1.0
    speed: float = 1.0


def find_database() -> Path:
    """The database of this process's bench: the one that DATABASE names, else the shipped one."""
    if given := os.environ.get(DATABASE):
        os.environ[DATABASE] = str(Path(given).absolute())  # a process that this one starts may have another folder
    return Path(os.environ.get(DATABASE) or SHIPPED)


@cache
def read_size(path: Path) -> Size:
    """The size of a bench with the database at `path`. Raises InputError, with each reason, where it cannot be of a bench."""
    if path == SHIPPED:
        return Size()
    shipped = {message.name: message for message in read_database(SHIPPED).messages}
    own = {message.name: message for message in read_database(path).messages}
    size = Size(_find_ratio(shipped, own, TORQUES), _find_ratio(shipped, own, SPEEDS))
    if problems := list(_find_problems(shipped, own, size)):
        more = f"; and {len(problems) - _MOST_PROBLEMS} more" if len(problems) > _MOST_PROBLEMS else ""
        raise InputError(
            f"DBC {path} is no database of a bench of another size; write one by `clutch-hil frames --torque --speed --write`:"
            f" {'; '.join(problems[:_MOST_PROBLEMS])}{more}"
        )
    return size


def write_sized_text(torque: float, speed: float) -> str:
    """The text of a database whose torque channels carry `torque` [Nm], and speed demands `speed` [rad/s], either way.

    Raises InputError for less than the shipped ones carry, and for more than a bench may have.
    """
    for name, value, least, most, unit in (
        ("torque", torque, SENSOR_TORQUE, _LARGEST[0], "Nm"), ("speed", speed, SPEED, _LARGEST[1], "rad/s"),
    ):  # fmt: skip
        if not least <= value <= most:
            raise InputError(
                f"a bench of {value:g} {unit} is not possible; allowed {name}s are {least:g} to {most:g} {unit}"
            )
    size, frame, lines = Size(torque / SENSOR_TORQUE, speed / SPEED), "", []
    for line in read_text(SHIPPED).splitlines():
        if line.startswith("BO_ "):
            frame = line.split()[2].rstrip(":")
        if (found := _SIGNAL.fullmatch(line)) and (ratio := _choose_ratio(size, frame, found["name"])) != 1.0:
            factor, low, high = (float(found[key]) * ratio for key in ("factor", "low", "high"))
            line = f"{found['head']}({factor!r},0) [{low:.10g}|{high:.10g}]{found['rest']}"
        lines.append(_SENSITIVITY.sub(lambda told: f"{told[1]}{float(told[2]) / size.torque:g} V/Nm", line))
    return "\n".join([*lines, ""])


def find_motor_range(path: Path) -> float:
    """The torque [Nm] of all counts of the motor's limit in the database at `path`: the guard's `motor_range` for it."""
    (message,) = (one for one in read_database(path).messages if one.name == "MOTOR_COMMAND")
    (signal,) = (one for one in message.signals if one.name == "TORQUE_LIMIT")
    return float(signal.scale) * float(1 << signal.length)


def _choose_ratio(size: Size, frame: str, signal: str) -> float:
    return size.torque if (frame, signal) in TORQUES else size.speed if (frame, signal) in SPEEDS else 1.0


def _find_ratio(shipped: dict[str, Message], own: dict[str, Message], signals: frozenset[tuple[str, str]]) -> float:
    """Ratio of the factors of the first of `signals` that both have; 1 where there is none."""
    for frame, name in sorted(signals):
        ours, theirs = _find_signal(shipped, frame, name), _find_signal(own, frame, name)
        if ours and theirs:
            return float(theirs.scale) / float(ours.scale)
    return 1.0


def _find_signal(messages: dict[str, Message], frame: str, name: str) -> Signal | None:
    return next((s for s in messages[frame].signals if s.name == name), None) if frame in messages else None


def _find_problems(shipped: dict[str, Message], own: dict[str, Message], size: Size) -> Iterator[str]:
    for ratio, what, most in (
        (size.torque, "torques", _LARGEST[0] / SENSOR_TORQUE),
        (size.speed, "speeds", _LARGEST[1] / SPEED),
    ):
        if not 1.0 - _SAME <= ratio <= most * (1.0 + _SAME):
            yield f"its {what} are {ratio:.6g} times the shipped ones; allowed are 1 to {most:.6g}"
    for name, message in shipped.items():
        if name not in own:
            yield f"it lacks the frame {name}"
            continue
        if _describe_frame(message) != _describe_frame(own[name]):
            yield f"frame {name} has another identifier, data ID, length or cycle time"
        for signal in message.signals:
            if (other := _find_signal(own, name, signal.name)) is None:
                yield f"frame {name} lacks the signal {signal.name}"
            elif _describe_signal(signal) != _describe_signal(other):
                yield f"{name}.{signal.name} is elsewhere, or has another sign or offset"
            elif not isclose(
                float(other.scale),
                expected := float(signal.scale) * _choose_ratio(size, name, signal.name),
                rel_tol=_SAME,
            ):
                yield f"{name}.{signal.name} has the factor {float(other.scale):.10g}; allowed is {expected:.10g}"


def _describe_frame(message: Message) -> tuple[object, ...]:
    return message.frame_id, message.is_extended_frame, message.length, read_data_id(message), message.cycle_time


def _describe_signal(signal: Signal) -> tuple[object, ...]:
    return signal.start, signal.length, signal.byte_order, signal.is_signed, float(signal.offset)
