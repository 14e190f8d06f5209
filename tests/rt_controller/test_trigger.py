"""Triggers of a cycle: a time grid, the sample, a grid that follows the samples. The tests set the clock.

Those at the end, of one call, have the module as argument, so that they can run on mutants (tests/mutation).
"""

from collections import deque
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rt_controller.loop.trigger
from protocols.errors import InputError
from protocols.realtime.beat import Beat, arrive
from protocols.realtime.clock import Clock
from rt_controller.loop.phase_lock import follow
from rt_controller.loop.samples import Samples, estimate_usual_arrival
from rt_controller.loop.trigger import BusTrigger, ClockTrigger, PllTrigger
from rt_controller.loop.turn import GRID, choose_slot

PERIOD = 1_000_000  # ns
SINCE_1970 = 1_700_000_000_000_000_000  # ns between the two clocks
ARRIVED = 7_000_000_123  # ns: of the last sample, in the tests of one call


@pytest.fixture(scope="module")
def trigger() -> ModuleType:
    return rt_controller.loop.trigger


class Rig:
    """A monotonic clock that the test sets, and a bus on which samples arrive at `arrivals` [ns]."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, arrivals: Any) -> None:
        self.now = 0
        self.answered: list[tuple[int, int, int]] = []  # time, samples and slots of each cycle
        self.count = self.marks = self.marked_ns = 0
        self._coming = deque(int(arrival) for arrival in arrivals)
        for module in ("protocols.realtime.clock", "protocols.realtime.waiting", "rt_controller.loop.samples"):
            monkeypatch.setattr(f"{module}.time", self)

    # of the module time
    def monotonic_ns(self) -> int:
        return self.now

    def monotonic(self) -> float:
        return self.now / 1e9

    def time_ns(self) -> int:
        return self.now + SINCE_1970

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)

    # of a line
    def arrive(self, until: int) -> bool:
        """Set the clock to the next sample or to `until` [ns]; return whether a sample has arrived."""
        came = bool(self._coming) and self._coming[0] <= until
        self.now = max(self.now, self._coming[0]) if came else max(self.now, until)
        return came

    def take(self) -> bool:
        taken = self.marks
        while self._coming and self._coming[0] <= self.now:
            self.marked_ns = self._coming.popleft() + SINCE_1970
            self.marks += 1
            self.count += 1
        return self.marks > taken

    # of a turn
    def answer(self, slots: int) -> bool:
        complete = self.take()
        self.answered.append((self.now, self.count, slots))
        self.count = 0
        return complete

    def answer_slots(self, beat: Any, changes: int, drifts: np.ndarray = GRID) -> int:
        missed: int = beat.clock.wait()
        complete = self.answer(1 + missed)
        if drifts.size:
            follow(beat.memory.clocks, drifts, complete, self.samples.find_arrival_ns())
        return missed

    def answer_samples(self, beat: Any, changes: int) -> int:
        before, period, slots = beat.clock.deadline_ns, beat.clock.period_ns, 0
        patience = usual = max(before + period, self.now) + period // 2
        while not slots:
            came = self.arrive(patience) and self.take()
            arrived = self.marked_ns - SINCE_1970 if came else 0
            slots, arrived, patience = choose_slot(before, period, arrived, self.now, patience, patience > usual)
        self.answer(slots)
        arrive(beat.memory.clocks, self.now, arrived, slots)
        return slots - 1

    @property
    def samples(self) -> Samples:
        class Plant:
            can_id = 2

        rig: Any = self
        codecs: Any = {"PLANT_HEARTBEAT": Plant}
        return Samples(rig, codecs)


def make_turn(rig: Any) -> Any:
    return rig


def run_cycles(rig: Rig, begins: Any, count: int, work: int = 100_000) -> list[tuple[int, int, int]]:
    """Return for each cycle its time [ns], the number of samples in it, and the missed slots before it."""
    result = []
    for _ in range(count):
        rig.answered.clear()
        missed = begins.run(0)
        ((at, samples, slots),) = rig.answered  # it is run once
        assert slots == missed + 1
        result.append((at, samples, missed))
        rig.now += work
        begins.clock.end_cycle()
        assert begins.clock.slots == begins.clock.run + begins.clock.skipped
    return result


def test_the_clock_runs_half_a_period_after_the_first_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(monkeypatch, PERIOD * np.arange(1, 20))
    begins = ClockTrigger(Beat(Clock(PERIOD)), make_turn(rig))
    begins.start(0)
    result = run_cycles(rig, begins, 10)
    assert [at for at, _, _ in result] == [PERIOD // 2 + k * PERIOD for k in range(10)]
    assert [samples for _, samples, _ in result] == [0] + [1] * 9


def test_on_the_bus_a_cycle_begins_with_its_sample_whatever_its_jitter(monkeypatch: pytest.MonkeyPatch) -> None:
    jitter = np.random.default_rng(1).integers(-200_000, 200_000, 300)
    arrivals = PERIOD * np.arange(1, 301) + jitter
    rig = Rig(monkeypatch, arrivals)
    begins = BusTrigger(Beat(Clock(PERIOD)), make_turn(rig))
    begins.start(0)
    result = run_cycles(rig, begins, 300)
    assert [at for at, _, _ in result] == arrivals.tolist()
    assert begins.clock.skipped == 0
    assert begins.clock.wake.maximum_ns == 0  # from the stamp of the frame to the cycle


def test_on_the_bus_a_lost_sample_costs_one_cycle_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    arrivals = np.delete(PERIOD * np.arange(1, 21), [5, 6])  # the 6th and 7th are lost
    rig = Rig(monkeypatch, arrivals)
    begins = BusTrigger(Beat(Clock(PERIOD)), make_turn(rig))
    begins.start(0)
    result = run_cycles(rig, begins, 20)
    assert [samples for _, samples, _ in result] == [1] * 5 + [0, 0] + [1] * 13
    assert result[5][0] == 6 * PERIOD + PERIOD // 2
    assert result[7][0] == 8 * PERIOD
    assert (begins.clock.run, begins.clock.skipped, begins.clock.slots) == (20, 0, 20)


def test_on_the_bus_a_stall_of_ours_is_counted_in_slots(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(monkeypatch, PERIOD * np.arange(1, 40))
    begins = BusTrigger(Beat(Clock(PERIOD)), make_turn(rig))
    begins.start(0)
    run_cycles(rig, begins, 10)
    rig.now += 4 * PERIOD
    at, samples, missed = run_cycles(rig, begins, 1)[0]
    assert (samples, missed) == (4, 3)
    assert at == 14 * PERIOD + 100_000
    assert run_cycles(rig, begins, 1)[0] == (15 * PERIOD, 1, 0)


def test_on_the_bus_a_stall_of_the_machine_is_one_cycle_with_what_comes_after_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The plant has stopped, too: its frames of that time arrive together, half a period late."""
    arrivals = [*(PERIOD * np.arange(1, 6)), *[15 * PERIOD + 300_000] * 10, *(PERIOD * np.arange(16, 30))]
    rig = Rig(monkeypatch, arrivals)
    begins = BusTrigger(Beat(Clock(PERIOD)), make_turn(rig))
    begins.start(0)
    run_cycles(rig, begins, 5)
    arrive, stalls = rig.arrive, [15 * PERIOD + 50_000]

    def stalled(until: int) -> bool:
        if stalls:
            rig.now = stalls.pop()
            return False
        return arrive(until)

    rig.arrive = stalled  # type: ignore[method-assign]
    assert run_cycles(rig, begins, 1) == [(15 * PERIOD + 300_000, 10, 9)]
    assert run_cycles(rig, begins, 1) == [(16 * PERIOD, 1, 0)]


