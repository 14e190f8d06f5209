"""Parameters of a running node: asked for by a mailbox, changed between two cycles, all of a request or none."""

import json
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from clutch_hil.bench.rig import find_rig
from plant_sim.node.injection import Injection
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.node import load_node
from protocols.realtime.mailbox import Asker, Mailbox
from protocols.telemetry.tuning import MOST_VALUES, Tunable, Tuning, describe_parameters
from rt_controller.law.valve_gains import VALVE

PATIENCE_FOR_MANY = 60.0  # s; before its first sample a plant prepares all of them anew
MANY_PLANNED = 600  # changes: their list has 70 kB, an answer takes 64
PATIENCE = 2.0  # s for an answer that is on its way


@pytest.fixture
def mailbox(tmp_path: Path) -> Iterator[Mailbox]:
    box = Mailbox(tmp_path / "mailbox")
    yield box
    box.close()


@pytest.fixture
def asker(mailbox: Mailbox, tmp_path: Path) -> Iterator[Asker]:
    asker = Asker(tmp_path / "mailbox")
    yield asker
    asker.close()


def make_controller() -> Tunable:
    return load_node("controller")()


def ask_in_thread(
    asker: Asker, tuning: Tuning, values: dict, row: int = 7, patience: float = PATIENCE, when: dict | None = None
) -> dict:
    """Ask for a change while a loop turns."""
    request = {"values": values, "until": time.monotonic() + patience} | ({"when": when} if when else {})
    answers: list[str] = []
    thread = threading.Thread(target=lambda: answers.append(asker.ask(json.dumps(request), patience)))
    thread.start()
    while thread.is_alive():
        if tuning.has_request():
            tuning.act(row)
    return json.loads(answers[0])


def test_nothing_waits_in_a_new_mailbox(mailbox: Mailbox) -> None:
    assert not mailbox.has_request()


def test_a_loop_that_does_not_turn_is_told_and_the_next_request_is_refused(mailbox: Mailbox, asker: Asker) -> None:
    with pytest.raises(InputError, match=r"has not answered within 0\.01 s; it may still be starting, or be stopped"):
        asker.ask("{}", 0.01)
    assert mailbox.has_request()
    with pytest.raises(InputError, match="an earlier change still waits"):
        asker.ask("{}", 0.01)
    mailbox.answer("late")
    assert not mailbox.has_request()


def test_a_request_waits_for_the_answer_to_an_earlier_one(mailbox: Mailbox, asker: Asker) -> None:
    with pytest.raises(InputError, match="has not answered"):
        asker.ask("first", 0.01)
    with ThreadPoolExecutor(1) as pool:
        second = pool.submit(asker.ask, "second", PATIENCE)
        seen = []
        while not second.done():
            if mailbox.has_request():
                seen.append(mailbox.request())
                mailbox.answer(f"to {seen[-1]}")
        assert second.result() == "to second"
    assert seen == ["first", "second"]


def test_a_request_that_is_too_long_is_refused(asker: Asker, mailbox: Mailbox) -> None:
    with pytest.raises(InputError, match=r"70000 bytes is too long; allowed are 65536"):
        asker.ask("x" * 70_000, 0.01)
    assert not mailbox.has_request()


def test_a_change_says_what_it_changed_and_from_which_row(mailbox: Mailbox, asker: Asker) -> None:
    node = make_controller()
    tuning = Tuning(node, mailbox)
    answer = ask_in_thread(asker, tuning, {"torque.proportional_gain": 0.02, "slip.bandwidth": 60})
    change = {"name": "torque.proportional_gain", "old": 0.012, "new": 0.02, "unit": "bar/Nm", "row": 7}
    assert answer["row"] == 7
    assert answer["changed"][0] == change
    assert tuning.count == 2
    assert node.parameters["slip.bandwidth"].value == 60.0


@pytest.mark.parametrize("started", [False, True])
def test_more_planned_changes_than_an_answer_can_list_end_no_loop(
    mailbox: Mailbox, asker: Asker, started: bool
) -> None:
    """A scenario may plan any number; a running plant with so many refuses a change."""
    injections = [Injection({"oil.sump_temperature": 70.0 + k % 5}, at=10.0 + k) for k in range(MANY_PLANNED)]
    node = PlantNode(injections=injections)
    if started:
        node.step([])
    tuning = Tuning(node, mailbox)
    answer = ask_in_thread(asker, tuning, {"oil.heat_transfer": 3.5}, patience=PATIENCE_FOR_MANY)
    assert ("refused" in answer) is started
    assert "planned" not in answer
    assert len(node.planned_changes) == MANY_PLANNED


