"""The plant's service: how it begins, runs and ends. Each test has the module as argument, so that it can run on mutants
(tests/mutation). All that it uses is made up (service_bench.py)."""

from copy import copy
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import plant_sim.node.plant_service
from protocols.can.frames import Frame, FrameCodec, list_bus_frames, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.errors import InputError
from tests.call_log import Opened
from tests.mutation.mutants import load_mutant, parse_plain
from tests.plant_sim.service_bench import ServiceBench

FRAMES = load_frames()
TIMES = 3.0, 4.0, 5.0, 6  # of a row: s, us, us, late cycles, as the bench's clock has them


@pytest.fixture
def plant_service() -> ModuleType:
    return load_mutant(parse_plain(plant_sim.node.plant_service))


# --- beginning and end -----------------------------------------------------------------------------------------------


class Scene:
    """A whole run of a service whose loops do nothing; `fails` is what they raise."""

    def __init__(
        self, module: ModuleType, lockstep: bool, fails: Exception | None = None, lost: int = 99, rate: int = 500
    ) -> None:
        self.bench = bench = ServiceBench(module, rate=rate, lockstep=lockstep, injections=("first", "second"), cpu=0)
        self.told, self.sent, self.lost = list[str](), list[Any](), lost
        self.log = bench.log
        bench.rig.make_node = self._make_node
        self.notifier = SimpleNamespace(stop=bench.note("stopping"), say=bench.note("say"))
        self.port, self.fails = Opened(name="local:resolved", send=self._send, read_counts=lambda: "counts"), fails
        for name, value in {
            "make_session": lambda: 9, "open_notifier": lambda: self.notifier,
            "Clock": bench.note("clock", "clock"), "Stop": lambda: Opened(asked=False, wakes=8), "open_bus": self._open,
            "check_alone": bench.note("alone"), "Exchange": bench.note("exchange", "line"), "Outlet": self._make_outlet,
            "realtime": SimpleNamespace(
                prepare=bench.note("prepare", ["no lock"]), relax=bench.note("relax"), check_cpu=lambda cpu: cpu,
            ),
            "Footprint": lambda: SimpleNamespace(summarise=lambda: "footprint"),
        }.items():  # fmt: skip
            setattr(module, name, value)
        for name in ("_await_controller", "_run_in_lockstep", "_run_in_real_time"):
            object.__setattr__(bench.service, name, self._make_part(name))

    def run(self) -> dict[str, Any]:
        summary: dict[str, Any] = self.bench.service.run(self.told.append)
        return summary

    def _make_node(self, *arguments: Any, **named: Any) -> Any:
        self.log.append(("node", *arguments, named))
        return self.bench.node

    def _send(self, frame: Any) -> None:
        if len(self.sent) == self.lost:
            raise OSError("the bus is gone")
        self.sent.append(frame)
        self.log.append(("sent", frame))

    def _open(self, name: str) -> Any:
        self.log.append(("open", name))
        return self.port

    def _make_outlet(self, *arguments: Any, **named: Any) -> Any:
        self.outlet = (arguments, named)
        outlet: Any = SimpleNamespace(
            make_beat=self.bench.note("beat", "beat"), close=self.bench.note("close", {"rows": 5})
        )
        return outlet

    def _make_part(self, name: str) -> Any:
        def part(node: Any, *more: Any) -> Any:
            self.log.append((name, node is self.bench.node, more[0]))
            if name.startswith("_run"):
                assert more[2] == "beat"
            if self.fails and name != "_await_controller":
                raise self.fails
            return "timing"

        return part


BEGUN = [
    ("open", "local:made-up"), ("alone", "plant", FRAMES["PLANT_HEARTBEAT"]), ("exchange", FRAMES["VALVE_COMMAND"].can_id, 8),
]  # fmt: skip
ENDED = [("stopping",), ("sent", "safe"), ("sent", "last"), ("relax",), ("close",)]


def list_known(scene: Scene) -> list[tuple[Any, ...]]:
    """Calls from the opening of the bus on, without the made-up port and notifier among their arguments."""
    calls = [tuple(one for one in call if one is not scene.port and one is not scene.notifier) for call in scene.log]
    return calls[calls.index(BEGUN[0]) :]


def test_what_cannot_be_is_refused_when_the_service_is_made(plant_service: ModuleType) -> None:
    rig = ServiceBench(plant_service).rig
    for name, value in {"temperature": float("nan"), "router": "nonsense", "cpu": 100_000}.items():
        with pytest.raises(InputError):
            plant_service.PlantService("local:made-up", 500, rig, **{name: value})


