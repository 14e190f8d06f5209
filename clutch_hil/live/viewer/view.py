"""Live view: send rows of a running bench to a viewer, to an .rrd file, or to both, each with a separate feed."""

import threading
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from clutch_hil.live.viewer.blueprint import build_blueprint
from clutch_hil.live.viewer.rrd_writer import RrdWriter
from clutch_hil.live.viewer.stream import ViewerStream
from clutch_hil.live.viewer.viewer import Say, Viewer
from protocols.errors import format_count
from protocols.realtime.notify import Notifier, open_notifier
from protocols.realtime.stopping import Stop
from protocols.telemetry.batch import Batch
from protocols.telemetry.feed import Feed, NoBenchError, find_bench
from protocols.telemetry.keys import NODES
from protocols.telemetry.lab import advise_start
from protocols.telemetry.session import open_consumer_session

_POLL_PERIOD = 0.1  # s between checks of the viewer and of signals
_REMINDER_PERIOD = 5.0  # s between two lines that report that no bench has been detected
_CONNECT_TIME = 2.0  # s for a session to detect the publishers of this machine, before the first such line
_READ_TIMEOUT = 0.05  # s to wait for rows before the next check whether to end
_SAVE_PERIOD = (
    2.0  # s of rows in one piece of a file, which a power failure loses; smaller pieces make it larger and slower
)


class Sink(Protocol):
    """Receiver of rows."""

    def put(self, batches: Iterable[Batch], events: Iterable[dict[str, Any]] = ()) -> None:
        """Accept rows and changes of parameters."""
        ...


class FeedThread(threading.Thread):
    """Move the rows of a bench from a separate feed to a sink, once per `period` [s]. Use as a context manager.

    rows, lost: numbers of arrived and missing rows by node; rejections: see `Feed`. error: what ended the thread, or None.
    """

    def __init__(self, bench: str, router: str | None, sink: Sink, live: bool, period: float) -> None:
        super().__init__(name=f"feed of {type(sink).__name__}", daemon=True)
        self.rows: Counter[str] = Counter()
        self.lost: dict[str, int] = {}
        self.rejections = ""
        self._sessions: dict[str, set[int]] = {}
        self.error: Exception | None = None
        self._wait_for_bench, self._router, self._sink, self._live, self._period = bench, router, sink, live, period
        self._end = threading.Event()

    def __enter__(self) -> "FeedThread":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self.join()

    @property
    def starts(self) -> int:
        """Return how often the bench was started while the thread ran."""
        return max(map(len, self._sessions.values()), default=1)

    def run(self) -> None:
        """Read until the end, including the last rows."""
        try:
            with (
                open_consumer_session(self._router) as session,
                Feed(session, self._wait_for_bench, live=self._live) as feed,
            ):
                while not self._end.is_set():
                    self._move(feed, time.monotonic() + self._period)
        except Exception as error:  # raised again by the main thread
            self.error = error

    def _move(self, feed: Feed, until: float) -> None:
        """Read until a time of CLOCK_MONOTONIC [s], then pass the rows to the sink."""
        batches: list[Batch] = []
        while time.monotonic() < until and not self._end.is_set():
            batches += feed.read(min(_READ_TIMEOUT, max(0.0, until - time.monotonic())))
        if self._end.is_set():
            batches += feed.read()
        for batch in batches:
            self.rows[batch.node] += len(batch.rows)
            self._sessions.setdefault(batch.node, set()).add(batch.session)
        self.lost, self.rejections = dict(feed.lost), feed.rejections
        self._sink.put(batches, feed.take_events())


@dataclass
class ViewResult:
    """Result of a live view: rows by node that were read, missing, or dropped because the viewer was slow."""

    bench: str
    rows: dict[str, int] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)
    saved: dict[str, Any] | None = None  # of the file: path, rows, lost, bytes
    starts: int = 1  # of the bench during the view
    viewer: str | None = None  # why the viewer failed; None when it did not
    rejections: str = ""  # data from other senders under the keys of the bench

    @property
    def lost_rows(self) -> int:
        """Return the number of rows missing on the screen, plus those missing in the file."""
        saved = self.saved["lost"] if self.saved else {}
        return sum(sum(count.values()) for count in (self.lost, self.dropped, saved))

    @property
    def good(self) -> bool:
        """Return whether rows arrived, none was lost, and the viewer did not fail."""
        return any(self.rows.values()) and not (self.lost_rows or self.viewer)

    @property
    def verdict(self) -> str:
        """Return the verdict line."""
        silent = [node for node in NODES if not self.rows.get(node)]
        if len(silent) == len(NODES):
            loss = "no rows were received"
        else:
            loss = f"{format_count(self.lost_rows, 'row')} lost" if self.lost_rows else "nothing lost"
            loss += "".join(f"; no rows of the {node} were received" for node in silent)
        return "; ".join(filter(None, (self.viewer, loss, self.rejections)))

    @property
    def text(self) -> str:
        """Return the rows read, written and lost, for people."""
        again = f", started {self.starts} times" if self.starts > 1 else ""
        lines = [f"read:    bench {self.bench}{again}: {_format_counts(self.rows) or 'no rows'}"]
        if self.saved:
            saved = self.saved
            lines.append(
                f"wrote:   {saved['path']}  ({_format_counts(saved['rows']) or 'no rows'}, {saved['bytes'] / 1e6:.1f} MB)"
            )
            if any(saved["lost"].values()):
                lines.append(f"missing: {_format_counts(saved['lost'])} in the file: they did not arrive")
        if any(self.lost.values()):
            lines.append(f"lost:    {_format_counts(self.lost)} on the way to the viewer")
        if any(self.dropped.values()):
            lines.append(f"dropped: {_format_counts(self.dropped)}: the viewer did not accept them")
        return "\n".join(lines)

    @property
    def document(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "bench": self.bench,
            "rows": self.rows,
            "lost": self.lost,
            "dropped": self.dropped,
            "saved": self.saved,
            "bench_starts": self.starts,
            "viewer_ended": self.viewer,
            "verdict": self.verdict,
        }


