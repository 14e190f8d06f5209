"""Live view: rows of a running bench to a viewer, to an .rrd file, or to both at once, each with a feed of its own."""

import threading
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from clutch_hil.live.blueprint import blueprint
from clutch_hil.live.rrd_writer import RrdWriter
from clutch_hil.live.stream import ViewerStream
from clutch_hil.live.viewer import Say, Viewer
from protocols.realtime.stopping import Stop
from protocols.telemetry.batch import Batch
from protocols.telemetry.feed import Feed, NoBenchError, find_bench
from protocols.telemetry.keys import NODES
from protocols.telemetry.session import consumer_session

_LOOK = 0.1  # s between looks at the viewer and at who asks us to stop
_SILENCE = 5.0  # s, after which we say again that we wait
_CONNECT = 2.0  # s for a session to find the publishers of this machine before we say that we wait
_READ = 0.05  # s to wait for rows before looking whether to end
_SAVE_PERIOD = 2.0  # s of rows in one piece of a file: what a power cut costs; smaller pieces make it longer and slower


class Sink(Protocol):
    """What rows go to."""

    def put(self, batches: Iterable[Batch], events: Iterable[dict[str, Any]] = ()) -> None:
        """Take rows and changes of parameters."""
        ...


class FeedThread(threading.Thread):
    """Moves the rows of a bench from a feed of its own to a sink, at most once in `period` [s]. Use as a context manager.

    `rows` and `lost` count by node what came and what never came. `error` is why it ended by itself, None while it runs.
    """

    def __init__(self, bench: str, router: str | None, sink: Sink, live: bool, period: float) -> None:
        super().__init__(name=f"feed of {type(sink).__name__}", daemon=True)
        self.rows: Counter[str] = Counter()
        self.lost: dict[str, int] = {}
        self._sessions: dict[str, set[int]] = {}
        self.error: Exception | None = None
        self._bench, self._router, self._sink, self._live, self._period = bench, router, sink, live, period
        self._end = threading.Event()

    def __enter__(self) -> "FeedThread":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self.join()

    @property
    def starts(self) -> int:
        """How often the bench was started, as far as we saw."""
        return max(map(len, self._sessions.values()), default=1)

    def run(self) -> None:
        """Read until the end, and then what came last."""
        try:
            with consumer_session(self._router) as session, Feed(session, self._bench, live=self._live) as feed:
                while not self._end.is_set():
                    self._move(feed, time.monotonic() + self._period)
        except Exception as error:  # told by the main thread
            self.error = error

    def _move(self, feed: Feed, until: float) -> None:
        """Read until a time of CLOCK_MONOTONIC, then hand over."""
        batches: list[Batch] = []
        while time.monotonic() < until and not self._end.is_set():
            batches += feed.read(min(_READ, max(0.0, until - time.monotonic())))
        if self._end.is_set():
            batches += feed.read()
        for batch in batches:
            self.rows[batch.node] += len(batch.rows)
            self._sessions.setdefault(batch.node, set()).add(batch.session)
        self.lost = dict(feed.lost)
        self._sink.put(batches, feed.events())


@dataclass
class ViewResult:
    """What a live view did: rows by node that were read, never came, or were dropped because the viewer was slow."""

    bench: str
    rows: dict[str, int] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)
    saved: dict[str, Any] | None = None  # of the file: path, rows, lost, bytes
    starts: int = 1  # of the bench while we watched
    viewer: str | None = None  # why the viewer ended; None when we ended it

    @property
    def lost_rows(self) -> int:
        """Rows that did not come to the screen, plus those that did not come to the file."""
        saved = self.saved["lost"] if self.saved else {}
        return sum(sum(count.values()) for count in (self.lost, self.dropped, saved))

    @property
    def good(self) -> bool:
        """Rows came, none was lost, and nobody killed the viewer."""
        return any(self.rows.values()) and not (self.lost_rows or self.viewer)

    @property
    def verdict(self) -> str:
        """The verdict line."""
        silent = [node for node in NODES if not self.rows.get(node)]
        if len(silent) == len(NODES):
            told = "no rows came"
        else:
            told = f"{self.lost_rows} rows lost" if self.lost_rows else "nothing lost"
            told += "".join(f"; no rows of the {node} came" for node in silent)
        return f"{self.viewer}; {told}" if self.viewer else told

    @property
    def text(self) -> str:
        """What was read, written and lost, for people."""
        again = f", started {self.starts} times" if self.starts > 1 else ""
        lines = [f"read:    bench {self.bench}{again}: {_counts(self.rows) or 'no rows'}"]
        if self.saved:
            saved = self.saved
            lines.append(
                f"wrote:   {saved['path']}  ({_counts(saved['rows']) or 'no rows'}, {saved['bytes'] / 1e6:.1f} MB)"
            )
            if any(saved["lost"].values()):
                lines.append(f"missing: {_counts(saved['lost'])} in the file: they never came")
        if any(self.lost.values()):
            lines.append(f"lost:    {_counts(self.lost)} on the way here")
        if any(self.dropped.values()):
            lines.append(f"dropped: {_counts(self.dropped)}: the viewer did not take them")
        return "\n".join(lines)

    @property
    def document(self) -> dict[str, Any]:
        """The same for machines."""
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


