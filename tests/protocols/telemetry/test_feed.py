"""Telemetry of real services: everything comes once and in order, whoever joins or goes."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import psutil
import pyarrow as pa
import pytest
import zenoh

from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import BatchEncoder
from protocols.telemetry.feed import Feed, ask, find_bench, list_benches
from protocols.telemetry.keys import Keys, make_bench_name
from protocols.telemetry.message import check_description, check_last
from protocols.telemetry.session import open_consumer_session, open_publisher_session
from tests.processes import PATIENCE
from tests.protocols.telemetry.benches import bench, collect_batches, list_row_numbers, wait_for_bench, wait_until

BEHIND = 0.5  # s a row may need to a listener in a test; 0.003 typical, the machine is shared
STOPPED = 6.0  # s a listener is stopped: longer than the 5 s that a live feed keeps

CROWD = 2500  # requests, and events: more than wait in the channel of a feed


@pytest.fixture(scope="module")
def session() -> Iterator[zenoh.Session]:
    with open_consumer_session() as session:
        yield session


@pytest.fixture(scope="module")
def running(session: zenoh.Session) -> Iterator[str]:
    """Name of a bench that runs through the tests that do not end it."""
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="ch-") as folder:
        patch.setenv("CLUTCH_HIL_BUS_DIR", folder)
        with bench("local:shared"):
            yield wait_for_bench(session, "local:shared")


def count_rows(batches: dict, node: str = "plant") -> int:
    return sum(len(batch.rows) for batch in batches[node])


def test_a_late_joiner_gets_the_history_and_what_comes_each_row_once(running: str, session: zenoh.Session) -> None:
    with Feed(session, running, live=False) as early:
        first = collect_batches(early, lambda batches: count_rows(batches) > 3000)
    with Feed(session, running, live=True) as late:
        batches = collect_batches(
            late, lambda batches: min(count_rows(batches), count_rows(batches, "controller")) > 5000
        )
        assert late.lost == {"plant": 0, "controller": 0}
        assert late.alive == {"plant": True, "controller": True}
    for node in ("plant", "controller"):
        numbers = list_row_numbers(batches[node])
        np.testing.assert_array_equal(numbers, np.arange(len(numbers)))  # from the very first row on
        old = np.concatenate([batch.rows for batch in first[node]])
        new = np.concatenate([batch.rows for batch in batches[node]])
        assert old.tobytes() == new[: len(old)].tobytes()
    newest = batches["controller"][-1]
    assert time.monotonic() - newest["controller_clock_s"][-1] < BEHIND


def test_a_rows_time_is_the_time_of_day(running: str, session: zenoh.Session) -> None:
    with Feed(session, running, live=True) as feed:
        collect_batches(feed, count_rows)
        newest = collect_batches(feed, count_rows)["plant"][-1]
        assert 0.0 < time.time() - (newest["plant_clock_s"][-1] + newest.epoch) < BEHIND
        assert np.diff(newest["time_s"]) == pytest.approx(1e-3)


def test_history_ends_after_thirty_seconds(tmp_path: Path) -> None:
    """A ring filled at once stands for a long run: what is older than 30 s at its rate is not kept."""
    from protocols.realtime.mailbox import Asker, Mailbox
    from protocols.realtime.ring import RingReader, RingWriter
    from protocols.telemetry.publisher import HISTORY, Publisher

    rate = 100
    about = {"node": "plant", "bench": f"test@{os.getpid()}", "rate": rate, "session": 1, "parameters": []}
    about |= {"planned": [], "blind": False}
    ring = RingWriter(
        tmp_path / "ring", [Column("time_s", "s", "time"), Column("plant_clock_s", "s", "clock")], 1000, about
    )
    Mailbox(tmp_path / "mailbox")
    with open_publisher_session() as session:
        publisher = Publisher(RingReader(tmp_path / "ring"), Asker(tmp_path / "mailbox"), session)
        for row in range(5000):
            ring.write((row / rate, row / rate))
            if row % 50 == 49:
                publisher.step()
        with open_consumer_session() as other, ExitStack() as stack:
            wait_until(lambda: about["bench"] in list_benches(other), "the bench")
            feed = stack.enter_context(Feed(other, str(about["bench"]), live=True))
            batches = []
            deadline = time.monotonic() + PATIENCE
            answering = stack.enter_context(_Stepping(publisher, ring, rate))
            while not batches:
                assert time.monotonic() < deadline
                batches = feed.read(0.1)
            answering.stop()
            numbers = list_row_numbers(batches)
            assert (np.diff(numbers) == 1).all()
            assert HISTORY * rate <= 5000 - numbers[0] <= (HISTORY + 1.0) * rate


class _Stepping:
    """Steps a publisher in a thread, with a new row now and then."""

    def __init__(self, publisher, ring, rate: int) -> None:
        import threading

        self._go, self._publisher, self._ring, self._rate = True, publisher, ring, rate
        self._thread = threading.Thread(target=self._turn)

    def __enter__(self) -> "_Stepping":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        self._go = False
        self._thread.join()

    def _turn(self) -> None:
        row = 5000
        while self._go:
            self._ring.write((row / self._rate, row / self._rate))
            row += 1
            self._publisher.step()
            time.sleep(0.01)


LISTENER = """
import sys, json
from protocols.telemetry.message import check_description, check_last
from protocols.telemetry.session import open_consumer_session
from protocols.telemetry.feed import Feed
with open_consumer_session() as session, Feed(session, sys.argv[1], live=True) as feed:
    rows = end = 0
    for line in sys.stdin:  # each line asks for what has come so far
        for batch in feed.read(2.0):
            if batch.node == "plant":
                rows, end = rows + len(batch.rows), batch.end
        print(json.dumps([rows, feed.lost.get("plant"), end]), flush=True)
