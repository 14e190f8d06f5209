"""Changes of a plant's parameters, and what a blind plant tells of them. Each test has the module as argument, so that it can
run on mutants (tests/mutation). It is the source of plant_node.py with all made up that it uses (node_bench.py)."""

from types import ModuleType
from typing import Any

import pytest

import plant_sim.node.plant_node
from plant_sim.node.injection import Injection
from protocols.errors import InputError
from tests.mutation.mutants import load_mutant, parse_plain
from tests.plant_sim.node_bench import BOTH, LEAKAGE, LEVEL, NOMINAL, PERIOD, RATE, SUMP, NodeBench

DELAY, BITS = "frame_delay.commands", "sensors.pressure_bits"
FIXED = f"parameter {BITS} is fixed while the plant runs: its data acquisition is set up at the start"
LEAKING = NOMINAL.with_values({LEAKAGE: 2e-6})


@pytest.fixture
def plant_node() -> ModuleType:
    return load_mutant(parse_plain(plant_sim.node.plant_node))


def describe(name: str, old: Any, new: float, tick: int, ramp: float = 0.0) -> dict[str, Any]:
    """A change at a tick, as it is told."""
    unit = {SUMP: "degC", LEVEL: "1", DELAY: "ms"}[name]
    return {"name": name, "unit": unit, "old": old, "new": new, "at": tick * PERIOD, "ramp": ramp, "row": tick}


def read_sump(bench: NodeBench) -> float:
    """Sump temperature of the rig that a kernel gets."""
    memory = bench.module.PlantMemory(*bench.node.memory)
    assert memory.states is bench.node._state.effects
    return float(memory.parameters["sump"][0])


# --- while the plant runs --------------------------------------------------------------------------------------------


def test_a_change_acts_from_its_sample_on(plant_node: ModuleType) -> None:
    """Outputs follow before the sample is shown, without a step: nothing moves. Where nothing changes nothing is done."""
    bench = NodeBench(plant_node, injections=[Injection({SUMP: 80.0}, at=2 * PERIOD)])
    assert bench.node.planned_changes == [describe(SUMP, 70.0, 80.0, 2)]
    bench.show(2)
    assert bench.list_calls("move") == []
    assert (bench.node.injected_changes, read_sump(bench)) == ([], 70.0)
    bench.log.clear()
    bench.show()
    assert [call[0] for call in bench.log] == ["begin", "move", "show", "note", "pass"]
    assert bench.list_calls("move", "show") == [("move", [7.0, 0.0], 0.0, 0), ("show", 0, 80.0, 2)]
    assert bench.node.injected_changes == [describe(SUMP, 70.0, 80.0, 2)]
    assert (bench.node.planned_changes, read_sump(bench)) == ([], 80.0)
    bench.show(3)
    assert len(bench.list_calls("move")) == 1


def test_along_a_ramp_outputs_follow_in_each_sample(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node, injections=[Injection({SUMP: 90.0}, at=2 * PERIOD, ramp=4 * PERIOD)])
    bench.show(9)
    assert [call[2] for call in bench.list_calls("show")] == [70.0, 70.0, 70.0, 75.0, 80.0, 85.0, 90.0, 90.0, 90.0]
    made = [call[0] for call in bench.list_calls("move", "begin")]
    assert made == [*2 * ["begin"], *5 * ["begin", "move"], *2 * ["begin"]]
    assert bench.node.injected_changes == [describe(SUMP, 70.0, 90.0, 2, 4 * PERIOD)]


def test_states_of_effects_are_carried_from_the_rig_before(plant_node: ModuleType) -> None:
    """A state remembers the number of effects of the rigs where it was."""
    steps = [Injection({LEVEL: 0.9}, at=1 * PERIOD), Injection({SUMP: 80.0}, at=2 * PERIOD)]
    bench = NodeBench(plant_node, injections=steps)
    bench.show(4)
    assert bench.list_calls("move") == [("move", [7.0, 0.0], 0.0, 0), ("move", [7.0, 0.0, 1.0], 0.0, 0)]
    assert bench.node._state.effects.tolist() == [7.0, 0.0, 1.0]
    assert [change["new"] for change in bench.node.injected_changes] == [0.9, 80.0]


