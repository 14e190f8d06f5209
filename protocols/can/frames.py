"""Frames: the DBC of the bench compiled once into pack and unpack functions; a call takes about 1 us.

The DBC is `clutch_rig.dbc`, or that of a bench of another size (`size.py`), read by cantools. The generated code handles each
payload as one integer. tests/protocols/test_frames.py compares it with cantools on random values.
"""

from collections import namedtuple
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import cache
from math import floor, isfinite
from pathlib import Path
from typing import Any, NamedTuple

from cantools.database.can import Message, Signal

from protocols.can.claim import bind_data_id
from protocols.can.database import check_carries, is_carried, read_data_id, read_database
from protocols.can.size import find_database, read_size
from protocols.can.two_clutches import CLUTCHES, make_messages
from protocols.can.version import VERSION_2, Version, find_version
from protocols.errors import InputError

DBC = find_database()
DBC_1 = Path(__file__).with_name("clutch_rig_version_1.dbc")  # of old logs

COUNTER_START, COUNTER_MODULUS = VERSION_2.counter_start, VERSION_2.counter_modulus


class Frame(NamedTuple):
    """A CAN frame: identifier and payload."""

    can_id: int
    data: bytes


@dataclass(frozen=True)
class OtherFrame:
    """A frame of a DBC that the bench neither sends nor receives; fields as of FrameCodec.

    extended: has an extended identifier.
    """

    name: str
    can_id: int
    length: int
    sender: str
    cycle_time: float
    signals: tuple[str, ...]
    extended: bool


