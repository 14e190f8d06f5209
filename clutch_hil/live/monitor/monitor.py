"""`clutch-hil monitor`: show a running bench on one screen of 80 x 24 characters, from its telemetry."""

import time
from typing import Any

from rich.console import Console
from rich.live import Live

from clutch_hil.live.monitor.collector import Collector
from clutch_hil.live.monitor.monitor_screen import draw_snapshot, format_snapshot
from clutch_hil.live.monitor.snapshot import Snapshot, make_document
from protocols.errors import InputError
from protocols.realtime.stopping import Stop
from protocols.telemetry.feed import Feed, ask, find_bench
from protocols.telemetry.keys import Keys, find_bus
from protocols.telemetry.message import check_last
from protocols.telemetry.session import open_consumer_session

_SETTLING_TIME = 1.0  # s before the first judgement: twice STALL_SECONDS
_DRAW_PERIOD = 0.25  # s
_LINE_PERIOD = 2.0  # s between lines where the output is no terminal
_READ_TIMEOUT = 0.1  # s to wait for a batch, so that a stalled service is also noticed and drawn


def watch(
    bus: str | None, router: str | None, once: bool, seconds: float | None, quiet: bool
) -> tuple[dict[str, Any], str, str, bool]:
    """Watch the bench on `bus`, None for the only one, for `seconds`, None until Ctrl-C; once: for one snapshot only.

    Return document, text, verdict, and whether there is no trouble. Raises InputError when there is no such bench.
    """
    if seconds is not None and not seconds > 0.0:
        raise InputError(f"--seconds is {seconds:g} s; allowed is more than 0 s")
    with (
        Stop() as stop,
        open_consumer_session(router) as session,
        Feed(session, bench := find_bench(session, bus, router), live=True) as feed,
        _Screen(quiet or once) as screen,
    ):
        collector = Collector(bench)
        began = time.monotonic()
        end = _SETTLING_TIME if once else seconds
        looked = False
        while True:
            collector.take(feed.read(_READ_TIMEOUT), now := time.monotonic())
            collector.add_changes(feed.take_events())
            collector.alive, collector.lost = feed.alive, feed.lost
            elapsed = now - began
            if not looked and elapsed >= _SETTLING_TIME:  # a service that stalled earlier has sent no row
                looked = True
                for node in collector.list_silent():
                    collector.last_rows[node] = (ask(session, Keys(bench, node).last, check_last) or {"row": -1})["row"]
            if stop.asked or (end is not None and elapsed >= end and looked):
                break
            screen.show(collector, now)
        snapshot = collector.make_snapshot(time.monotonic())
    troubles = snapshot.list_troubles()
    verdict = "; ".join(troubles) or f"{_list_states(snapshot)}, {_list_phases(snapshot)}, no fault"
    if feed.rejections:
        verdict += f"; {feed.rejections}"
    text = f"read:    telemetry of {find_bus(bench)} for {elapsed:.1f} s\nwrote:   nothing"
    if once:
        text = f"{_render_text(snapshot)}\n{text}"
    return make_document(snapshot), text, verdict, not troubles


def _list_states(snapshot: Snapshot) -> str:
    return ", ".join(f"{name} {state.state}" for name, state in snapshot.nodes.items() if state.state != "absent")


def _list_phases(snapshot: Snapshot) -> str:
    return ", ".join(f"phase {f'of {c.name} ' if c.name else ''}{c.phase}" for c in snapshot.clutches)


def _render_text(snapshot: Snapshot) -> str:
    """Return the screen as text, in the colours that the terminal supports."""
    console = Console(width=80)
    with console.capture() as capture:
        console.print(draw_snapshot(snapshot, console.width))
    return capture.get().rstrip("\n")


class _Screen:
    """Show snapshots on the whole terminal, or a line every 2 s where there is no terminal; nothing when `quiet`."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._console = Console()
        self._live = Live(console=self._console, screen=True, auto_refresh=False)
        self._every = _DRAW_PERIOD if self._console.is_terminal else _LINE_PERIOD
        self._next = 0.0

    def __enter__(self) -> "_Screen":
        if self._console.is_terminal and not self._quiet:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(self, collector: Collector, now: float) -> None:
        """Show a snapshot when the next one is due."""
        if self._quiet or now < self._next:
            return
        self._next = now + self._every
        snapshot = collector.make_snapshot(now)
        if self._console.is_terminal:
            self._live.update(draw_snapshot(snapshot, self._console.width), refresh=True)
        else:
            print(format_snapshot(snapshot), flush=True)
