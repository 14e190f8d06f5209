"""Injections: the plant changes at a time, along a ramp, and goes back; nothing else changes, and what cannot be is refused."""

from collections.abc import Mapping

import numpy as np
import pytest

from clutch_hil.bench.in_process import Played, play
from plant_sim.effects.catalogue import find_effect
from plant_sim.node.injection import (
    BIAS,
    Injection,
    bias_sensor,
    freeze_sensor,
    parse_injection,
    switch_off,
    switch_on,
)
from plant_sim.node.plant_node import PlantNode
from plant_sim.node.power_shift_node import PowerShiftNode
from plant_sim.node.schedule import Schedule
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.node import load_node

RATE = 1000
NOW = 0.001  # s: the plant runs
LEVEL = "friction_level.level"
WEAKER = 0.6
SUMP = "oil.sump_temperature"
ENGAGED = 2.0  # s into the profile: the plates slip at 10 Nm, and go on


def make_plant(*injections: Injection, seconds: float = 3.0) -> PlantNode:
    return PlantNode(RATE, profile=load_profile("engagement", seconds), injections=injections)


def play_plant(*injections: Injection, seconds: float = 3.0) -> Played:
    return play(make_plant(*injections, seconds=seconds), load_node("controller")(adaptation=False))


def step_node(node: PlantNode, cycles: int) -> None:
    for _ in range(cycles):
        node.step([])


def read_level(node: PlantNode) -> float:
    return node.parameters[LEVEL].value


# ---- what is made ----


def test_an_effect_is_switched_on_at_typical_values_or_given_ones() -> None:
    longer = {"piston_seal_friction.travel": 1e-5}
    typical = {f"piston_seal_friction.{s.name}": s.typical for s in find_effect("piston_seal_friction").strengths}
    assert switch_on("piston_seal_friction") == typical
    assert switch_on("piston_seal_friction", {"force": 50.0}) == {"piston_seal_friction.force": 50.0}
    assert (
        switch_on("piston_seal_friction", {"travel": 1e-5}) == typical | longer
    )  # a shape alone shapes the typical effect
    assert switch_off("friction_level") == {"friction_level.level": 1.0, "friction_level.drift": 0.0}