class FrameCodec:
    """One frame of the DBC, compiled, with the protection of its version.

    `pack(counter, *values)` takes physical values in the order of `signals` (or by lower-case name) and returns the
    payload with CRC and counter, `pack_raw` takes raw integers; both raise InputError for a value outside the raw range. A
    signal that is not given has the raw integer 0, as in `words`.
    `unpack(data)` returns a namedtuple of physical values, `raw(data)` of raw integers; neither checks: `is_valid` does.
    """

    extended = False  # its identifier

    def __init__(self, message: Message, version: Version = VERSION_2) -> None:
        self.name: str = message.name
        self.version = version
        self.can_id: int = message.frame_id
        self.length: int = message.length
        self.data_id = read_data_id(message)
        self.sender: str = message.senders[0] if message.senders else "-"
        self.cycle_time: float = (message.cycle_time or 0) / 1000.0  # s
        self.comment: str = message.comment or ""
        self.definitions: list[Signal] = sorted(message.signals, key=lambda signal: signal.start)
        payload = [signal for signal in self.definitions if signal.name not in ("CRC", "COUNTER")]
        self.signals: tuple[str, ...] = tuple(signal.name.lower() for signal in payload)
        self.scale = {signal.name.lower(): float(signal.scale) for signal in payload}  # unit of the signal per count
        self.bits = {signal.name.lower(): signal.length for signal in payload}
        self._payload = payload
        self._make_functions()

    def _make_functions(self) -> None:
        functions = _compile(self.name, self.length, self.data_id, self._payload, self.version)
        self.pack: Callable[..., bytes] = functions["pack"]
        self.pack_raw: Callable[..., bytes] = functions["pack_raw"]
        self.unpack: Callable[[bytes], Any] = functions["unpack"]
        self.raw: Callable[[bytes], Any] = functions["raw"]

    def list_choices(self, signal: str) -> dict[int, str]:
        """Return the value names of a signal (its name in lower case), with spaces instead of underscores."""
        (definition,) = (one for one in self.definitions if one.name.lower() == signal)
        return {int(value): str(name).replace("_", " ") for value, name in (definition.choices or {}).items()}

    def wrap(self, signal: str, count: int) -> int:
        """Return `count` as stored in an unsigned signal (lower-case name): modulo its range."""
        return count & (1 << self.bits[signal]) - 1

    def is_valid(self, data: bytes) -> bool:
        """Return whether length and CRC of `data` are correct."""
        return len(data) == self.length and self.version.check(data, self.data_id)

    def bind(self, session: int) -> "FrameCodec":
        """Return the same frame for the supervisor that claims with `session` (`claim.py`)."""
        bound = copy(self)
        bound.data_id = bind_data_id(self.data_id, session)
        bound._make_functions()
        return bound

    def read_counter(self, data: bytes) -> int:
        """Return the alive counter: 0..255, in frames of version 1 0..15."""
        return data[self.version.counter_start // 8] & self.version.counter_modulus - 1


@cache
def load_frames(path: Path = DBC, clutch: str = "a") -> dict[str, FrameCodec]:
    """Return the compiled frames of a clutch by their names in the DBC: those of the bench, and others of the same kind.

    `clutch` is a or b; a single clutch is a. The dictionary is cached and shared: do not change it. Raises InputError that
    names file, frame and signal, also where the DBC cannot carry the bench (`database.py`).
    """
    if path == DBC:
        read_size(path)
    database = read_database(path)
    check_carries(path, database)
    version = find_version(database)
    messages = [message for message in database.messages if is_carried(message, version)]
    made = make_messages(path, messages, clutch)
    return {name: FrameCodec(message, version) for name, message in made.items()}


def list_bus_frames(path: Path = DBC, clutches: int = 1) -> list[FrameCodec]:
    """Return the frames of a bus with one or two `clutches`, highest priority first. Raises InputError as `load_frames`."""
    frames: dict[int, FrameCodec] = {}
    for name in CLUTCHES[:clutches]:
        for codec in load_frames(path, name).values():
            other = frames.setdefault(codec.can_id, codec)
            if other.name != codec.name:
                raise InputError(
                    f"DBC {path}: frame {codec.name} would have 0x{codec.can_id:03X}, which is {other.name}"
                )
    return [frames[can_id] for can_id in sorted(frames)]


def list_other_frames(path: Path) -> list[OtherFrame]:
    """Return the frames of a DBC that the bench does not use, highest priority first. Raises InputError as `load_frames`."""
    ours = load_frames(path)
    others = [message for message in read_database(path).messages if message.name not in ours]
    return [
        OtherFrame(
            message.name, message.frame_id, message.length, message.senders[0] if message.senders else "-",
            (message.cycle_time or 0) / 1000.0, tuple(signal.name.lower() for signal in message.signals),
            message.is_extended_frame,
        )
        for message in sorted(others, key=lambda message: message.frame_id)
    ]  # fmt: skip


def _compile(name: str, length: int, number: int, signals: list[Signal], version: Version) -> dict[str, Any]:
    """Generate `pack`, `pack_raw`, `unpack` and `raw` for the payload signals of a frame with the data ID `number`.

    Scaling: raw = floor((value - offset) / scale + 0.5); value = raw * scale + offset.
    """
    names = [signal.name.lower() for signal in signals]
    zeros = [f"{name}={float(signal.offset)!r}" for signal, name in zip(signals, names, strict=True)]
    pack_raw = [
        f"def pack_raw(_counter, {', '.join(f'{name}=0' for name in names)}):",
        f" _word = (_counter & {version.counter_modulus - 1}) << {version.counter_start}",
    ]
    scaled, raws, values = [], [], []
    for index, (signal, value) in enumerate(zip(signals, names, strict=True)):
        mask, sign = (1 << signal.length) - 1, 1 << signal.length - 1
        low, high = (-sign, sign - 1) if signal.is_signed else (0, mask)
        scale, offset = float(signal.scale), float(signal.offset)
        plain = scale == 1.0 and offset == 0.0
        scaled.append(f"_floor({value if plain else f'({value} - {offset!r}) / {scale!r}'} + 0.5)")
        pack_raw += [
            f" if not {low} <= {value} <= {high}: _refuse({index}, {value} * {scale!r} + {offset!r})",
            f" _word |= ({value} & {mask}) << {signal.start}",
        ]
        bits = f"(_word >> {signal.start} & {mask})"
        raws.append(f"({bits} ^ {sign}) - {sign}" if signal.is_signed else bits)
        values.append(raws[-1] if plain else f"({raws[-1]}) * {scale!r} + {offset!r}")
    source = [
        *pack_raw,
        f" _data = bytearray(_word.to_bytes({length}, 'little'))",
        f" _protect(_data, {number})",
        " return bytes(_data)",
        f"def pack(_counter, {', '.join(zeros)}):",
        " try:",
        f"  return pack_raw(_counter, {', '.join(scaled)})",
        " except (ValueError, OverflowError):",  # not a number, infinite
        *(f"  if not _isfinite({value}): _refuse({index}, {value})" for index, value in enumerate(names)),
        "  raise",
        "def unpack(_data):",
        " _word = _int_from(_data, 'little')",
        f" return _Signals({', '.join(values)})",
        "def raw(_data):",
        " _word = _int_from(_data, 'little')",
        f" return _Signals({', '.join(raws)})",
    ]

    def refuse(index: int, value: float) -> None:
        """Raise InputError for a physical value outside the range of its signal."""
        signal = signals[index]
        half = 1 << signal.length - 1
        limits = (-half, half - 1) if signal.is_signed else (0, 2 * half - 1)
        least, most = (float(raw * signal.scale + signal.offset) for raw in limits)
        unit = f" {signal.unit}" if signal.unit else ""
        raise InputError(f"{name}.{signal.name} = {value:.10g}{unit} is outside {least:.10g}..{most:.10g}{unit}")

    scope: dict[str, Any] = {
        "_floor": floor,
        "_isfinite": isfinite,
        "_protect": version.protect,
        "_int_from": int.from_bytes,
        "_refuse": refuse,
        "_Signals": namedtuple(name, names),
    }
    exec(compile("\n".join(source), f"<frame {name}>", "exec"), scope)
    return scope
