"""Logged frames: the database of a car, and an MF4 as a bus logger writes it, for damaged copies and for tests."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import can
import numpy as np

# Features of DBC files: both byte orders, signs, a multiplexer, a float, an extended identifier, value names
CAR = """VERSION ""
NS_ :
BS_:
BU_: ECU
BO_ 291 ENGINE: 8 ECU
 SG_ SPEED : 7|16@0+ (0.25,-10) [0|0] "rpm" ECU
 SG_ TORQUE : 16|12@1- (0.5,3) [0|0] "Nm" ECU
 SG_ GEAR : 28|3@1+ (1,0) [0|0] "" ECU
 SG_ BRAKE : 31|1@1+ (1,0) [0|0] "" ECU
 SG_ COOLANT : 47|8@0- (1,40) [0|0] "°C" ECU
BO_ 2566844926 PAGES: 8 ECU
 SG_ PAGE M : 0|4@1+ (1,0) [0|0] "" ECU
 SG_ VOLTAGE m0 : 8|32@1- (1,0) [0|0] "V" ECU
 SG_ CURRENT m1 : 15|24@0- (0.001,0) [0|0] "A" ECU
 SG_ POWER m1 : 40|24@1+ (2,0) [0|0] "W" ECU
SIG_VALTYPE_ 2566844926 VOLTAGE : 1;
VAL_ 291 GEAR 0 "neutral" 1 "first" 2 "second" ;
"""


def write_mf4(path: Path, messages: list[can.Message], beside: Sequence[Any] = ()) -> None:
    """Write an MF4 as a bus logger does; `beside`: signals of a measurement in the same file."""
    from asammdf import MDF, Signal
    from asammdf.blocks.v4_blocks import SourceInformation
    from asammdf.blocks.v4_constants import BUS_TYPE_CAN, FLAG_CG_BUS_EVENT, SOURCE_BUS

    kind = [
        ("BusChannel", "u1"),
        ("ID", "u4"),
        ("IDE", "u1"),
        ("DLC", "u1"),
        ("DataLength", "u1"),
        ("DataBytes", "u1", (8,)),
    ]
    rows = np.zeros(len(messages), [(f"CAN_DataFrame.{name}", *rest) for name, *rest in kind])
    for row, one in zip(rows, messages, strict=True):
        row["CAN_DataFrame.BusChannel"], row["CAN_DataFrame.ID"] = 1, one.arbitration_id
        row["CAN_DataFrame.IDE"], row["CAN_DataFrame.DLC"] = one.is_extended_id, one.dlc
        row["CAN_DataFrame.DataLength"] = len(one.data)
        row["CAN_DataFrame.DataBytes"][: len(one.data)] = list(one.data)
    stamps = np.array([one.timestamp - messages[0].timestamp for one in messages])
    with MDF(version="4.10") as mdf:
        source = SourceInformation(source_type=SOURCE_BUS, bus_type=BUS_TYPE_CAN)
        mdf.append([Signal(rows, stamps, name="CAN_DataFrame", source=source)])
        mdf.groups[0].channel_group.flags |= FLAG_CG_BUS_EVENT
        if beside:
            mdf.append(list(beside))
        mdf.header.start_time = datetime.fromtimestamp(messages[0].timestamp, UTC)
        mdf.save(path)
