"""`clutch-hil tune`: names and values, a node that answers by the documented keys, and a real bench."""

import json
import os
import pty
import subprocess
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh

from clutch_hil.live.tuning.catalogue import WHOLE, Catalogue, describe_parameter, format_tables, parse_assignments
from clutch_hil.live.tuning.tune import list_parameters, request_parameters, run_tune, set_parameters
from protocols.errors import InputError
from protocols.realtime import child as children
from protocols.telemetry.feed import list_live_nodes
from protocols.telemetry.keys import Keys
from protocols.telemetry.session import open_consumer_session, open_publisher_session
from tests.clutch_hil.live.running import Running, run_command, running_bench
from tests.protocols.telemetry.benches import wait_until

BENCH = "local:tuned@here"


def make_entry(name: str, value: float, unit: str = "1", fixed: str | None = None) -> dict:
    return {
        "name": name, "value": value, "unit": unit, "type": "number", "bounds": [0.0, 100.0], "source": "a test",
        "default": value, "uncertainty": 0.1, "fixed": fixed,
    }  # fmt: skip


CATALOGUE = Catalogue(
    BENCH,
    {
        "controller.torque.proportional_gain": make_entry("torque.proportional_gain", 0.012, "bar/Nm"),
        "controller.torque.integral_gain": make_entry("torque.integral_gain", 0.3),
        "controller.model.coulomb_slope": make_entry("model.coulomb_slope", 10.8),
        "controller.shared.name": make_entry("shared.name", 1.0),
        "plant.shared.name": make_entry("shared.name", 1.0),
        "plant.clutch.coulomb_slope": make_entry("clutch.coulomb_slope", 10.8),
        "plant.motor.integral_gain": make_entry("motor.integral_gain", 4.0, fixed="the motor's gain is fixed"),
    },
)


PRESSED = Catalogue(
    BENCH,
    {
        "plant.piston.contact_pressure": make_entry("piston.contact_pressure", 2.35, "bar"),
        "plant.valve.frequency": make_entry("valve.frequency", 60.0, "rad/s"),
    },
)


def test_a_name_needs_no_node_where_it_is_clear() -> None:
    assert CATALOGUE.find_full_name("torque.integral_gain") == "controller.torque.integral_gain"
    assert CATALOGUE.find_full_name("plant.shared.name") == "plant.shared.name"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("shared.name", "parameter 'shared.name' is ambiguous; it can be controller.shared.name, plant.shared.name"),
        ("torque.proportional_gian", "did you mean torque.proportional_gain"),
        ("plant.clutch.coulomb_slop", "did you mean plant.clutch.coulomb_slope"),
        (
            "zzz",
            "groups are controller.model, controller.shared, controller.torque, plant.clutch, plant.motor, plant.shared",
        ),
    ],
)
def test_what_is_not_one_parameter_is_told(name: str, sentence: str) -> None:
    with pytest.raises(InputError) as error:
        CATALOGUE.find_full_name(name)
    assert sentence in str(error.value)


@pytest.mark.parametrize("prefix", ["torque.", "torque", "torque.*", "controller.torque", "controller.torque."])
def test_a_group_is_found_with_or_without_its_node(prefix: str) -> None:
    assert CATALOGUE.list_group(prefix) == ["controller.torque.proportional_gain", "controller.torque.integral_gain"]


def test_a_group_does_not_begin_in_the_middle_of_a_word() -> None:
    assert not CATALOGUE.list_group("tor")


def test_values_are_sorted_by_node() -> None:
    assert parse_assignments(CATALOGUE, ["torque.integral_gain=0.5", "clutch.coulomb_slope=1e1"]) == {
        "controller": {"torque.integral_gain": 0.5},
        "plant": {"clutch.coulomb_slope": 10.0},
    }


def test_a_value_may_have_another_unit() -> None:
    values = parse_assignments(PRESSED, ["piston.contact_pressure=34 psi", "valve.frequency=8Hz"])
    assert values == {"plant": pytest.approx({"piston.contact_pressure": 2.3442, "valve.frequency": 50.265}, rel=1e-4)}


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (
            "34 Nm",
            "parameter plant.piston.contact_pressure is given in 'Nm'; its unit is 'bar'; allowed are also Pa, kPa,",
        ),
        ("-34psi", "parameter plant.piston.contact_pressure = -2.34422 bar is outside 0..100"),
        (
            "235000",
            "parameter plant.piston.contact_pressure = 235000 bar is outside 0..100; 235000 Pa would be 2.35 bar",
        ),
    ],
)
def test_a_value_in_a_wrong_unit_is_told(value: str, sentence: str) -> None:
    with pytest.raises(InputError) as error:
        parse_assignments(PRESSED, [f"piston.contact_pressure={value}"])
    assert str(error.value).startswith(sentence)