@pytest.mark.parametrize("sensor", BIAS)
def test_every_sensor_can_be_frozen_and_biased(sensor: str) -> None:
    nominal = wet_clutch.load_nominal()
    assert set(freeze_sensor(sensor)) | set(bias_sensor(sensor, 0.01)) <= set(nominal)
    Schedule(nominal, [Injection(freeze_sensor(sensor) | bias_sensor(sensor, 0.01))])


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (lambda: switch_on("friction_levle"), "effect 'friction_levle' is unknown; did you mean friction_level"),
        (lambda: switch_on("friction_level", {"lvel": 1.0}), "friction_level has no parameter 'lvel'; did you mean level"),
        (lambda: freeze_sensor("presure"), "sensor 'presure' is unknown; did you mean pressure"),
        (lambda: bias_sensor("presure", 0.1), "sensor 'presure' is unknown; did you mean pressure"),
        (lambda: Injection({}), "changes nothing"),
        (lambda: Injection({LEVEL: 0.5}, at=-1.0), "time -1 s of an injection is not possible"),
        (lambda: Injection({LEVEL: 0.5}, ramp=float("nan")), "ramp nan s"),
        (lambda: Injection({LEVEL: 0.5}, at=1.0, ramp=2.0, until=2.5), "its ramp ends at 3 s"),
        (lambda: Injection({LEVEL: 0.5}, at=0.3, until=0.1 + 0.2), "from 0.3 s until 0.3 s is not possible: it would last 0 s"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_told(values, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        values()


def test_a_ramp_may_turn_back_where_it_ends() -> None:
    assert parse_injection({LEVEL: 0.5}, {"ramp": 1.0, "for": 0.0}, now=10.0).until == 11.0


def test_decimal_times_that_add_up_are_taken() -> None:
    at, ramp, until = 0.1, 0.2, 0.3
    assert at + ramp > until, "as floats"
    injection = Injection({LEVEL: 0.5}, at, ramp, until)
    assert (injection.at, injection.ramp, injection.until) == (at, ramp, until)


# ---- when it acts ----


def test_a_change_acts_from_its_row_on_and_is_noted() -> None:
    node = make_plant(Injection({LEVEL: WEAKER}, at=0.0125))
    step_node(node, 13)  # rows 0 to 12
    assert read_level(node) == WEAKER  # from the next row on
    assert node.injected_changes == []
    step_node(node, 1)
    assert node.injected_changes == [
        {"name": LEVEL, "unit": "1", "old": 1.0, "new": WEAKER, "at": 0.0125, "ramp": 0.0, "row": 13}
    ]


def test_the_torque_steps_in_the_row_of_the_change() -> None:
    run, quiet = play_plant(Injection({LEVEL: WEAKER}, at=ENGAGED)), play_plant()
    row = round(ENGAGED * RATE)
    ratio = run["truth_clutch_torque_nm"][row] / quiet["truth_clutch_torque_nm"][row]
    assert ratio == pytest.approx(WEAKER, rel=1e-12)
    np.testing.assert_array_equal(run.plant[:row], quiet.plant[:row])


def test_a_ramp_goes_along_a_line_and_back() -> None:
    node = make_plant(Injection({LEVEL: 0.5}, at=0.010, ramp=0.020, until=0.050))
    seen = []
    for _ in range(80):
        node.step([])
        seen.append(node._rig.table.values[0] if node._rig.table.names else 1.0)
    time = np.arange(80) / RATE
    np.testing.assert_allclose(seen, np.interp(time, [0.010, 0.030, 0.050, 0.070], [1.0, 0.5, 0.5, 1.0]), atol=1e-12)
    assert node._rig.table.names == ()  # at the end the effect is off, and its law is not called


def test_a_parameter_of_the_rig_moves_along_a_ramp() -> None:
    node = make_plant(Injection({SUMP: 90.0}, at=0.0, ramp=0.1))
    step_node(node, 51)
    assert node._rig.record["oil_sump_temperature"][0] - 273.15 == pytest.approx(80.0)
    assert node.parameters[SUMP].value == pytest.approx(80.2)  # of the next row


def test_ramps_of_two_parameters_overlap_and_do_not_mind_each_other() -> None:
    schedule = Schedule(
        wet_clutch.load_nominal(),
        [Injection({LEVEL: 0.5}, at=1.0, ramp=2.0), Injection({SUMP: 90.0}, at=2.0, ramp=2.0)],
    )
    for time, expected in ((2.5, (0.625, 75.0)), (3.5, (0.5, 85.0)), (9.0, (0.5, 90.0))):
        rig, _ = schedule.make_rig(time)
        assert rig.table.values[0] == pytest.approx(expected[0])
        assert rig.record["oil_sump_temperature"][0] - 273.15 == pytest.approx(expected[1])


def test_a_later_injection_takes_a_parameter_over_where_it_is() -> None:
    node = make_plant(Injection({LEVEL: 0.5, SUMP: 90.0}, at=0.0, ramp=0.1))
    step_node(node, 50)
    node.inject(Injection({LEVEL: 1.0}, at=0.05, ramp=0.05))
    step_node(node, 26)
    assert node._rig.table.values[0] == pytest.approx(0.875)  # from 0.75
    assert node.parameters[SUMP].value == pytest.approx(85.2)  # goes its own way
    assert [(change["name"], change["old"]) for change in node.injected_changes] == [
        (LEVEL, 1.0),
        (SUMP, 70.0),
        (LEVEL, 0.75),
    ]


def test_a_change_made_at_once_ends_a_ramp_and_leaves_what_is_planned() -> None:
    node = make_plant(Injection({LEVEL: 0.5}, at=0.0, ramp=0.1), Injection({SUMP: 90.0}, at=0.05))
    step_node(node, 20)
    node.tune({LEVEL: 0.9})
    step_node(node, 40)
    assert (read_level(node), node.parameters[SUMP].value) == (0.9, 90.0)
    assert [change["name"] for change in node.injected_changes] == [LEVEL, SUMP]


# ---- what stays the same ----


def test_injections_give_the_same_run_however_they_are_given() -> None:
    """At the start, while it runs, and twice."""
    injections = (
        Injection(switch_on("piston_seal_friction"), at=1.0, ramp=0.3, until=2.0),
        Injection(switch_on("internal_leakage") | {SUMP: 80.0}, at=1.5),
    )
    first, again = play_plant(*injections), play_plant(*injections)
    np.testing.assert_array_equal(first.plant, again.plant)
    node = make_plant()

    def inject(cycle: int) -> None:
        if cycle == 500:
            node.inject(*injections)

    live = play(node, load_node("controller")(adaptation=False), progress=inject)
    np.testing.assert_array_equal(live.plant, first.plant)


def test_injected_at_the_start_is_as_if_it_had_been_in_the_rig_file() -> None:
    values = switch_on("piston_seal_friction") | {SUMP: 80.0}
    file = PlantNode(RATE, wet_clutch.load_nominal().with_values(values), load_profile("engagement", 1.0))
    controllers = [load_node("controller")() for _ in range(2)]
    a = play(file, controllers[0])
    b = play(make_plant(Injection(values), seconds=1.0), controllers[1])
    np.testing.assert_array_equal(a.plant, b.plant)


def test_a_ramp_to_where_it_is_changes_nothing_to_the_bit() -> None:
    """Effects attached and off, tables swapped, states carried: the run is the nominal one."""
    still = play_plant(Injection(switch_off("friction_level") | {SUMP: 70.0}, at=1.0, ramp=1.0))
    np.testing.assert_array_equal(still.plant, play_plant().plant)


def test_states_of_an_effect_are_carried_over_other_changes_and_dropped_with_it() -> None:
    force = "piston_seal_friction.force"
    node = make_plant(
        Injection({force: 60.0}),
        Injection({LEVEL: 0.9}, at=2.0),  # another table: the seals' state moves to another place
        Injection({force: 0.0}, at=2.2),
        Injection({force: 60.0}, at=2.5),
    )
    controller = load_node("controller")()
    inbox: list = []
    states = {}
    while node.tick < 2499:
        inbox = controller.step(node.step(inbox))
        table = node._rig.table
        if "piston_seal_friction" in table.names:
            states[node.tick] = node._state.effects[table.spans["piston_seal_friction"][0]]
    assert abs(states[1999]) > 1.0  # N
    assert states[2000] == pytest.approx(states[1999], abs=1.0)
    assert set(range(2200, 2499)) & set(states) == set()
    node._update_rig(2.5)
    assert node._state.effects[node._rig.table.spans["piston_seal_friction"][0]] == 0.0


def test_a_frozen_sensor_shows_what_it_showed() -> None:
    run = play_plant(Injection(freeze_sensor("clutch_torque"), at=ENGAGED, until=ENGAGED + 0.5))
    row = round(ENGAGED * RATE)
    torque = run["clutch_torque_nm"]
    assert len(set(torque[row + 1 : row + 500])) == 1
    assert len(set(torque[row + 501 : row + 600])) > 10


def test_a_biased_sensor_shows_so_much_more_from_its_row_on() -> None:
    row = round(ENGAGED * RATE)
    run, quiet = play_plant(Injection(bias_sensor("clutch_torque", 2.0), at=ENGAGED)), play_plant()
    difference = run["clutch_torque_nm"] - quiet["clutch_torque_nm"]
    assert not difference[:row].any()
    np.testing.assert_allclose(difference[row:], 2.0, atol=0.01)  # Nm; the 16-bit converter has steps of 1.5 mNm
    np.testing.assert_array_equal(run["truth_clutch_torque_nm"], quiet["truth_clutch_torque_nm"])


def test_a_row_shows_what_a_ramp_has_reached_at_its_time() -> None:
    run, quiet = play_plant(Injection(bias_sensor("clutch_torque", 2.0), at=ENGAGED, ramp=0.1)), play_plant()
    row = round(ENGAGED * RATE)
    difference = run["clutch_torque_nm"] - quiet["clutch_torque_nm"]
    np.testing.assert_allclose(difference[row : row + 100], 0.02 * np.arange(100), atol=0.004)  # Nm; 20 mNm a row


# ---- what is refused ----


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"friction_level.levle": 0.5}, "parameter 'friction_level.levle' is unknown; did you mean friction_level.level"),
        ({LEVEL: 9.0}, r"friction_level.level = 9 is outside 0\.3..3"),
        ({LEVEL: 0.5, "piston.damping": 100.0}, "piston.damping = 100 N|too fast to integrate"),
        ({"sensors.pressure_bits": 16.0}, "sensors.pressure_bits is fixed while the plant runs"),
    ],
)  # fmt: skip
def test_a_refused_injection_leaves_everything_as_it_was(values: Mapping[str, float], sentence: str) -> None:
    node, other = (make_plant(Injection({LEVEL: 0.5}, at=0.01, ramp=0.05)) for _ in range(2))
    step_node(node, 20)
    step_node(other, 20)
    with pytest.raises(InputError, match=sentence):
        node.inject(Injection({SUMP: 80.0}, at=0.03), Injection(values, at=0.04))
    assert node.planned_changes == []
    step_node(node, 60)
    step_node(other, 60)
    assert node.make_row() == other.make_row()
    assert node.injected_changes == other.injected_changes


