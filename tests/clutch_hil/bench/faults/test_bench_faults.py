"""Faults of the bench: each begins and ends when it is due, ends with the run, and says what it is; wrong ones are refused."""

import contextlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from clutch_hil.bench.faults import clock, interface, peers
from clutch_hil.bench.faults.bench_fault import MOST_FAULTS, BenchFault, BenchFaults, Surroundings
from clutch_hil.bench.faults.catalogue import HOST_FAULTS, PlannedHostFault
from clutch_hil.bench.faults.fault_requests import FaultRequests, answer_request, find_address, request_fault
from clutch_hil.bench.faults.process_fault import ProcessFault
from plant_sim.bus_faults.catalogue import BUS_FAULTS
from plant_sim.effects.catalogue import load_effects
from protocols.errors import InputError
from protocols.files.disk import Disk

BUS = "local:faults-asked"


class Services:
    """Services that note the signals they get."""

    names = ("plant", "controller")

    def __init__(self) -> None:
        self.signals: list[tuple[str, str]] = []

    def send_signal(self, name: str, number: signal.Signals) -> None:
        self.signals.append((name, number.name))


@dataclass(frozen=True)
class Noted(BenchFault):
    """A fault that notes its begin and end."""

    kind = "noted"
    notes: list[str]

    @property
    def what(self) -> str:
        return "noted fault"

    def begin(self, around: Surroundings) -> Callable[[], None]:
        self.notes.append("began")
        return lambda: self.notes.append("ended")


def make_surroundings(telemetry: bool = True) -> Surroundings:
    return Surroundings(Services(), Disk(), BUS, telemetry, None)


