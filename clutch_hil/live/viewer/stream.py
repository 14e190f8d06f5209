"""ViewerStream: send rows to a viewer that may be slow, stopped, killed or restarted.

Every call of rerun may block for ever while its viewer is stopped. So all calls run in a separate thread, behind a queue of
limited size that drops its oldest rows and counts them.
"""

import contextlib
import threading
import uuid
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from clutch_hil.live.viewer.screen import Screen
from protocols.telemetry.batch import Batch

APPLICATION = "clutch-hil"
QUEUE_BYTES = 32_000_000  # of rows: a minute of both nodes at 1 kHz and 60 signals
_FLUSH_TIMEOUT = 0.5  # s for the viewer to accept rows, before the next check whether to end
_CHECK_PERIOD = 1.0  # s without rows after which the viewer is checked
_RETRY_PERIOD = 1.0  # s between attempts to reconnect to a viewer
_END_TIMEOUT = 2.0  # s for the last rows to reach the viewer


def make_recording(name: str, recording_id: str | None = None) -> rr.RecordingStream:
    """Return a recording of this application, without rerun's own timelines."""
    recording = rr.RecordingStream(APPLICATION, recording_id=recording_id)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    return recording


class ViewerStream:
    """Send rows to the viewer at `url` [rerun+http://...]. Use as a context manager.

    limit: bytes of waiting rows. light: send only the data of a light screen. sent, dropped: rows by node; rows that a viewer
    had not accepted when it ended count as dropped. error: what ended the thread, or None.
    """

    def __init__(
        self, url: str, name: str, blueprint: rrb.Blueprint, limit: int = QUEUE_BYTES, light: bool = False
    ) -> None:
        self.sent: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self.error: Exception | None = None
        self._url, self._name, self._blueprint, self._limit = url, name, blueprint, limit
        self._light = light
        self._id = str(uuid.uuid4())
        self._lock = threading.Lock()
        self._news = threading.Event()
        self._batches: deque[Batch] = deque()
        self._events: list[dict[str, Any]] = []
        self._bytes = 0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="viewer stream", daemon=True)

    def __enter__(self) -> "ViewerStream":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
        self._news.set()
        self._thread.join(_END_TIMEOUT)
        with self._lock:
            self._drop(len(self._batches))

    def put(self, batches: Iterable[Batch], events: Iterable[dict[str, Any]] = ()) -> None:
        """Add rows and changes of parameters to the queue, without waiting."""
        with self._lock:
            self._events += events
            for batch in batches:
                self._batches.append(batch)
                self._bytes += batch.rows.nbytes
            while self._bytes > self._limit:
                self._drop(1)
        self._news.set()

    def _drop(self, count: int) -> None:
        for _ in range(count):
            batch = self._batches.popleft()
            self._bytes -= batch.rows.nbytes
            self.dropped[batch.node] += len(batch.rows)

    def _take(self) -> tuple[list[Batch], list[dict[str, Any]]]:
        with self._lock:
            batches, events = list(self._batches), self._events
            self._batches.clear()
            self._events, self._bytes = [], 0
        return batches, events

    def _run(self) -> None:
        """Connect and send until the end; reconnect when the viewer has ended."""
        try:
            while not self._end.is_set():
                with contextlib.suppress(RuntimeError):
                    self._send_until_end()
                self._end.wait(_RETRY_PERIOD)
        except Exception as error:  # raised again by the main thread
            self.error = error

    def _send_until_end(self) -> None:
        """Send until the end. Raises RuntimeError when the viewer has ended."""
        recording = make_recording(self._name, self._id)
        recording.connect_grpc(self._url)
        recording.send_recording_name(self._name)
        recording.send_blueprint(self._blueprint, make_active=True, make_default=True)
        screen = Screen(recording, light=self._light)
        screen.open()
        while not self._end.is_set():
            self._news.wait(_CHECK_PERIOD)
            self._news.clear()
            self._send(recording, screen, *self._take())
        self._send(recording, screen, *self._take())

    def _send(
        self, recording: rr.RecordingStream, screen: Screen, batches: list[Batch], events: list[dict[str, Any]]
    ) -> None:
        """Send rows and wait until the viewer has accepted them, so that later rows wait and are counted in this queue."""
        rows: Counter[str] = Counter()
        for batch in batches:
            rows[batch.node] += len(batch.rows)
        arrived = False
        try:
            for batch in join_batches(batches):
                screen.log(batch)
            for event in events:
                screen.log_event(event)
            arrived = self._wait_until_taken(recording)
        finally:
            (self.sent if arrived else self.dropped).update(rows)

    def _wait_until_taken(self, recording: rr.RecordingStream) -> bool:
        """Wait until the viewer has accepted all rows; False if the end comes first. Raises RuntimeError when it has ended."""
        while True:
            try:
                recording.flush(timeout_sec=_FLUSH_TIMEOUT)
            except RuntimeError as error:
                if "timed out" not in str(error):
                    raise
                if self._end.is_set():
                    return False
            else:
                return True


def join_batches(batches: Sequence[Batch]) -> list[Batch]:
    """Join consecutive batches of each node, in the order of their first batches: few large batches cost least."""
    runs: dict[str, list[list[Batch]]] = {}
    for batch in batches:
        own = runs.setdefault(batch.node, [])
        if own and (own[-1][-1].session, own[-1][-1].end) == (batch.session, batch.first_row):
            own[-1].append(batch)
        else:
            own.append([batch])
    return [_concatenate(parts) for own in runs.values() for parts in own]


def _concatenate(parts: list[Batch]) -> Batch:
    first, last = parts[0], parts[-1]
    if len(parts) == 1:
        return first
    rows = np.concatenate([part.rows for part in parts])
    return Batch(
        first.node, first.session, first.first_row, first.rate, first.epoch, last.rows_lost, first.columns, rows
    )
