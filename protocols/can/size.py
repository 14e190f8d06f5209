"""Size: ranges of torque, speed and pressure in the frames of a bench, given by the factors of its database.

A bench of another size has its own database, named by the environment variable DATABASE in each of its processes. It is the
shipped database with other factors of torques, speeds and pressures, with one ratio for each quantity. Everything else must be
as shipped, because the loops are compiled for it. Voltages and temperatures are not scaled.

Its frames have other data IDs: those of the shipped database XOR a key of the size (`compute_key`). So no process uses a frame
of a process with another database (`other_size.py`), unless both sizes have the same key by chance (1 in 4096).
"""

import os
import re
from collections.abc import Iterator
from functools import cache
from math import isclose, pi
from pathlib import Path
from typing import NamedTuple

from cantools.database.can import Message, Signal
from e2e.crc import calculate_crc16

from protocols.can.database import read_data_id, read_database, read_text
from protocols.can.version import DATA_ID
from protocols.errors import InputError

DATABASE = "CLUTCH_HIL_DATABASE"
SHIPPED = Path(__file__).with_name("clutch_rig.dbc")
# Signals whose factor depends on the bench's size. The encoder angle does not: it wraps
TORQUES = frozenset({
    ("MOTOR_COMMAND", "TORQUE_LIMIT"), ("ANALOG_SENSORS", "CLUTCH_TORQUE"), ("ENCODER", "MOTOR_TORQUE"),
    ("TORQUE_SETPOINT", "TORQUE_DEMAND"), ("CONTROLLER_STATUS", "TORQUE_ESTIMATE"),
})  # fmt: skip
SPEEDS = frozenset({("MOTOR_COMMAND", "SPEED_DEMAND"), ("TORQUE_SETPOINT", "SPEED_DEMAND")})
PRESSURES = frozenset({("ANALOG_SENSORS", "CYLINDER_PRESSURE"), ("TORQUE_SETPOINT", "PRESSURE_DEMAND")})
SENSOR_TORQUE = 50.0  # Nm, range of the shipped torque channels, both signs
SPEED = 32.768  # rad/s, range of the shipped speed demands, both signs
PRESSURE = 10.0  # bar, range of the shipped pressure channel
_RPM = pi / 30.0  # rad/s, 1/min (2 pi rad in 60 s)
# Nm: the largest motor of janssens2010.toml; rad/s: the guard's at 200 Hz and more; bar: the highest supply there
_LARGEST = 3500.0, 1000.0, 60.0
_SAME = 1e-9  # of a factor
# Bits of a key. Data IDs of the bench have bits 14 and 15 set and 11 to 13 clear, so that no data ID of a size equals that of
# another shipped frame, and none is 0. Bit 3 is the clutch (two_clutches.py)
_ALWAYS, _FREE = 0x0800, 0x37F7
KEY_BITS = _ALWAYS | _FREE
_MOST_PROBLEMS = 5  # named in one message
_SIGNAL = re.compile(
    r"(?P<head> SG_ (?P<name>\w+) : \S+ )\((?P<factor>[^,]+),0\) \[(?P<low>[^|]+)\|(?P<high>[^\]]+)\](?P<rest>.*)"
)
_SENSITIVITY = re.compile(r'(CM_ SG_ \d+ \w+ "[^"]*?)([0-9.]+) V/(Nm|bar)')
_NUMBER = re.compile(rf'(BA_ "{DATA_ID}" BO_ \d+ )(\d+);')


class Size(NamedTuple):
    """Ratios of the torque, speed and pressure ranges of a bench to those of the shipped bench."""

    torque: float = 1.0
    speed: float = 1.0
    pressure: float = 1.0

    def choose_ratio(self, frame: str, signal: str) -> float:
        """Return the factor of a signal divided by that in the shipped database."""
        kinds = zip((TORQUES, SPEEDS, PRESSURES), self, strict=True)
        return next((ratio for signals, ratio in kinds if (frame, signal) in signals), 1.0)


def compute_key(size: Size) -> int:
    """Return the key of a size: 0 for the shipped size, else a CRC of its ratios.

    Most sizes have different keys.
    """
    if all(isclose(ratio, 1.0, rel_tol=_SAME) for ratio in size):
        return 0
    text = " ".join(f"{ratio:.7g}" for ratio in size)  # fewer digits than a database may round
    return _ALWAYS | int(calculate_crc16(text.encode(), 0, False)) & _FREE


def find_database() -> Path:
    """Return the database of this process's bench: the one that DATABASE names, else the shipped one."""
    if given := os.environ.get(DATABASE):
        os.environ[DATABASE] = str(Path(given).absolute())  # a process that this one starts may have another folder
    return Path(os.environ.get(DATABASE) or SHIPPED)


@cache
def read_size(path: Path) -> Size:
    """Return the size of a bench with the database at `path`.

    Raises InputError, with each reason, if it cannot be a bench's database.
    """
    return _read_size(path)


def _read_size(path: Path) -> Size:
    if path == SHIPPED:
        return Size()
    shipped = {message.name: message for message in read_database(SHIPPED).messages}
    own = {message.name: message for message in read_database(path).messages}
    size = Size(*(_find_ratio(shipped, own, signals) for signals in (TORQUES, SPEEDS, PRESSURES)))
    if problems := list(_find_problems(shipped, own, size)):
        more = f"; and {len(problems) - _MOST_PROBLEMS} more" if len(problems) > _MOST_PROBLEMS else ""
        raise InputError(
            f"DBC {path} is not a database of a bench of another size; `clutch-hil frames --write` makes one, with {DATABASE}"
            f" unset: {'; '.join(problems[:_MOST_PROBLEMS])}{more}"
        )
    return size


