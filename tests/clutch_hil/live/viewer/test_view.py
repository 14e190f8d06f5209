"""The live view: real viewer processes, real files, a bench whose rows are known."""

import os
import signal
import socket
import time
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import psutil
import pytest

from clutch_hil.live.viewer.graphics import MISSING
from clutch_hil.live.viewer.rrd_reader import read_rrd
from clutch_hil.live.viewer.stream import ViewerStream
from clutch_hil.live.viewer.view import Watch
from clutch_hil.live.viewer.viewer import WebViewer
from protocols.errors import InputError
from protocols.node import Column
from protocols.realtime.notify import NoNotifier
from protocols.realtime.stopping import Stop
from protocols.telemetry.batch import Batch
from tests.clutch_hil.live.fake_bench import FakeBench
from tests.clutch_hil.live.viewer import chromium
from tests.clutch_hil.live.viewer.viewing import (
    NO_DISPLAY,
    View,
    connect_to_viewer,
    count_colours,
    find_newest,
    find_refusal,
    find_refusal_of_process,
    free_port,
    make_shown_condition,
    read_reply,
    wait_until,
)
from tests.processes import PATIENCE
from tests.protocols.telemetry.benches import bench
from tests.stopwatch import Stopwatch

LOOKS = 3  # at the age of the newest row, which is told and not judged: two cores are shared with a software renderer
RATE = 250  # Hz: at 1 kHz that renderer needs seconds a picture beside other tests, and is seldom free to answer
COLOURS = 200  # in a picture with plots; an empty viewer has less than 60
PUT = 0.05  # s; a put is a few us
STOPPED = 5.0  # s of a stopped viewer: enough for everything between us and it to be full


@pytest.fixture
def bus() -> str:
    """The name of a bus that no other bench on this machine has."""
    return f"local:view{os.getpid()}"


@pytest.mark.needs("vulkan")
def test_a_viewer_shows_the_running_bench(bus: str, tmp_path: Path) -> None:
    port = free_port()
    with bench(bus, "--rate", str(RATE)), View("--bus", bus, "--headless", "--port", port) as view:
        client = connect_to_viewer(port)
        state = wait_until(make_shown_condition(client, "time"), "rows in the viewer")
        first = find_newest(state, "time")
        wait_until(lambda: find_newest(read_reply(client.get_state), "time") > first + 1e9, "a second of rows")
        ages = np.array([_measure_ages(client) for _ in range(LOOKS)]) * 1e3
        for name, age in zip(("at least", "at most"), ages.T, strict=True):
            message = "p50 {:.0f}, p99 {:.0f}, max {:.0f} ms".format(*np.percentile(age, [50, 99, 100]))
            print(f"from cycle to viewer {name}: {message}")
        state = read_reply(client.get_state)
        assert [view.name for view in state.views if view.reports] == []
        picture = read_reply(client.take_screenshot)
        (tmp_path / "viewer.png").write_bytes(picture)
        assert count_colours(picture) > COLOURS
        assert view.end() == 0
    assert "verdict: nothing lost" in view.output


def _measure_ages(client: Any) -> tuple[float, float]:
    """Of the newest row [s], when we asked the viewer and when it had answered: it looked in between."""
    before = time.time()
    end = find_newest(read_reply(client.get_state), "time") / 1e9
    return before - end, time.time() - end


@pytest.mark.needs("vulkan")
def test_a_stopped_viewer_does_not_disturb_the_file(bus: str, tmp_path: Path) -> None:
    file = tmp_path / "run.rrd"
    with FakeBench(bus) as bench, View("--bus", bus, "--headless", "--save", file) as view:
        view.find_line("bench")
        viewer = view.find_viewer()
        wait_until((tmp_path / "run.rrd.part").exists, "the file's first rows")
        viewer.suspend()
        time.sleep(STOPPED)
        assert view.end() in (0, 1)  # 1 when the viewer, which never went on, has missed rows
    assert f"wrote:   {file}" in view.output
    for node, table in read_rrd(file).items():
        assert len(table.row) > STOPPED * bench.rate
        assert (np.diff(table.row) == 1).all()
        expected = bench.list_published(node, table.row[0], table.row[-1] + 1)
        assert np.array_equal(table.rows, expected), f"{node}: the file has other values than were published"
    assert not (tmp_path / "run.rrd.part").exists()


@pytest.mark.needs("vulkan")
def test_a_killed_viewer_ends_the_view_with_a_word(bus: str) -> None:
    with FakeBench(bus), View("--bus", bus, "--headless") as view:
        view.find_line("bench")
        view.find_viewer().kill()
        assert view.end(None) == 1
    assert "verdict: the viewer was killed by SIGKILL" in view.output


@pytest.mark.needs("vulkan")
def test_a_killed_viewer_does_not_end_the_file(bus: str, tmp_path: Path) -> None:
    file = tmp_path / "run.rrd"
    with FakeBench(bus), View("--bus", bus, "--headless", "--save", file) as view:
        view.find_line("bench")
        view.find_viewer().kill()
        view.find_line("the viewer has ended")
        size = (tmp_path / "run.rrd.part").stat().st_size
        wait_until(lambda: (tmp_path / "run.rrd.part").stat().st_size > size, "more rows in the file")
        assert view.end(signal.SIGINT) == 1
    assert set(read_rrd(file)) == {"plant", "controller"}


