"""Faults by other programs in the network of the telemetry: a flood of requests, and a peer that sends rubbish."""

import subprocess
from collections.abc import Callable, Mapping

from clutch_hil.bench.faults.bench_fault import Surroundings
from clutch_hil.bench.faults.host_fault import SOURCE, HostFault
from plant_sim.effects.effect import Shape
from protocols.errors import InputError
from protocols.realtime.child import end_child, list_module_command, spawn
from protocols.telemetry.keys import make_bench_name

VALID, UNKNOWN = "valid", "unknown"  # kinds of requests in a flood
_ENDING = 2.0  # s for a peer to end after the request


class NetworkFault(HostFault):
    """A fault that needs a bench with telemetry."""

    @classmethod
    def check(cls, bus: str, telemetry: bool) -> None:
        """See `HostFault`."""
        if not telemetry:
            raise InputError(f"{cls.name} needs telemetry, but --no-telemetry was given; leave one of them out")


class RequestFlood(NetworkFault):
    """A program sends so many requests a second to the controller, valid or for names that are unknown, from about 1 s on."""

    name = "request_flood"
    parameters = (Shape("rate", "Hz", 1300.0, (1.0, 10_000.0), SOURCE), Shape("unknown", "1", 0.0, (0.0, 1.0), SOURCE))

    @classmethod
    def begin(cls, around: Surroundings, values: Mapping[str, float]) -> Callable[[], None]:
        """See `HostFault`."""
        return _start("request_flood", around, f"{values['rate']:g}", UNKNOWN if values["unknown"] >= 0.5 else VALID)


class RubbishPeer(NetworkFault):
    """A program publishes so many damaged messages a second in the name of the bench, from about 1 s on."""

    name = "rubbish_peer"
    parameters = (Shape("rate", "Hz", 50.0, (1.0, 1000.0), SOURCE), Shape("seed", "1", 1.0, (0.0, 1e6), SOURCE))

    @classmethod
    def begin(cls, around: Surroundings, values: Mapping[str, float]) -> Callable[[], None]:
        """See `HostFault`."""
        return _start("rubbish_peer", around, f"{values['rate']:g}", f"{values['seed']:.0f}")


def _start(program: str, around: Surroundings, *arguments: str) -> Callable[[], None]:
    """Start a program of this package against the bench; return a function that ends it."""
    network = [around.router] if around.router else []
    words = [make_bench_name(around.bus), *arguments, *network]
    peer = spawn(list_module_command(f"{__package__}.{program}", *words), subprocess.DEVNULL)
    return lambda: end_child(peer, _ENDING)


FAULTS = RequestFlood, RubbishPeer
