"""The controller's service: its settings, and how a run begins and ends. Each test has the module as argument, so that it can
run on mutants (tests/mutation). All that a run uses is made up (service_bench.py)."""

from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import rt_controller.loop.service
from protocols.can.frames import load_frames
from protocols.errors import InputError
from protocols.realtime.overrun import OverrunError
from protocols.realtime.rights import PRIORITY
from rt_controller.loop.cycle_record import COLUMNS
from tests.call_log import Opened
from tests.mutation.mutants import load_mutant, parse_plain
from tests.rt_controller.service_bench import ServiceBench

PARTS = "_await_plant", "_warm_up", "_run_in_real_time", "_run_in_lockstep"
NOTE_OF_TWO = "note: no adaptation with two clutches: the motor's torque belongs to both"


@pytest.fixture
def service() -> ModuleType:
    return load_mutant(parse_plain(rt_controller.loop.service))


class Scene(ServiceBench):
    """A whole run of a service whose parts do nothing, but the one that `fails` with an error."""

    def __init__(self, module: ModuleType, fails: tuple[str, Exception] | None = None, **settings: Any) -> None:
        super().__init__(module, **settings)
        self.fails, self.stop = fails, Opened(wakes=8)
        self.port = Opened(**vars(self.port), read_counts=lambda: "counts", close=self.note("port closed"))
        self.outlet = SimpleNamespace(
            make_beat=self.note("beat", "beat"), close=self.note("outlet closed", {"rows": 5})
        )
        self.clock = SimpleNamespace(summarise=lambda: "timing")
        self.faults = SimpleNamespace(count=2, first=SimpleNamespace(line="the first"))
        self.node = SimpleNamespace(
            received_ids=[1, 2], listen=self.note("listen"), parameters=make_parameters("first"),
            list_safe_frames=lambda: ["valve", "motor"], watch_faults=lambda: self.faults, first_rejected="rejected",
            count_receptions=lambda: "receptions", count_strays=lambda: "strays", describe_claim=lambda: "claim",
        )  # fmt: skip
        for name, value in {
            "make_session": self.note("session", 9), "find_trigger": self.note("choose", self.note("trigger", "begins")),
            "open_notifier": lambda: self.notifier, "ControllerNode": self.note("node", self.node),
            "Clock": self.note("clock", self.clock),
            "choose_waiting": lambda spin, period: ("waiting", spin, period),
            "find_overrun_policy": lambda name: ("policy", name), "Stop": lambda: self.stop,
            "open_bus": self.note("open", self.port), "check_alone": self.note("alone", "heard"),
            "Exchange": self.note("line", "line"), "Samples": self.note("samples", "samples"),
            "Outlet": self.note("outlet", self.outlet), "load_shipped_parameters": lambda: "shipped",
            "Turn": self.note("turn", "turn"),
            "realtime": SimpleNamespace(
                PRIORITY=PRIORITY, prepare=self.note("prepare", ["no lock", "no CPU"]), relax=self.note("relax"),
                check_cpu=lambda cpu: cpu,
            ),
        }.items():  # fmt: skip
            setattr(module, name, value)
        for name in PARTS:
            object.__setattr__(self.service, name, self._make_part(name))

    def run(self) -> dict[str, Any]:
        summary: dict[str, Any] = self.service.run(self.note("tell"))
        return summary

    def _make_part(self, name: str) -> Any:
        noted = self.note(name, "footprint" if name == "_run_in_real_time" else None)

        def part(*arguments: Any) -> Any:
            result = noted(*arguments)
            self.node.parameters = make_parameters("changed")
            if self.fails and self.fails[0] == name:
                raise self.fails[1]
            return result

        return part

    def list_ended(self, cycle: float = 0.002) -> list[tuple[Any, ...]]:
        """Calls that end a run with a `cycle` [s]: the manager is told, the valve is closed, then the rest."""
        sent = [("sent", "valve"), ("sent", "motor"), ("sleep", cycle)]
        return [("stopping",), *sent, *sent, *sent, ("relax",), ("port closed",), ("outlet closed",)]


def make_parameters(value: str) -> Any:
    return SimpleNamespace(as_values=lambda: value)


# --- settings --------------------------------------------------------------------------------------------------------


