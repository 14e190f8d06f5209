"""Keys of a bench's telemetry in zenoh. A bench is named BUS@HOST, its nodes are `plant`, `controller` and `controller_b`.

| key after `clutch-hil/BENCH/NODE/` | kind | payload |
|---|---|---|
| `alive` | liveliness | token: the service lives |
| `record` | put | Arrow IPC stream (batch.py): every row, in order; DROP, REAL_TIME |
| `history` | queryable | such batches of the last 30 s, oldest first; `?from=ROW;to=ROW` for a part |
| `last` | queryable | JSON, the newest row: {"row": n, "values": {column: {"value": x, "unit": u}}} |
| `describe` | queryable | JSON: columns with unit and meaning, rate, session, versions; of the plant its rig and controllers |
| `parameters` | queryable | JSON: all of them |
| `change/NAME` | queryable | JSON payload {name: value}: set, all or none; with WHEN: inject; {"demand": text}: log a demand |
| `event` | put | JSON: a parameter was changed; of an injection, that it is accepted, has started, has ended |
| `events` | queryable | JSON: the events so far, the newest 10 000 |
| `request` | put | JSON: a change or a demand that was accepted, with who asked and when |
| `requests` | queryable | JSON: the requests so far, the newest 10 000 |

WHEN is the payload {"values": {name: value}} with at most one of "at" [s of the node's time] and "after" [s from now], "ramp"
[s], and at most one of "until" [s of the node's time] and "for" [s from the ramp's end], when the parameters return to their
old values. An event of an injection has "injection": "accepted", "started" or "ended"; its "row" is the first with the change.
"time" is the time of day [s, UNIX], "clock_s" CLOCK_MONOTONIC [s], which nobody sets. So is the "epoch_s" of a description, the
present sum to add to it for the time of day.
NAME is who asks. On a network with certificates it must be the name in the certificate, and a request has "checked": true.
"""

import os
import socket
import zlib
from typing import NamedTuple

PREFIX = "clutch-hil"
NODES = ("plant", "controller")


class Keys(NamedTuple):
    """Keys of one node of one bench, as attributes (LEAVES); `*` as a name means any."""

    bench: str
    node: str

    def __getattr__(self, name: str) -> str:
        if name not in LEAVES:
            raise AttributeError(name)
        return f"{PREFIX}/{self.bench}/{self.node}/{name}"

    def change_by(self, name: str) -> str:
        """Return the key under which `name` requests a change; `*` matches any name."""
        return f"{self.change}/{name}"


LEAVES = (
    "alive", "record", "history", "last", "describe", "parameters", "change", "event", "events", "request", "requests",
)  # fmt: skip


def parse_key(key: str) -> Keys:
    """Return the bench and node of a key."""
    _, bench, node, _ = key.split("/")
    return Keys(bench, node)


def make_bench_name(bus: str) -> str:
    """Return the name of the bench on `bus` of this machine.

    A local bus in another folder (CLUTCH_HIL_BUS_DIR) is another bench.
    """
    folder = os.environ.get("CLUTCH_HIL_BUS_DIR")
    elsewhere = f"~{zlib.crc32(folder.encode()):08x}" if folder and bus.startswith("local:") else ""
    return f"{bus}{elsewhere}@{socket.gethostname()}"


def find_bus(bench: str) -> str:
    """Return the bus in a bench's name."""
    return bench.rpartition("@")[0]