def _counts(rows: dict[str, int]) -> str:
    return ", ".join(f"{node} {count} rows" for node, count in sorted(rows.items()))


@dataclass(frozen=True)
class LiveView:
    """A view of the bench on `bus` (None: the only one there is) through `router` (None: this machine) for `seconds`."""

    bus: str | None
    router: str | None
    seconds: float | None

    def run(self, viewer: Viewer | None, save: Path | None, say: Say) -> ViewResult:
        """Show and save until the time is over, the window is closed or somebody stops us. Raises InputError."""
        with Stop() as stop, ExitStack() as stack:
            if viewer:
                stack.enter_context(viewer).announce(say)
            bench = self._bench(stop, viewer, say)
            say(f"bench {bench}; Ctrl-C ends the view")
            result = ViewResult(bench)
            watch = Watch(stop, self.seconds)
            writer = saving = None
            if save:
                writer = stack.enter_context(RrdWriter(save, bench, blueprint(window=None)))
                saving = FeedThread(bench, self.router, writer, live=False, period=_SAVE_PERIOD)
            with saving or nullcontext():
                if viewer:
                    self._show(viewer, watch, saving, result)
                    if saving and not watch.over:
                        say(f"the viewer has ended; {save} is written on until Ctrl-C")
                while saving and not watch.over:
                    watch.look(saving)
            if writer and saving:
                _raise(saving)
                writer.finish()
                size = writer.path.stat().st_size
                result.saved = {"path": str(save), "rows": dict(saving.rows), "lost": saving.lost, "bytes": size}
                result.starts = saving.starts
                if not viewer:
                    result.rows, result.lost = dict(saving.rows), {}
        return result

    def _bench(self, stop: Stop, viewer: Viewer | None, say: Say) -> str:
        """The bench, once there is one. Raises InputError when we are stopped before, or there are several."""
        began = time.monotonic()
        following = began + _CONNECT
        with consumer_session(self.router) as session:
            while True:
                try:
                    return find_bench(session, self.bus)
                except NoBenchError:
                    waited = time.monotonic() - began
                    closed = viewer is not None and viewer.ended() is not None
                    stop.check("no bench came; nothing was shown or written")
                    if closed or (self.seconds is not None and waited > self.seconds):
                        raise
                    if began + waited > following:
                        following += _SILENCE
                        say("waiting for a bench; start one with: clutch-hil up")
                time.sleep(_LOOK)

    def _show(self, viewer: Viewer, watch: "Watch", saving: FeedThread | None, result: ViewResult) -> None:
        """Show until the time is over, or the viewer has ended."""
        with (
            ViewerStream(viewer.url, result.bench, blueprint(light=viewer.light), light=viewer.light) as stream,
            FeedThread(result.bench, self.router, stream, live=True, period=viewer.period) as showing,
        ):
            while not watch.over:
                dropped = dict(stream.dropped)
                if viewer.ended() is not None:  # what was on its way to a closed window is no loss
                    break
                result.dropped = dropped
                watch.look(showing, *([saving] if saving else []))
        _raise(showing)
        result.viewer = viewer.ended() or None
        if viewer.ended() is None:
            result.dropped = dict(stream.dropped)
        result.rows, result.lost, result.starts = dict(showing.rows), showing.lost, showing.starts


class Watch:
    """Tells when a view is over: stopped by somebody, or after `seconds` (None: never)."""

    def __init__(self, stop: Stop, seconds: float | None) -> None:
        self._stop = stop
        self._end = None if seconds is None else time.monotonic() + seconds

    @property
    def over(self) -> bool:
        """Whether it is over."""
        return self._stop.asked or (self._end is not None and time.monotonic() >= self._end)

    def look(self, *threads: FeedThread) -> None:
        """Wait a moment. Raises the error of a thread that has failed."""
        time.sleep(_LOOK)
        for thread in threads:
            _raise(thread)


def _raise(thread: FeedThread) -> None:
    if thread.error:
        raise thread.error