def test_a_run_in_real_time_ends_with_the_last_frames(plant_service: ModuleType) -> None:
    scene = Scene(plant_service, lockstep=False)
    assert scene.run() == {
        "bus": "local:resolved", "rate_hz": 500, "lockstep": False, "samples": 5, "timing": "timing",
        "footprint": "footprint", "not_available": ["no lock"], "port": "counts", "frames": "receptions",
        "stray_frames": "strays", "first_rejected": "rejected", "rows": 5,
    }  # fmt: skip
    assert scene.told == ["plant on local:resolved at 500 Hz, real time", "note: no lock"]
    assert list_known(scene) == [
        *BEGUN, ("beat", "clock"), ("prepare", 0), ("_await_controller", True),
        ("say", "simulates at 500 Hz on local:resolved"), ("_run_in_real_time", True, "line"), *ENDED,
    ]  # fmt: skip
    assert ("clock", 2_000_000) in scene.log
    assert ("beat", "clock", scene.notifier) in scene.log
    assert scene.outlet[1]["about"]["bus_faults"]


def test_the_end_of_the_profile_is_published(plant_service: ModuleType) -> None:
    scene = Scene(plant_service, lockstep=False)
    scene.run()
    assert scene.outlet[1]["about"]["profile_end_s"] is None
    object.__setattr__(scene.bench.service, "profile", SimpleNamespace(duration=12.0))
    scene.run()
    assert scene.outlet[1]["about"]["profile_end_s"] == 12.0


@pytest.mark.parametrize("lockstep", [False, True])
def test_any_error_of_a_node_of_a_user_is_told_with_its_class(plant_service: ModuleType, lockstep: bool) -> None:
    scene = Scene(plant_service, lockstep=lockstep, fails=TypeError("wrong"))
    with pytest.raises(InputError, match=r"^the node SimpleNamespace of .*types.py raises TypeError: wrong$"):
        scene.run()
    assert list_known(scene)[-len(ENDED) :] == ENDED  # the valve is closed all the same


def test_a_period_is_of_whole_nanoseconds(plant_service: ModuleType) -> None:
    scene = Scene(plant_service, lockstep=False, rate=7)
    scene.run()
    assert ("clock", 142_857_142) in scene.log


def test_a_run_in_step_leaves_the_machine_as_it_is(plant_service: ModuleType) -> None:
    scene = Scene(plant_service, lockstep=True)
    summary = scene.run()
    assert (summary["timing"], summary["footprint"], summary["not_available"]) == (None, None, [])
    assert scene.told == ["plant on local:resolved at 500 Hz, lock-step"]
    assert list_known(scene) == [
        *BEGUN, ("beat", "clock"), ("_await_controller", True), ("say", "simulates at 500 Hz on local:resolved"),
        ("_run_in_lockstep", True, "line"), *ENDED,
    ]  # fmt: skip
    assert scene.outlet[1]["about"]["bus_faults"] == []


def test_what_ends_a_run_is_raised_after_the_last_frames(plant_service: ModuleType) -> None:
    for lockstep in (False, True):
        scene = Scene(plant_service, lockstep, InputError("no answer"))
        with pytest.raises(InputError, match="no answer"):
            scene.run()
        assert scene.log[-len(ENDED) :] == ENDED


def test_on_a_bus_that_is_gone_the_rest_is_closed(plant_service: ModuleType) -> None:
    for lost in (0, 1):
        scene = Scene(plant_service, lockstep=False, lost=lost)
        assert scene.run()["rows"] == 5
        assert scene.log[-3 - lost :] == [("stopping",), *ENDED[1 : 1 + lost], *ENDED[3:]]


def test_a_node_is_made_as_the_settings_say(plant_service: ModuleType) -> None:
    for lockstep in (False, True):
        scene = Scene(plant_service, lockstep)
        scene.run()
        assert scene.log[0] == ("node", 500, None, None, 1, None, {"session": 9, "blind": False})
        assert scene.log[1] == ("node.inject", "first", "second")
        assert scene.bench.node.lockstep is lockstep
        assert scene.outlet[1]["publish"] is True


def test_without_more_settings_a_plant_runs_in_real_time(plant_service: ModuleType) -> None:
    service: Any = plant_service.PlantService("bus", 500, None)
    assert (service.lockstep, service.seed, service.blind, service.telemetry) == (False, 1, False, True)


