"""Sessions of publishers and consumers in zenoh.

Peer to peer on loopback: a publisher listens on the first free port of a short range, and a consumer connects to all of them.
Benches have different keys, so several benches need no configuration. With a router both sides are its clients. With a file of
`clutch-hil secure` (lab.py) the connection is peer to peer over a network, encrypted, and certificates identify both sides.
"""

import json
from collections.abc import Mapping

import zenoh

from protocols.errors import InputError
from protocols.telemetry.lab import BENCH, Lab, read_bench_lab, read_lab

PORTS = range(7447, 7463)  # from zenoh's own port on; two for each bench: eight benches on one machine
_LOOPBACK = "tcp/127.0.0.1:{}"
_LEASE = 2000  # ms without a sign of life after which a peer counts as gone
_ROUTER_TIMEOUT = 2000  # ms to reach a router
_RETRY_PERIOD = 500  # ms between attempts to reach a publisher that has not started yet
_RETRY = {"period_init_ms": _RETRY_PERIOD, "period_max_ms": _RETRY_PERIOD, "period_increase_factor": 1.0}
_COMMON = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,  # no gain at these sizes, and a killed process would leave its segment
    "transport/link/tx/lease": _LEASE,
    "transport/unicast/open_timeout": _LEASE,  # ms; a stopped process accepts a link and never opens it, and close waits for it
    # A put waits for a slow consumer once. Then what its queue cannot take is dropped until it drains. Only the telemetry
    # process waits; so a consumer that joins late gets its history without a gap.
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 50_000,  # us
    # Replies wait so long, then the link is closed: a history is some MB, and the machine may be busy.
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 2_000_000,  # us
    "transport/link/tx/queue/size/real_time": 16,  # batches
}


def open_publisher_session(router: str | None = None) -> zenoh.Session:
    """Return a session that consumers can reach. Raises InputError.

    router: endpoint such as tcp/192.168.1.5:7447, or a lab file.
    """
    if lab := read_bench_lab(router):
        return _open_lab_publisher(lab)
    if router:
        return _open_client(router)
    for port in PORTS:
        try:
            return zenoh.open(_make_config({"mode": "peer", "listen/endpoints": [_LOOPBACK.format(port)]}))
        except zenoh.ZError:
            continue  # another service or program listens there
    raise InputError(f"no port of {PORTS.start} to {PORTS.stop - 1} on 127.0.0.1 is free for telemetry")


def open_consumer_session(router: str | None = None) -> zenoh.Session:
    """Return a session that reaches every publisher of this machine, of `router`, or of a lab file. Raises InputError."""
    if lab := read_lab(router):
        if lab.role == BENCH:
            raise InputError(f"{lab.path} is for plant and controller; allowed here are operator.json and viewer.json")
        return zenoh.open(_make_config({"connect/retry": _RETRY}, lab))
    if router:
        return _open_client(router)
    return zenoh.open(
        _make_config(
            {
                "mode": "peer",
                "listen/endpoints": [],
                "connect/endpoints": [_LOOPBACK.format(port) for port in PORTS],
                "connect/retry": _RETRY,
            }
        )
    )


def _open_client(router: str) -> zenoh.Session:
    try:
        config = {"mode": "client", "connect/endpoints": [router], "connect/timeout_ms": _ROUTER_TIMEOUT}
        return zenoh.open(_make_config(config))
    except zenoh.ZError:
        raise InputError(
            f"zenoh router {router!r} cannot be reached; an address such as tcp/192.168.1.5:7447 is needed"
        ) from None


def _open_lab_publisher(lab: Lab) -> zenoh.Session:
    endpoints = lab.settings["listen"]["endpoints"]
    for endpoint in endpoints:
        try:
            return zenoh.open(_make_config({"listen/endpoints": [endpoint]}, lab))
        except zenoh.ZError:
            continue  # another service listens there
    raise InputError(
        f"{lab.path}: none of {endpoints[0]} to {endpoints[-1]} is a free address of this machine for telemetry"
    )


def _make_config(settings: Mapping[str, object], lab: Lab | None = None) -> zenoh.Config:
    try:
        config = zenoh.Config.from_json5(json.dumps(lab.settings)) if lab else zenoh.Config()
    except zenoh.ZError:
        raise InputError(f"file {lab.path if lab else ''} is not a zenoh configuration; make it again") from None
    for key, value in {**settings, **_COMMON}.items():
        config.insert_json5(key, json.dumps(value))
    return config
