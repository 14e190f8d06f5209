"""The loops of the controller's service: until a plant comes, warm-up, in real time, in lock-step. Each test has the module as
argument, so that it can run on mutants (tests/mutation). Bus, clock and cycle are made up (service_bench.py)."""

from collections.abc import Callable
from copy import copy
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import rt_controller.loop.service
from protocols.can.frame_batch import load, make_batch, unload
from protocols.can.frames import Frame, FrameCodec, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.errors import InputError
from protocols.realtime.overrun import OverrunError
from tests.call_log import NEVER
from tests.mutation.mutants import load_mutant, parse_plain
from tests.rt_controller.service_bench import ServiceBench

HEARTBEAT = Frame(1, b"plant")  # what a node takes before its first cycle


@pytest.fixture
def service() -> ModuleType:
    return load_mutant(parse_plain(rt_controller.loop.service))


# --- until a plant comes ---------------------------------------------------------------------------------------------


class Waiting(ServiceBench):
    """A controller that waits for a plant. coming: frames of each look at the bus; complete: looks until a sample is there."""

    def __init__(
        self,
        module: ModuleType,
        coming: list[list[Frame]],
        complete: int = NEVER,
        stops: int = NEVER,
        **settings: Any,
    ) -> None:
        super().__init__(module, stops, **settings)
        self.coming, self.complete = coming, complete
        self.node.listen = lambda frames: [frame for frame in frames if frame != HEARTBEAT]
        self.line: Any = SimpleNamespace(inbox=make_batch(200), count=0, port=self.port, clear=self._clear)
        samples = SimpleNamespace(line=self.line, wait_for_next=self._wait_for_next)
        self.service._await_plant(self.node, samples, self.outlet, self, self.notifier)

    def _wait_for_next(self, seconds: float) -> bool:
        self.log.append(("wait", seconds))
        self.line.count += load(self.line.inbox[self.line.count :], self.coming.pop(0))
        self.complete -= 1
        return self.complete == 0

    def _clear(self) -> None:
        self.line.count = 0

    def list_inbox(self) -> list[Frame]:
        return unload(self.line.inbox[: self.line.count])


def number(first: int, end: int) -> list[Frame]:
    """Frames with these numbers."""
    return [Frame(0x100, bytes([count])) for count in range(first, end)]


def make_other(clutch: str, name: str) -> FrameCodec:
    """A frame of clutch a or b as that of a bench of another size."""
    other = copy(load_frames(clutch=clutch)[name])
    other.data_id ^= 0x0A11
    other._make_functions()
    return other


def test_a_plant_of_a_bench_of_another_size_is_not_waited_for(service: ModuleType) -> None:
    for clutch, name in (("a", "ENCODER"), ("b", "ENCODER_B")):
        other = make_other(clutch, "ENCODER")
        coming = [[Frame(other.can_id, other.pack(count))] for count in range(3)]
        sentence = f"frames {name} on local:resolved come from a bench of another size"
        with pytest.raises(InputError, match=sentence):
            Waiting(service, coming, complete=3, clutch=clutch)
    of_a = make_other("a", "VALVE_COMMAND")
    others = [[Frame(of_a.can_id, of_a.pack(count))] for count in range(3)]
    Waiting(service, others, complete=3, clutch="b")  # frames that a controller of clutch b does not read


def test_a_controller_says_that_it_is_there_until_a_sample_is_complete(service: ModuleType) -> None:
    waiting = Waiting(service, [[], [], []], complete=3)
    once = [("sent", ("heartbeat", Lifecycle.ACTIVE)), ("extend",), ("tune",), ("wait", 0.05)]
    assert waiting.log == [("say", "waits for samples of a plant, or rig, on local:resolved"), *once, *once, *once]
    assert waiting.list_inbox() == []


def test_frames_before_the_first_sample_are_kept_for_its_cycle(service: ModuleType) -> None:
    """But for those that the node takes before it."""
    waiting = Waiting(service, [[*number(0, 2), HEARTBEAT], [HEARTBEAT], number(2, 5)], complete=3)
    assert waiting.list_inbox() == number(0, 5)


def test_of_many_frames_before_the_first_sample_the_last_64_are_kept(service: ModuleType) -> None:
    for coming, kept in (
        ([number(0, 64)], number(0, 64)),
        ([number(0, 65)], number(1, 65)),
        ([number(0, 40), number(40, 70), number(70, 80)], number(16, 80)),
    ):
        assert Waiting(service, list(coming), complete=len(coming)).list_inbox() == kept