def test_the_parameters_of_a_plant_are_those_of_its_next_sample(plant_node: ModuleType) -> None:
    bench, sentence = (
        NodeBench(plant_node, injections=[Injection({SUMP: 90.0}, at=2 * PERIOD, ramp=4 * PERIOD)]),
        list[float](),
    )
    for _ in range(8):
        sentence.append(bench.node.parameters[SUMP].value)
        bench.show()
    assert sentence == [70.0, 70.0, 70.0, 75.0, 80.0, 85.0, 90.0, 90.0]


def test_the_rig_of_the_start_has_what_is_injected_then(plant_node: ModuleType) -> None:
    """And nothing that comes later."""
    first, later = Injection({SUMP: 80.0}, at=0.0), Injection({SUMP: 90.0}, at=0.5)
    bench = NodeBench(plant_node, injections=[first, later])
    assert read_sump(bench) == 80.0
    bench.show()
    assert bench.node.injected_changes == [describe(SUMP, 70.0, 80.0, 0)]


def test_a_plant_is_tuned_between_two_samples(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node)
    bench.show(3)
    bench.log.clear()
    bench.node.tune({SUMP: 85.0, LEVEL: 0.9})
    assert bench.log == [("move", [7.0, 0.0], 0.0, 0)]
    assert (read_sump(bench), bench.node.parameters[LEVEL].value) == (85.0, 0.9)
    assert (bench.node.blind, bench.node.injected_changes, bench.node.planned_changes) == (False, [], [])


def test_a_plant_takes_all_values_of_a_change_or_none(plant_node: ModuleType) -> None:
    for blind in (False, True):
        bench = NodeBench(plant_node, blind=blind)
        for values in ({SUMP: 85.0, "oil.unknown": 1.0}, {SUMP: 85.0, "oil.reference": -1e9}):
            with pytest.raises(InputError):
                bench.node.tune(values)
        assert (read_sump(bench), bench.node.parameters[SUMP].value) == (70.0, 70.0)


# --- injections ------------------------------------------------------------------------------------------------------


def test_an_injection_is_planned_for_rig_and_bus(plant_node: ModuleType) -> None:
    node = NodeBench(plant_node).node
    node.inject(Injection({SUMP: 80.0, DELAY: 10.0}, at=4 * PERIOD), Injection({LEVEL: 0.9}, at=6 * PERIOD))
    on_bus = describe(DELAY, 0.0, 10.0, 4)
    assert node.planned_changes == [describe(SUMP, 70.0, 80.0, 4), describe(LEVEL, 1.0, 0.9, 6), on_bus]
    assert [change.to_dict(RATE) for change in node.bus.planned] == [on_bus]


def test_data_acquisition_cannot_change_while_the_plant_runs(plant_node: ModuleType) -> None:
    node = NodeBench(plant_node).node
    assert node.explain_fixed(BITS) == FIXED
    assert [node.explain_fixed(name) for name in (SUMP, "oil.sensors", "sensor_freeze.pressure")] == [None, None, None]
    with pytest.raises(InputError) as sentence:
        node.inject(Injection({SUMP: 80.0}), Injection({DELAY: 10.0, SUMP: 80.0, BITS: 16.0}))
    assert str(sentence.value) == FIXED
    assert node.planned_changes == []


def test_a_change_in_the_past_is_refused_for_rig_and_bus(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node)
    bench.show(256)
    for name in (SUMP, DELAY):
        with pytest.raises(InputError, match=r"injection at 0\.25 s is too late: the rig is at 0\.5 s"):
            bench.node.inject(Injection({name: 80.0}, at=0.25))
        bench.node.inject(Injection({name: 80.0}, at=0.5))


