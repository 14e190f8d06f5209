"""Sessions of publishers and consumers in zenoh.

Peer to peer on loopback: a publisher listens on the first free port of a short range, and a consumer connects to all of them.
Benches differ by their keys, so several benches need no configuration. With a router both sides are its clients.
"""

import json

import zenoh

from protocols.errors import InputError

PORTS = range(7447, 7463)  # from zenoh's own port on; two for each bench: eight benches on one machine
_LOOPBACK = "tcp/127.0.0.1:{}"
_LEASE = 2000  # ms without a sign of life after which a peer counts as gone
_ROUTER_TIMEOUT = 2000  # ms to reach a router
_RETRY_PERIOD = 500  # ms between attempts to reach a publisher that is not there yet
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
    """A session that consumers can reach; router: endpoint such as tcp/192.168.1.5:7447. Raises InputError."""
    if router:
        return _open_client(router)
    for port in PORTS:
        try:
            return zenoh.open(_make_config({"mode": "peer", "listen/endpoints": [_LOOPBACK.format(port)]}))
        except zenoh.ZError:
            continue  # another service or program listens there
    raise InputError(f"no port of {PORTS.start} to {PORTS.stop - 1} on 127.0.0.1 is free for telemetry")


def open_consumer_session(router: str | None = None) -> zenoh.Session:
    """A session that reaches every publisher of this machine, or of `router`. Raises InputError."""
    if router:
        return _open_client(router)
    return zenoh.open(
        _make_config(
            {
                "mode": "peer",
                "listen/endpoints": [],
                "connect/endpoints": [_LOOPBACK.format(port) for port in PORTS],
                "connect/retry": {
                    "period_init_ms": _RETRY_PERIOD,
                    "period_max_ms": _RETRY_PERIOD,
                    "period_increase_factor": 1.0,
                },
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


def _make_config(settings: dict[str, object]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in (settings | _COMMON).items():
        config.insert_json5(key, json.dumps(value))
    return config
