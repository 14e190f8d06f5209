"""Changes that wait behind others for a stopped loop: each is answered while its caller still waits, and none is made later."""

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from protocols.node import Column
from protocols.realtime.mailbox import Asker, Mailbox
from protocols.realtime.ring import RingReader, RingWriter
from protocols.telemetry import publisher as module
from protocols.telemetry.feed import list_benches
from protocols.telemetry.keys import Keys
from protocols.telemetry.publisher import Publisher
from protocols.telemetry.session import open_consumer_session, open_publisher_session
from protocols.telemetry.tuning import MOST_VALUES
from tests.protocols.telemetry.benches import wait_until

BENCH = f"local:waiting@{os.getpid()}"
LATEST = 1.0  # s from the arrival of a change, instead of the 4 s of a bench
ENTRY = {"name": "x.gain", "value": 1.0, "unit": "bar", "bounds": [0.0, 10.0], "fixed": None}
COLUMNS = [Column("time_s", "s", "time"), Column("plant_clock_s", "s", "clock")]


class Stopped:
    """The telemetry process of a loop that does not turn, and a caller."""

    def __init__(self, publisher: Publisher, mailbox: Mailbox, session: zenoh.Session) -> None:
        self.publisher, self.mailbox, self._session = publisher, mailbox, session

    def ask(self, values: dict[str, float]) -> zenoh.Handler[zenoh.Reply]:
        return self._session.get(Keys(BENCH, "plant").change_by("me"), payload=json.dumps(values), timeout=10.0)


@pytest.fixture
def stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stopped]:
    for name, seconds in {"_MOST_DELAY": LATEST, "_ANSWER_TIMEOUT": 0.4 * LATEST, "_CHANGE_PERIOD": 0.01}.items():
        monkeypatch.setattr(module, name, seconds)
    about = {"node": "plant", "bench": BENCH, "rate": 100, "session": 1, "parameters": [ENTRY], "planned": []}
    ring, mailbox = RingWriter(tmp_path / "ring", COLUMNS, 10, about | {"blind": False}), Mailbox(tmp_path / "mailbox")
    with open_publisher_session() as session, open_consumer_session() as other:
        publisher = Publisher(RingReader(tmp_path / "ring"), Asker(tmp_path / "mailbox"), session)
        wait_until(lambda: BENCH in list_benches(other), "the bench")
        yield Stopped(publisher, mailbox, other)
    mailbox.close()
    ring.close()


def test_changes_behind_others_are_refused_in_time_and_never_made(stopped: Stopped) -> None:
    began = time.monotonic()
    asked = [stopped.ask({"x.gain": 2.0 + k}) for k in range(5)]
    refusals: list[str] = []
    while len(refusals) < len(asked):
        stopped.publisher.step()
        for handler in asked[len(refusals) : len(refusals) + 1]:
            if (reply := handler.try_recv()) is not None:
                assert reply.err is not None
                refusals.append(reply.err.payload.to_bytes().decode())
        assert time.monotonic() - began < 3.0 * LATEST
    assert "the service has not answered within 0.6 s" in refusals[0]
    assert "earlier changes waited for the service for 1 s; it is busy or stopped; nothing was changed" in refusals[-1]
    request = json.loads(stopped.mailbox.request())  # the loop turns again, and finds only the first
    assert request["values"] == {"x.gain": 2.0}
    assert request["until"] < time.monotonic()


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (
            {f"x.{k}": 1.0 for k in range(MOST_VALUES + 1)},
            f"a change has {MOST_VALUES + 1} values; allowed are 1 to {MOST_VALUES}",
        ),
        ({"x.gain": 235000.0}, "parameter x.gain = 235000 bar is outside 0..10; 235000 Pa would be 2.35 bar"),
    ],
)
def test_what_no_loop_can_take_is_refused_before_it(stopped: Stopped, values: dict[str, float], sentence: str) -> None:
    handler = stopped.ask(values)

    def find_refusal() -> str | None:
        stopped.publisher.step()
        reply = handler.try_recv()
        return reply.err.payload.to_bytes().decode() if reply and reply.err else None

    assert wait_until(find_refusal, "the refusal") == sentence
    assert not stopped.mailbox.has_request()