@pytest.mark.parametrize("drift", [-200e-6, -20e-6, 0.0, 20e-6, 200e-6])  # of a crystal: 20 to 100 ppm
def test_the_loop_locks_to_the_samples_and_follows_their_clock(monkeypatch: pytest.MonkeyPatch, drift: float) -> None:
    """From any phase. Then each cycle is a quarter of a period after its sample, with less jitter than the bus."""
    count, spread = 8000, 30_000
    jitter = np.random.default_rng(2).normal(0.0, spread, count)
    arrivals = PERIOD * (1.0 + drift) * np.arange(1, count + 1) + np.abs(jitter)
    rig = Rig(monkeypatch, arrivals)
    begins = PllTrigger(Beat(Clock(PERIOD)), make_turn(rig))
    begins.start(370_000)  # far from where it belongs
    result = np.array(run_cycles(rig, begins, count - 10))
    settled = result[4000:]
    phase = (settled[:, 0] / (PERIOD * (1.0 + drift)) + 0.5) % 1.0 - 0.5
    assert phase.mean() == pytest.approx(0.25 + np.abs(jitter).mean() / PERIOD, abs=0.005)
    assert phase.std() < 0.25 * spread / PERIOD
    assert (settled[:, 1] == 1).all()  # every cycle has its sample, and one
    assert begins.clock.slots == begins.clock.run