def test_a_stop_ends_the_wait_for_a_plant(service: ModuleType) -> None:
    for stops in (0, 2):
        waiting = Waiting(service, [number(0, 1), number(1, 2)], stops=stops)
        assert len(waiting.list_calls("sent")) == stops
        assert waiting.list_inbox() == number(0, stops)


# --- warm-up ---------------------------------------------------------------------------------------------------------


class Loops(ServiceBench):
    """A controller with a made-up turn and a clock with 6 late cycles. in_step: what its turns in lock-step return.

    next_samples: whether one comes in time, for each wait; ended: whether the plant has ended, for each look.
    """

    def __init__(
        self,
        module: ModuleType,
        stops: int = NEVER,
        rate: int = 500,
        in_step: tuple[tuple[bool, bool], ...] = ((True, True),),
        next_samples: tuple[bool, ...] = (True,),
        ended: tuple[bool, ...] = (False,),
    ) -> None:
        super().__init__(module, stops, rate)
        self.samples = SimpleNamespace(
            line=SimpleNamespace(port=self.port), wait_for_next=self.note("wait", *next_samples),
            find_arrival_ns=self.note("arrival", *range(1000, 1200)), has_plant_ended=self.note("ended", *ended),
        )  # fmt: skip
        self.turn = SimpleNamespace(
            samples=self.samples, node=self.node, answer=self.note("answer"),
            answer_in_step=self.note("in_step", *in_step),
        )  # fmt: skip
        self.clock: Any = SimpleNamespace(
            period_ns=2_000_000, woken_ns=3_000_000_000, lateness_ns=4_000, work_ns=5_000, late=6,
            end_cycle=self.note("end"),
        )  # fmt: skip
        self.beat = SimpleNamespace(record_cycle=self.note("record"), clock=self.clock)
        self.trigger: Any = SimpleNamespace(clock=self.clock, start=self.note("start"), run=self.note("run"))
        module.estimate_usual_arrival = self.note("usual", 777)  # type: ignore[attr-defined]
        module.Footprint = self._measure  # type: ignore[attr-defined]

    def _measure(self) -> Any:
        self.log.append(("measure",))
        return SimpleNamespace(summarise=self.note("summarise", "footprint"))

    def warm_up(self) -> list[tuple[Any, ...]]:
        self.service._warm_up(self.node, self.turn, self.outlet, self.trigger)
        return self.log

    def run_real_time(self) -> Any:
        return self.service._run_in_real_time(self.node, self.outlet, self.beat, self.trigger, self)

    def run_lockstep(self) -> list[tuple[Any, ...]]:
        self.service._run_in_lockstep(self.turn, self.outlet, self.beat, self)
        return self.log


WRITTEN = ("write", "record", 50.0, 0.0, 0.0, 0)  # a row without timing
CYCLE = [("answer", 1), WRITTEN, ("tune",)]


def test_a_warm_up_runs_at_the_pace_of_the_plant_and_then_sets_the_grid(service: ModuleType) -> None:
    """A sample may be late by a period."""
    paced = [*CYCLE, ("wait", 0.05), ("arrival",)]
    assert Loops(service, rate=40).warm_up() == [
        *paced, *paced, *CYCLE, ("usual", [1000, 1001], 2_000_000), ("start", 777),
    ]  # fmt: skip


def test_a_warm_up_takes_50_ms_and_a_cycle_at_least(service: ModuleType) -> None:
    for rate, cycles in ((1, 1), (10, 1), (20, 1), (500, 25), (2000, 100)):
        loops = Loops(service, rate=rate)
        assert loops.warm_up().count(("arrival",)) == cycles
        assert len(loops.list_calls("answer")) == cycles + 1


# --- in real time ----------------------------------------------------------------------------------------------------


def test_it_runs_by_the_trigger_until_a_stop(service: ModuleType) -> None:
    for stops in (0, 1, 3):
        loops = Loops(service, stops)
        assert loops.run_real_time() == "footprint"
        assert loops.log == [("measure",), *stops * [("run", 7), ("record", "record", 7)], ("summarise",)]


def test_where_a_parameter_changes_the_cycle_is_ended_after_the_change(service: ModuleType) -> None:
    """Its row is of before, in s and us."""
    loops, changes = Loops(service, stops=2), [True, False]
    loops.outlet.has_change = lambda: changes.pop(0)
    loops.run_real_time()
    assert loops.log[1:-1] == [
        ("run", 7), ("write", "record", 3.0, 4.0, 5.0, 6), ("tune",), ("end",), ("run", 7), ("record", "record", 7),
    ]  # fmt: skip