def test_a_view_waits_for_its_bench_and_follows_it_through_a_restart(bus: str, tmp_path: Path) -> None:
    file = tmp_path / "run.rrd"
    with View("--bus", bus, "--save", file) as view:
        view.find_line("waiting for a bench")
        with FakeBench(bus, session=1) as first:
            view.find_line("bench")
            wait_until((tmp_path / "run.rrd.part").exists, "the file")
            wait_until(lambda: first.published > 3000, "three seconds of the first bench")
        with FakeBench(bus, session=2) as second:
            wait_until(lambda: second.published > 3000, "three seconds of the second bench")
            part = tmp_path / "run.rrd.part"
            wait_until(lambda: 2 in _list_sessions(part), "the second bench in the file")
        assert view.end() == 0
    assert "started 2 times" in view.output
    assert {batch.session for batch in read_rrd(file)["plant"].make_batches()} == {1, 2}


def _list_sessions(part: Path) -> set[int]:
    """Sessions of the plant in a file that is being written; none while a batch is written in part."""
    try:
        return {batch.session for batch in read_rrd(part)["plant"].make_batches()}
    except InputError:
        return set()


def _make_batch(first: int, count: int) -> Batch:
    columns = (Column("time_s", "s", ""), Column("valve_voltage_v", "V", ""))
    values = np.tile(np.arange(first, first + count)[:, None] / 1000.0, 2)
    return Batch("plant", 1, first, 1000.0, 0.0, 0, columns, values)


def _put_until(stream: ViewerStream, begin: int, seconds: float) -> int:
    """Put a thousand rows every 10 ms; return the number of the next row. No put may wait."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        batch = _make_batch(begin, 1000)
        watch = Stopwatch()
        stream.put([batch])
        assert watch.read_seconds() < PUT
        begin += 1000
        time.sleep(0.01)
    return begin


def test_a_stopped_viewer_costs_only_rows_that_are_counted() -> None:
    from clutch_hil.live.viewer.blueprint import build_blueprint

    with (
        WebViewer(free_port(), None, "64MB", browser=False) as viewer,
        ViewerStream(viewer.url, "test", build_blueprint(), limit=2_000_000) as stream,
    ):
        row = _put_until(stream, 0, 1.0)
        wait_until(lambda: stream.sent["plant"] == row, "the viewer to take everything")
        psutil.Process(viewer.pid).suspend()
        row = _put_until(stream, row, STOPPED)
        assert stream.dropped["plant"] > 0
        psutil.Process(viewer.pid).resume()
        wait_until(lambda: stream.sent["plant"] + stream.dropped["plant"] == row, "the viewer to catch up")
        dropped = stream.dropped["plant"]
        row = _put_until(stream, row, 0.5)
        wait_until(lambda: stream.sent["plant"] + stream.dropped["plant"] == row, "the last rows")
        assert stream.dropped["plant"] == dropped


def test_an_error_of_the_stream_ends_the_view(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of rows that rerun cannot take; without it the screen would stand still, and the view go on."""
    from clutch_hil.live.viewer.blueprint import build_blueprint

    def fail(*_: object) -> None:
        raise ValueError("such rows cannot be drawn")

    monkeypatch.setattr("clutch_hil.live.viewer.stream.make_recording", fail)
    with (
        Stop() as stop,
        ViewerStream("rerun+http://127.0.0.1:1/proxy", "test", build_blueprint()) as stream,
        pytest.raises(ValueError, match="such rows cannot be drawn"),
    ):
        _watch_to_end(Watch(stop, PATIENCE, NoNotifier()), stream)


def _watch_to_end(watch: Watch, stream: ViewerStream) -> None:
    while not watch.is_over:
        watch.wait(stream)


def test_a_stream_finds_a_viewer_that_was_started_again() -> None:
    from clutch_hil.live.viewer.blueprint import build_blueprint

    port = free_port()
    with WebViewer(port, None, "64MB", browser=False) as viewer:
        stream = ViewerStream(viewer.url, "test", build_blueprint())
        with stream:
            row = _put_until(stream, 0, 0.5)
            wait_until(lambda: stream.sent["plant"] == row, "the viewer to take everything")
            viewer.__exit__()
            row = _put_until(stream, row, 1.0)
            with WebViewer(port, None, "64MB", browser=False):
                sent = stream.sent["plant"]
                wait_until(
                    lambda: stream.put([_make_batch(row, 1000)]) or stream.sent["plant"] > sent,
                    "rows in the new viewer",
                )