def _format_counts(rows: dict[str, int]) -> str:
    return ", ".join(f"{node} {count} rows" for node, count in sorted(rows.items()))


@dataclass(frozen=True)
class LiveView:
    """A view of the bench on `bus` (None: the only one there is) through `router` (None: this machine) for `seconds`."""

    bus: str | None
    router: str | None
    seconds: float | None

    def run(self, viewer: Viewer | None, save: Path | None, say: Say) -> ViewResult:
        """Show and save until the time is over, the window is closed or a signal arrives. Raises InputError."""
        notifier = open_notifier()
        with Stop() as stop, ExitStack() as stack:
            if viewer:
                stack.enter_context(viewer).announce(say)
            notifier.say("waits for a bench")
            notifier.be_ready()  # the viewer listens
            bench = self._wait_for_bench(stop, viewer, say, notifier)
            say(f"bench {bench}; Ctrl-C ends the view")
            notifier.say(f"shows bench {bench}")
            result = ViewResult(bench)
            watch = Watch(stop, self.seconds, notifier)
            writer = saving = None
            if save:
                writer = stack.enter_context(RrdWriter(save, bench, build_blueprint(window=None)))
                saving = FeedThread(bench, self.router, writer, live=False, period=_SAVE_PERIOD)
            with saving or nullcontext():
                if viewer:
                    self._show(viewer, watch, saving, result)
                    if saving and not watch.is_over:
                        say(f"the viewer has ended; {save} is still written until Ctrl-C")
                while saving and not watch.is_over:
                    watch.wait(saving)
                notifier.stop()
            if writer and saving:
                _raise_error(saving)
                writer.finish()
                size = writer.path.stat().st_size
                result.saved = {"path": str(save), "rows": dict(saving.rows), "lost": saving.lost, "bytes": size}
                result.starts, result.rejections = saving.starts, saving.rejections
                if not viewer:
                    result.rows, result.lost = dict(saving.rows), {}
        return result

    def _wait_for_bench(self, stop: Stop, viewer: Viewer | None, say: Say, notifier: Notifier) -> str:
        """Wait for a bench, and return its name. Raises InputError when a signal arrives first, or for several benches."""
        began = time.monotonic()
        following = began + _CONNECT_TIME
        with open_consumer_session(self.router) as session:
            while True:
                try:
                    return find_bench(session, self.bus, self.router)
                except NoBenchError:
                    waited = time.monotonic() - began
                    closed = viewer is not None and viewer.find_exit_reason() is not None
                    stop.check("no bench was found; nothing was shown or written")
                    if closed or (self.seconds is not None and waited > self.seconds):
                        raise
                    if began + waited > following:
                        following += _REMINDER_PERIOD
                        say(f"waiting for a bench; {advise_start(self.router)}")
                notifier.ping()
                time.sleep(_POLL_PERIOD)

    def _show(self, viewer: Viewer, watch: "Watch", saving: FeedThread | None, result: ViewResult) -> None:
        """Show until the time is over, or the viewer has ended."""
        with (
            ViewerStream(viewer.url, result.bench, build_blueprint(light=viewer.light), light=viewer.light) as stream,
            FeedThread(result.bench, self.router, stream, live=True, period=viewer.period) as showing,
        ):
            while not watch.is_over:
                dropped = dict(stream.dropped)
                if viewer.find_exit_reason() is not None:  # rows on their way to a closed window do not count as lost
                    break
                result.dropped = dropped
                watch.wait(showing, stream, *([saving] if saving else []))
        _raise_error(showing)
        result.viewer = viewer.find_exit_reason() or None
        if viewer.find_exit_reason() is None:
            result.dropped = dict(stream.dropped)
        result.rows, result.lost, result.starts = dict(showing.rows), showing.lost, showing.starts
        result.rejections = showing.rejections


class Watch:
    """End of a view: by a signal, or after `seconds` (None: unlimited)."""

    def __init__(self, stop: Stop, seconds: float | None, notifier: Notifier) -> None:
        self._stop, self._notifier = stop, notifier
        self._end = None if seconds is None else time.monotonic() + seconds

    @property
    def is_over(self) -> bool:
        """Return whether the view is over."""
        return self._stop.asked or (self._end is not None and time.monotonic() >= self._end)

    def wait(self, *threads: FeedThread | ViewerStream) -> None:
        """Wait a moment, and report that the view is alive. Raises the error of a thread that has failed."""
        self._notifier.ping()
        time.sleep(_POLL_PERIOD)
        for thread in threads:
            _raise_error(thread)


def _raise_error(thread: FeedThread | ViewerStream) -> None:
    if thread.error:
        raise thread.error
