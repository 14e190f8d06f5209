"""Beat: the clock of a loop for compiled code. It waits for a slot, and records the row and the timing of a cycle. It also
pings the watchdog of systemd.

It works on the memory of a `Clock` and implements `Clock.wait` with the policy "skip", `SleepThenSpin`, `Clock.end_cycle` and
`RingWriter.write`.

Method          clock_nanosleep(2) to the absolute time. The cycle follows in the same call, and one call runs several cycles.
                So no Python code, whose memory is no longer in the caches after a sleep, runs before a cycle
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit, types

from protocols.buses.exchange import CLOCK_MONOTONIC, load_system_function, read_clock
from protocols.node import Column, make_record_type
from protocols.realtime.clock import CLOCK, Clock
from protocols.realtime.mailbox import ANSWER_NUMBER, REQUEST_NUMBER, WORDS, Mailbox
from protocols.realtime.notify import NoNotifier
from protocols.realtime.ring import RingWriter
from protocols.realtime.waiting import SPIN_DECAY_SLEEPS, WAKE_MARGIN_NS

OVERRUN, OVERSLEPT = -1, -2  # returned by `wait` if the clock's policy for overruns must decide
_ABSOLUTE = 1  # TIMER_ABSTIME of linux/time.h
_SECOND = 1_000_000_000  # ns
_NO_WAIT = 0x4040  # MSG_DONTWAIT and MSG_NOSIGNAL of linux/socket.h
# ns, longest call of compiled code without a request: other processes wait ten seconds for a service to end. Each return to
# Python costs 0.15 ms, as its memory is not in the caches. At 4 kHz and above, this makes the next cycle late.
_LONGEST_CALL = 2_000_000_000
# Columns of a row with the timing of its cycle, after the node's record
TIMING = (
    Column("clock_s", "s", "CLOCK_MONOTONIC when the cycle began"),
    Column("wake_us", "us", "lateness of the cycle's wake-up"),
    Column("work_us", "us", "duration of the cycle before"),
    Column("late_cycles", "1", "cycles that ended after their slot, total"),
    Column("parameter_changes", "1", "parameters changed while running, total"),
)
_TIMING_RECORD, _TIMES = make_record_type(TIMING), len(TIMING)

_clock_nanosleep = load_system_function(
    "clock_nanosleep", types.int32, types.int32, types.int32, types.int64, types.int64
)
_send = load_system_function("send", types.int64, types.int32, types.int64, types.int64, types.int32)


class BeatMemory(NamedTuple):
    """Memory of a Beat for compiled code: its clock, waiting, ring, mailbox and ping.

    clocks (1,) of CLOCK; spins (2,) of `Waiting`; rows (capacity + 1, columns) and counts (1,) of `RingWriter`; numbers (4,) of
    `Mailbox`; pings (1,) of `notify.PING`.
    """

    clocks: np.ndarray
    spins: np.ndarray
    rows: np.ndarray
    counts: np.ndarray
    numbers: np.ndarray
    pings: np.ndarray


class Beat:
    """`clock` for compiled code, which works on the same `memory`.

    One call of compiled code runs up to `most` cycles. It writes all rows but the last to `ring`, and ends early if `mailbox`
    has a request (`is_called`). Without a ring it runs one cycle. ping: message to systemd, from `Notifier.make_ping`; None for
    none.
    """

    def __init__(
        self,
        clock: Clock,
        ring: RingWriter | None = None,
        mailbox: Mailbox | None = None,
        ping: np.ndarray | None = None,
    ) -> None:
        self.clock, self._ring, self._mailbox = clock, ring, mailbox
        self._pings = NoNotifier().make_ping() if ping is None else ping
        self.most = max(1, _LONGEST_CALL // clock.period_ns) if ring else 1

    @property
    def memory(self) -> BeatMemory:
        """BeatMemory, made for each call: a kept reference would keep the ring's file open."""
        clock, waits = np.frombuffer(self.clock.words, CLOCK), np.frombuffer(self.clock.waiting.words, np.int64)
        rows, counts = (self._ring.rows, self._ring.counts) if self._ring else (np.zeros((1, 0)), np.zeros(1, np.int64))
        numbers = self._mailbox.numbers if self._mailbox else np.zeros(WORDS, np.int64)
        return BeatMemory(clock, waits, rows, counts, numbers, self._pings)

    def record_cycle(self, row: np.ndarray, changes: int) -> None:
        """End a cycle: write its row (columns,), with the number of parameter `changes` so far, and record its timing."""
        record_cycle(self.memory, row, changes)

    def wake_up(self, how: int) -> int:
        """Begin the cycle after a `wait` that returned `how`, OVERRUN or OVERSLEPT; see `Clock.wake_up`."""
        return self.clock.wake_up(self.clock.woken_ns, how == OVERSLEPT)