def test_an_injection_at_a_time_that_is_past_is_refused() -> None:
    node = make_plant()
    step_node(node, 20)
    with pytest.raises(InputError, match=r"injection at 0\.01 s is too late: the rig is at 0\.02 s"):
        node.inject(Injection({LEVEL: 0.5}, at=0.01))


def test_effects_that_exclude_each_other_are_refused_where_they_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("plant_sim.effects.table._check_exclusions", _refuse_exclusive)
    first, second = Injection(switch_on("internal_leakage")), Injection(switch_on("friction_level"), at=1.0)
    with pytest.raises(InputError, match="exclude each other"):
        Schedule(wet_clutch.load_nominal(), [first, second])
    Schedule(wet_clutch.load_nominal(), [Injection(first.values, until=1.0), second])  # one goes when the other comes


def _refuse_exclusive(chosen: list) -> None:
    if {"internal_leakage", "friction_level"} <= {effect.name for effect in chosen}:
        raise InputError("effects internal_leakage and friction_level exclude each other")


@pytest.mark.parametrize(
    ("when", "sentence"),
    [
        ({"at": 1.0, "after": 1.0}, "'at' and 'after' of an injection were both given"),
        ({"until": 1.0, "for": 1.0}, "'until' and 'for' of an injection were both given"),
        ({"ramps": 1.0}, "has no entry 'ramps'; did you mean ramp"),
        ({"ramp": "long"}, "ramp of an injection is long; it must be a time in s"),
        ({"for": 0.0}, "it would last 0 s"),
        ({"after": -1.0}, "time -1 s|too late"),
        ({"at": 1e306}, "at of an injection is 1e\\+306; it must be a time in s, at most 1e\\+09"),
        ({"until": 10**400}, "until of an injection is 1000"),
        ({"for": float("inf")}, "for of an injection is inf"),
        ({"x" * 65_000: 1.0}, "has no entry 'xxxx"),
    ],
)
def test_a_request_that_cannot_be_is_told(when: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        PlantNode().accept({LEVEL: 0.5}, when)


def test_a_request_counts_from_now() -> None:
    assert parse_injection({LEVEL: 0.5}, {"after": 2.0, "ramp": 1.0, "for": 3.0}, now=10.0) == Injection(
        {LEVEL: 0.5}, at=12.0, ramp=1.0, until=16.0
    )
    assert parse_injection({LEVEL: 0.5}, {}, now=10.0) == Injection({LEVEL: 0.5}, at=10.0)


def test_a_running_plant_prepares_only_what_a_change_alters() -> None:
    """What is planned in order of time keeps what was prepared; more than a plant can take is refused."""
    schedule = Schedule(wet_clutch.load_nominal())
    for k in range(30):
        before = [segment.rig for segment in schedule._segments]
        schedule = schedule.with_injections([Injection({LEVEL: 0.9 - 0.01 * k}, at=float(k + 1), ramp=0.5)], NOW)
        kept = [segment.rig for segment in schedule._segments]
        assert kept[: len(before)] == before
        assert len(kept) == len(before) + 2
    planned = list(schedule.planned)
    with pytest.raises(InputError, match=r"would come before 30 planned injections, .* no more than 4;"):
        schedule.with_injections([Injection({SUMP: 80.0}, at=0.5)], NOW)
    with pytest.raises(InputError, match="would come before 30 planned injections"):
        schedule.with_values({SUMP: 80.0}, NOW)
    assert schedule.planned == planned
    for k in range(30, 64):
        schedule = schedule.with_injections([Injection({LEVEL: 0.5 + 0.001 * k}, at=float(k + 1))], NOW)
    with pytest.raises(InputError, match="would have 65 planned changes; allowed are 64"):
        schedule.with_injections([Injection({LEVEL: 0.5}, at=100.0)], NOW)
    first = [Injection({LEVEL: 0.5 + 0.001 * k}, at=float(100 - k)) for k in range(1, 101)]
    assert len(PlantNode(injections=first).planned_changes) == 100  # a plant that has not begun takes any number


def test_changes_planned_one_by_one_are_those_planned_at_once() -> None:
    """In any order that a running plant takes: values and changes are the same at each time."""
    injections = [
        Injection({LEVEL: 0.9}, at=1.0, ramp=0.5, until=4.0), Injection({SUMP: 80.0}, at=2.0),
        Injection({LEVEL: 0.7}, at=3.0, ramp=2.0), Injection({SUMP: 60.0, LEVEL: 1.1}, at=2.5, until=3.5),
    ]  # fmt: skip
    whole = Schedule(wet_clutch.load_nominal(), injections)
    one_by_one = Schedule(wet_clutch.load_nominal())
    for injection in sorted(injections, key=lambda one: one.at):
        one_by_one = one_by_one.with_injections([injection], 0.0)
    times = np.arange(0.0, 8.0, 0.05)
    for time in times:
        assert whole.list_parameters(time).as_values() == one_by_one.list_parameters(time).as_values()
        rigs = [schedule.make_rig(time)[0] for schedule in (whole, one_by_one)]
        for name in rigs[0].record.dtype.names:
            assert rigs[0].record[name] == pytest.approx(rigs[1].record[name], rel=1e-12)
    assert one_by_one.planned == whole.planned


@pytest.mark.parametrize(
    ("kind", "name"), [(PlantNode, SUMP), (PowerShiftNode, f"a.{SUMP}"), (PowerShiftNode, "frame_delay.commands")]
)
def test_a_request_that_comes_three_times_is_answered_three_times(kind: type, name: str) -> None:
    """Who asks needs the change that is planned, though it changes nothing more."""
    node = kind()
    for _ in range(3):
        assert [(change["name"], change["at"]) for change in node.accept({name: 75.0}, {"at": 100.0})] == [
            (name, 100.0)
        ]
