"""MF4 of a bus logger: its frames, read with asammdf. python-can's own reader is switched off (protocols/__init__.py).

Reference: ASAM MDF bus logging 1.0: groups of CAN_DataFrame, CAN_RemoteFrame and CAN_ErrorFrame, a row for each frame
"""

import heapq
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import numpy as np

from protocols.errors import InputError
from protocols.files.mdf.blocks import open_checked
from protocols.files.mdf.walk import make_damage_error
from protocols.files.quiet_libraries import quiet

_ROWS = 50_000  # read at once: with CAN FD, 3 MB of payloads
_KINDS = ("CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame")
_FD_BYTES = 64  # of data in a row
_MAY_BE_INVALID = 2  # flag of a channel of MDF 4
_BYTES, _MOST_BITS = 6, 64  # lowest data type of MDF 4 that is not a number; bits of a number
# Flags of a channel group: FLAG_CG_BUS_EVENT of asammdf, whose import costs a second
_BUS_EVENT, _PLAIN_BUS_EVENT = 2, 4
# Structures of frames in ASAM MDF bus logging, and their members
_FRAME = re.compile(
    r"(CAN_(Data|Remote|Error|Overload)Frame|LIN_(Frame|WakeUp|Spike|LongDom|\w+Error)"
    r"|(FLX|ETH|MOST|KLINE|USB)_(\w*Frame|\w*Pdu|Symbol|Message|Packet|\w+Error))(\.|$)",
    re.IGNORECASE,
)


def is_bus_log(path: Path, wholly: bool = True) -> bool:
    """Return whether all rows of an MDF file are frames of a bus, or, if not `wholly`, some are. Raises InputError."""
    if not _contains(path, b"CAN_DataFrame"):
        return False
    with quiet():
        try:
            with _open(path) as mdf:
                groups = [group for group in mdf.groups if group.channel_group.cycles_nr]
                of_a_bus = [holds_frames(group) for group in groups]
                return any(map(_holds_can_frames, groups)) and (all(of_a_bus) or not wholly)
        except InputError:
            raise
        except Exception:  # asammdf raises many exception types for a damaged file
            pass
    return False


def holds_frames(group: Any) -> bool:
    """Return whether a group of asammdf holds bus frames.

    Groups of signals decoded from frames keep the mark of a bus, so the mark alone is not enough.
    """
    flags = getattr(group.channel_group, "flags", 0)
    frames = flags & _PLAIN_BUS_EVENT or any(_FRAME.match(channel.name or "") for channel in group.channels)
    return bool(flags & _BUS_EVENT and frames)


def _holds_can_frames(group: Any) -> bool:
    names = {channel.name for channel in group.channels}
    return holds_frames(group) and any(f"{kind}.ID" in names for kind in _KINDS)


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    """Yield the file opened by asammdf, after a check of its blocks: asammdf never ends on some damaged files."""
    from asammdf import MDF

    stream, _ = open_checked(path)
    with stream, MDF(stream) as mdf:  # type: ignore[arg-type]
        for group in mdf.groups:
            _check_record(path, group)
        yield mdf


def _check_record(path: Path, group: Any) -> None:
    """Raise InputError if a channel lies outside its record, or rows are missing: the C library does not check that."""
    block = group.channel_group
    row_bytes, mark_bytes = block.samples_byte_nr, getattr(block, "invalidation_bytes_nr", 0)
    for channel in group.channels:
        first, bits = getattr(channel, "byte_offset", 0), getattr(channel, "bit_offset", 0) + channel.bit_count
        marked = getattr(channel, "flags", 0) & _MAY_BE_INVALID
        if 8 * first + bits > 8 * row_bytes or (channel.data_type < _BYTES and channel.bit_count > _MOST_BITS):
            raise make_damage_error(path, f"{channel.name} lies outside of its record")
        if marked and channel.pos_invalidation_bit >= 8 * mark_bytes:
            raise make_damage_error(path, f"the mark of {channel.name} lies outside of its record")
    size = sum(info.original_size for info in group.get_data_blocks())
    if block.cycles_nr * row_bytes > size:
        raise make_damage_error(
            path, f"a group has {block.cycles_nr} rows of {row_bytes} bytes by its header, and {size} bytes of data"
        )


def read_frames(path: Path, most: int) -> Iterator[can.Message]:
    """Yield the frames in order of time. Raises InputError if the file declares more than `most`, and errors of asammdf."""
    with _open(path) as mdf:
        start = mdf.header.start_time.timestamp()
        groups: Any = mdf.groups
        rows, streams = 0, []
        for index, group in enumerate(groups):
            names = {channel.name for channel in group.channels}
            kinds = [kind for kind in _KINDS if f"{kind}.ID" in names]
            rows += int(group.channel_group.cycles_nr) if kinds else 0
            streams += [_read_messages(mdf, index, kind, names, start) for kind in kinds]
        if rows > most:
            raise InputError(f"log {path} has {rows} frames; allowed are {most}: cut it into parts")
        yield from heapq.merge(*streams, key=lambda message: message.timestamp)


def _read_messages(mdf: Any, index: int, kind: str, names: set[str], start: float) -> Iterator[can.Message]:
    rows = int(mdf.groups[index].channel_group.cycles_nr)

    def read_values(name: str, offset: int, otherwise: int = 0) -> list[int]:
        if f"{kind}.{name}" not in names:
            return [otherwise] * min(_ROWS, rows - offset)
        signal = mdf.get(f"{kind}.{name}", group=index, raw=True, record_offset=offset, record_count=_ROWS)
        # CANedge has the bus and IDE as constants, which are conversions of the row's number, and the length as one of the DLC
        return [int(value) for value in signal.physical(ignore_value2text_conversions=True).samples]

    for offset in range(0, rows, _ROWS):
        ids = mdf.get(f"{kind}.ID", group=index, raw=True, record_offset=offset, record_count=_ROWS)
        lengths = read_values("DataLength", offset)
        data = np.zeros((len(ids.samples), 0), np.uint8)
        if f"{kind}.DataBytes" in names:
            data = mdf.get(f"{kind}.DataBytes", group=index, raw=True, record_offset=offset, record_count=_ROWS).samples
        columns = zip(
            ids.timestamps.tolist(), ids.samples.tolist(), read_values("IDE", offset), read_values("EDL", offset),
            lengths, data,
            read_values("BusChannel", offset), read_values("DLC", offset), strict=True,
        )  # fmt: skip
        for stamp, can_id, extended, fd, length, payload, channel, dlc in columns:
            plain = kind == "CAN_DataFrame"
            yield can.Message(
                timestamp=stamp + start,
                arbitration_id=can_id & 0x1FFFFFFF,
                is_extended_id=bool(extended or can_id & 0x80000000),
                is_fd=bool(fd) and plain,
                is_remote_frame=kind == "CAN_RemoteFrame",
                is_error_frame=kind == "CAN_ErrorFrame",
                dlc=min(length, _FD_BYTES) if plain else dlc,
                data=payload[: min(length, _FD_BYTES)].tobytes() if plain else None,
                channel=channel,
            )


def _contains(path: Path, word: bytes) -> bool:
    with path.open("rb") as file:
        before = b""
        while part := file.read(1 << 20):
            if word in before + part:
                return True
            before = part[-len(word) :]
    return False
