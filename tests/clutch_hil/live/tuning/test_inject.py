"""`clutch-hil inject`: words and sensors, and a real bench that is changed while it runs."""

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh

from clutch_hil.bench.unseal import read_truth
from clutch_hil.live.recording.bench_recording import record
from clutch_hil.live.tuning import inject as module
from clutch_hil.live.tuning.inject import describe_change, find_unit, inject, list_planned, parse_values, read_state
from clutch_hil.live.tuning.tune import request_parameters, set_parameters
from plant_sim.node.injection import switch_on
from protocols.errors import InputError
from protocols.files.runs import read_run
from protocols.realtime.stopping import Stop
from protocols.telemetry.feed import ask, find_bench
from protocols.telemetry.keys import Keys
from protocols.telemetry.message import check_description, check_events, check_last
from protocols.telemetry.session import open_consumer_session
from tests.clutch_hil.live.running import RATE, Running, run_command, running_bench
from tests.processes import ONE_CPU, service
from tests.protocols.telemetry.benches import wait_until

SUMP = "oil.sump_temperature"
LEVEL = "friction_level.level"
UNIT_OF = partial(find_unit, prefix="", bus="local:nobody", router=None)  # without a bench


@pytest.mark.parametrize(
    ("words", "values"),
    [
        (["internal_leakage"], switch_on("internal_leakage")),
        (["friction_level", "level=0.8", SUMP + "=90"], {LEVEL: 0.8, SUMP: 90.0}),
        (["plant.oil.sump_temperature=90"], {SUMP: 90.0}),
        (["friction_level", "level=80%"], {LEVEL: 0.8}),
        ([LEVEL + "=80 %"], {LEVEL: 0.8}),
        (["frame_loss", "commands=20 %"], {"frame_loss.commands": 0.2}),
    ],
)
def test_words_become_values(words: list[str], values: dict[str, float]) -> None:
    assert parse_values(words, False, (), (), UNIT_OF) == values