def test_as_many_values_as_are_allowed_fit_into_an_answer_and_more_end_no_loop(mailbox: Mailbox, asker: Asker) -> None:
    """Of a plant with two clutches, whose names are the longest; they change along a ramp and go back."""
    node = find_rig("power_shift").plant.make_node(1000)
    free = [p for p in node.parameters.values() if node.explain_fixed(p.name) is None]
    free.sort(key=lambda parameter: -len(parameter.name + parameter.unit))
    values = {p.name: p.value for p in free}
    tuning = Tuning(node, mailbox)
    assert len(values) > MOST_VALUES
    sentence = f"a change has {len(values)} values; allowed are {MOST_VALUES}"
    assert ask_in_thread(asker, tuning, values, patience=PATIENCE_FOR_MANY)["refused"] == sentence
    few = dict(list(values.items())[:MOST_VALUES])
    answer = ask_in_thread(asker, tuning, few, row=1 << 40, patience=PATIENCE_FOR_MANY)
    assert len(answer["changed"]) == MOST_VALUES
    when = {"at": 1.0 / 3.0, "ramp": 2.0 / 3.0, "for": 4.0 / 3.0}
    answer = ask_in_thread(asker, tuning, few, patience=PATIENCE_FOR_MANY, when=when)
    assert len(answer["accepted"]) == 2 * MOST_VALUES


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"torque.integral_gain": 0.1, "torque.proportional_gain": 0.3}, "is outside 0..0.2"),
        ({"torque.integral_gain": 0.1, "torque.gain": 0.3}, "parameter 'torque.gain' is unknown; did you mean"),
        ({"torque.integral_gain": 0.1, "torque.demand_limit": "high"}, "is 'high'; a number is needed"),
        (
            {"torque.integral_gain": 0.1, "guard.voltage": 5.0},
            "parameter guard.voltage is fixed while the controller runs",
        ),
        ({"torque.integral_gain": 0.1, "pressure.voltage_limit": 5.0}, "is above the guard's limit of 4 V"),
    ],
)
def test_a_refused_change_gives_its_reason_and_changes_nothing(
    mailbox: Mailbox, asker: Asker, values: dict, sentence: str
) -> None:
    node = make_controller()
    before = node.parameters.as_values()
    tuning = Tuning(node, mailbox)
    assert sentence in ask_in_thread(asker, tuning, values)["refused"]
    assert node.parameters.as_values() == before
    assert tuning.changes == []


def test_changes_are_counted_to_the_end_and_a_bounded_number_is_kept(
    mailbox: Mailbox, asker: Asker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop's memory is locked: a program that tunes for days must not fill it."""
    monkeypatch.setattr("protocols.telemetry.tuning._MOST_LOGGED", 3)
    tuning = Tuning(make_controller(), mailbox)
    for gain in (0.01, 0.02, 0.03):
        ask_in_thread(asker, tuning, {"torque.proportional_gain": gain, "torque.integral_gain": gain})
    assert tuning.count == 6
    assert [(one["name"], one["new"]) for one in tuning.changes] == [
        ("torque.proportional_gain", 0.01), ("torque.integral_gain", 0.01), ("torque.proportional_gain", 0.02),
    ]  # fmt: skip


def test_a_change_that_comes_too_late_is_not_made(mailbox: Mailbox, asker: Asker) -> None:
    node = make_controller()
    tuning = Tuning(node, mailbox)
    request = json.dumps({"values": {"slip.bandwidth": 60.0}, "until": time.monotonic() + 0.05})
    with pytest.raises(InputError, match="has not answered"):
        asker.ask(request, 0.1)
    tuning.act(7)  # the loop wakes
    assert node.parameters["slip.bandwidth"].value != 60.0
    assert tuning.changes == []
    assert ask_in_thread(asker, tuning, {"slip.bandwidth": 70.0})["row"] == 7


@pytest.mark.parametrize(("node", "shipped"), [(make_controller(), None), (PlantNode(), wet_clutch.load_nominal())])
def test_every_parameter_is_described(node: Tunable, shipped) -> None:
    entries = describe_parameters(node, shipped or node.parameters)
    assert len(entries) == len(node.parameters)
    for entry in entries:
        assert entry["bounds"][0] <= entry["default"] <= entry["bounds"][1]
        assert entry["unit"]
        assert entry["source"]
        fixed = entry["name"].split(".")[0] in ("guard", "sensors") or entry["name"] in VALVE
        assert (entry["fixed"] is not None) == fixed


def test_a_controller_that_is_tuned_while_it_runs_is_one_that_was_started_so(tmp_path: Path) -> None:
    """Before the first cycle there is no state yet: both must agree to the bit."""
    from clutch_hil.bench.in_process import play

    changed = {
        "torque.integral_gain": 0.1,
        "model.coulomb_intercept": -24.0,  # nothing follows these, as other parameters of a file follow its slope
        "phases.fill_pressure": 2.7,
        "slip.bandwidth": 60.0,
    }
    changed |= {"adaptation.time_constant": 1.0}
    file = tmp_path / "changed.toml"
    file.write_text("".join(f"{name} = {value}\n" for name, value in changed.items()))
    tuned, started = make_controller(), load_node("controller")(parameters_file=file)
    tuned.tune(changed)
    profile = load_profile("engagement", 2.0)
    a, b = (play(PlantNode(profile=profile), node) for node in (tuned, started))
    assert (a.controllers[0] == b.controllers[0]).all()


def test_a_plant_whose_friction_is_changed_in_mid_run_slips_with_the_new_torque() -> None:
    from clutch_hil.bench.in_process import play

    profile = load_profile("engagement", 3.0)
    plant, node = PlantNode(profile=profile), load_node("controller")(adaptation=False)

    def weaken(cycle: int) -> None:
        if cycle == 2000:
            plant.tune({"friction_level.level": 0.5})

    played = play(plant, node, progress=weaken)
    torque, estimate = played["truth_clutch_torque_nm"], played["controller_torque_estimate_nm"]
    assert torque[1999] == pytest.approx(estimate[1999], rel=0.05)  # the estimator believes the old friction
    assert torque[2600] == pytest.approx(0.5 * estimate[2600], rel=0.05)
