"""`clutch-hil record`: a running bench's telemetry in run files.

The 30 s before the recorder came are in the first one: whoever has just seen something can still record it.
"""

import time
from collections.abc import Callable
from pathlib import Path

import zenoh

from clutch_hil.live.conversion import checked_target, convert
from clutch_hil.live.recorder import Recorded, Recorder, rows_file
from protocols.errors import InputError
from protocols.realtime.stopping import Stop
from protocols.telemetry.feed import Feed, NoBenchError, find_bench
from protocols.telemetry.session import consumer_session

_LOOK = 0.2  # s between looks for rows
_PATIENCE = 10.0  # s for a bench to be there where the length is given; else it is waited for without end


def record(
    path: Path | None,
    bus: str | None,
    router: str | None,
    seconds: float | None,
    stop: Stop,
    progress: Callable[[str], None],
    blind: bool = False,
    tell: Callable[[str], None] = print,
) -> Recorded:
    """Record the bench on `bus` (None: the only one) until `stop` is asked, the bench is gone or `seconds` after its first row.

    Rows are written as Parquet; another suffix is made of that at the end. `blind` seals the truth away, in Parquet alone.
    `tell` takes what stays on the terminal: faults. Raises InputError when there is no bench, or a file is in the way.
    """
    if blind and path and path.suffix != ".parquet":
        raise InputError(f"{path} cannot be recorded blind as {path.suffix!r}; allowed is .parquet")
    if path:
        checked_target(path)
        checked_target(rows_file(path))
    with consumer_session(router) as session:
        progress("waiting for a bench; start one with: clutch-hil up")
        bench = _found(session, bus, stop, float("inf") if seconds is None else _PATIENCE)
        with Feed(session, bench, live=False) as feed, Recorder(session, feed, path, blind, tell) as recorder:
            end = float("inf")
            while not stop.asked and time.monotonic() < end:
                came = recorder.step()
                if recorder.began and seconds is not None:
                    end = min(end, time.monotonic() + seconds)
                if recorder.began and not came and not any(feed.alive.values()):
                    break
                progress(recorder.status())
                time.sleep(_LOOK)
            if not recorder.began:
                stop.check(f"bench {bench} had published no row; nothing was recorded")
            recorder.step(plant=False)  # answers to the last samples
            recorder.finish()
    for file in recorder.recorded.files:
        if rows_file(file) != file:
            progress(f"writing {file}")
            _convert(file)
    return recorder.recorded


def _convert(file: Path) -> None:
    rows = rows_file(file)
    try:
        convert(rows, file)
    except InputError as error:
        raise InputError(f"{error}; what was recorded is in {rows}") from None
    rows.unlink()


def _found(session: zenoh.Session, bus: str | None, stop: Stop, patience: float) -> str:
    """Name of the bench, waited for up to `patience` [s]. Raises InputError."""
    deadline = time.monotonic() + patience
    while True:
        try:
            return find_bench(session, bus)
        except NoBenchError:
            stop.check("no bench came; nothing was recorded")
            if time.monotonic() > deadline:
                raise
        time.sleep(_LOOK)