def test_a_unit_apart_from_its_number_is_told_before_any_bench_is_looked_for() -> None:
    with pytest.raises(
        InputError, match="'psi' is a unit without a number; write both as one word, such as NAME=34psi"
    ):
        run_tune(["piston.contact_pressure=34", "psi"], "local:nobody", None)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["torque.proportional_gain=abc"], "is given as 'abc'; a number is needed, 0 to 100 bar/Nm"),
        (["torque.proportional_gain="], "is given as ''"),
        (["torque.integral_gain=1", "controller.torque.integral_gain=2"], "was given twice"),
        (["torque.integral_gain=101"], "parameter controller.torque.integral_gain = 101 is outside 0..100"),
        (["torque.proportional_gain=-1"], "torque.proportional_gain = -1 bar/Nm is outside 0..100"),
        (["torque.integral_gain=nan"], "= nan is outside"),
        (["torque.integral_gain=abc"], "a number is needed, 0 to 100$"),
        (["motor.integral_gain=5"], "^the motor's gain is fixed$"),
    ],
)
def test_values_that_cannot_be_taken_are_told(arguments: list[str], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        parse_assignments(CATALOGUE, arguments)


PLANT = Catalogue(BENCH, {name: entry for name, entry in CATALOGUE.entries.items() if name.startswith("plant.")})


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            "controller.torque.integral_gain",
            "the controller on local:tuned does not answer; it may still be starting, or be stopped",
        ),
        ("controller.", "the controller on local:tuned does not answer; it may still be starting, or be stopped"),
        (
            "torque.integral_gain",
            "the controller on local:tuned does not answer, and the plant has no parameter 'torque.integral_gain'; "
            "the nearest name is motor.integral_gain",
        ),
        ("plant.clutch.slope", "parameter 'plant.clutch.slope' is unknown; did you mean plant.clutch.coulomb_slope"),
    ],
)
def test_who_does_not_answer_is_named_where_a_name_may_be_its(name: str, sentence: str) -> None:
    with pytest.raises(InputError) as error:
        PLANT.find_full_name(name)
    assert str(error.value).startswith(sentence)


def test_who_answers_is_tuned_without_the_other() -> None:
    assert parse_assignments(PLANT, ["clutch.coulomb_slope=11"]) == {"plant": {"clutch.coulomb_slope": 11.0}}


def test_no_line_of_a_table_is_wider_than_the_terminal() -> None:
    entries = CATALOGUE.entries | {
        "plant.clutch.exponent": make_entry("clutch.exponent", 1.0, "Nm/(bar (rad/s)^gamma)")
        | {"source": "a long tale " * 9}
    }
    for width in (60, 80, 90, 120):
        assert max(map(len, format_tables(entries, width).splitlines())) <= width
    assert any(
        "a long tale" in line and line.endswith("…") and len(line) == 100
        for line in format_tables(entries, 100).splitlines()
    )
    assert "a long tale " * 9 in format_tables(entries, WHOLE) + " "
    for sentence in ("value", "bounds", "0..100", "fixed"):
        assert sentence in format_tables(entries, 80)


def test_what_has_no_dimension_has_no_unit() -> None:
    name = "controller.torque.integral_gain"
    lines = describe_parameter(name, CATALOGUE.entries[name]).splitlines()
    assert [line.split("  ")[-1].strip() for line in lines[:4]] == [f"{name} = 0.3", "0 to 100", "0.3", "0.1"]