class Clock:
    """A clock of this process that only the test moves."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)


def test_a_fault_begins_and_ends_when_it_is_due_also_while_no_samples_come(monkeypatch: pytest.MonkeyPatch) -> None:
    made_up, notes = Clock(monkeypatch), []
    faults = BenchFaults([Noted(notes, at=1.0, until=1.5)], make_surroundings())
    faults.play(None)
    assert faults.now is None
    faults.play(0.9)
    assert not notes
    made_up.now += 0.2
    faults.play(None)
    assert (notes, faults.list_on()) == (["began"], ["noted fault"])
    made_up.now += 0.5
    faults.play(None)
    assert (notes, faults.list_on()) == (["began", "ended"], [])
    assert [(one["kind"], one["fault"], one["does"], round(one["time_s"], 3)) for one in faults.log] == [
        ("noted", "noted fault", "began", 1.1), ("noted", "noted fault", "ended", 1.6),
    ]  # fmt: skip


def test_what_is_on_ends_with_the_run_and_what_is_planned_does_not_begin() -> None:
    notes: list[str] = []
    with BenchFaults([Noted(notes, at=0.0), Noted(notes, at=9.0)], make_surroundings()) as faults:
        faults.play(1.0)
    assert notes == ["began", "ended"]


@dataclass(frozen=True)
class Endless(Noted):
    """A fault that cannot be ended."""

    def begin(self, around: Surroundings) -> Callable[[], None]:
        def refuse() -> None:
            raise InputError("it cannot be ended")

        return refuse


def test_a_fault_that_cannot_be_ended_keeps_no_other_on() -> None:
    """As an interface that is gone: the time of day, stepped by another fault, is set back all the same."""
    notes: list[str] = []
    planned = [Noted(at=0.0, notes=notes), Endless(at=0.0, notes=notes), Noted(at=0.0, notes=notes)]
    with pytest.raises(InputError, match="it cannot be ended"), BenchFaults(planned, make_surroundings()) as faults:
        faults.play(0.0)
    assert notes == ["began", "began", "ended", "ended"]
    assert faults.list_on() == []


def test_a_fault_that_was_ended_by_name_does_not_end_again(monkeypatch: pytest.MonkeyPatch) -> None:
    made_up, notes = Clock(monkeypatch), []
    faults = BenchFaults([Noted(notes, at=0.0, until=2.0)], make_surroundings())
    faults.play(1.0)
    assert faults.end(["other"]) == []
    assert faults.end(["noted"]) == ["noted fault"]
    made_up.now += 5.0
    faults.play(6.0)
    assert notes == ["began", "ended"]


def test_a_service_is_killed_or_stopped_and_goes_on() -> None:
    around = make_surroundings()
    ProcessFault("plant", "kill", at=1.0).begin(around)()
    go_on = ProcessFault("controller", "stop", at=1.0).begin(around)
    assert around.services.signals == [("plant", "SIGKILL"), ("controller", "SIGSTOP")]
    go_on()
    assert around.services.signals[-1] == ("controller", "SIGCONT")


def test_a_full_disk_refuses_each_write_and_a_slow_one_takes_longer() -> None:
    around = make_surroundings()
    make_room = PlannedHostFault("disk_full", {}, at=0.0).begin(around)
    with pytest.raises(OSError, match="No space left on device"):
        around.disk.before_write()
    make_room()
    around.disk.before_write()
    speed_up = PlannedHostFault("disk_slow", {"delay": 50.0}, at=0.0).begin(around)
    began = time.monotonic()
    around.disk.before_write()
    assert time.monotonic() - began >= 0.05
    make_full = PlannedHostFault("disk_full", {}, at=0.0).begin(around)
    speed_up()  # the later fault stays
    with pytest.raises(OSError, match="No space left"):
        around.disk.before_write()
    make_full()


def test_the_time_of_day_jumps_and_is_set_back_by_the_time_that_has_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    made_up, was_set = Clock(monkeypatch), []
    monkeypatch.setattr(time, "clock_gettime", lambda _: 5000.0)
    monkeypatch.setattr(time, "clock_settime", lambda _, seconds: was_set.append(seconds))
    set_back = PlannedHostFault("clock_step", {"step": -3600.0}, at=0.0).begin(make_surroundings())
    made_up.now += 2.5
    set_back()
    assert was_set == [1400.0, 5002.5]


def test_a_user_who_may_not_set_the_time_is_told_before_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock, "has_capability", lambda number: False)
    with pytest.raises(InputError, match="clock_step sets the time of this computer, and this user has no permission"):
        BenchFaults([PlannedHostFault("clock_step", {}, at=0.0)], make_surroundings())


def test_an_interface_is_taken_down_on_a_can_bus_by_who_may(monkeypatch: pytest.MonkeyPatch) -> None:
    fault = PlannedHostFault("interface_down", {}, at=0.0)
    with pytest.raises(InputError, match="interface_down needs a CAN interface, but the bus is local:x; use bus_fault"):
        fault.check("local:x", True)
    monkeypatch.setattr(interface, "has_capability", lambda number: False)
    with pytest.raises(InputError, match="interface_down takes vcan7 down, and this user has no permission"):
        fault.check("vcan7", True)
    with pytest.raises(InputError, match="interface nothing7 cannot be set down: No such device"):
        fault.begin(replace(make_surroundings(), bus="nothing7"))


@pytest.mark.parametrize("name", ["request_flood", "rubbish_peer"])
def test_a_peer_needs_telemetry_and_lives_as_long_as_its_fault(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    fault = PlannedHostFault(name, {}, at=0.0)
    with pytest.raises(InputError, match=f"{name} needs telemetry, but --no-telemetry was given"):
        BenchFaults([fault], make_surroundings(telemetry=False))
    peers_started: list[subprocess.Popen[bytes]] = []

    def spawn(command: list[str], output: int) -> subprocess.Popen[bytes]:
        assert command[command.index("-m") + 1] == f"clutch_hil.bench.faults.{name}"
        peers_started.append(subprocess.Popen(["sleep", "60"], stdout=output))
        return peers_started[0]

    monkeypatch.setattr(peers, "spawn", spawn)
    end = fault.begin(make_surroundings())
    assert peers_started[0].poll() is None
    end()
    assert peers_started[0].poll() is not None


def test_names_of_faults_are_of_one_thing_and_each_has_a_line_of_text_and_a_row_in_the_docs() -> None:
    assert not set(HOST_FAULTS) & ({*load_effects(), *BUS_FAULTS})
    page = (Path(__file__).parents[4] / "docs" / "scenarios.md").read_text(encoding="utf-8")
    for name, fault in HOST_FAULTS.items():
        text = (fault.__doc__ or "").partition("\n")[0]
        values = [f"`{p.name}` {p.typical:g}{'' if p.unit == '1' else ' ' + p.unit}" for p in fault.parameters]
        assert f"| `{name}` | {text[0].lower()}{text[1:].removesuffix('.')} | {', '.join(values)} |" in page


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: PlannedHostFault("disk_ful", {}, at=0.0), "host_fault is 'disk_ful'; did you mean disk_full"),
        (lambda: PlannedHostFault("disk_full", {"x": 1.0}, at=0.0), "disk_full has no parameter 'x'; it has none"),
        (lambda: PlannedHostFault("disk_slow", {"dely": 1.0}, at=0.0), "no parameter 'dely'; did you mean delay"),
        (
            lambda: PlannedHostFault("disk_slow", {"delay": 1e9}, at=0.0),
            "disk_slow.delay = 1e\\+09 ms is outside 1",
        ),
        (lambda: PlannedHostFault("disk_slow", {"delay": "x"}, at=0.0), "disk_slow.delay is 'x'"),
        (lambda: PlannedHostFault("disk_full", {}, at=inf), "at is inf s; allowed is 0 and more"),
        (lambda: PlannedHostFault("disk_full", {}, at=2.0, until=2.0), "until is 2 s; allowed are times after 2 s"),
    ],
)
def test_what_cannot_be_meant_is_refused(make: Callable[[], BenchFault], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()


def test_a_run_has_a_bounded_number_of_faults() -> None:
    faults = BenchFaults([Noted([], at=1.0)] * MOST_FAULTS, make_surroundings())
    with pytest.raises(InputError, match=f"the run has {MOST_FAULTS} faults of the bench already"):
        faults.plan(Noted([], at=2.0))


def make_running(monkeypatch: pytest.MonkeyPatch) -> BenchFaults:
    """The faults of a run that is at 10 s and stays there."""
    Clock(monkeypatch)
    faults = BenchFaults([], make_surroundings())
    faults.play(10.0)
    return faults


def test_a_request_plans_from_now_or_at_a_time_and_what_is_on_can_be_listed_and_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    faults = make_running(monkeypatch)
    answer = answer_request(faults, {"host_fault": "disk_full", "for": 2.0})
    assert answer == {"bus": BUS, "planned": "disk_full", "at": 10.0, "until": 12.0}
    answer_request(faults, {"process": "controller", "signal": "stop", "at": 11.0, "until": 11.5})
    faults.play(10.0)
    assert answer_request(faults, {})["on"] == ["disk_full"]
    assert answer_request(faults, {"end": ["disk_full"]})["ended"] == ["disk_full"]
    assert answer_request(faults, {})["on"] == []


@pytest.mark.parametrize(
    ("request_", "sentence"),
    [
        ({"process": "controller_b"}, "process is 'controller_b'; did you mean controller"),
        ({"process": "plant", "at": 9.0}, "at is 9 s, but the run is already at 10.000 s; allowed are later times"),
        ({"process": "plant", "at": 12.0}, "at is 12 s, but the run ends at 12 s; allowed are earlier times"),
        ({"process": "plant", "after": 90.0}, "at is 100 s, but the run ends at 12 s; allowed are earlier times"),
        ({"process": "plant", "at": 11.0, "after": 1.0}, "at and after were both given; only one of them is allowed"),
        ({"host_fault": "disk_full", "until": 11.0, "for": 1.0}, "until and for were both given"),
        ({"host_fault": "disk_full", "after": "soon"}, "after is 'soon'; allowed is a number of seconds"),
        ({"host_fault": "disk_full", "for": 10**400}, "for is 1000"),
        ({"host_fault": "disk_full", "at": True}, "at is True; allowed is a number of seconds"),
        ({"host_fault": "disk_slow", "values": {"delay": 10**400}}, "disk_slow.delay"),
        ({"host_fault": "disk_full", "for": float("inf")}, "for is inf; allowed is a number of seconds"),
        ({"host_fault": "disk_full", "for": -1.0}, "until is 9 s; allowed are times after 10 s"),
        ({"host_fault": "disk_full", "values": 3}, "values is not a table of numbers"),
        ({"host_fault": ["x"]}, "host_fault is"),
        ({"word": 1}, "host_fault is 'None'"),
    ],
)
def test_a_request_that_cannot_be_meant_is_refused(
    request_: dict[str, object], sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=sentence):
        answer_request(make_running(monkeypatch), request_, end=12.0)


_WORDS = st.sampled_from(
    [
        "process",
        "signal",
        "host_fault",
        "values",
        "at",
        "after",
        "until",
        "for",
        "end",
        "plant",
        "stop",
        "disk_slow",
        "delay",
    ]
)
_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | _WORDS,
    lambda inner: st.lists(inner) | st.dictionaries(_WORDS | st.text(), inner),
    max_leaves=8,
)


@given(st.dictionaries(_WORDS, _VALUES))
def test_whatever_is_asked_is_answered_or_refused(request_: dict[str, object]) -> None:
    faults = BenchFaults([], make_surroundings())
    faults.play(10.0)
    with contextlib.suppress(InputError):
        json.dumps(answer_request(faults, request_))


def test_a_request_before_the_first_sample_is_refused() -> None:
    with pytest.raises(InputError, match="the bench has no sample yet"):
        answer_request(BenchFaults([], make_surroundings()), {"host_fault": "disk_full"})


def ask_while_answering(bus: str, answer: Callable[..., dict[str, object]], request: object) -> dict[str, object]:
    """Ask a bench on `BUS` that answers by `answer`; the request waits in the socket until then."""
    with FaultRequests(BUS) as requests, ThreadPoolExecutor(1) as other:
        asked = other.submit(request_fault, bus, request)
        deadline = time.monotonic() + 10.0
        while not asked.done() and time.monotonic() < deadline:
            requests.answer(answer)
            time.sleep(0.01)
        return asked.result(0.0)


def test_a_bench_is_asked_by_its_bus_and_its_refusal_is_passed_on() -> None:
    assert ask_while_answering(BUS, lambda request: {"got": request}, {"a": 1}) == {"got": {"a": 1}}

    def refuse(request: object) -> dict[str, object]:
        raise InputError("no such fault")

    with pytest.raises(InputError, match="no such fault"):
        ask_while_answering(BUS, refuse, {"a": 1})
    with pytest.raises(InputError, match="a request for a fault must be a JSON object"):
        ask_while_answering(BUS, lambda request: {}, [1, 2])


_STRANGER = """
import os, socket, sys
os.setuid(65534)
with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as port:
    port.connect(bytes.fromhex(sys.argv[1]))
    port.send(b'{"process": "plant"}')
    print(port.recv(4096).decode())
"""


@pytest.mark.needs("root")
def test_another_user_is_refused_and_told() -> None:
    answered: list[object] = []
    with FaultRequests(BUS) as requests:
        address = find_address(BUS).encode().hex()
        words = [sys.executable, "-c", _STRANGER, address]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as stranger:
            while stranger.poll() is None:
                requests.answer(lambda request: answered.append(request) or {})
                time.sleep(0.01)
            sentence = stranger.stdout.read() if stranger.stdout else ""
    assert "user 65534 may not ask for faults of a bench of user 0" in sentence
    assert not answered


def test_without_a_bench_who_asks_is_told() -> None:
    with pytest.raises(InputError, match="no clutch-hil up of this user runs on bus local:none on this computer"):
        request_fault("local:none", {})


def test_a_second_bench_on_the_bus_leaves_the_first_one_its_requests() -> None:
    with FaultRequests(BUS), FaultRequests(BUS) as second:
        second.answer(lambda request: {})  # it has no socket, and asks nobody
