"""Frames in MF4 as CANedge writes them: bus and kind as constants, the length as a conversion of the length code."""

from pathlib import Path

import numpy as np
from asammdf import MDF, Signal
from asammdf.blocks.conversion_utils import from_dict
from asammdf.blocks.source_utils import Source
from asammdf.blocks.v4_constants import BUS_TYPE_CAN, CHANNEL_TYPE_VIRTUAL, FLAG_CG_BUS_EVENT, SOURCE_BUS

from protocols.files.mdf.frames import read_frames

ROWS = 300  # more than buses can be
BYTES = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)  # by length code, ISO 11898-1
CONSTANTS = {"BusChannel": 9, "IDE": 0, "EDL": 1}


def write(path: Path) -> None:
    members = [(name, "u1") for name in (*CONSTANTS, "DLC", "DataLength")]
    kind = [*members, ("ID", "u4"), ("DataBytes", "u1", (64,))]
    rows = np.zeros(ROWS, [(f"CAN_DataFrame.{name}", *rest) for name, *rest in kind])
    codes = np.arange(ROWS) % len(BYTES)
    rows["CAN_DataFrame.DLC"] = rows["CAN_DataFrame.DataLength"] = codes
    rows["CAN_DataFrame.ID"] = 0x123
    rows["CAN_DataFrame.DataBytes"] = np.arange(64)
    conversions = {name: {"a": 0.0, "b": float(value)} for name, value in CONSTANTS.items()}
    lengths = {f"raw_{code}": code for code in range(16)} | {f"phys_{code}": size for code, size in enumerate(BYTES)}
    with MDF(version="4.11") as mdf:
        source = Source("", "", "", SOURCE_BUS, BUS_TYPE_CAN)
        mdf.append([Signal(rows, 0.001 * np.arange(ROWS), name="CAN_DataFrame", source=source)])
        mdf.groups[0].channel_group.flags |= FLAG_CG_BUS_EVENT
        for channel in mdf.groups[0].channels:
            member = channel.name.removeprefix("CAN_DataFrame.")
            if member in CONSTANTS:
                channel.channel_type, channel.bit_count, channel.byte_offset = CHANNEL_TYPE_VIRTUAL, 0, 0
                channel.conversion = from_dict(conversions[member])
            elif member == "DataLength":
                channel.conversion = from_dict(lengths)
        mdf.save(path)


def test_constants_and_lengths_are_those_of_their_conversions(tmp_path: Path) -> None:
    write(tmp_path / "log.mf4")
    messages = list(read_frames(tmp_path / "log.mf4", ROWS))
    assert len(messages) == ROWS
    assert {one.channel for one in messages} == {9}
    assert {(one.is_extended_id, one.is_fd) for one in messages} == {(False, True)}
    for row, one in enumerate(messages):
        assert bytes(one.data) == bytes(range(BYTES[row % len(BYTES)]))
