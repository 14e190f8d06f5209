"""Files of a logger, as a recording format of one's own (CONTRIBUTING.md).

A file begins with LABLOG. Rows of three float32 follow: time [ms], pressure [bar], torque [Nm].
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from clutch_hil.recordings.channel import Channel, Signal
from protocols.errors import InputError

MAGIC = b"LABLOG"
NAMES = (("time", "s"), ("pressure", "bar"), ("torque", "Nm"))  # the units of `read`
ROW = np.dtype(("<f4", len(NAMES)))


class LabLogger:
    """The format: how a file of it is recognised and opened."""

    name = "lab logger"
    keys: ClassVar[Mapping[str, type]] = {}  # no options in [file] of an import map
    order = 0  # its first bytes are unique

    def recognises(self, head: bytes, path: Path) -> bool:
        """Return whether a file that begins with `head` is of this logger."""
        return head.startswith(MAGIC)

    def open(self, path: Path, options: Mapping[str, Any]) -> "LabRecording":
        """Return the open file. Raises InputError."""
        return LabRecording(path)


class LabRecording:
    """An open file: its channels, and their values on request."""

    def __init__(self, path: Path) -> None:
        self._path = path
        size = path.stat().st_size - len(MAGIC)
        if size % ROW.itemsize:
            raise InputError(f"recording {path} ends within a row: it has {size} bytes; a row has {ROW.itemsize}")
        rows = size // ROW.itemsize
        self.channels = [
            Channel(name, number, name, unit, "table", rows, kind="time" if name == "time" else "number")
            for number, (name, unit) in enumerate(NAMES, start=1)
        ]
        self.numbers: dict[str, float] = {}
        self.notes: list[str] = []
        self.start = ""

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """Return the values of `channels`; a time axis is in seconds."""
        table = np.fromfile(self._path, ROW, offset=len(MAGIC)).astype(float)
        table[:, 0] /= 1000.0
        return [Signal(channel, table[:, channel.number - 1], table[:, 0]) for channel in channels]