def write_sized_text(torque: float = SENSOR_TORQUE, speed: float = SPEED, pressure: float = PRESSURE) -> str:
    """Return the text of a database with torque channels up to +-`torque` [Nm] and speed demands up to +-`speed` [rad/s].

    pressure [bar]: range of its pressure channel. Raises InputError for less than the shipped ranges, and for more than a bench
    may have.
    """
    for name, value, least, most, unit in (
        ("torque", torque, SENSOR_TORQUE, _LARGEST[0], "Nm"), ("speed", speed, SPEED, _LARGEST[1], "rad/s"),
        ("pressure", pressure, PRESSURE, _LARGEST[2], "bar"),
    ):  # fmt: skip
        if not least <= value <= most:
            hint = f"; for a smaller rig use {least:g} {unit}" if 0.0 < value < least else ""
            if name == "speed" and most < value <= most / _RPM:
                hint = f"; {value:g} 1/min are {value * _RPM:.4g} rad/s"
            raise InputError(
                f"a bench of {value:g} {unit} is not possible; allowed {name}s are {least:g} to {most:g} {unit}{hint}"
            )
    size, frame, lines = Size(torque / SENSOR_TORQUE, speed / SPEED, pressure / PRESSURE), "", []
    data_key = compute_key(size)
    for line in read_text(SHIPPED).splitlines():
        if line.startswith("BO_ "):
            frame = line.split()[2].rstrip(":")
        if (match := _SIGNAL.fullmatch(line)) and (ratio := size.choose_ratio(frame, match["name"])) != 1.0:
            factor, low, high = (float(match[key]) * ratio for key in ("factor", "low", "high"))
            line = f"{match['head']}({factor!r},0) [{low:.10g}|{high:.10g}]{match['rest']}"
        line = _SENSITIVITY.sub(lambda match: _divide_sensitivity(match, size), line)
        if match := _NUMBER.fullmatch(line):
            line = f"{match[1]}{int(match[2]) ^ data_key};"
        lines.append(line)
    return "\n".join([*lines, ""])


def read_guard_values(path: Path) -> dict[str, float]:
    """Return the values that the guard's limits must have for the database at `path`, by names and in units of limits.toml.

    motor_range [Nm]: the torque of all counts of the motor's limit; pressure_range [bar]: the end of the pressure's range;
    data_key: the key of the size. Raises InputError as `read_size`.
    """
    (torque,), (pressure,) = (
        [s for m in read_database(path).messages if m.name == frame for s in m.signals if s.name == name]
        for frame, name in (("MOTOR_COMMAND", "TORQUE_LIMIT"), ("ANALOG_SENSORS", "CYLINDER_PRESSURE"))
    )
    return {
        "motor_range": float(torque.scale) * float(1 << torque.length),
        "pressure_range": float(pressure.scale) * float(1 << pressure.length - 1),
        "data_key": float(
            compute_key(_read_size(path))
        ),  # of the present file, uncached: it may just have been written
    }


def _divide_sensitivity(match: re.Match[str], size: Size) -> str:
    ratio = {"Nm": size.torque, "bar": size.pressure}[match[3]]
    return f"{match[1]}{float(match[2]) / ratio:g} V/{match[3]}"


def _find_ratio(shipped: dict[str, Message], own: dict[str, Message], signals: frozenset[tuple[str, str]]) -> float:
    """Return the ratio of the factors of the first of `signals` that both databases have; 1 if there is none."""
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
        (size.pressure, "pressures", _LARGEST[2] / PRESSURE),
    ):
        if not 1.0 - _SAME <= ratio <= most * (1.0 + _SAME):
            yield f"its {what} are {ratio:.6g} times the shipped ones; allowed are 1 to {most:.6g}"
    for name, message in shipped.items():
        if name not in own:
            yield f"it lacks the frame {name}"
            continue
        if _describe_frame(message) != _describe_frame(own[name]):
            yield f"frame {name} has another identifier, length or cycle time"
        for signal in message.signals:
            if (other := _find_signal(own, name, signal.name)) is None:
                yield f"frame {name} lacks the signal {signal.name}"
            elif _describe_signal(signal) != _describe_signal(other):
                yield f"{name}.{signal.name} has another position, sign or offset"
            elif not isclose(
                float(other.scale),
                factor := float(signal.scale) * size.choose_ratio(name, signal.name),
                rel_tol=_SAME,
            ):
                yield f"{name}.{signal.name} has the factor {float(other.scale):.10g}; allowed is {factor:.10g}"
    numbers = {name: read_data_id(message) ^ compute_key(size) for name, message in shipped.items() if name in own}
    if wrong := {name: number for name, number in numbers.items() if read_data_id(own[name]) != number}:
        needed = ", ".join(f"{name} {number}" for name, number in wrong.items())
        yield f"data IDs are not those of its size, which are {needed}"


def _describe_frame(message: Message) -> tuple[object, ...]:
    return message.frame_id, message.is_extended_frame, message.length, message.cycle_time


def _describe_signal(signal: Signal) -> tuple[object, ...]:
    return signal.start, signal.length, signal.byte_order, signal.is_signed, float(signal.offset)
