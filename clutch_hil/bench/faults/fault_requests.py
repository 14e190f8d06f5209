"""Fault requests: faults of the bench requested while it runs, by the same user on the same computer.

A bench listens on a Unix socket that is named by its bus and user. The name is in no folder, so a killed bench leaves nothing.
"""

import hashlib
import json
import os
import socket
import struct
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from math import inf, isfinite
from pathlib import Path
from typing import Any

from clutch_hil.bench.faults.bench_fault import BenchFault, BenchFaults
from clutch_hil.bench.faults.catalogue import PlannedHostFault
from clutch_hil.bench.faults.process_fault import ProcessFault
from protocols.errors import InputError, suggest_closest
from protocols.telemetry.keys import make_bench_name
from protocols.telemetry.message import parse_message

_MOST_BYTES = 1 << 16  # of a request, and of an answer, which may list 64 faults
_PATIENCE = 0.2  # s that a bench waits for the data of a connected process
_TIMEOUT = 5.0  # s for an answer: a bench checks every 50 ms, and a bench with a slow disk takes longer
_CREDENTIALS = struct.Struct("3i")  # struct ucred of linux/socket.h: process, user, group
_WAITING = 8  # requests that may wait

Answer = Callable[[Mapping[str, Any]], Mapping[str, Any]]


class FaultRequests:
    """Listens for requests to the bench on `bus`. Use as a context manager. Another bench of that name is not disturbed."""

    def __init__(self, bus: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)
        try:
            self._socket.bind(_make_address(bus))
            self._socket.listen(_WAITING)
        except OSError:  # another bench of the user is on this bus; faults of the scenario still work
            self._socket.close()

    def __enter__(self) -> "FaultRequests":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def answer(self, answer: Answer) -> None:
        """Answer a waiting request, if there is one. `answer` returns a document, or raises InputError."""
        if self._socket.fileno() < 0:
            return
        try:
            connection, _ = self._socket.accept()
        except OSError:
            return
        with closing(connection):
            connection.settimeout(_PATIENCE)
            try:
                connection.send(json.dumps(_find_answer(connection, answer)).encode())
            except OSError:  # the requester has gone, or sends nothing
                return


def request_fault(bus: str | None, request: Mapping[str, Any]) -> dict[str, Any]:
    """Send a request to the bench of this user on `bus`, or the only bench; return its answer. Raises InputError on refusal."""
    address = find_address(bus)
    with closing(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)) as connection:
        connection.settimeout(_TIMEOUT)
        try:
            connection.connect(address)
            if _find_user(connection) != os.getuid():
                raise OSError  # another user has taken the name
            connection.send(json.dumps(request).encode())
            reply = parse_message(connection.recv(_MOST_BYTES))
        except TimeoutError:
            raise InputError(f"the bench{f' on {bus}' if bus else ''} did not answer within {_TIMEOUT:g} s") from None
        except OSError:
            raise InputError(
                f"no clutch-hil up of this user runs{f' on bus {bus}' if bus else ''} on this computer; faults of its processes"
                " and of the computer need one"
            ) from None
    if "error" in reply:
        raise InputError(str(reply["error"]))
    answered: dict[str, Any] = reply
    return answered


def answer_request(faults: BenchFaults, request: Mapping[str, Any], end: float = inf) -> dict[str, Any]:
    """Plan, end or list faults of a running bench as requested; return what was done. Raises InputError.

    request: {"process": service, "signal": text} or {"host_fault": name, "values": {..}}, with at most one of "at" [s of the
    run] and "after" [s from now], and at most one of "until" and "for" [s]; {"end": [name, ..]}; or {} to list active faults.
    end: of the run [s].
    """
    if "end" in request:
        names = [str(name) for name in request["end"]] if isinstance(request["end"], list) else []
        return {"bus": faults.around.bus, "ended": faults.end(names)}
    if not request:
        return {"bus": faults.around.bus, "on": faults.list_on()}
    if (now := faults.now) is None:
        raise InputError("the bench has no sample yet; try again in a moment")
    times = {name: _read_time(request, name) for name in ("at", "after", "until", "for")}
    for one, other in (("at", "after"), ("until", "for")):
        if times[one] is not None and times[other] is not None:
            raise InputError(f"{one} and {other} were both given; only one of them is allowed")
    at = times["at"] if times["at"] is not None else now + (times["after"] or 0.0)
    if at < now:
        raise InputError(f"at is {at:g} s, but the run is already at {now:.3f} s; allowed are later times")
    if at >= end:
        raise InputError(f"at is {at:g} s, but the run ends at {end:g} s; allowed are earlier times")
    until = at + times["for"] if times["for"] is not None else inf if times["until"] is None else times["until"]
    if "process" in request:
        service = str(request["process"])
        if service not in faults.around.services.names:
            raise InputError(f"process is {service!r}; {suggest_closest(service, faults.around.services.names)}")
        fault: BenchFault = ProcessFault(service, str(request.get("signal", "kill")), at=at, until=until)
    else:
        values = request.get("values", {})
        if not isinstance(values, dict):
            raise InputError("values is not a table of numbers")
        fault = PlannedHostFault(str(request.get("host_fault")), values, at=at, until=until)
    faults.plan(fault)
    return {"bus": faults.around.bus, "planned": fault.what, "at": at, "until": None if until == inf else until}


def _read_time(request: Mapping[str, Any], name: str) -> float | None:
    value = request.get(name)
    if value is None:
        return None
    with suppress(OverflowError):  # a whole number of hundreds of digits
        if isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value):
            return float(value)
    raise InputError(f"{name} is {value!r}; allowed is a number of seconds")


def _find_answer(connection: socket.socket, answer: Answer) -> Mapping[str, Any]:
    asked = connection.recv(_MOST_BYTES)  # also from a user without permission: else the answer would be lost
    if (user := _find_user(connection)) != os.getuid():
        return {"error": f"user {user} may not ask for faults of a bench of user {os.getuid()}"}
    try:
        request = parse_message(asked)
        if not isinstance(request, dict):
            raise InputError("a request for a fault must be a JSON object")
        return answer(request)
    except InputError as error:
        return {"error": str(error)}


def _find_user(connection: socket.socket) -> int:
    """Return the user number of the peer."""
    content = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    user: int = _CREDENTIALS.unpack(content)[1]
    return user


def find_address(bus: str | None) -> str:
    """Return the address of the bench on `bus`, or of the only one of this user. Raises InputError for several benches."""
    if bus is not None:
        return _make_address(bus)
    lines = Path("/proc/net/unix").read_text(encoding="utf-8", errors="replace").splitlines()
    there = {line.split()[-1] for line in lines if line.split()[-1].startswith("@" + _make_prefix()[1:])}
    if len(there) > 1:
        raise InputError(f"{len(there)} benches of this user run here; give --bus")
    return "\0" + there.pop()[1:] if there else _make_address("-")


def _make_prefix() -> str:
    return f"\0clutch-hil-faults-{os.getuid()}-"


def _make_address(bus: str) -> str:
    bench = hashlib.sha256(make_bench_name(bus).encode()).hexdigest()[:32]  # a name has at most 107 bytes
    return _make_prefix() + bench