def test_a_request_is_answered_by_its_changes(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node)
    node = bench.node
    node.inject(Injection({LEVEL: 0.9}, at=6 * PERIOD), Injection({SUMP: 75.0}, at=20 * PERIOD))
    bench.show(2)
    sentence = node.accept({SUMP: 80.0, DELAY: 10.0}, {"after": 4 * PERIOD, "for": 2 * PERIOD})
    assert sentence == [
        describe(SUMP, 70.0, 80.0, 6),
        describe(SUMP, 80.0, 70.0, 8),
        describe(DELAY, 0.0, 10.0, 6),
        describe(DELAY, 10.0, 0.0, 8),
    ]
    assert len(node.planned_changes) == 6


def test_of_two_changes_at_one_time_the_newer_is_told(plant_node: ModuleType) -> None:
    node = NodeBench(plant_node).node
    assert [change["new"] for change in node.accept({SUMP: 80.0}, {"at": PERIOD})] == [80.0]
    assert [change["new"] for change in node.accept({SUMP: 90.0}, {"at": PERIOD})] == [90.0]


def test_a_request_is_refused_with_its_reason(plant_node: ModuleType) -> None:
    for blind in (False, True):
        node = NodeBench(plant_node, blind=blind).node
        for values, when, reason in (
            ({BITS: 16.0}, {}, FIXED),
            ({LEVEL: 9.0}, {}, "is outside"),
            ({DELAY: -1.0}, {}, "is outside"),
            ({"friction_levle.level": 0.5}, {}, "did you mean friction_level"),
            ({SUMP: 80.0}, {"ramps": 1.0}, "did you mean ramp"),
            ({LEVEL: 0.9, LEAKAGE: 1e-6}, {}, BOTH),
        ):
            with pytest.raises(InputError, match=reason):
                node.accept(values, when)
        assert node.planned_changes == []


# --- a blind plant ---------------------------------------------------------------------------------------------------


def test_a_blind_plant_shows_its_first_parameters_without_effects(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node, parameters=LEAKING, blind=True, injections=[Injection({SUMP: 80.0}, at=PERIOD)])
    bench.show(3)
    assert (bench.node.blind, read_sump(bench)) == (True, 80.0)
    shown = bench.node.parameters.as_values()
    effects = {"internal_leakage", "friction_level", "sensor_freeze"}
    own = {"valve", "hydraulics", "piston", "clutch", "oil", "motor", "sensors", "standstill"}
    groups = {name.partition(".")[0] for name in shown}
    assert (groups & effects, groups & own) == (set(), own)
    assert shown == {name: value for name, value in NOMINAL.as_values().items() if name in shown}


def test_a_blind_plant_is_tuned_in_what_it_shows_alone(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node, parameters=LEAKING, blind=True)
    bench.node.tune({SUMP: 85.0})
    assert (read_sump(bench), bench.node.parameters[SUMP].value) == (85.0, 85.0)
    with pytest.raises(InputError, match=r"'internal_leakage\.conductance' is unknown"):
        bench.node.tune({LEAKAGE: 0.0})


def test_a_blind_plant_tells_of_a_request_neither_what_was_before_nor_what_will_be(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node, blind=True, injections=[Injection({SUMP: 75.0}, at=8 * PERIOD)])
    bench.show(2)
    sentence = bench.node.accept({SUMP: 80.0, DELAY: 10.0}, {"at": 4 * PERIOD, "until": 6 * PERIOD})
    assert sentence == [describe(SUMP, None, 80.0, 4), describe(DELAY, None, 10.0, 4)]
    assert [change["new"] for change in bench.node.planned_changes] == [80.0, 70.0, 75.0, 10.0, 0.0]


def test_a_blind_plant_hides_why_it_alone_refuses(plant_node: ModuleType) -> None:
    node = NodeBench(plant_node, parameters=LEAKING).node
    with pytest.raises(InputError, match=BOTH):
        node.accept({LEVEL: 0.5}, {})
    node = NodeBench(plant_node, parameters=LEAKING, blind=True).node
    with pytest.raises(InputError) as sentence:
        node.accept({LEVEL: 0.5}, {})
    assert str(sentence.value) == "the plant refuses this in its present state; a blind plant does not give the reason"
    assert node.planned_changes == []
