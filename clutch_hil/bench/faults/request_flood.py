"""Request flood: a program that sends requests to the controller of a bench without waiting for the answers.

    python -m clutch_hil.bench.faults.request_flood BENCH RATE KIND [NETWORK]

The program sends RATE requests per second, alternately for a change of a parameter and for the newest row. KIND `valid` sets a
parameter to its present value; `unknown` uses parameters that do not exist, another name each time. At its end the program
prints the number of requests and the time in s. NETWORK is that of a consumer: a router, or a file of `secure`.
"""

import json
import sys
import time

from clutch_hil.bench.faults.peers import UNKNOWN
from protocols.realtime.stopping import Stop
from protocols.telemetry.feed import ask
from protocols.telemetry.keys import Keys
from protocols.telemetry.message import check_parameters
from protocols.telemetry.session import open_consumer_session

_PERIOD = 0.01  # s between bursts of requests
_ANSWER_TIMEOUT = 1.0  # s after which zenoh forgets a request that had no answer
_GAIN = "torque.integral_gain"
_MOST_WAITING = 2000  # requests that wait for answers; older ones are dropped


def flood(bench: str, rate: float, unknown: bool, network: str | None = None) -> tuple[int, float]:
    """Send `rate` requests per second [Hz] until the process is asked to end; return the number of requests, and the time [s].

    unknown: whether the names of the parameters do not exist.
    """
    with Stop() as stop, open_consumer_session(network) as session:
        keys, value = Keys(bench, "controller"), None
        while value is None and not stop.asked:
            entries = ask(session, keys.parameters, check_parameters) or []
            value = next((entry["value"] for entry in entries if entry["name"] == _GAIN), None)
            time.sleep(_PERIOD)
        began, sent, waiting = time.monotonic(), 0, []
        while not stop.asked:
            due = int((time.monotonic() - began) * rate)
            for number in range(sent, due):
                if number % 2:
                    change = json.dumps({f"nothing.number_{number}" if unknown else _GAIN: value})
                    waiting.append(session.get(keys.change_by("flood"), payload=change, timeout=_ANSWER_TIMEOUT))
                else:
                    waiting.append(session.get(keys.last, timeout=_ANSWER_TIMEOUT))
            sent, waiting = due, waiting[-_MOST_WAITING:]
            time.sleep(_PERIOD)
        return sent, time.monotonic() - began


def _run(bench: str, rate: str, kind: str, network: str | None = None) -> None:
    print(*flood(bench, float(rate), kind == UNKNOWN, network))


if __name__ == "__main__":
    _run(*sys.argv[1:])
