"""Log of a demand: report the user and the demand to the controller's telemetry. The CAN bus itself carries no names.

A demand needs no telemetry: if it cannot be logged, it is still made, and the command reports this.
"""

import json
from contextlib import ExitStack

import zenoh

from clutch_hil.live.tuning.tune import read_reply
from protocols.errors import InputError
from protocols.telemetry.feed import find_bench
from protocols.telemetry.keys import Keys
from protocols.telemetry.lab import find_asker_name
from protocols.telemetry.session import open_consumer_session

_TIMEOUT = 3.0  # s for the controller to log the demand; its publisher gives up after 2 s


class DemandLog:
    """Connection to the telemetry of the bench on `bus`. Use as a context manager, entered before anything is demanded.

    network: see `open_consumer_session`. Raises InputError for a network file that cannot be used.
    """

    def __init__(self, bus: str, network: str | None) -> None:
        self._bus, self._network, self._by = bus, network, find_asker_name(network)
        self._handler: zenoh.handlers.Handler[zenoh.Reply] | None = None
        self._bench = self._reason = ""

    def __enter__(self) -> "DemandLog":
        with ExitStack() as stack:
            self._session = stack.enter_context(open_consumer_session(self._network))
            try:
                self._bench = find_bench(self._session, self._bus, self._network)
            except InputError as error:
                self._reason = str(error)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def send(self, demand: str) -> None:
        """Send a `demand` to the controller's log; do not wait for the answer."""
        if self._bench:
            key = Keys(self._bench, "controller").change_by(self._by)
            self._handler = self._session.get(key, payload=json.dumps({"demand": demand}), timeout=_TIMEOUT)

    def describe_outcome(self) -> str:
        """Wait for the answer; return whether the demand was logged, and under which name, or why not."""
        try:
            if self._handler is None:
                raise InputError(self._reason)
            read_reply(self._bench, "controller", self._handler)
        except InputError as error:
            return f"not logged: {error}"
        return f"logged:  by the controller, as demanded by {self._by}"
