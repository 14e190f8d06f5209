"""MDF files for tests: written by asammdf, or byte by byte."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF, Signal

from clutch_hil.recordings.channel import Channel, choose_channel
from clutch_hil.recordings.format import open_recording

ROWS = 300
TIME = np.arange(ROWS) / 100.0
POSITION, FORCE = np.sin(TIME), np.cos(TIME)
SECONDS = ("time", 1)
MAP = """
[columns]
time_s = { from = "time_s", unit = "s" }
position_m = { from = "pos", unit = "m" }
motor_force_n = { from = "force", unit = "N" }
"""


def make_signal(name: str, samples: Any, time: np.ndarray = TIME, **options: Any) -> Signal:
    return Signal(np.asarray(samples), time, name=name, master_metadata=options.pop("master", SECONDS), **options)


def write(path: Path, *groups: list[Signal], version: str = "4.10", compression: int = 0) -> Path:
    with MDF(version=version) as mdf:
        for group in groups:
            mdf.append(group, common_timebase=True)
        written = mdf.save(
            path.with_suffix(".mf4" if version >= "4" else ".mdf"), compression=compression, overwrite=True
        )
    return Path(written).rename(path)


def make_plain_signals() -> list[Signal]:
    return [make_signal("pos", POSITION, unit="m"), make_signal("force", FORCE, unit="N")]


def read_values(path: Path, name: str) -> tuple[Channel, np.ndarray, np.ndarray | None]:
    recording = open_recording(path)
    channel = choose_channel(path, recording.channels, name)
    (read,) = recording.read([channel])
    return channel, read.values, read.time


def make_block(kind: bytes, links: list[int], data: bytes) -> bytes:
    length = 24 + 8 * len(links) + len(data)
    return struct.pack(f"<4s4xQQ{len(links)}Q", b"##" + kind, length, len(links), *links) + data


def write_unsorted(path: Path, bus_flag: int = 0) -> Path:
    """MDF 4 as loggers write it: the rows of two groups after each other as they came, each with the number of its group."""
    content = bytearray(b"MDF     4.10    by hand ".ljust(64, b"\0"))
    struct.pack_into("<H", content, 28, 410)
    content += bytes(104)  # of the header, which is written last

    def add(kind: bytes, links: list[int], data: bytes) -> int:
        content.extend(bytes(-len(content) % 8))
        content.extend(make_block(kind, links, data))
        return len(content) - len(make_block(kind, links, data))

    def write_channel(name: str, following: int, kind: int, place: int) -> int:
        text = add(b"TX", [], name.encode().ljust(8, b"\0"))
        sync = 1 if kind == 2 else 0
        data = struct.pack("<BBBBIIIIBxH6d", kind, sync, 4, 0, place, 64, 0, 0, 0, 0, *[0.0] * 6)
        return add(b"CN", [following, 0, text, 0, 0, 0, 0, 0], data)

    rows, group = {1: TIME, 2: TIME[::10]}, 0
    names = {1: "pos", 2: "force"}
    for number in (2, 1):
        first = write_channel("time", write_channel(names[number], 0, 0, 8), 2, 0)
        data = struct.pack("<QQHHIII", number, len(rows[number]), bus_flag, 0, 0, 16, 0)
        group = add(b"CG", [group, first, 0, 0, 0, 0], data)
    records = b""
    for k, time in enumerate(TIME):
        records += struct.pack("<Bdd", 1, time, np.sin(time))
        if k % 10 == 0:
            records += struct.pack("<Bdd", 2, time, np.cos(time))
    data_group = add(b"DG", [0, group, add(b"DT", [], records), 0], b"\1".ljust(8, b"\0"))
    history = add(b"FH", [0, 0], struct.pack("<QhhB3x", 0, 0, 0, 0))
    header = make_block(
        b"HD", [data_group, history, 0, 0, 0, 0], struct.pack("<QhhBBBBdd", 0, 0, 0, 0, 0, 0, 0, 0.0, 0.0)
    )
    content[64 : 64 + len(header)] = header
    path.write_bytes(content)
    return path


GEARS = {"val_0": 0, "text_0": b"neutral", "val_1": 1, "text_1": b"first", "val_2": 2, "text_2": b"second"}
