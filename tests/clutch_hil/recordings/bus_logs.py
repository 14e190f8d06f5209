"""Bus logs in every format, of the bench's sensor frames, for the tests of bus logs."""

from pathlib import Path
from typing import Any

import can

from benchmarks.logged_frames import write_mf4
from protocols.can.frames import load_frames
from protocols.files.bus_logs.bus_log import read_bus_log

CODECS = load_frames()
ENCODER, ANALOG = CODECS["ENCODER"], CODECS["ANALOG_SENSORS"]
START = 1_700_000_000.0  # s, UNIX time


def make_message(stamp: float, can_id: int, data: bytes, **kinds: Any) -> can.Message:
    return can.Message(stamp, can_id, **{"is_extended_id": False, "data": data, "channel": 0, **kinds})


def make_bench_messages(samples: int = 40, start: float = START) -> list[can.Message]:
    """Sensor frames of some samples at 1 kHz."""
    messages = []
    for n in range(samples):
        at = round(start + n * 1e-3, 6)
        messages.append(make_message(at, ANALOG.can_id, ANALOG.pack(n, 0.01 * (n % 500), 60.0, 0.0)))
        messages.append(
            make_message(round(at + 1e-4, 6), ENCODER.can_id, ENCODER.pack(n, 0.001 * (n % 5000), n % 1024))
        )
    return messages


def format_candump(messages: list[can.Message], channel: str = "can0") -> str:
    return "".join(f"({m.timestamp:.6f}) {channel} {m.arbitration_id:03X}#{m.data.hex().upper()}\n" for m in messages)


def format_screen(messages: list[can.Message]) -> str:
    return "".join(
        f" ({m.timestamp:.6f})  can0  {m.arbitration_id:03X}   [{len(m.data)}]  {m.data.hex(' ').upper()}\n"
        for m in messages
    )


def write(path: Path, messages: list[can.Message]) -> Path:
    if path.suffix == ".mf4":
        write_mf4(path, messages)
        return path
    with can.Logger(path) as writer:
        for one in messages:
            writer(one)
    return path


def read_frames(path: Path) -> list[tuple[int, bytes]]:
    log = read_bus_log(path)
    return [(int(log.ids[row]), log.read_data(row)) for row in range(len(log))]


WANTED = [(m.arbitration_id, bytes(m.data)) for m in make_bench_messages()]
ASC_HEAD = "date Wed Nov 25 03:01:09.978 2026\nbase hex  timestamps absolute\ninternal events logged\n"


def format_asc(messages: list[can.Message], head: str = ASC_HEAD, base: str = "02X", relative: bool = False) -> str:
    lines, before = [head], START
    for m in messages:
        at = m.timestamp - (before if relative else START)
        before = m.timestamp
        data = " ".join(format(byte, base) for byte in m.data)
        lines.append(f"  {at:.6f} 1  {format(m.arbitration_id, base[-1])}             Rx   d {len(m.data)} {data}\n")
    return "".join(lines)