def test_all_is_compiled_before(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service)
    bench.node.warm = bench.note("warm")
    plant_service.compile_record_cycle = bench.note("compile")  # type: ignore[attr-defined]
    bench.service.warm()
    assert bench.log == [("warm",), ("compile",)]


# --- until a controller comes ----------------------------------------------------------------------------------------


def watch_size(bench: ServiceBench) -> None:
    """Note what is watched for frames of a bench of another size."""

    def make_watch(codecs: list[FrameCodec], where: str) -> Any:
        bench.log.append(("watches", [codec.name for codec in codecs], where))
        return SimpleNamespace(hear=bench.note("watched"))

    bench.module.SizeWatch = make_watch  # type: ignore[attr-defined]


def await_controller(bench: ServiceBench, heard: list[Lifecycle]) -> list[tuple[Any, ...]]:
    bench.module.listen = lambda port, seconds: ("heard", seconds)  # type: ignore[attr-defined]
    watch_size(bench)
    bench.node.receive = lambda frames: setattr(bench.node, "controller", heard.pop(0))
    bench.node.controller = Lifecycle.INACTIVE
    port = SimpleNamespace(name="bus", send=bench.note("sent"))
    notifier = SimpleNamespace(say=bench.note("say"), extend_start=bench.note("extend"))
    bench.service._await_controller(bench.node, port, bench.outlet, bench, notifier)
    return bench.log


def test_a_plant_says_that_it_is_there_until_a_controller_is_active(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service)
    log = await_controller(bench, [Lifecycle.INACTIVE, Lifecycle.ACTIVE])
    once = [("sent", ("heartbeat", Lifecycle.INACTIVE)), ("extend",), ("tune",), ("watched", ("heard", 0.05))]
    watches = ("watches", [codec.name for codec in list_bus_frames(clutches=2)], "on bus")
    assert log == [("say", "waits for a controller on bus"), watches, *once, *once]


def test_it_hears_for_the_period_of_a_heartbeat(plant_service: ModuleType) -> None:
    bench, heard = ServiceBench(plant_service, stops=1), list[Any]()
    watch_size(bench)
    plant_service.listen = lambda port, seconds: heard.append(seconds)  # type: ignore[attr-defined]
    port = SimpleNamespace(name="bus", send=bench.note("sent"))
    notifier = SimpleNamespace(say=bench.note("say"), extend_start=bench.note("extend"))
    bench.node.controller = Lifecycle.INACTIVE
    bench.service._await_controller(bench.node, port, bench.outlet, bench, notifier)
    assert heard == [0.05]
    assert bench.list_calls("node.receive") == [("node.receive", None)]


def test_a_stop_ends_the_wait_for_a_controller(plant_service: ModuleType) -> None:
    for stops in (0, 3):
        bench = ServiceBench(plant_service, stops)
        await_controller(bench, [Lifecycle.INACTIVE] * 9)
        assert len(bench.list_calls("sent")) == stops


def test_controllers_of_a_bench_of_another_size_are_not_waited_for(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service, stops=9)
    heartbeat = FRAMES["CONTROLLER_HEARTBEAT"]
    other = copy(heartbeat)
    other.data_id ^= 0x0A11
    other._make_functions()
    plant_service.listen = lambda port, seconds: [Frame(other.can_id, other.pack(len(bench.log)))]  # type: ignore[attr-defined]
    port = SimpleNamespace(name="bus", send=bench.note("sent"))
    notifier = SimpleNamespace(say=bench.note("say"), extend_start=bench.note("extend"))
    bench.node.controller = Lifecycle.INACTIVE
    with pytest.raises(InputError, match="frames CONTROLLER_HEARTBEAT on bus come from a bench of another size"):
        bench.service._await_controller(bench.node, port, bench.outlet, bench, notifier)
    assert len(bench.list_calls("sent")) == 2


# --- in real time ----------------------------------------------------------------------------------------------------


def test_it_runs_in_compiled_calls_until_a_stop(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service, stops=2)
    assert bench.run_real_time() == "summary 5"
    first = plant_service.find_first_slot(50_000_000_000, 2_000_000)
    cycle = [("run_real_time", bench.line, bench.beat, 7, 0), ("record", "record", 7)]
    assert bench.log == [("start", first), *cycle, *cycle]
    assert bench.node.late_cycles == 6