def test_the_next_cycle_tells_how_many_were_late(service: ModuleType) -> None:
    for change in (False, True):
        loops, sentence = Loops(service, stops=3), list[int]()
        loops.outlet.has_change = lambda change=change: change
        loops.trigger.run = make_late(loops, sentence)
        loops.run_real_time()
        assert (sentence, loops.node.late_cycles) == ([-1, 7, 8], 9)


def make_late(loops: Loops, sentence: list[int]) -> Callable[[int], None]:
    """A run of which each cycle is late; it notes the number of late cycles that the node tells."""

    def run(changes: int) -> None:
        sentence.append(loops.node.late_cycles)
        loops.clock.late += 1

    return run


def test_an_overrun_ends_it(service: ModuleType) -> None:
    loops = Loops(service)

    def run(changes: int) -> None:
        raise OverrunError("2 cycles were missed")

    loops.trigger.run = run
    with pytest.raises(OverrunError, match="2 cycles were missed"):
        loops.run_real_time()


# --- in lock-step ----------------------------------------------------------------------------------------------------


def test_in_step_it_answers_complete_samples_until_a_stop(service: ModuleType) -> None:
    for stops in (0, 1, 3):
        loops = Loops(service, stops, ended=(True,))  # a sample that has come is answered
        assert loops.run_lockstep() == stops * [("in_step", loops.beat, 7), ("tune",)]


def test_in_step_a_last_row_that_is_not_written_is_written_by_python(service: ModuleType) -> None:
    for complete in (True, False):
        loops = Loops(service, stops=2, in_step=((False, complete), (True, complete)))
        assert loops.run_lockstep()[:3] == [("in_step", loops.beat, 7), WRITTEN, ("tune",)]
        assert len(loops.list_calls("write")) == 1


def test_in_step_the_next_sample_is_waited_for(service: ModuleType) -> None:
    loops = Loops(service, stops=4, in_step=((True, False),))  # two looks at each sample
    once = [("in_step", loops.beat, 7), ("tune",), ("ended",), ("wait", 5.0)]
    assert loops.run_lockstep() == [*once, *once]


def test_in_step_the_end_of_the_plant_ends_the_controller(service: ModuleType) -> None:
    """Before a wait for a sample, or in one."""
    loops = Loops(service, in_step=((True, False),), ended=(True,))
    assert ("wait", 5.0) not in loops.run_lockstep()
    loops = Loops(service, in_step=((True, False),), next_samples=(True, False), ended=(False, False, True))
    assert [call for call in loops.run_lockstep() if call[0] in ("in_step", "wait")] == [
        ("in_step", loops.beat, 7), ("wait", 5.0), ("in_step", loops.beat, 7), ("wait", 5.0),
    ]  # fmt: skip


def test_in_step_a_plant_that_is_silent_for_5_s_is_an_error(service: ModuleType) -> None:
    loops = Loops(service, in_step=((True, False),), next_samples=(False,))
    with pytest.raises(InputError, match="the plant on local:resolved has been silent for 5 s of lock-step"):
        loops.run_lockstep()
    assert loops.list_calls("wait") == [("wait", 5.0)]


def test_in_step_a_plant_may_be_silent_while_whoever_collects_the_rows_is_behind(service: ModuleType) -> None:
    loops = Loops(service, in_step=((True, False),))
    loops.outlet.backlog = 2

    def wait(seconds: float) -> bool:
        loops.log.append(("wait", seconds))
        loops.outlet.backlog -= 1
        return False

    loops.samples.wait_for_next = wait
    with pytest.raises(InputError, match="has been silent for 5 s of lock-step"):
        loops.run_lockstep()
    assert loops.list_calls("in_step", "wait") == [("in_step", loops.beat, 7), *3 * [("wait", 5.0)]]


def test_in_step_a_stop_ends_a_wait_for_whoever_collects_the_rows(service: ModuleType) -> None:
    loops = Loops(service, stops=4, in_step=((True, False),), next_samples=(False,))
    loops.outlet.backlog = 3
    loops.run_lockstep()
    assert loops.list_calls("in_step", "wait") == [("in_step", loops.beat, 7), *3 * [("wait", 5.0)]]