def test_the_loop_coasts_while_samples_are_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    drift = 100e-6
    arrivals = PERIOD * (1.0 + drift) * np.delete(np.arange(1, 9001), np.arange(6000, 6500))
    rig = Rig(monkeypatch, arrivals)
    begins = PllTrigger(Beat(Clock(PERIOD)), make_turn(rig))
    begins.start(0)
    result = np.array(run_cycles(rig, begins, 8900))
    phase = (result[6490:6600, 0] / (PERIOD * (1.0 + drift)) + 0.5) % 1.0 - 0.5
    assert np.abs(phase - 0.25).max() < 0.01  # without the drift learnt it would be off by 0.05


@pytest.mark.parametrize("phase", [0, 10_000, 500_000, 990_000])
def test_a_grid_begins_where_samples_usually_come(phase: int) -> None:
    """For a late last sample, and for any phase of the clock."""
    jitter = np.random.default_rng(4).exponential(20_000, 50)
    jitter[[7, 20, 49]] = 400_000, 3_300_000, 700_000
    arrivals = phase + PERIOD * np.arange(1000, 1050) + jitter.astype(int)
    result = estimate_usual_arrival(arrivals.tolist(), PERIOD)
    assert 0 < (result - phase + PERIOD // 2) % PERIOD - PERIOD // 2 < 60_000
    assert abs(result - arrivals[-1]) <= PERIOD // 2


# --- one call --------------------------------------------------------------------------------------------------------


class Calls:
    """A trigger `name` with a made-up clock and turn. `log` has their calls."""

    def __init__(self, module: ModuleType, name: str) -> None:
        self.log, self.drifts = list[tuple[Any, ...]](), list[Any]()
        self.beat: Any = SimpleNamespace(clock=SimpleNamespace(period_ns=PERIOD, start=self._start))
        turn = SimpleNamespace(answer_slots=self._answer_slots, answer_samples=self._answer_samples)
        self.trigger = module.find_trigger(name)(self.beat, turn)

    def _start(self, first: int) -> None:
        self.log.append(("start", first))

    def _answer_slots(self, beat: Any, changes: int, *drifts: np.ndarray) -> int:
        self.log.append(("slots", beat is self.beat, changes, [one.tolist() for one in drifts]))
        self.drifts += drifts
        return 3

    def _answer_samples(self, beat: Any, changes: int) -> int:
        self.log.append(("samples", beat is self.beat, changes))
        return 4


def test_a_grid_begins_after_the_last_sample(trigger: ModuleType) -> None:
    """By half a period, one, and one and a quarter: its cycle is done."""
    for name, after in (("clock", 500_000), ("bus", 1_000_000), ("pll", 1_250_000)):
        calls = Calls(trigger, name)
        assert calls.trigger.clock is calls.beat.clock
        calls.trigger.start(ARRIVED)
        assert calls.log == [("start", ARRIVED + after)]


def test_on_an_absolute_grid_a_run_does_turns_by_slots(trigger: ModuleType) -> None:
    calls = Calls(trigger, "clock")
    assert calls.trigger.run(7) == 3
    assert calls.log == [("slots", True, 7, [])]


def test_on_the_bus_a_run_does_turns_by_samples(trigger: ModuleType) -> None:
    calls = Calls(trigger, "bus")
    assert calls.trigger.run(7) == 4
    assert calls.log == [("samples", True, 7)]


def test_a_grid_that_follows_the_samples_keeps_its_drift(trigger: ModuleType) -> None:
    calls = Calls(trigger, "pll")
    assert calls.trigger.run(7) == 3
    calls.drifts[0][0] = 5.0
    calls.trigger.run(8)
    assert calls.log == [("slots", True, 7, [[0.0]]), ("slots", True, 8, [[5.0]])]


def test_only_known_triggers(trigger: ModuleType) -> None:
    for name, kind in (("clock", "ClockTrigger"), ("bus", "BusTrigger"), ("pll", "PllTrigger")):
        assert trigger.find_trigger(name) is getattr(trigger, kind)
    with pytest.raises(InputError, match=r"trigger 'time' is unknown; allowed are bus, clock, pll"):
        trigger.find_trigger("time")