"""


def test_what_a_stopped_listener_misses_is_counted_and_others_miss_nothing(
    running: str, session: zenoh.Session, tmp_path: Path
) -> None:
    script = tmp_path / "listener.py"
    script.write_text(LISTENER)
    process = subprocess.Popen(
        [sys.executable, str(script), running], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )

    def sentence() -> tuple[int, int, int]:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write("\n")
        process.stdin.flush()
        return tuple(json.loads(process.stdout.readline()))

    try:
        with Feed(session, running, live=False) as other:
            wait_until(lambda: sentence()[0], "rows at the listener")
            received, lost, end = sentence()
            start = end - received  # older than the history
            assert lost == 0
            process.send_signal(signal.SIGSTOP)
            collect_batches(other, lambda batches: batches["plant"] and batches["plant"][-1].end > end + STOPPED * 1000)
            process.send_signal(signal.SIGCONT)
            wait_until(lambda: sentence()[1], "the listener's losses")
            received, lost, end = sentence()
            assert received + lost == end - start  # every row came or was counted
            assert other.lost == {"plant": 0, "controller": 0}
    finally:
        process.kill()
        process.wait()


def test_the_last_rows_are_published_before_a_service_ends(local_bus: str, session: zenoh.Session) -> None:
    with bench(local_bus) as services:
        with Feed(session, wait_for_bench(session, local_bus), live=False) as feed:
            batches = collect_batches(feed, lambda batches: count_rows(batches) > 1000)
            for process in services.values():
                process.terminate()
            while any(feed.alive.values()):
                for batch in feed.read(0.05):
                    batches[batch.node].append(batch)
        out, _ = services["plant"].communicate(timeout=PATIENCE)
        assert f"plant stopped after {count_rows(batches)} samples" in out
        assert (np.diff(list_row_numbers(batches["plant"])) == 1).all()


def test_a_killed_service_is_no_longer_alive_and_leaves_nothing(local_bus: str, session: zenoh.Session) -> None:
    with bench(local_bus) as services, Feed(session, wait_for_bench(session, local_bus), live=True) as feed:
        collect_batches(feed, count_rows)
        for node in ("controller", "plant"):
            child = psutil.Process(services[node].pid).children()[0]  # its telemetry process
            ring = child.cmdline()[4]
            assert Path(ring).exists()
            assert feed.alive[node]
            services[node].kill()
            wait_until(lambda node=node: feed.read(0.01) is None or not feed.alive[node], "the token to go")
            wait_until(lambda child=child: not child.is_running(), "the telemetry process to end")
            assert not Path(ring).parent.exists()


def test_last_values_and_description_for_any_zenoh_program(running: str, session: zenoh.Session) -> None:
    keys = Keys(running, "controller")
    last = wait_until(
        lambda: (answer := ask(session, keys.last, check_last)) and answer["row"] > 100 and answer, "rows"
    )
    assert last["values"]["controller_pressure_bar"]["unit"] == "bar"
    assert isinstance(last["values"]["controller_pressure_bar"]["value"], float)
    described = ask(session, keys.describe, check_description)
    assert described["rate"] == 1000
    assert {column["name"] for column in described["columns"]} == set(last["values"])
    assert all(column["unit"] and column["meaning"] for column in described["columns"])
    subscriber = session.declare_subscriber(keys.record, zenoh.handlers.FifoChannel(10))
    sample = subscriber.recv()
    assert str(sample.encoding) == "application/vnd.apache.arrow.stream"
    assert pa.ipc.open_stream(sample.payload.to_bytes()).read_all().num_columns == len(last["values"])


@pytest.mark.parametrize(
    ("key", "payload"),
    [
        ("parameters", b"\xff"),
        ("parameters", b"junk"),
        ("parameters", b"[1]"),
        ("parameters", b"{}"),
        ("change/somebody", b"\xff"),
        ("change/somebody", b"[1]"),
        ("change/somebody", b"{}"),
        ("change/somebody", b'{"demand": 1}'),
        ("change/somebody", b'{"demand": "a\\nb"}'),
        ("change/some body", b'{"demand": "10 Nm"}'),
        ("change/*", b'{"demand": "10 Nm"}'),
        ("history", None),
    ],
)
def test_a_bad_question_gets_an_error_and_the_telemetry_goes_on(
    running: str, session: zenoh.Session, key: str, payload: bytes | None
) -> None:
    keys = Keys(running, "plant")
    replies = list(session.get(f"clutch-hil/{running}/plant/{key}?from=junk", payload=payload, timeout=PATIENCE))
    assert [reply.ok for reply in replies] == [None]
    assert replies[0].err.payload.to_string()
    assert ask(session, keys.last, check_last)["row"] > 0


def test_through_a_router(local_bus: str) -> None:
    config = zenoh.Config()
    for key, value in {"mode": "router", "listen/endpoints": ["tcp/127.0.0.1:17447"]}.items():
        config.insert_json5(key, json.dumps(value))
    config.insert_json5("scouting/multicast/enabled", "false")
    router = "tcp/127.0.0.1:17447"
    with zenoh.open(config), bench(local_bus, "--router", router), open_consumer_session(router) as session:
        with Feed(session, wait_for_bench(session, local_bus), live=True) as feed:
            batches = collect_batches(
                feed, lambda batches: count_rows(batches) > 500 and count_rows(batches, "controller") > 500
            )
        assert list_row_numbers(batches["plant"])[0] == 0
        with open_consumer_session() as elsewhere:
            assert make_bench_name(local_bus) not in list_benches(elsewhere)


def test_without_telemetry_nothing_is_published(local_bus: str, session: zenoh.Session) -> None:
    with bench(local_bus, "--no-telemetry"):
        time.sleep(2.0)
        with pytest.raises(InputError, match=f"no bench on {local_bus} publishes telemetry"):
            find_bench(session, local_bus)


def test_several_benches_must_be_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, running: str, session: zenoh.Session
) -> None:
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", str(tmp_path))
    with bench("local:two"):
        two = wait_for_bench(session, "local:two")
        assert two != running
        with pytest.raises(InputError, match=r"\d+ benches run: .*choose one with --bus"):
            find_bench(session)
        with Feed(session, two, live=True) as feed:
            batches = collect_batches(feed, lambda batches: count_rows(batches) > 100)
        assert feed.bench == two
        assert (np.diff(list_row_numbers(batches["plant"])) == 1).all()


def test_a_router_that_is_not_there_is_one_sentence() -> None:
    with pytest.raises(InputError, match=r"zenoh router 'tcp/127\.0\.0\.1:9' cannot be reached"):
        open_consumer_session("tcp/127.0.0.1:9")


def test_rubbish_under_the_keys_of_a_bench_is_counted_and_harms_nothing(running: str, session: zenoh.Session) -> None:
    """Another program publishes what is no telemetry, or none of this bench; the listeners go on, and lose no row."""
    described = ask(session, Keys(running, "plant").describe, check_description)
    assert described
    columns = [Column(**column) for column in described["columns"]]
    rows = np.zeros((20, len(columns)))

    def bogus(number: int, ahead: int = 0, width: int = 0) -> bytes:
        newest = ask(session, Keys(running, "plant").last, check_last)
        assert newest
        encoder = BatchEncoder("plant", number, 1000.0, 0.0, columns[: len(columns) - width])
        return encoder.encode(newest["row"] + ahead, rows[:, : len(columns) - width], 0)

    own = described["session"]
    records = [
        b"", b"junk", b"\0" * 1000, bogus(own + 1), bogus(own + 1), bogus(own, ahead=10_000), bogus(own, ahead=2**50),
        bogus(own, width=1), BatchEncoder("controller", own, 1000.0, 0.0, columns).encode(0, rows, 0),
    ]  # fmt: skip
    events = [b"", b"null", b"[]", b"{}", b'{"node": 1}', b"[" * 50_000, b"1" * 5000, b'{"time": "now"}']
    with Feed(session, running, live=False) as feed:
        batches = collect_batches(feed, lambda batches: count_rows(batches) > 100)
        for payload in records:
            session.put(Keys(running, "plant").record, payload)
        for payload in events:
            session.put(Keys(running, "plant").event, payload)
        session.put(Keys(running, "nobody").record, records[3])
        end = count_rows(batches) + 3000
        later = collect_batches(
            feed, lambda batches: count_rows(batches) > end and count_rows(batches, "controller") > 3000
        )
        assert feed.take_events() == []
        assert feed.rejected == {"plant": len(records) + len(events), "others": 1}
        assert feed.rejections.startswith(
            f"{len(records) + len(events) + 1} messages were rejected, the first because "
        )
        assert not any(feed.lost.values())
        for node in ("plant", "controller"):
            numbers = list_row_numbers([*batches[node], *later[node]])
            np.testing.assert_array_equal(numbers, np.arange(len(numbers)) + numbers[0])


def test_more_requests_and_events_than_wait_hold_up_no_row(session: zenoh.Session) -> None:
    """A reader of rows alone never asks for requests: they must not fill the session that brings the rows."""
    name = f"local:crowded@{os.getpid()}"
    keys = Keys(name, "plant")
    with open_publisher_session() as other, Feed(session, name, live=True) as feed:
        wait_until(lambda: other.put(keys.record, b"") or feed.read(0.05) or feed.rejected.total(), "a message")
        for number in range(CROWD):
            request = {"node": "plant", "kind": "tune", "by": "somebody", "time": 1.0, "row": number}
            other.put(keys.request, json.dumps(request))
            event = {"node": "plant", "name": "x", "unit": "1", "old": 0.0, "new": 1.0, "time": 1.0, "row": number}
            other.put(keys.event, json.dumps(event))
            if number % 100 == 0:
                feed.read(0.01)
        before = feed.rejected.total()
        other.put(keys.record, b"")
        wait_until(lambda: feed.read(0.05) or feed.rejected.total() > before, "the record after them")
        assert [request["row"] for request in feed.read_requests()] == list(range(CROWD))
        assert [event["row"] for event in feed.take_events()] == list(range(CROWD))
        assert feed.take_events() == []
