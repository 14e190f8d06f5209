"""A service that is asked to end: by a flag for Python, by a descriptor for compiled code."""

import gc
import os
import select
import signal

import pytest

from protocols.errors import InterruptionError
from protocols.realtime.stopping import Stop


def is_readable(descriptor: int) -> bool:
    return bool(select.select([descriptor], [], [], 0.0)[0])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_asks(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_DFL)  # `nohup make test` ignores SIGHUP
    try:
        with Stop() as stop:
            assert not stop.asked
            assert not is_readable(stop.wakes)
            signal.raise_signal(number)
            assert stop.asked
            assert is_readable(stop.wakes)
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize(("number", "asked"), [(signal.SIGINT, True), (signal.SIGTERM, True), (signal.SIGHUP, False)])
def test_of_ignored_signals_a_closed_terminal_alone_stays_so(number: signal.Signals, asked: bool) -> None:
    """nohup ignores SIGHUP, which a closed terminal sends. A script's & ignores SIGINT, which a person sends on purpose."""
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with Stop() as stop:
            signal.raise_signal(number)
            assert stop.asked == asked
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, before)


def test_who_was_asked_has_no_result() -> None:
    with Stop() as stop:
        stop.check("nothing is kept")
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(InterruptionError, match="nothing is kept"):
            stop.check("nothing is kept")


def test_one_inside_another_is_asked_alone() -> None:
    with Stop() as outer:
        with Stop() as inner:
            signal.raise_signal(signal.SIGTERM)
        assert (inner.asked, outer.asked) == (True, False)
        signal.raise_signal(signal.SIGTERM)
        assert outer.asked
        assert is_readable(outer.wakes)


def test_afterwards_signals_are_as_before() -> None:
    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    gc.collect()  # what earlier tests left open is not closed meanwhile
    descriptors = len(os.listdir("/proc/self/fd"))
    with Stop():
        assert len(os.listdir("/proc/self/fd")) == descriptors + 2
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == handlers
    assert signal.set_wakeup_fd(-1) == -1
    assert len(os.listdir("/proc/self/fd")) == descriptors