def test_samples_that_are_owed_follow_at_once_and_then_an_answer_is_waited_for(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service, stops=4)
    bench.node.run_real_time = bench.note("run_real_time", 2, 1, 0, 0)
    bench.run_real_time()
    row, ended = ("write", "record", *TIMES), ("record", "record", 7)
    calls = [("run_real_time", bench.line, bench.beat, 7, owed) for owed in (0, 2, 1, 0)]
    assert bench.log[1:] == [calls[0], row, calls[1], row, calls[2], ended, ("receive", 0.001), calls[3], ended]


def test_where_something_changes_a_sample_is_made_in_python(plant_service: ModuleType) -> None:
    for steady, changes in ((False, False), (True, True), (False, True)):
        bench = ServiceBench(plant_service, stops=1)
        bench.node.steady, bench.outlet.has_change = steady, lambda changes=changes: changes
        bench.line.count = 12
        bench.run_real_time()
        assert bench.log[1:] == [
            ("wait",), ("node.advance",), ("tune",), ("receive",), ("node.take", "inbox", 12), ("clear",),
            ("node.skip_periods", 0), ("show",), ("send", "outbox", 3), ("record", "record", 7),
        ]  # fmt: skip


def test_frames_in_the_inbox_are_kept_for_the_next_sample_that_waits(plant_service: ModuleType) -> None:
    """Who was admitted after a sample has sent them. A compiled call would lose them: samples that are owed take none."""
    bench = ServiceBench(plant_service, stops=2)
    bench.node.run_real_time, bench.line.count = bench.note("run_real_time", 1), 1
    bench.run_real_time()
    assert bench.list_calls("run_real_time", "node.take", "clear") == [("run_real_time", bench.line, bench.beat, 7, 0)]
    assert bench.list_calls("show") == [("show",)]


def test_samples_that_are_owed_in_python_take_no_frames(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service, stops=4)
    bench.node.steady, bench.clock.wait = False, bench.note("wait", 2, 0)
    bench.run_real_time()
    made = [("show",), ("send", "outbox", 3)]
    taken = ("receive",), ("node.take", "inbox", 0), ("clear",)
    row, ended, answer = ("write", "record", *TIMES), ("record", "record", 7), ("receive", 0.001)
    assert bench.log[1:] == [
        ("wait",), ("node.advance",), ("tune",), *taken, ("node.skip_periods", 2), *made, row,
        ("node.advance",), ("tune",), *made, row,
        ("node.advance",), ("tune",), *made, ended, answer,
        ("wait",), ("node.advance",), ("tune",), *taken, ("node.skip_periods", 0), *made, ended,
    ]  # fmt: skip


def test_a_sample_in_python_with_a_slot_missed_before_is_followed_by_its_answer(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service, stops=2)
    bench.node.steady, bench.clock.wait = False, bench.note("wait", 1)
    bench.run_real_time()
    assert bench.list_calls("write", "record", "receive") == [
        ("receive",), ("write", "record", *TIMES), ("record", "record", 7), ("receive", 0.001),
    ]  # fmt: skip


def test_before_its_first_sample_a_rig_does_not_move(plant_service: ModuleType) -> None:
    for tick, moves in ((-1, 0), (0, 1), (1, 1)):
        bench = ServiceBench(plant_service, stops=1)
        bench.node.steady, bench.node.tick = False, tick
        bench.run_real_time()
        assert len(bench.list_calls("node.advance")) == moves


def test_the_timing_is_that_of_the_profile(plant_service: ModuleType) -> None:
    """Without what follows: the controller ends, and the plant waits for a stop."""
    bench = ServiceBench(plant_service, stops=3)

    def run(*_: Any) -> int:
        bench.log.append(("run_real_time",))
        bench.node.finished = len(bench.log) > 3
        return 0

    bench.node.run_real_time = run
    assert bench.run_real_time() == "summary 5"
    assert len(bench.log) == 7
    bench = ServiceBench(plant_service, stops=2)
    bench.node.finished = True
    assert bench.run_real_time() == "summary 3"


def test_the_first_slot_is_a_quarter_after_a_tick_of_the_kernel(plant_service: ModuleType) -> None:
    for now, period, slot in (
        (10_000_000, 2_000_000, 14_250_000),
        (11_999_999, 2_000_000, 14_250_000),
        (12_000_000, 2_000_000, 16_250_000),
        (10_000_000, 1_000_000, 12_250_000),
        (10_000_000, 400_000, 10_900_000),
    ):
        assert plant_service.find_first_slot(now, period) == slot


# --- in lock-step ----------------------------------------------------------------------------------------------------