def compile_record_cycle() -> None:
    """Compile `record_cycle`, or load it from disk, before the loop begins."""
    record_cycle(Beat(Clock(1)).memory._replace(rows=np.zeros((1, 1 + _TIMES))), np.zeros(1), 0)


@njit(cache=True, nogil=True)
def wait(beat: Any) -> Any:
    """Wait for the next slot of a BeatMemory, and return how many slots were skipped since the last one.

    If slots are missed and the clock's policy is not "skip", return OVERRUN or OVERSLEPT without beginning a cycle.
    """
    clock = beat.clocks[0]
    clock.deadline += clock.period
    due = clock.deadline
    at = read_clock(CLOCK_MONOTONIC, clock.spare)
    asleep = at < due
    if asleep:
        at = _wait_until(due, at, clock, beat.spins)
    clock.woken, missed = at, 0
    if at >= due + clock.period:
        if clock.skips == 0:
            return OVERSLEPT if asleep else OVERRUN
        missed = (at - due) // clock.period
        clock.deadline += missed * clock.period
    clock.run += 1
    clock.skipped += missed
    clock.lateness = at - (due if asleep else clock.deadline)
    return missed


@njit
def _wait_until(due, at, clock, spins):
    """Wait until `due` [ns of CLOCK_MONOTONIC]; return the time then [ns]."""
    spin, most = spins[0], spins[1]
    begin = due - spin
    if at < begin:
        while at < begin:  # a signal may end a sleep
            sleep_until(begin, clock.spare)
            at = read_clock(CLOCK_MONOTONIC, clock.spare)
        if most > 0:
            needed = min(at - begin + WAKE_MARGIN_NS, most)
            spins[0] = needed if needed > spin else spin - (spin - needed) // SPIN_DECAY_SLEEPS
    while at < due:
        at = read_clock(CLOCK_MONOTONIC, clock.spare)
    return at


@njit
def sleep_until(due, times):
    """Sleep until `due` of CLOCK_MONOTONIC [ns]; `times` (2,) is overwritten. Return non-zero if a signal interrupted it."""
    times[0], times[1] = due // _SECOND, due % _SECOND
    return _clock_nanosleep(CLOCK_MONOTONIC, _ABSOLUTE, times.ctypes.data, 0)


@njit(cache=True, nogil=True)
def arrive(clocks: Any, woken: Any, arrived: Any, slots: Any) -> None:
    """Begin a cycle at `woken` [ns] for a sample that `arrived` [ns], `slots` after the last one; shift the grid to it."""
    clock = clocks[0]
    clock.first += arrived - clock.deadline - slots * clock.period
    clock.deadline, clock.woken, clock.lateness = arrived, woken, woken - arrived
    clock.run += 1
    clock.skipped += slots - 1


@njit
def is_called(line, beat):
    """Return whether Python has work: a signal has come, or the mailbox of a BeatMemory has a request."""
    return line.signalled or beat.numbers[REQUEST_NUMBER] != beat.numbers[ANSWER_NUMBER]


@njit(cache=True, nogil=True)
def record_cycle(beat: Any, row: Any, changes: Any) -> None:
    """End a cycle: write its row, then record its timing as `Clock.end_cycle` does."""
    at, clock = write(beat, row, changes), beat.clocks[0]
    clock.worked = at - clock.woken
    _add_duration(clock.wake, clock.lateness)
    _add_duration(clock.work, clock.worked)
    if at > clock.deadline + clock.period or clock.lateness >= clock.period:
        clock.late += 1


@njit(cache=True, nogil=True)
def write(beat: Any, row: Any, changes: Any) -> Any:
    """Write a row, `row` and the columns TIMING, to the ring of a BeatMemory; return the present time [ns].

    Before that, ping systemd if it is due.
    """
    clock, place, width = beat.clocks[0], beat.rows[beat.counts[0] % beat.rows.shape[0]], row.size
    for column in range(width):
        place[column] = row[column]
    timing = place[width : width + _TIMES].view(_TIMING_RECORD)[0]
    timing.clock_s, timing.wake_us = clock.woken / 1e9, clock.lateness / 1e3
    timing.work_us, timing.late_cycles, timing.parameter_changes = clock.worked / 1e3, clock.late, changes
    ping = beat.pings[0]
    if clock.woken >= ping.due:
        ping.due = clock.woken + ping.period
        _send(ping.socket, ping.text, ping.length, _NO_WAIT)
    at = read_clock(CLOCK_MONOTONIC, clock.spare)  # a call between: the count is stored after the row
    beat.counts[0] += 1
    return at


@njit
def _add_duration(histogram, duration):
    """Count a `duration` [ns] in a record of HISTOGRAM; see `Histogram.add`."""
    histogram.bins[min(max(duration, 0) // 1000, histogram.bins.size - 1)] += 1
    histogram.total += 1
    histogram.maximum = max(histogram.maximum, duration)