def test_without_more_settings_a_controller_runs_in_real_time_and_sleeps(service: ModuleType) -> None:
    made = service.ControllerService("bus", 500)
    assert (made.lockstep, made.adaptation, made.telemetry, made.spin_us) == (False, True, True, 0.0)


def test_only_the_controller_of_clutch_b_has_a_name_of_its_own(service: ModuleType) -> None:
    for clutch, name in ((None, "controller"), ("a", "controller"), ("b", "controller_b")):
        assert service.ControllerService("bus", 500, clutch=clutch).name == name


def test_who_answers_a_sample_at_once_goes_before_the_plant(service: ModuleType) -> None:
    """Up to 1 kHz; otherwise it goes behind."""
    for rate, trigger, above in (
        (1000, "bus", 1), (500, "bus", 1), (1001, "bus", -1), (4000, "bus", -1), (1000, "clock", -1), (500, "pll", -1),
    ):  # fmt: skip
        assert service.ControllerService("bus", rate, trigger=trigger).priority == PRIORITY + above


def test_all_is_compiled_before(service: ModuleType) -> None:
    bench = ServiceBench(service)
    service.ControllerNode = lambda: "node"  # type: ignore[attr-defined]
    service.warm, service.compile_record_cycle = bench.note("warm"), bench.note("compile")  # type: ignore[attr-defined]
    bench.service.warm()
    assert bench.log == [("warm", "node"), ("compile",)]


# --- a run -----------------------------------------------------------------------------------------------------------


def list_begun(scene: Scene, clutch: str, name: str, pace: str) -> list[tuple[Any, ...]]:
    """Calls from the opening of the bus to what the user is told first, of the controller `name` of a clutch."""
    frames = load_frames(clutch=clutch)
    settings = scene.service
    outlet = {
        "shipped": "shipped", "ring": settings.ring, "publish": settings.telemetry, "router": settings.router,
    }  # fmt: skip
    return [
        ("open", "local:made-up", [1, 2]), ("alone", scene.port, name, frames["CONTROLLER_HEARTBEAT"]), ("listen", "heard"),
        ("line", scene.port, frames["ENCODER"].can_id, 8), ("samples", "line", frames),
        ("outlet", name, scene.node, COLUMNS, "local:resolved", settings.rate, 9, outlet), ("turn", "samples", scene.node),
        ("beat", scene.clock, scene.notifier), ("trigger", "beat", "turn"),
        ("tell", f"{name} on local:resolved at {settings.rate} Hz, {pace}"),
    ]  # fmt: skip


def list_since_opening(scene: Scene) -> list[tuple[Any, ...]]:
    return scene.log[[call[0] for call in scene.log].index("open") :]


def test_what_cannot_be_is_refused_when_the_service_is_made(service: ModuleType) -> None:
    wrong = {
        "trigger": "moon", "overrun": "never", "spin_us": float("nan"), "router": "nonsense", "cpu": 100_000,
    }  # fmt: skip
    for name, value in wrong.items():
        with pytest.raises(InputError):
            service.ControllerService("local:made-up", 500, **{name: value})


def test_a_run_in_real_time_ends_with_the_safe_commands(service: ModuleType) -> None:
    scene = Scene(service, cpu=0)
    assert scene.run() == {
        "bus": "local:resolved", "rate_hz": 500, "lockstep": False, "timing": "timing", "footprint": "footprint",
        "trigger": "clock", "overrun": None, "not_available": ["no lock", "no CPU"], "valve_closed": True, "faults": 2,
        "first_fault": "the first", "port": "counts", "frames": "receptions", "stray_frames": "strays",
        "supervisor": "claim", "first_rejected": "rejected", "parameters": "first", "rows": 5,
    }  # fmt: skip
    node, outlet, notifier, stop = scene.node, scene.outlet, scene.notifier, scene.stop
    assert list_since_opening(scene) == [
        *list_begun(scene, "a", "controller", "real time"), ("prepare", 0, PRIORITY - 1), ("tell", "note: no lock"),
        ("tell", "note: no CPU"), ("_await_plant", node, "samples", outlet, stop, notifier),
        ("say", "controls at 500 Hz on local:resolved"), ("_warm_up", node, "turn", outlet, "begins"),
        ("_run_in_real_time", node, outlet, "beat", "begins", stop), *scene.list_ended(),
    ]  # fmt: skip