def test_auto_is_the_bench_that_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `clutch-hil up --bus auto` calls it."""
    buses: list[str | None] = []

    def tell(names: list[str], bus: str | None, router: str | None) -> tuple[dict, str, str, bool]:
        buses.append(bus)
        return {}, "", "fine", True

    monkeypatch.setattr("clutch_hil.live.tuning.tune.run_tune", tell)
    for bus in ("auto", "vcan0"):
        assert run_command("tune", "--bus", bus).exit_code == 0
    assert buses == [None, "vcan0"]


@contextmanager
def answering(node: str, answer: object, refusal: str = "") -> Iterator[list[str | None]]:
    """A node of BENCH that lives and answers every query with `answer` or `refusal`; yields the payloads it was sent."""
    asked: list[str | None] = []
    with open_publisher_session() as session:
        keys = Keys(BENCH, node)
        queryables = [
            session.declare_queryable(key, zenoh.handlers.FifoChannel(8))
            for key in (keys.parameters, keys.change_by("*"))
        ]
        token = session.liveliness().declare_token(keys.alive)

        def serve(queryable: zenoh.Queryable) -> None:
            while True:
                try:
                    query = queryable.recv()
                except zenoh.ZError:  # the session is closed
                    return
                with query:
                    asked.append(None if query.payload is None else query.payload.to_string())
                    if answer is None:
                        query.reply_err(refusal)
                    else:
                        query.reply(query.key_expr, json.dumps(answer))

        servers = [threading.Thread(target=serve, args=(queryable,)) for queryable in queryables]
        for server in servers:
            server.start()
        yield asked
        token.undeclare()
    for server in servers:
        server.join()


def test_the_wire_is_as_documented() -> None:
    answer = [make_entry("clutch.coulomb_slope", 10.8)]
    with answering("plant", answer) as asked, open_consumer_session() as session:
        assert list_live_nodes(session, BENCH) == ["plant"]
        assert request_parameters(session, BENCH, "plant") == answer
        assert set_parameters(session, BENCH, "plant", {"clutch.coulomb_slope": 11.0}) == answer
    assert asked[0] is None
    assert json.loads(str(asked[1])) == {"clutch.coulomb_slope": 11.0}


@pytest.mark.parametrize("rubbish", [None, [1], {"row": 7}, "text"])
def test_what_another_program_answers_is_left_out(rubbish: object) -> None:
    """It answers in the name of a node, no parameters, or refuses."""
    answer = [make_entry("clutch.coulomb_slope", 10.8)]
    with (
        answering("plant", rubbish, "no") as foreign,
        answering("plant", answer) as own,
        open_consumer_session() as session,
    ):
        key = Keys(BENCH, "plant").parameters
        wait_until(lambda: list(session.get(key, timeout=1.0)) and own and foreign, "both to be reached")
        assert all(request_parameters(session, BENCH, "plant") == answer for _ in range(5))


def test_a_refusal_is_told_in_the_words_of_the_node() -> None:
    with (
        answering("plant", None, "the slope is fixed"),
        open_consumer_session() as session,
        pytest.raises(InputError, match=r"^the slope is fixed$"),
    ):
        set_parameters(session, BENCH, "plant", {"clutch.coulomb_slope": 11.0})


@contextmanager
def silent(node: str) -> Iterator[None]:
    """A node of BENCH that lives and answers nothing."""
    with open_publisher_session() as session:
        handler = zenoh.handlers.FifoChannel(8)
        queryable = session.declare_queryable(Keys(BENCH, node).parameters, handler)  # noqa: F841  # ends with its name
        token = session.liveliness().declare_token(Keys(BENCH, node).alive)
        yield
        token.undeclare()


def test_a_plant_is_not_changed_when_a_value_of_the_controller_is_refused() -> None:
    with (
        answering("plant", [make_entry("friction.level", 1.0)]) as plant,
        answering("controller", [make_entry("torque.integral_gain", 0.3)]) as controller,
        pytest.raises(InputError, match=r"controller\.torque\.integral_gain = 101 is outside"),
    ):
        run_tune(["plant.friction.level=0.95", "controller.torque.integral_gain=101"], "local:tuned", None)
    assert (plant, controller) == ([None], [None])  # both were asked for their lists, and for nothing else


def test_a_controller_that_lives_and_keeps_silent_is_named() -> None:
    with (
        silent("controller"),
        answering("plant", [make_entry("motor.integral_gain", 4.0)]) as asked,
        pytest.raises(InputError, match=r"^the controller on local:tuned does not answer"),
    ):
        run_tune(["torque.integral_gain=0.31"], "local:tuned", None)
    assert asked == [None]


def test_an_absent_controller_is_named_under_the_list_of_the_plant() -> None:
    with answering("plant", [make_entry("motor.integral_gain", 4.0)]):
        _, text, verdict, good = run_tune([], "local:tuned", None)
    assert "read:    1 parameter of plant on local:tuned; the controller on local:tuned does not answer\n" in text
    assert (verdict, good) == ("1 parameter, 0 of them fixed while the service runs", True)


def test_effects_that_are_off_take_one_line_and_can_be_asked_for() -> None:
    off = [make_entry("friction_level.level", 1.0), make_entry("friction_level.drift", 0.0)]
    on = [make_entry("valve_delay.delay", 3.0) | {"default": 0.0}, make_entry("motor.integral_gain", 4.0)]
    with answering("plant", off + on):
        document, text, _, _ = run_tune([], "local:tuned", None)
        _, asked, _, _ = run_tune(["friction_level."], "local:tuned", None)
    assert "\n1 effect of the plant off; `clutch-hil tune NAME.` shows one: friction_level\n" in text
    assert "friction_level.level" not in text
    assert "valve_delay.delay" in text
    assert "motor.integral_gain" in text
    assert "friction_level.drift" in asked
    assert len(document["parameters"]) == 4, "a machine is told everything"


def test_a_bench_where_nobody_answers_is_told() -> None:
    with (
        silent("plant"),
        open_consumer_session() as session,
        pytest.raises(InputError, match=r"the plant on .* not answer"),
    ):
        list_parameters(session, BENCH)


def test_a_node_that_does_not_answer_is_told() -> None:
    with (
        open_consumer_session() as session,
        pytest.raises(InputError, match="does not answer; it may still be starting, or be stopped"),
    ):
        request_parameters(session, BENCH, "plant")


@pytest.fixture(scope="module")
def bench() -> Iterator[Running]:
    with running_bench(telemetry=True) as running:
        yield running


def tune(bench: Running, *arguments: str) -> dict:
    done = run_command("tune", *arguments, "--bus", bench.bus, "--json")
    assert done.exit_code == 0, done.exception
    return json.loads(done.stdout)


def find_refusal(bench: Running, *arguments: str) -> str:
    done = run_command("tune", *arguments, "--bus", bench.bus)
    assert isinstance(done.exception, InputError)
    assert not done.stdout
    return str(done.exception)


def test_all_parameters_of_both_services_are_listed(bench: Running) -> None:
    sentence = tune(bench)["parameters"]
    assert sentence["controller.torque.proportional_gain"]["unit"] == "bar/Nm"
    assert sentence["plant.clutch.coulomb_slope"]["default"] == 10.8
    assert sentence["controller.guard.pressure"]["fixed"]


def test_no_short_name_is_ambiguous(bench: Running) -> None:
    names = [name.partition(".")[2] for name in tune(bench)["parameters"]]
    assert len(set(names)) == len(names)


def test_both_services_are_tuned_at_once(bench: Running) -> None:
    sentence = tune(bench, "torque.proportional_gain=0.02", "plant.clutch.coulomb_slope=11.5")["changed"]
    assert [(change["node"], change["old"], change["new"]) for change in sentence] == [
        ("controller", 0.012, 0.02), ("plant", 10.8, 11.5),
    ]  # fmt: skip
    assert all(change["row"] > 0 for change in sentence)
    again = run_command("tune", "torque.proportional_gain=0.02", "--bus", bench.bus).stdout
    assert "controller.torque.proportional_gain  0.02 bar/Nm, as before" in again
    assert "verdict: 0 parameters changed, requested by " in again
    assert again.rstrip().endswith("; 1 already had this value")
    now = tune(bench, "torque.proportional_gain", "clutch.coulomb_slope")["parameters"]
    assert [entry["value"] for entry in now.values()] == [0.02, 11.5]


def test_a_refused_change_changes_nothing(bench: Running) -> None:
    before = tune(bench, "torque.")["parameters"]
    message = find_refusal(bench, "torque.integral_gain=0.4", "torque.demand_limit=-1")
    assert "torque.demand_limit = -1 Nm is outside 0.." in message
    assert tune(bench, "torque.")["parameters"] == before


@pytest.mark.needs("terminal")
def test_the_list_fits_the_terminal(bench: Running) -> None:
    master, slave = pty.openpty()
    termios.tcsetwinsize(slave, (24, 80))
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    child = subprocess.Popen(children.list_command("tune", "--bus", bench.bus), stdout=slave, env=environment)
    os.close(slave)
    shown = b""
    try:
        while piece := os.read(master, 4096):
            shown += piece
    except OSError:  # the child has closed its end
        pass
    os.close(master)
    assert child.wait() == 0
    table = shown.decode().replace("\r", "").partition("read:")[0].splitlines()
    assert max(map(len, table)) <= 80
    assert ["hydraulics.capacity", "1e-06", "m^3/bar", "2e-07..0.0001"] in [line.split()[:4] for line in table]
    assert "friction_level," in " ".join(table).split(), "off, it is named"


def test_bad_names_and_values_are_told(bench: Running) -> None:
    assert "'0.2' is a number, and no name of a parameter; write NAME=VALUE" in find_refusal(
        bench, "torque.integral_gain", "0.2"
    )
    assert "guard.pressure" in find_refusal(bench, "guard.pressure=9")
    assert "did you mean" in find_refusal(bench, "torque.proportional_gian=1")
    assert "has no value, but other arguments have one" in find_refusal(
        bench, "torque.integral_gain", "torque.proportional_gain=1"
    )