def test_off_frees_and_biases_nothing() -> None:
    assert parse_values(["friction_level"], True, ["pressure"], ["temperature"], UNIT_OF) == {
        LEVEL: 1.0, "friction_level.drift": 0.0, "sensor_freeze.pressure": 0.0, "temperature_sensor_offset.offset": 0.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("words", "off", "bias", "sentence"),
    [
        (["frition_level"], False, [], "effect 'frition_level' is unknown; did you mean friction_level"),
        (["level=0.8"], False, [], "'level=0.8' comes before any effect; write EFFECT level=0.8, or GROUP.level=0.8"),
        (["friction_level", "level=x"], False, [], "'level=x' needs a number after the ="),
        (["oil.sump_temperature"], False, [], "parameter oil.sump_temperature has no value"),
        (["friction_level", "level=1", "level=2"], False, [], "level was given twice"),
        (["friction_level", LEVEL + "=2", "level=0.8"], False, [], "friction_level.level was given twice"),
        (["friction_level", "level=1"], True, [], "an effect that is switched off needs no value"),
        ([], False, ["pressure"], "write --bias SENSOR=VALUE"),
        ([], True, ["pressure=1"], "write --bias SENSOR=VALUE, or --bias SENSOR --off"),
        (
            [],
            False,
            ["pressure=1 Nm"],
            "pressure_sensor_offset.offset is given in 'Nm'; its unit is 'bar'; allowed are also Pa",
        ),
        (["friction_level", "level=1 bar"], False, [], "friction_level.level is given in 'bar'; its unit is '1'"),
        (
            ["friction_level", "levle=80 %"],
            False,
            [],
            "effect friction_level has no parameter 'levle'; did you mean level",
        ),
        ([SUMP + "=363 K"], False, [], "no bench on local:nobody publishes telemetry"),
    ],
)
def test_words_that_cannot_be_meant_are_told(words: list[str], off: bool, bias: list[str], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        parse_values(words, off, (), bias, UNIT_OF)


@pytest.fixture(scope="module")
def bench() -> Iterator[Running]:
    with running_bench(telemetry=True) as running:
        yield running


def test_a_sensor_is_biased_in_another_unit() -> None:
    assert parse_values([], False, (), ["pressure=20 kPa"], UNIT_OF) == {
        "pressure_sensor_offset.offset": pytest.approx(0.2)
    }


class Line:
    """A session with the plant of a bench."""

    def __init__(self, session: zenoh.Session, bus: str) -> None:
        self.session, self.bench = session, find_bench(session, bus)

    def inject(self, *words: str, freeze: Sequence[str] = (), off: bool = False, **when: float) -> list[dict]:
        named = {name.rstrip("_"): seconds for name, seconds in when.items()}
        return inject(self.session, self.bench, parse_values(words, off, freeze, (), UNIT_OF), named)

    def read_state(self) -> dict[str, Any]:
        return read_state(self.session, self.bench)

    def ask(self, key: str) -> Any:
        return ask(self.session, getattr(Keys(self.bench, "plant"), key), lambda value: value, attempts=3)


@pytest.fixture(scope="module")
def line(bench: Running) -> Iterator[Line]:
    with open_consumer_session() as session:
        yield Line(session, bench.bus)


def find_refusal(bench: Running, *arguments: str) -> str:
    done = run_command("inject", *arguments, "--bus", bench.bus)
    assert isinstance(done.exception, InputError)
    assert not done.stdout
    return str(done.exception)


def test_an_effect_goes_on_along_a_ramp_and_off_again_and_events_say_so(line: Line) -> None:
    there, back = line.inject("friction_level", "level=0.8", ramp=0.2, for_=0.3)
    assert [(c["old"], c["new"], c["ramp"]) for c in (there, back)] == [(1.0, 0.8, 0.2), (0.8, 1.0, 0.2)]
    assert back["row"] - there["row"] == pytest.approx(0.5 * RATE, abs=1)

    def events() -> list[tuple[str, dict]]:
        own = [event for event in line.ask("events") if event["name"] == LEVEL]
        return [(event["injection"], {key: event[key] for key in there}) for event in own]

    wait_until(lambda: len(events()) == 6, "the end of the second ramp")
    stages = [("accepted", there), ("accepted", back), ("started", there), ("ended", there), ("started", back)]
    assert events() == [*stages, ("ended", back)]
    assert line.read_state()["changed"] == []


@pytest.mark.parametrize(
    ("end", "at", "warned"),
    [(12.0, 12.0, True), (12.0, 99.0, True), (12.0, 11.9, False), (None, 99.0, False)],
)
def test_a_change_after_the_end_of_the_profile_is_told(
    end: float | None, at: float, warned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    change = {"name": LEVEL, "old": 1.0, "new": 0.8, "at": at, "ramp": 0.0, "row": 7, "unit": "1"}
    for name, answer in {
        "open_consumer_session": nullcontext(), "find_bench": "h/local:bench~1", "inject": [change],
        "ask": {"profile_end_s": end},
    }.items():  # fmt: skip
        monkeypatch.setattr(module, name, lambda *_, answer=answer, **__: answer)
    document, text, _, _ = module.run_injection({LEVEL: 0.8}, {"at": at}, None, None)
    assert [f"warning: {said}" in text.splitlines() for said in document["warnings"]] == [True] * warned
    if warned:
        assert document["warnings"][0].startswith(
            f"1 change at {at:g} s or later: the profile ends at 12 s, and so does"
        )


def test_a_bench_without_a_profile_says_so(line: Line) -> None:
    assert line.ask("describe")["profile_end_s"] is None


def test_a_parameter_is_listed_while_it_is_to_come_and_when_it_is_on(line: Line) -> None:
    line.inject(SUMP + "=90", after=0.5)
    assert [(change["name"], change["new"]) for change in line.read_state()["to_come"]] == [(SUMP, 90.0)]
    wait_until(lambda: line.read_state()["changed"], "the change")
    now = line.read_state()
    assert [(entry["name"], entry["value"]) for entry in now["changed"]] == [(SUMP, 90.0)]
    assert now["to_come"] == []
    line.inject(SUMP + "=70")
    wait_until(lambda: not line.read_state()["changed"], "the change back")


def test_a_parameter_on_its_way_is_listed_where_it_is(line: Line) -> None:
    line.inject(SUMP + "=90", ramp=1.0)
    wait_until(lambda: line.read_state()["changed"], "the change")
    (entry,) = line.read_state()["changed"]
    assert 70.0 < entry["value"] < 90.0
    set_parameters(line.session, line.bench, "plant", {SUMP: 70.0})
    assert line.read_state()["changed"] == []


def test_a_fault_of_the_bus_is_listed_while_it_is_on_and_in_the_frames(line: Line) -> None:
    """Frames that come twice cost nothing."""
    line.inject("frame_repetition", "samples=1")
    wait_until(lambda: line.read_state()["changed"], "the fault")
    (entry,) = line.read_state()["changed"]
    assert (entry["name"], entry["value"], entry["default"]) == ("frame_repetition.samples", 1.0, 0.0)

    def count() -> float:
        counted = ask(line.session, Keys(line.bench, "controller").last, lambda value: value, attempts=3)
        return float(counted["values"]["controller_frames_repeated"]["value"])

    before = count()
    wait_until(lambda: count() > before, "repeated frames")
    line.inject("frame_repetition", off=True)
    wait_until(lambda: not line.read_state()["changed"], "the end of the fault")


def test_a_fault_of_the_bus_out_of_bounds_is_refused(bench: Running) -> None:
    assert "frame_loss.commands = 2 is outside 0..1" in find_refusal(bench, "frame_loss", "commands=2")


def test_a_frozen_sensor_shows_one_value(line: Line) -> None:
    def looks() -> set[float]:
        seen = []
        for _ in range(6):
            time.sleep(0.03)
            seen.append(line.ask("last")["values"]["cylinder_pressure_bar"]["value"])
        return set(seen[1:])

    line.inject(freeze=["pressure"])
    assert len(looks()) == 1
    line.inject(freeze=["pressure"], off=True)
    assert len(looks()) > 1


def test_bad_input_is_told_in_the_words_of_the_plant_and_changes_nothing(bench: Running, line: Line) -> None:
    assert "did you mean oil.sump_temperature" in find_refusal(bench, "oil.sump_temprature=90")
    assert "friction_level.level = 9 is outside 0.3..3" in find_refusal(bench, SUMP + "=90", LEVEL + "=9")
    assert "is too late: the rig is at" in find_refusal(bench, SUMP + "=90", "--at", "0")
    assert "is not possible: it would last 0 s" in find_refusal(bench, "friction_level", "--for", "0")
    assert "nothing to inject; give an effect" in find_refusal(bench, "--ramp", "2")
    for option in ("--at", "--after", "--ramp", "--until", "--for"):
        assert find_refusal(bench, "friction_level", option, "-1") == f"{option} is -1 s; allowed are 0 and more"
    sentence = find_refusal(bench, "friction_level", "--clutch", "b")
    assert sentence.startswith("b.friction_level.")
    assert "has only one: leave the name of the clutch out" in sentence
    assert line.read_state()["changed"] == []


def test_a_parameter_of_the_plant_takes_another_unit(bench: Running, line: Line) -> None:
    document = json.loads(
        run_command("inject", SUMP + "=353.15 K", "--for", "0.1", "--bus", bench.bus, "--json").stdout
    )
    assert [round(change["new"], 9) for change in document["accepted"]] == [80.0, 70.0]
    assert "did you mean oil.sump_temperature" in find_refusal(bench, "oil.sump_temprature=353.15 K")
    assert f"{SUMP} is given in 'bar'; its unit is 'degC'; allowed is also K" in find_refusal(bench, SUMP + "=80 bar")
    wait_until(lambda: not line.read_state()["changed"], "the change back")


HOSTILE: list[Any] = [
    {"values": {SUMP: 80.0}, "at": 1e306}, {"values": {SUMP: 80.0}, "until": 1e306}, {"values": {SUMP: 80.0}, "for": 1e306},
    {"values": {SUMP: 80.0}, "ramp": -1.0}, {"values": {SUMP: 80.0}, "at": 10**400}, {"values": {SUMP: 80.0}, "at": None},
    {"values": {SUMP: 80.0}, "at": [1.0]}, {"values": {SUMP: 80.0}, "w" * 65_000: 1.0}, {"values": {"n" * 65_000: 1.0}},
    {"n" * 65_000: 1.0}, {SUMP: 10**400}, {SUMP: "80"}, {SUMP: True}, {SUMP: None}, {SUMP: float("nan")}, {SUMP: {}},
    {"values": {}}, {}, [], None, 3, "text", {f"x{k}": 1.0 for k in range(2000)}, {"values": {SUMP: 80.0}, "after": -1e308},
]  # fmt: skip


@pytest.mark.parametrize("node", ["plant", "controller"])
def test_a_hostile_request_is_refused_and_the_service_lives(bench: Running, line: Line, node: str) -> None:
    before = request_parameters(line.session, line.bench, node)
    for request in HOSTILE:
        with pytest.raises(InputError) as sentence:
            set_parameters(line.session, line.bench, node, request)
        assert len(str(sentence.value)) < 20_000
        assert "does not answer" not in str(sentence.value)
    assert request_parameters(line.session, line.bench, node) == before
    assert bench.plant.poll() is bench.controller.poll() is None


def test_a_controller_refuses_what_is_to_come(line: Line) -> None:
    asked: dict[str, Any] = {"values": {"torque.integral_gain": 0.2}, "after": 1.0}
    with pytest.raises(InputError, match=r"^only the plant accepts a change for a later time"):
        set_parameters(line.session, line.bench, "controller", asked)


def test_what_is_done_is_told_to_people(bench: Running, line: Line) -> None:
    done = run_command("inject", SUMP + "=80", "--for", "0.1", "--bus", bench.bus)
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert lines[0].startswith(f"read:    1 value for the plant on {bench.bus}")
    assert lines[1].startswith("wrote:   oil.sump_temperature  70 -> 80 degC, at ")
    assert lines[-1].startswith("verdict: 2 changes accepted, the first at ")
    wait_until(lambda: not line.read_state()["changed"], "the change back")
    document = json.loads(run_command("inject", "--list", "--bus", bench.bus, "--json").stdout)
    assert document["verdict"] == "0 parameters not as shipped, 0 changes planned"


@pytest.mark.parametrize("blind", [False, True])
def test_an_injection_is_in_the_recording_or_in_its_truth_file(
    bench: Running, line: Line, tmp_path: Path, blind: bool
) -> None:
    line.inject(SUMP + "=70")
    (accepted,) = line.inject(SUMP + "=85", ramp=0.1)
    with Stop() as stop:
        recorded = record(tmp_path / "run.parquet", bench.bus, None, 0.2, stop, lambda text: None, blind)
    run = read_run(next(iter(recorded.files)))
    assert ("injections" in run.metadata) != blind
    assert ("truth_clutch_torque_nm" in run.columns) != blind
    whole = read_truth(tmp_path / "run.parquet")[1] if blind else run
    assert whole.metadata["injections"][-1] == accepted
    assert not any(change["new"] == 85.0 for change in whole.metadata["parameter_changes"])
    assert whole["truth_clutch_torque_nm"].shape == run["time_s"].shape


def test_events_without_a_start_are_to_come() -> None:
    change = {"name": LEVEL, "row": 7, "unit": "1", "old": 1.0, "new": 0.5, "at": 0.07, "ramp": 2.0}
    accepted, started = ({"injection": stage} | change for stage in ("accepted", "started"))
    assert list_planned([accepted]) == [accepted]
    assert list_planned([accepted, started]) == []
    assert describe_change(change) == "friction_level.level  1 -> 0.5, at 0.070 s (row 7), along 2 s"
    assert describe_change(change | {"old": None}).startswith("friction_level.level  -> 0.5,")


def test_what_is_to_come_stands_in_the_order_in_which_it_comes() -> None:
    late, soon = ({"injection": "accepted", "name": SUMP, "row": row} for row in (900, 300))
    assert list_planned([late, soon]) == [soon, late]


def test_a_blind_plant_does_not_tell_over_zenoh(local_bus: str) -> None:
    common = ["--bus", local_bus, "--rate", str(RATE), *ONE_CPU]
    with service("controller", *common), service("plant", *common, "--blind"), open_consumer_session() as session:

        def ready() -> str | None:
            try:
                name = find_bench(session, local_bus)
            except InputError:
                return None
            return name if ask(session, Keys(name, "plant").last, check_last) else None

        name = str(wait_until(ready, "the plant"))
        keys = Keys(name, "plant")
        columns = ask(session, keys.last, check_last)["values"]
        assert "cylinder_pressure_bar" in columns
        assert not [column for column in columns if column.startswith("truth_") or column == "plant_work_us"]
        assert [c["name"] for c in ask(session, keys.describe, check_description)["columns"]] == list(columns)
        names = [entry["name"] for entry in request_parameters(session, name, "plant")]
        assert SUMP in names
        assert LEVEL not in names
        done = run_command("inject", "friction_level", SUMP + "=90", "--bus", local_bus, "--json")
        assert done.exit_code == 0, done.exception
        assert [change["old"] for change in json.loads(done.stdout)["accepted"]] == [None, None, None]
        time.sleep(0.3)
        assert ask(session, keys.events, check_events) == []
        assert {e["name"]: e["value"] for e in request_parameters(session, name, "plant")}[SUMP] == 70.0
        assert ask(session, keys.last, check_last)["values"]["plant_parameter_changes"]["value"] == 0.0
        sentence = run_command("inject", "--list", "--bus", local_bus)
        assert "the plant is blind: it does not show what is on" in sentence.stdout


def test_more_changes_than_a_plant_can_take_are_refused_and_the_others_are_made(bench: Running, line: Line) -> None:
    now = line.ask("last")["values"]["time_s"]["value"]
    replies = [
        line.session.get(
            Keys(line.bench, "plant").change_by("somebody"), timeout=20.0,
            payload=json.dumps({"values": {SUMP: 71.0 + 0.01 * k}, "at": now + 1000.0 + k}),
        )
        for k in range(40)
    ]  # fmt: skip
    answers = [[reply.ok is not None for reply in each] for each in replies]
    taken = sum(map(sum, answers))
    assert 10 <= taken < 40  # ten wait, and some are made meanwhile
    assert len(line.read_state()["to_come"]) == taken
    assert bench.plant.poll() is bench.controller.poll() is None
    assert line.session.get(Keys(line.bench, "controller").last)
