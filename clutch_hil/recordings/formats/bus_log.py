"""Bus log with a DBC: each signal a channel, named Message.Signal; each message a raster, with the times of its frames."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from clutch_hil.recordings.channel import Recording
from protocols.files.bus_logs.log_kind import find_log_kind


class BusLogFormat:
    """A log of a CAN bus; what its frames mean is in the database `dbc`, `channel` is the one to take where it has several.

    j1939: whether frames with 29 bits are of J1939, where the database does not say it.
    """

    name = "bus log"
    keys: Mapping[str, type] = {"dbc": str, "channel": str, "j1939": bool}
    order = -1  # before MDF, which a bus logger writes too

    def recognises(self, head: bytes, path: Path) -> bool:
        return bool(find_log_kind(path, head))

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        from clutch_hil.recordings.bus_recording import open_frames  # loads what decodes frames: 0.3 s

        return open_frames(path, options)