def test_a_run_in_step_leaves_the_machine_as_it_is(service: ModuleType) -> None:
    scene = Scene(service, lockstep=True)
    summary = scene.run()
    assert summary["lockstep"]
    assert (summary["timing"], summary["footprint"], summary["not_available"]) == (None, None, [])
    assert list_since_opening(scene) == [
        *list_begun(scene, "a", "controller", "lock-step"),
        ("_await_plant", scene.node, "samples", scene.outlet, scene.stop, scene.notifier),
        ("say", "controls at 500 Hz on local:resolved"), ("_run_in_lockstep", "turn", scene.outlet, "beat", scene.stop),
        *scene.list_ended(),
    ]  # fmt: skip


def test_the_parts_are_made_as_the_settings_say(service: ModuleType) -> None:
    file, ring = Path("parameters"), Path("ring")
    for rate, period in ((500, 2_000_000), (7, 142_857_142)):  # ns, whole ones
        scene = Scene(
            service, rate=rate, parameters_file=file, law="law", adaptation=False, ring=ring, telemetry=False,
            router="tcp/bench:7447", trigger="bus", overrun="fault", spin_us=30.0,
        )  # fmt: skip
        assert scene.run()["trigger"] == "bus"
        assert [call for call in scene.log if call[0] in ("session", "choose", "node", "clock")] == [
            ("session",), ("choose", "bus"), ("node", rate, file, "law", False, 9, None),
            ("clock", period, ("waiting", 30.0, period), ("policy", "fault")),
        ]  # fmt: skip
        begun = list_begun(scene, "a", "controller", "real time")
        assert list_since_opening(scene)[: len(begun)] == begun
        ended = scene.list_ended(1.0 / rate)
        assert scene.log[-len(ended) :] == ended


def test_each_of_two_controllers_has_the_frames_of_its_clutch(service: ModuleType) -> None:
    for clutch, name in (("a", "controller"), ("b", "controller_b")):
        scene = Scene(service, clutch=clutch)
        scene.run()
        assert ("node", 500, None, "both", True, 9, clutch) in scene.log
        begun = list_begun(scene, clutch, name, "real time")
        assert list_since_opening(scene)[: len(begun)] == begun


def test_who_has_two_clutches_is_told_that_none_adapts(service: ModuleType) -> None:
    for clutch, adaptation in ((None, True), (None, False), ("a", True), ("a", False), ("b", True)):
        scene = Scene(service, clutch=clutch, adaptation=adaptation)
        scene.run()
        assert (("tell", NOTE_OF_TWO) in scene.log) is (clutch is not None and adaptation)


def test_a_run_without_a_fault_has_no_first_one(service: ModuleType) -> None:
    scene = Scene(service)
    scene.faults = SimpleNamespace(count=0, first=None)
    summary = scene.run()
    assert (summary["faults"], summary["first_fault"]) == (0, None)


# --- a run that fails ------------------------------------------------------------------------------------------------


def test_what_ends_a_run_is_raised_after_the_safe_commands(service: ModuleType) -> None:
    for lockstep, part in ((False, 0), (False, 1), (False, 2), (True, 0), (True, 3)):
        scene = Scene(service, fails=(PARTS[part], InputError("another rate")), lockstep=lockstep)
        with pytest.raises(InputError, match="another rate"):
            scene.run()
        assert scene.log[-len(scene.list_ended()) :] == scene.list_ended()


def test_an_overrun_that_ends_a_run_is_part_of_the_summary(service: ModuleType) -> None:
    scene = Scene(service, fails=("_run_in_real_time", OverrunError("3 cycles were missed")))
    summary = scene.run()
    assert (summary["overrun"], summary["footprint"], summary["valve_closed"]) == ("3 cycles were missed", None, True)
    assert scene.log[-len(scene.list_ended()) :] == scene.list_ended()


def test_on_a_bus_that_is_gone_the_rest_is_closed(service: ModuleType) -> None:
    scene = Scene(service)

    def send(frame: str) -> None:
        raise OSError("the bus is gone")

    scene.port.send = send
    summary = scene.run()
    assert (summary["valve_closed"], summary["rows"]) == (False, 5)
    assert scene.log[-4:] == [("stopping",), *scene.list_ended()[-3:]]
