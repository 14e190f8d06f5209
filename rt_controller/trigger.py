"""Trigger: what begins a control cycle.

clock   an absolute grid, half a period after the first sample: with a plant on this machine the phase stays, both clocks
        being CLOCK_MONOTONIC; with a real rig it drifts by the difference of two crystals
bus     the sample itself: lowest latency; a slot whose sample has not come half a period after it was due runs without one
pll     a grid that follows the samples' arrival, a quarter of a period behind it: no drift, and no jitter of the bus

Equation        pll: e = arrival + T/4 - slot, within +-T/2;  I += K_I e;  next slot = slot + T + K_P e + I, the last two
                together at most T/50
Assumptions     sample times are a grid of nearly our period; stamps of frames are CLOCK_REALTIME
References      Gardner 2005, Phaselock Techniques, ch. 2 (loop of second order, damped by 1/sqrt 2: K_P^2 = 2 K_I)
"""

import time
from collections.abc import Callable
from typing import Protocol

from protocols.beat import Beat
from protocols.clock import Clock
from protocols.errors import InputError, listing
from rt_controller.turn import Turn

_K_P, _K_I = 0.02, 0.0002  # bandwidth of some 3 Hz at 1 kHz: far below the jitter, far above the drift of crystals
_FURTHEST = 50  # part of a period that the grid moves at most in a cycle


class Trigger(Protocol):
    """Runs cycles, each in a slot of `clock`."""

    clock: Clock

    def start(self, arrived_ns: int) -> None:
        """The last sample was complete at `arrived_ns` of CLOCK_MONOTONIC; its cycle has been run."""

    def run(self, changes: int) -> int:
        """Wait for the next cycle and run it, and so on for some; rows but the last are booked (`Beat.book`, with `changes`).

        Returns how many slots were left out before the last.
        """
        ...


class ClockTrigger:
    """On an absolute grid."""

    def __init__(self, beat: Beat, turn: Turn) -> None:
        self.clock, self._turn, self._beat = beat.clock, turn, beat

    def start(self, arrived_ns: int) -> None:
        """See `Trigger`."""
        self.clock.start(arrived_ns + self.clock.period_ns // 2)

    def run(self, changes: int) -> int:
        """See `Trigger`."""
        missed, _ = self._turn.answer_slots(self._beat, self._beat.most, changes)
        return missed


class BusTrigger:
    """When a sample comes, or half a period after it was due."""

    def __init__(self, beat: Beat, turn: Turn) -> None:
        self.clock, self._turn = beat.clock, turn

    def start(self, arrived_ns: int) -> None:
        """See `Trigger`."""
        self.clock.start(arrived_ns + self.clock.period_ns)

    def run(self, changes: int) -> int:
        """See `Trigger`; one."""
        clock, turn, period = self.clock, self._turn, self.clock.period_ns
        before = clock.deadline_ns
        now = time.monotonic_ns()
        patience = max(before + period, now) + period // 2
        while not (slots := turn.answer_sample(max(patience - now, 0), before, period)):
            now = time.monotonic_ns()
            if now < patience:  # somebody has come, or a sample too late
                continue
            if now < patience + period // 2:
                break
            patience = now + period // 2  # the machine stood still, and the plant with it: its frames are on the way
        if slots:
            now, arrived = turn.woken_ns, turn.samples.arrived_ns()
        else:
            slots = max(1, round((now - before) / period - 0.5))
            arrived = before + slots * period
            turn.answer(slots)
        clock.shift(arrived - before - slots * period)
        clock.deadline_ns = arrived
        clock.begin(now, slots - 1, now - arrived)
        return slots - 1


class PllTrigger:
    """On a grid that follows the samples."""

    def __init__(self, beat: Beat, turn: Turn) -> None:
        self.clock, self._turn, self._beat = beat.clock, turn, beat
        self._drift = 0.0  # I [ns a period]

    def start(self, arrived_ns: int) -> None:
        """See `Trigger`."""
        self.clock.start(arrived_ns + self.clock.period_ns + self.clock.period_ns // 4)

    def run(self, changes: int) -> int:
        """See `Trigger`; one."""
        clock, turn, period = self.clock, self._turn, self.clock.period_ns
        missed, complete = turn.answer_slots(self._beat, 1, changes)
        error = 0
        if complete:
            error = (turn.samples.arrived_ns() + period // 4 - clock.deadline_ns + period // 2) % period - period // 2
        most = period / _FURTHEST
        self._drift = min(max(self._drift + _K_I * error, -most), most)
        clock.shift(round(min(max(_K_P * error + self._drift, -most), most)))
        return missed


TRIGGERS: dict[str, Callable[[Beat, Turn], Trigger]] = {
    "clock": ClockTrigger, "bus": BusTrigger, "pll": PllTrigger
}  # fmt: skip


def trigger(name: str) -> Callable[[Beat, Turn], Trigger]:
    """The trigger of that name, to be made of a beat and turns. Raises InputError."""
    if name not in TRIGGERS:
        raise InputError(f"trigger {name!r} is unknown; allowed are {listing(TRIGGERS)}")
    return TRIGGERS[name]
