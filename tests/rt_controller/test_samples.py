"""How a controller waits for a sample, and when it arrived. Each test has the module as argument, so that it can run on mutants
(tests/mutation). Bus and clock are made up."""

from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest

import rt_controller.loop.samples
from protocols.can.frame_batch import load, make_batch
from protocols.can.frames import Frame, load_frames
from protocols.can.lifecycle import Lifecycle

FRAMES = load_frames()
BEAT = FRAMES["PLANT_HEARTBEAT"]
PERIOD = 1000  # ns


@pytest.fixture(scope="module")
def samples() -> ModuleType:
    return rt_controller.loop.samples


def make_heartbeat(lifecycle: Lifecycle) -> Frame:
    return Frame(BEAT.can_id, BEAT.pack(1, lifecycle, 1000, 7))


OTHER = Frame(0x100, make_heartbeat(Lifecycle.FINALIZED).data)  # the same bytes from somebody else
ENDED = make_heartbeat(Lifecycle.FINALIZED)
ACTIVE = make_heartbeat(Lifecycle.ACTIVE)


class Line:
    """A bus whose calls to receive each take a time [s], bring frames and, where `marked`, complete a sample.

    `timeouts` are the times for which it was asked to wait.
    """

    def __init__(self, *calls: tuple[float, list[Frame], bool]) -> None:
        self.calls, self.timeouts = list(calls), list[float]()
        self.inbox, self.count, self.marks, self.marked_ns, self.now = make_batch(16), 0, 5, 0, 100.0

    def receive(self, timeout: float) -> bool:
        self.timeouts.append(timeout)
        took, frames, marked = self.calls.pop(0)
        self.now += took
        self.count += load(self.inbox[self.count :], frames)
        self.marks += marked
        return bool(frames)


def wait(samples: ModuleType, line: Line, timeout: float = 1.0) -> bool:
    clock = SimpleNamespace(monotonic=lambda: line.now)
    with patch.object(samples, "time", clock):
        complete: bool = samples.Samples(line, FRAMES).wait_for_next(timeout)
    assert not line.calls  # it has not ended before
    return complete


# --- waiting ---------------------------------------------------------------------------------------------------------


def test_a_sample_ends_the_wait(samples: ModuleType) -> None:
    line = Line((0.25, [OTHER], True))
    assert wait(samples, line) is True
    assert line.timeouts == [1.0]


def test_other_frames_do_not_end_the_wait(samples: ModuleType) -> None:
    """It goes on for what remains of its time, to its very end."""
    line = Line((0.25, [OTHER], False), (0.5, [ACTIVE], False), (0.125, [OTHER], True))
    assert wait(samples, line) is True
    assert line.timeouts == [1.0, 0.75, 0.25]


def test_the_wait_ends_with_its_time(samples: ModuleType) -> None:
    for first in (0.25, 0.9375):
        line = Line((first, [OTHER], False), (1.0 - first, [OTHER], False))
        assert wait(samples, line) is False
        assert line.timeouts == [1.0, 1.0 - first]
    assert wait(samples, Line((1.5, [OTHER], False))) is False


def test_a_sample_counts_that_comes_after_the_time(samples: ModuleType) -> None:
    assert wait(samples, Line((1.5, [OTHER], True))) is True


def test_who_is_told_of_nothing_waits_no_longer(samples: ModuleType) -> None:
    """A signal may have come."""
    assert wait(samples, Line((0.25, [], False))) is False


def test_a_negative_time_looks_once(samples: ModuleType) -> None:
    line = Line((0.0, [], False))
    wait(samples, line, -3.0)
    assert line.timeouts == [0.0]


def test_the_end_of_the_plant_ends_the_wait(samples: ModuleType) -> None:
    assert wait(samples, Line((0.25, [ACTIVE], False), (0.25, [OTHER, ENDED, ACTIVE], False))) is False


def test_an_end_that_was_known_before_does_not(samples: ModuleType) -> None:
    """A plant that was started anew is waited for."""
    line = Line((0.25, [ACTIVE], False), (0.25, [ACTIVE], True))
    line.count = load(line.inbox, [ENDED, ENDED])
    assert wait(samples, line) is True


# --- the end of the plant, and times ---------------------------------------------------------------------------------


def test_a_plant_has_ended_when_its_heartbeat_says_so(samples: ModuleType) -> None:
    for frames, since, ended in (
        ([ENDED], 0, True), ([ACTIVE, OTHER, ENDED], 2, True), ([ENDED, ACTIVE], 1, False), ([ACTIVE, OTHER], 0, False),
        ([], 0, False),
    ):  # fmt: skip
        line = Line()
        line.count = load(line.inbox, frames)
        line.inbox[line.count :]["can_id"] = BEAT.can_id  # not received
        load(line.inbox[line.count :], [ENDED])
        result = samples.Samples(line, FRAMES)
        assert result.has_plant_ended(since) is ended
        if since == 0:
            assert result.has_plant_ended() is ended


def test_the_arrival_of_a_sample_is_that_of_its_stamp(samples: ModuleType) -> None:
    line: Any = SimpleNamespace(marked_ns=0)
    for stamp, arrived in ((9_000, 400), (9_599, 999), (9_600, 1_000), (9_700, 1_000)):  # the last is of the future
        line.marked_ns = stamp
        with patch.object(samples, "time", SimpleNamespace(monotonic_ns=lambda: 1_000, time_ns=lambda: 9_600)):
            assert samples.Samples(line, FRAMES).find_arrival_ns() == arrived


def test_the_usual_arrival_has_the_mean_phase(samples: ModuleType) -> None:
    for arrivals, usual in (
        ([7_300], 7_300),
        ([1_300, 2_300, 5_300], 5_300),
        ([0, 1_000, 2_000, 3_250], 3_051),  # three a quarter of a turn before the last: atan(3) of it is taken off
        ([250, 1_250, 2_250, 3_000], 3_199),
        ([950, 2_050], 2_000),  # the mean of phases on both sides of a period's end
    ):
        assert samples.estimate_usual_arrival(arrivals, PERIOD) == usual
