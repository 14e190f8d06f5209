"""The clock of a service: a grid that never drifts and accounts for every slot."""

import itertools
import time

import numpy as np
import pytest

from protocols.errors import InputError
from protocols.realtime.clock import Clock, Histogram
from protocols.realtime.overrun import OverrunError, find_overrun_policy
from protocols.realtime.waiting import Sleep, SleepThenSpin, choose_waiting

PERIOD_NS = 1_000_000
BIN_US = 1.0  # width of the histogram's bins
OVERRUN = 5.5  # periods: far enough from a whole number that a sleep's own lateness rarely matters
SCHEDULER_US = 50_000.0  # a shared machine may wake a sleeper this late; what is exact is not measured against it


def start_clock(period_ns: int = PERIOD_NS) -> tuple[Clock, int]:
    clock = Clock(period_ns)
    start = time.monotonic_ns() + period_ns
    clock.start(start)
    return clock, start


class Hands:
    """A monotonic clock moved by hand: sleeping is exact, work takes what the test says."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1_000_000_007
        self.oversleep = self.look = 0  # ns that a sleep takes longer, and that a look at the clock takes
        for module in ("clock", "waiting"):
            monkeypatch.setattr(f"protocols.realtime.{module}.time", self)

    def monotonic_ns(self) -> int:
        self.now += self.look
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9) + self.oversleep


@pytest.fixture
def hands(monkeypatch: pytest.MonkeyPatch) -> Hands:
    return Hands(monkeypatch)


def test_every_slot_is_run_or_skipped_when_work_overruns() -> None:
    clock, start = start_clock()
    for cycle in range(30):
        missed = clock.wait()
        slot = (clock.deadline_ns - start) // PERIOD_NS
        assert slot + 1 == clock.run + clock.skipped
        if cycle % 10 == 1:
            assert missed >= int(OVERRUN) - 1
        if cycle % 10 == 0:
            time.sleep(OVERRUN * PERIOD_NS / 1e9)
        clock.end_cycle()
    assert clock.run == 30
    assert clock.skipped >= 3 * (int(OVERRUN) - 1)
    assert clock.late >= 3


def test_deadlines_stay_on_the_grid_exactly() -> None:
    clock, start = start_clock(333_333)
    for cycle in range(100):
        clock.wait()
        assert (clock.deadline_ns - start) % 333_333 == 0
        assert clock.deadline_ns <= clock.woken_ns
        if cycle % 25 == 0:
            time.sleep(0.001)
        clock.end_cycle()
    assert clock.deadline_ns == start + (clock.run + clock.skipped - 1) * 333_333


def test_a_wake_up_is_never_early_and_not_absurdly_late() -> None:
    clock, _ = start_clock()
    for _ in range(20):
        clock.wait()
        assert time.monotonic_ns() >= clock.deadline_ns
        clock.end_cycle()
    assert clock.summarise()["wake"]["p50_us"] < SCHEDULER_US


def test_the_slots_of_a_perfect_machine_are_all_run(hands: Hands) -> None:
    clock = Clock(PERIOD_NS)
    start = hands.now + 12_345
    clock.start(start)
    for k in range(1000):
        assert clock.wait() == 0
        assert clock.deadline_ns == start + k * PERIOD_NS == hands.now
        hands.now += 400_000
        clock.end_cycle()
    assert (clock.run, clock.skipped, clock.late) == (1000, 0, 0)
    assert clock.summarise()["work"]["max_us"] == 400.0


@pytest.mark.parametrize(
    ("work", "skipped", "late"),
    [(999_999, 0, 0), (1_000_000, 0, 0), (1_000_001, 0, 1), (1_999_999, 0, 1), (2_000_000, 1, 1), (5_500_000, 4, 1)],
)
def test_an_overrun_is_late_and_skips_the_slots_it_has_slept_through(
    hands: Hands, work: int, skipped: int, late: int
) -> None:
    clock = Clock(PERIOD_NS)
    start = hands.now
    clock.start(start)
    clock.wait()
    hands.now += work
    clock.end_cycle()
    assert clock.wait() == skipped
    assert (clock.run, clock.skipped, clock.late) == (2, skipped, late)
    assert clock.deadline_ns == start + (1 + skipped) * PERIOD_NS
    assert clock.lateness_ns == max(0, work - (1 + skipped) * PERIOD_NS)


def test_the_account_holds_for_any_work(hands: Hands) -> None:
    generator = np.random.default_rng(1)
    clock = Clock(PERIOD_NS)
    start = hands.now
    clock.start(start)
    late = 0
    for work in generator.exponential(1.5 * PERIOD_NS, 3000).astype(int):
        hands.oversleep = int(generator.exponential(0.2 * PERIOD_NS))
        clock.wait()
        assert clock.deadline_ns == start + (clock.run + clock.skipped - 1) * PERIOD_NS
        assert 0 <= hands.now - clock.deadline_ns < PERIOD_NS
        hands.now += int(work)
        clock.end_cycle()
        late += hands.now > clock.deadline_ns + PERIOD_NS or clock.lateness_ns >= PERIOD_NS
    assert clock.skipped > 0
    assert clock.late == late > 0


@pytest.mark.parametrize("over", [0.0, 0.3, 0.9])
def test_slots_that_a_sleep_went_past_are_left_out_before_its_cycle(hands: Hands, over: float) -> None:
    """The cycle that takes what came meanwhile is the one that knows how long that was; the next one has its slot as ever."""
    clock = Clock(PERIOD_NS)
    start = hands.now
    clock.start(start)
    clock.wait()
    hands.oversleep = 4 * PERIOD_NS + int(over * PERIOD_NS)
    assert clock.wait() == 4
    hands.oversleep = 0
    assert clock.deadline_ns == start + 5 * PERIOD_NS
    assert clock.lateness_ns == hands.now - (start + PERIOD_NS)  # what it waited for was the first of them
    clock.end_cycle()
    assert clock.late == 1
    assert clock.wait() == 0
    assert hands.now == start + 6 * PERIOD_NS
    assert clock.slots == clock.run + clock.skipped == 7


def test_a_clock_that_was_not_started_has_no_slots(hands: Hands) -> None:
    clock = Clock(PERIOD_NS)
    assert (clock.slots, clock.run, clock.skipped) == (0, 0, 0)
    clock.start(hands.now)
    assert clock.slots == 0
    clock.wait()
    assert clock.slots == 1


def test_late_starts_are_accounted_for(hands: Hands) -> None:
    clock = Clock(PERIOD_NS)
    clock.start(hands.now - 3 * PERIOD_NS)
    assert clock.wait() == 3
    assert clock.run + clock.skipped == 4


def test_catching_up_runs_every_slot_and_leaves_the_grid_as_it_was(hands: Hands) -> None:
    clock = Clock(PERIOD_NS, overrun=find_overrun_policy("catch-up"))
    start = hands.now
    clock.start(start)
    for cycle in range(10):
        assert clock.wait() == 0
        assert clock.deadline_ns == start + cycle * PERIOD_NS
        hands.now += 4_200_000 if cycle == 2 else 100_000
        clock.end_cycle()
    assert (clock.run, clock.skipped, clock.slots) == (10, 0, 10)
    assert clock.lateness_ns == 0  # it has caught up


def test_an_overrun_can_be_a_fault(hands: Hands) -> None:
    clock = Clock(PERIOD_NS, overrun=find_overrun_policy("fault"))
    clock.start(hands.now)
    clock.wait()
    hands.now += 1_900_000
    clock.wait()  # late, but in its slot
    hands.now += 3_500_000
    with pytest.raises(OverrunError, match=r"^3 cycles were missed, and the overrun policy is fault$"):
        clock.wait()


def test_only_known_policies() -> None:
    with pytest.raises(InputError, match=r"overrun policy 'slip' is unknown; allowed are catch-up, fault, skip"):
        find_overrun_policy("slip")


def test_a_spin_begins_as_early_as_sleeps_are_late(hands: Hands) -> None:
    """At first as early as allowed; a late sleep makes it longer at once, good ones shorter slowly; the deadline is met."""
    spin, clock = SleepThenSpin(100_000), Clock(PERIOD_NS)
    clock = Clock(PERIOD_NS, spin)
    clock.start(hands.now + PERIOD_NS)
    hands.look, hands.oversleep = 50, 8_000
    lengths = []
    for cycle in range(3000):
        if cycle == 2000:
            hands.oversleep = 60_000
        if cycle == 2001:
            hands.oversleep = 8_000
        clock.wait()
        lengths.append(spin.spin_ns)
        assert 0 <= clock.lateness_ns <= (60_000 if cycle == 2000 else 2 * hands.look)
        clock.end_cycle()
    assert lengths[0] == pytest.approx(100_000, rel=0.01)
    assert lengths[1999] == pytest.approx(10_300, abs=500)  # lateness, margin, and what the division leaves
    assert lengths[2000] > 60_000
    assert lengths[2999] < 13_000
    assert all(later <= earlier for earlier, later in itertools.pairwise(lengths[:2000]))


def test_a_spin_is_never_longer_than_allowed(hands: Hands) -> None:
    spin = SleepThenSpin(20_000)
    hands.look, hands.oversleep = 50, 500_000
    for _ in range(5):
        spin(hands.now, hands.now + PERIOD_NS)
        assert spin.spin_ns == 20_000


def test_at_most_a_tenth_of_a_period_is_spun() -> None:
    fast, slow = choose_waiting(100.0, 100_000), choose_waiting(100.0, 4_000_000)
    assert isinstance(fast, SleepThenSpin)
    assert isinstance(slow, SleepThenSpin)
    assert (fast.spin_ns, slow.spin_ns) == (10_000, 100_000)
    assert isinstance(choose_waiting(0.0, 1_000_000), Sleep)


@pytest.mark.parametrize("size", [1, 3, 11, 1003, 20_011])  # percent of it is never whole: numpy rounds such ties
@pytest.mark.parametrize("percent", [50.0, 90.0, 99.0, 99.9])
def test_percentiles_agree_with_numpy_within_a_bin(size: int, percent: float) -> None:
    durations = np.random.default_rng(size).gamma(2.0, 150_000.0, size).astype(int)
    histogram = Histogram()
    for duration in durations:
        histogram.add(int(duration))
    # The smallest duration that at least `percent` of all do not exceed: the definition, without interpolation.
    expected = np.percentile(durations, percent, method="inverted_cdf") / 1000.0
    assert expected <= histogram.compute_percentile(percent) <= expected + BIN_US


def test_the_summary_tells_percentiles_and_the_exact_maximum() -> None:
    histogram = Histogram()
    for duration in [*itertools.repeat(10_500, 999), 7_654_321]:
        histogram.add(duration)
    assert histogram.summarise() == {"p50_us": 11.0, "p99_us": 11.0, "p99.9_us": 11.0, "max_us": 7654.321}


def test_an_empty_histogram_is_all_zero() -> None:
    assert set(Histogram().summarise().values()) == {0.0}


def test_durations_beyond_the_last_bin_are_counted_and_their_maximum_kept() -> None:
    histogram = Histogram()
    histogram.add(3_000_000_000)
    assert histogram.total == 1
    assert histogram.summarise()["max_us"] == 3e6
    assert histogram.compute_percentile(50.0) >= 20_000.0  # us, where the last bin begins
