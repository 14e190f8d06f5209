"""`clutch-hil record`: record the telemetry of a running bench to run files.

The first file contains the 30 s before the recorder started, so that an event just seen can still be recorded.
"""

import time
from collections.abc import Callable
from pathlib import Path

from clutch_hil.bench.recovery import recover_folder
from clutch_hil.live.conversion import check_target, convert
from clutch_hil.live.recording.recorder import RUNS, Recorder, RecordingResult, make_rows_path
from protocols.errors import InputError
from protocols.realtime.notify import Notifier, open_notifier
from protocols.realtime.stopping import Stop
from protocols.telemetry.feed import Feed, NoBenchError, find_bench
from protocols.telemetry.lab import advise_start
from protocols.telemetry.session import open_consumer_session

_POLL_PERIOD = 0.2  # s between checks for rows
_BENCH_TIMEOUT = 10.0  # s to wait for a bench where the length is given; otherwise without limit


def record(
    path: Path | None,
    bus: str | None,
    router: str | None,
    seconds: float | None,
    stop: Stop,
    progress: Callable[[str], None],
    blind: bool = False,
    tell: Callable[[str], None] = print,
    overwrite: bool = False,
) -> RecordingResult:
    """Record the bench on `bus` (None: the only one) until `stop`, the end of the bench, or `seconds` after its first row.

    Rows are written as Parquet, and converted at the end where `path` has another suffix. blind: seal the truth; Parquet only.
    progress: called with the present state as text. tell: called with faults as text. Raises InputError when there is no bench,
    or a file exists.
    """
    if blind and path and path.suffix.lower() != ".parquet":
        raise InputError(f"{path} cannot be recorded blind as {path.suffix!r}; allowed is .parquet")
    if path:
        check_target(path, overwrite)
        check_target(make_rows_path(path), overwrite)
    recover_folder(path.parent if path else Path(RUNS), tell)
    notifier = open_notifier()
    with open_consumer_session(router) as session:
        progress(f"waiting for a bench; {advise_start(router)}")
        notifier.say("waits for a bench")
        notifier.be_ready()  # no row is lost from now on: the first file has the 30 s before
        patience = float("inf") if seconds is None else _BENCH_TIMEOUT
        bench = _wait_for_bench(lambda: find_bench(session, bus, router), stop, patience, notifier)
        notifier.say(f"records bench {bench}")
        with Feed(session, bench, live=False) as feed, Recorder(session, feed, path, blind, tell) as recorder:
            end = float("inf")
            while not stop.asked and time.monotonic() < end:
                came = recorder.step()
                if recorder.began and seconds is not None:
                    end = min(end, time.monotonic() + seconds)
                if recorder.began and not came and not any(feed.alive.values()):
                    break
                progress(recorder.describe_status())
                notifier.ping()
                time.sleep(_POLL_PERIOD)
            notifier.stop()
            if not recorder.began:
                stop.check(f"bench {bench} published no row; nothing was recorded")
            recorder.step(plant=False)  # answers to the last samples
            recorder.finish()
    for file in recorder.recorded.files:
        if make_rows_path(file) != file:
            progress(f"writing {file}")
            _convert_rows(file)
    return recorder.recorded


def _convert_rows(file: Path) -> None:
    rows = make_rows_path(file)
    try:
        convert(rows, file, overwrite=True)  # the target was checked before the recording began
    except InputError as error:
        raise InputError(f"{error}; the part recorded so far is in {rows}") from None
    rows.unlink()


def _wait_for_bench(find: Callable[[], str], stop: Stop, patience: float, notifier: Notifier) -> str:
    """Wait up to `patience` [s] until `find` returns the name of a bench, and return it. Raises InputError."""
    deadline = time.monotonic() + patience
    while True:
        try:
            return find()
        except NoBenchError:
            stop.check("no bench was found; nothing was recorded")
            if time.monotonic() > deadline:
                raise
        notifier.ping()
        time.sleep(_POLL_PERIOD)
