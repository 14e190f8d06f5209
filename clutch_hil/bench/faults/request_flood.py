"""Request flood: a program that sends requests to the controller of a bench, and does not wait for the answers.

    python -m clutch_hil.bench.faults.request_flood BENCH RATE KIND [NETWORK]

asks RATE times a second, in turn, for a change of a parameter and for the newest row. KIND `valid` changes a parameter to the
value that it has, `unknown` one that there is not, another name each time. When it is asked to end it prints how many requests
it sent, and in how many s. NETWORK is that of a consumer: a router, or a file of `secure`.
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
_MOST_WAITING = 2000  # requests whose answers are waited for; older ones are dropped


def flood(bench: str, rate: float, unknown: bool, network: str | None = None) -> tuple[int, float]:
    """Ask `rate` times a second [Hz] until the process is asked to end; return the number of requests, and the time [s].

    unknown: whether the parameters have names that nobody knows.
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