def test_in_step_it_runs_in_compiled_calls(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service, stops=4)  # a look before each sample, and one at its answer
    bench.line.count = 12
    bench.run_lockstep()
    once = [("run_lockstep", bench.line, bench.beat, 7), ("node.take", "inbox", 12), ("clear",), ("tune",)]
    assert bench.log[: len(once)] == once
    assert len(bench.list_calls("run_lockstep")) > 1
    assert bench.list_calls("write", "receive") == []


def test_in_step_no_sample_is_made_while_whoever_collects_the_rows_is_behind(plant_service: ModuleType) -> None:
    for backlog, made in ((8192, 4), (8193, 0)):
        bench = ServiceBench(plant_service, stops=4)
        bench.outlet.backlog = backlog
        bench.run_lockstep()
        assert len(bench.list_calls("run_lockstep")) == made
        assert bench.list_calls("sleep") == (0 if made else 4) * [("sleep", 0.005)]


def test_in_step_the_row_of_a_last_sample_is_written_by_python(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service, stops=1)
    bench.node.run_lockstep = bench.note("run_lockstep", False)
    bench.run_lockstep()
    assert bench.list_calls("write") == [("write", "record", 50.0, 0.0, 0.0, 0)]


def test_in_step_where_something_changes_a_sample_is_made_in_python(plant_service: ModuleType) -> None:
    for steady, changes in ((False, False), (True, True), (False, True)):
        bench = ServiceBench(plant_service, stops=1)
        bench.node.steady, bench.outlet.has_change = steady, lambda changes=changes: changes
        bench.run_lockstep()
        assert bench.log == [
            ("show",), ("send", "outbox", 3), ("node.advance",), ("write", "record", 50.0, 0.0, 0.0, 0), ("tune",),
        ]  # fmt: skip


def test_in_step_it_ends_with_the_profile(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service)
    bench.node.finished = True
    bench.run_lockstep()
    assert bench.log == []


def answer_after(bench: ServiceBench, calls: int, tick: int, seconds: float = 0.125) -> None:
    """Let the answer to `tick` come with call number `calls`, each of which takes `seconds`."""
    received = list[float]()

    def receive(timeout: float) -> None:
        bench.log.append(("receive", timeout))
        bench.now += seconds
        received.append(timeout)
        assert len(received) < 1000
        if len(received) == calls:
            bench.node.answered_tick = tick
            bench.node.finished = True

    bench.line.receive = receive


def test_in_step_an_answer_is_awaited_with_looks_at_a_stop(plant_service: ModuleType) -> None:
    for made, tick in ((4, 4), (0x405, 5)):  # a command has 10 bits of the tick
        bench = ServiceBench(plant_service)
        bench.node.tick, bench.node.answered_tick, bench.line.count = made, 1, 12
        answer_after(bench, 3, tick)
        bench.run_lockstep()
        assert bench.log[4:] == 3 * [("receive", 0.2), ("node.take", "inbox", 12), ("clear",)]


def test_in_step_a_stop_ends_the_wait_for_an_answer(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service, stops=3)
    bench.node.answered_tick = 1
    answer_after(bench, 0, 4)
    bench.run_lockstep()
    assert len(bench.list_calls("receive")) == 2
    assert len(bench.list_calls("run_lockstep")) == 1


def test_in_step_the_end_of_the_controller_ends_the_plant(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service)
    bench.node.answered_tick, bench.node.controller = 1, Lifecycle.FINALIZED
    answer_after(bench, 0, 4)
    bench.run_lockstep()
    assert len(bench.list_calls("receive")) == 1


def test_in_step_a_controller_that_is_silent_for_5_s_is_an_error(plant_service: ModuleType) -> None:
    """At 5 s it still may answer, and what comes with the last look is an answer."""
    bench = ServiceBench(plant_service)
    bench.node.answered_tick = 1
    answer_after(bench, 0, 4)
    with pytest.raises(InputError, match="the controller on local:made-up has not answered for 5 s of lock-step"):
        bench.run_lockstep()
    assert len(bench.list_calls("receive")) == 41  # of 1/8 s
    bench = ServiceBench(plant_service)
    bench.node.answered_tick = 1
    answer_after(bench, 1, 4, seconds=60.0)
    bench.run_lockstep()
    assert len(bench.list_calls("receive")) == 1


def test_in_step_the_time_for_an_answer_begins_anew_with_each_sample(plant_service: ModuleType) -> None:
    bench = ServiceBench(plant_service, stops=3)
    bench.node.run_lockstep = lambda *_: setattr(bench, "now", bench.now + 60.0)
    bench.run_lockstep()