@pytest.mark.needs("chromium")
def test_a_browser_shows_the_running_bench_and_asks_nobody_else(bus: str, tmp_path: Path) -> None:
    with FakeBench(bus), View("--bus", bus, "--web", "--no-open") as view:
        page = view.find_line("open").removeprefix("open ")
        with chromium.Chromium(1200, 700) as browser:
            browser.open(f"{page}&renderer=webgl")
            picture = wait_until(
                lambda: count_colours(shot := browser.take_picture()) > COLOURS and shot, "plots on the page"
            )
            (tmp_path / "page.png").write_bytes(picture)
            wait_until(lambda: browser.take_picture() != picture, "the page to move")
            asked = {request.split("/")[2] for request in browser.requests if request.startswith("http")}
        assert {address.split(":")[0] for address in asked} == {"127.0.0.1"}
        assert view.end() == 0


@pytest.mark.needs("chromium")
def test_beyond_loopback_a_browser_needs_the_token(bus: str, tmp_path: Path) -> None:
    """127.0.0.2 stands for an address of the network: it is another one than 127.0.0.1, and every Linux has it."""
    with FakeBench(bus), View("--bus", bus, "--web", "--no-open", "--address", "127.0.0.2") as view:
        page = view.find_line("open").removeprefix("open ")
        place = page.partition("?")[0]
        assert place.startswith("http://127.0.0.2:")
        method = f"{place}rerun.sdk_comms.v1alpha1.MessageProxyService/ReadMessages"
        for url, data in (
            (place, None),
            (f"{place}?token=wrong", None),
            (f"{place}re_viewer_bg.wasm", None),
            (method, b""),
        ):
            with pytest.raises(HTTPError, match="403"):
                urlopen(Request(url, data, {"Cookie": "clutch_hil_token=wrong"}), timeout=PATIENCE)
        with chromium.Chromium(1200, 700) as browser:
            browser.open(f"{page}&renderer=webgl")
            picture = wait_until(
                lambda: count_colours(shot := browser.take_picture()) > COLOURS and shot, "plots on the page"
            )
            (tmp_path / "page.png").write_bytes(picture)
            asked = {request.split("/")[2] for request in browser.requests if request.startswith("http")}
        assert asked == {place.split("/")[2]}  # the data come by the same way, none past the token
        assert view.end() == 0


def test_without_a_vulkan_driver_a_view_says_what_brings_one(bus: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):  # of Vulkan's loader, the second of an old one
        monkeypatch.setitem(NO_DISPLAY, variable, "/nowhere.json")
    with FakeBench(bus):
        assert find_refusal_of_process("--bus", bus, "--headless") == f"error: {MISSING}"


def test_without_a_display_a_view_says_what_else_there_is() -> None:
    expected_text = find_refusal_of_process()
    assert "the viewer has no display" in expected_text
    assert all(way in expected_text for way in ("--web", "--save FILE.rrd", "clutch-hil monitor"))


def test_a_port_that_is_taken_is_refused() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert find_refusal_of_process("--headless", "--port", port).startswith(
            f"error: port {port} on 127.0.0.1 is in use"
        )


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--save", "nowhere/run.rrd"], "folder nowhere of run.rrd does not exist"),
        (["--save", "run.txt"], "file run.txt has the suffix .txt; a saved view ends with .rrd"),
        (["--save", "run.rrd", "--seconds", "0"], "--seconds is 0 s; allowed is more than 0 s"),
        (
            ["--headless", "--memory", "much"],
            "memory 'much' is not possible; allowed are for example 500MB, 2GB and 25%",
        ),
        (["--headless", "--port", "0"], "port 0 is not possible; allowed is 1 to 65535"),
        (["--headless", "--port", "65536"], "port 65536 is not possible; allowed is 1 to 65535"),
        (["--address", "127.0.0.2"], "--address 127.0.0.2 was given without --web"),
        (["--save", "run.rrd", "--web-port", "9090"], "--web-port 9090 was given without --web"),
        (["--save", "run.rrd", "--no-open"], "--no-open was given without --web"),
        (
            ["--save", "run.rrd", "--port", "9876"],
            "--port 9876 was given without a viewer; with --save it needs --web or",
        ),
        (
            ["--save", "run.rrd", "--memory", "2GB"],
            "--memory 2GB was given without a viewer; with --save it needs --web",
        ),
        (
            ["--web", "--address", "0.0.0.0"],
            "the page cannot be served at '0.0.0.0'; allowed is an IPv4 address of this",
        ),
        (["--web", "--address", "nowhere"], "the page cannot be served at 'nowhere'"),
        (["--web", "--headless"], "more than one of --web, --headless and --window was given; only one is allowed"),
        (["--save", "run.rrd", "--seconds", "0.5", "--bus", "local:nobody"], "no bench on local:nobody"),
        (
            ["mine.parquet", "--save", "run.rrd", "--bus", "local:a"],
            "--bus local:a and run mine.parquet cannot be combined; --bus is for the running bench",
        ),
    ],
)
def test_bad_input_is_refused_in_one_sentence(
    arguments: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_refusal(*arguments).startswith(f"error: {sentence}")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "run.rrd"
    file.write_bytes(b"mine")
    assert (
        find_refusal("--save", file)
        == f"error: file {file} exists already; give another name, or --overwrite to replace it"
    )
    assert file.read_bytes() == b"mine"
