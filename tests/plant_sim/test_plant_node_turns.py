"""How a plant's node begins, samples and calls its kernels. Each test has the module as argument, so that it can run on mutants
(tests/mutation). It is the source of plant_node.py with all made up that it uses (node_bench.py)."""

from math import inf
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import plant_sim.node.plant_node
from plant_sim.node.injection import Injection
from plant_sim.node.noise import draw
from plant_sim.rigs.wet_clutch import STATE
from protocols.can.frame_batch import FRAME
from protocols.errors import InputError
from tests.mutation.mutants import load_mutant, parse_plain
from tests.plant_sim.node_bench import NOMINAL, PERIOD, RATE, SUMP, MadeUpProfile, NodeBench


@pytest.fixture
def plant_node() -> ModuleType:
    return load_mutant(parse_plain(plant_sim.node.plant_node))


# --- the beginning ---------------------------------------------------------------------------------------------------


def test_a_plant_is_nominal_and_has_a_rate_of_1_khz(plant_node: ModuleType) -> None:
    node = type(NodeBench(plant_node).node)()
    assert (node.rate, node.profile, node.blind, node.finished) == (1000, None, False, False)
    assert node.parameters.as_values() == NOMINAL.as_values()
    assert node._settings[0]["session"] == 1
    numbers = np.zeros(4)
    draw(int(node._settings[0]["clutches"][0]["noise_source"]), numbers)
    assert numbers.tolist() == np.random.default_rng(1).standard_normal(4).tolist()


def test_a_plant_has_the_parameters_that_it_is_given(plant_node: ModuleType) -> None:
    own = NOMINAL.with_values({SUMP: 75.0, "motor.torque_limit": 30.0})
    node = NodeBench(plant_node, parameters=own, session=7).node
    assert node.parameters.as_values() == own.as_values()
    assert node._settings[0]["session"] == 7
    assert node._interface.torque_limit == 30.0


def test_without_a_profile_the_motor_rests_and_no_set_point_is_sent(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node)
    assert bench.node._setpoints.shape == (0, 5, 0)
    assert bench.node._interface.speed_demand == 0.0
    assert bench.node._rig.rested == [(0.0, 343.15)]
    assert bench.begun == [("make_rig", 0.0)]


def test_a_profile_gives_set_points_and_the_first_speed(plant_node: ModuleType) -> None:
    profile = MadeUpProfile()
    bench = NodeBench(plant_node, profile=profile)
    assert bench.node.profile is profile
    assert bench.node._setpoints.tolist() == [profile.table.tolist()]
    assert bench.node._interface.speed_demand == 3.0
    assert bench.node._rig.rested == [(3.0, 343.15)]


def test_oil_begins_at_a_temperature_or_at_that_of_reference(plant_node: ModuleType) -> None:
    for temperature, reference, kelvin in ((None, 70.0, 343.15), (None, 60.0, 333.15), (50.0, 60.0, 323.15)):
        own = NOMINAL.with_values({"oil.reference": reference})
        node = NodeBench(plant_node, parameters=own, temperature=temperature).node
        assert node._rig.rested == [(0.0, pytest.approx(kelvin, abs=1e-9))]


def test_oil_begins_at_35_to_150_degrees(plant_node: ModuleType) -> None:
    convert = plant_node.convert_initial_temperature
    assert [convert(celsius) for celsius in (35.0, 150.0)] == [308.15, 423.15]
    for celsius in (34.9, 150.1, -300.0, 1000.0, float("nan")):
        with pytest.raises(InputError) as message:
            convert(celsius)
        assert str(message.value) == f"oil temperature {celsius:g} degC is outside 35..150 degC"


def test_a_period_is_integrated_in_steps_of_a_tenth_of_a_millisecond_at_most(plant_node: ModuleType) -> None:
    for rate, substeps in {100: 100, 250: 40, 512: 20, 1000: 10, 4000: 3, 5000: 2, 10_000: 1, 20_000: 1}.items():
        bench = NodeBench(plant_node, rate=rate)
        bench.node.advance()
        assert bench.log == [("move", [7.0], 1.0 / rate, substeps)]


def test_the_kernels_work_on_the_memory_of_the_node(plant_node: ModuleType) -> None:
    """It is a plain tuple: for a named one Numba keeps some kB a call. The type of the state is the very object STATE."""
    node = NodeBench(plant_node).node
    assert type(node.memory) is tuple
    memory = plant_node.PlantMemory(*node.memory)
    for given, own in (
        (memory.interfaces, node._interfaces), (memory.settings, node._settings), (memory.setpoints, node._setpoints),
        (memory.rig_state, node._state.y), (memory.states, node._state.effects), (memory.parameters, node._rig.record),
        (memory.effects, node._rig.table.kernel), (memory.outbox, node.outbox), (memory.row, node.record),
        (memory.rig_state.dtype, STATE),
    ):  # fmt: skip
        assert given is own
    assert (memory.preload_pressure, memory.contact_pressure) == ("preload", "contact")
    assert (memory.period, memory.substeps) == (PERIOD, 20)


def test_all_kernels_are_called_before_a_run_with_an_effect_and_without(plant_node: ModuleType) -> None:
    """With the least of all that compiles them: one place, no frame, and a period that is over at once."""
    log = list[Any]()

    class Node:
        def __init__(self, parameters: Any) -> None:
            log.append({name: p.value for name, p in parameters.items() if p.value != NOMINAL[name].value})

        def __getattr__(self, name: str) -> Any:
            return lambda *arguments: log.append((name, *(simplify(one) for one in arguments)))

    def simplify(one: Any) -> Any:
        if isinstance(one, np.ndarray):
            return ("batch" if one.dtype == FRAME else "lines"), len(one)
        return one.clock.period_ns if hasattr(one, "clock") else one

    warm, real = plant_node.PlantNode.warm, plant_node.wet_clutch
    plant_node.PlantNode = Node  # type: ignore[attr-defined]
    plant_node.load_effects = lambda: {"internal_leakage": None}  # type: ignore[attr-defined]
    plant_node.wet_clutch = SimpleNamespace(  # type: ignore[attr-defined]
        warm=lambda: log.append(("rig",)), load_nominal=real.load_nominal
    )
    warm()
    batch, lines = ("batch", 1), ("lines", 1)
    calls = [
        ("take", batch, 0), ("step", []), ("skip_periods", 0), ("_run_real_time", 1, lines, batch, 0, 0, 0),
        ("_run_lockstep", 1, lines, batch, 0),
    ]  # fmt: skip
    assert log == [("rig",), {}, *calls, {"internal_leakage.conductance": 2e-6}, *calls]


# --- samples ---------------------------------------------------------------------------------------------------------


def test_a_sample_is_shown_and_noted_and_passes_the_bus(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node)
    for tick in (0, 1, 2):
        bench.show()
        note = ("note", tick * PERIOD, "preload", "contact")
        assert [call for call in bench.log if call[0] != "make_rig"] == [
            ("begin",),
            ("show", 0, 70.0, 2),
            note,
            ("pass", 4),
        ]
        assert bench.list_calls("make_rig") == [("make_rig", tick * PERIOD)]
        bench.log.clear()


def test_a_plant_is_steady_between_changes_after_its_first_sample(plant_node: ModuleType) -> None:
    step, ramp = Injection({SUMP: 80.0}, at=3 * PERIOD), Injection({SUMP: 90.0}, at=6 * PERIOD, ramp=2 * PERIOD)
    bench, steady = NodeBench(plant_node, injections=[step, ramp]), list[bool]()
    for _ in range(11):
        steady.append(bench.node.steady)
        bench.show()
    changes = [0, 3, 6, 7, 8]  # before the first sample, and where a value is another than before
    assert [tick for tick, still in enumerate(steady) if not still] == changes


def test_a_plant_is_steady_while_its_bus_is_clear(plant_node: ModuleType) -> None:
    asked = list[float]()
    bench = NodeBench(plant_node)
    bench.show(4)
    for clear in (True, False):
        bench.node.bus = SimpleNamespace(is_clear=lambda time, clear=clear: asked.append(time) or clear)
        assert bench.node.steady is clear
    assert asked == [4 * PERIOD, 4 * PERIOD]


def test_a_subclass_with_a_part_of_its_own_is_never_steady(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node)
    bench.show(2)
    node = type(bench.node)
    longer = {"columns": (*node.columns, node.columns[0])}
    for part in ({}, {"take": object()}, {"show": object()}, {"advance": object()}, longer):
        own = type("Own", (node,), part)(rate=RATE, parameters=NOMINAL)
        bench.node._compiled = own._compiled
        assert bench.node.steady is (not part)


def test_a_row_of_more_columns_is_filled_from_its_start(plant_node: ModuleType) -> None:
    rows = list[Any]()
    bench = NodeBench(plant_node)
    plant_node.note_sample = lambda row, *_: rows.append(row)  # type: ignore[attr-defined]
    bench.node.record = np.zeros(len(plant_node.COLUMNS) + 2)
    bench.show()
    assert rows[0].base is bench.node.record
    assert len(rows[0]) == len(plant_node.COLUMNS)


def test_a_profile_is_at_its_end_with_the_sample_at_its_last_row(plant_node: ModuleType) -> None:
    node = NodeBench(plant_node, profile=MadeUpProfile(0.5)).node
    for tick, finished in ((-1, False), (0, False), (254, False), (255, True), (256, True), (1000, True)):
        node.tick = tick
        assert node.finished is finished


# --- compiled calls --------------------------------------------------------------------------------------------------


def test_a_call_in_real_time_makes_samples_and_leaves_the_rest_to_the_line(plant_node: ModuleType) -> None:
    for samples, settled in ((1, []), (2, [("count_settled",)]), (3, [("count_settled",)])):
        bench = NodeBench(plant_node)
        bench.node.tick, bench.done = 6, (samples, 4, 9, 3, 768)
        assert bench.node.run_real_time(bench.line, bench.beat, 5, 1) == 4
        assert bench.node.tick == 6 + samples
        assert bench.log == [
            ("refresh",), ("run_real_time", ("clock", "ring"), "lines", "inbox", 12, "memory", 7, 8, 5, 1), *settled,
            ("finish_send", bench.node.outbox, 3, 768), ("discard_used", 9),
        ]  # fmt: skip


def test_a_call_in_step_makes_samples_and_leaves_the_rest_to_the_line(plant_node: ModuleType) -> None:
    """Whether the last row is written is told by the frames sent: none are left then."""
    for sent in (0, 1, 3):
        bench = NodeBench(plant_node)
        bench.node.tick, bench.done = 6, (2, 9, sent, 768)
        assert bench.node.run_lockstep(bench.line, bench.beat, 5) is (sent == 0)
        assert bench.node.tick == 8
        assert bench.log == [
            ("refresh",), ("run_lockstep", ("clock", "ring"), "lines", "inbox", "memory", 7, 8, 5), ("count_settled",),
            ("finish_send", bench.node.outbox, sent, 768), ("discard_used", 9),
        ]  # fmt: skip


def test_a_call_that_sent_nothing_is_no_refusal(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node)
    bench.done = 1, 0, 9, 0, 0
    assert bench.node.run_real_time(bench.line, bench.beat, 5, 0) == 0
    assert bench.list_calls("discard_used") == [("discard_used", 9)]


def test_a_frame_that_is_refused_ends_a_call(plant_node: ModuleType) -> None:
    message = {-1: "a second plant is on the bus", -2: "the controller runs at 250 Hz"}
    for sent, sentence in message.items():
        for run in ("run_real_time", "run_lockstep"):
            bench = NodeBench(plant_node)
            bench.node._interface.refused_id, bench.node._interface.refused_value = 0x101, 250
            bench.done = (2, 4, 9, sent, 0) if run == "run_real_time" else (2, 9, sent, 0)
            more = (5, 1) if run == "run_real_time" else (5,)
            with pytest.raises(InputError, match=sentence):
                getattr(bench.node, run)(bench.line, bench.beat, *more)
            assert bench.node.tick == 1
            assert [call[0] for call in bench.log] == ["refresh", run, "count_settled"]


def limit(bench: NodeBench, most: int, change: float, fault: float = inf) -> int:
    """Samples of a call before its tick 10, with a change of the rig and one of the bus at so many periods after that."""
    asked = list[float]()
    bench.node.tick = 9
    bench.node._schedule = SimpleNamespace(until=(10 + change) * PERIOD)
    bench.node.bus = SimpleNamespace(find_next=lambda time: asked.append(time) or (10 + fault) * PERIOD)
    samples = bench.node.limit_samples(most)
    assert asked == [10 * PERIOD]
    return int(samples)


def test_a_call_ends_before_the_next_change(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node)
    for change, samples in ((inf, 8), (9, 8), (8, 8), (7, 7), (2, 2), (1.5, 1), (1, 1), (0.5, 1), (-2, 1)):
        assert limit(bench, 8, change) == samples
        assert limit(bench, 8, inf, change) == samples
        assert limit(bench, 8, change, 5) == min(samples, 5)
    assert limit(bench, 1, inf) == 1


def test_a_time_within_a_millionth_of_a_period_is_that_of_its_sample(plant_node: ModuleType) -> None:
    bench = NodeBench(plant_node)
    assert limit(bench, 8, 5 - 0.995e-6) == 5
    assert limit(bench, 8, 5 - 1.005e-6) == 4


def test_a_call_ends_at_the_end_of_the_profile(plant_node: ModuleType) -> None:
    for duration, samples in ((17 * PERIOD, 7), (11 * PERIOD, 1), (30 * PERIOD, 8), (10 * PERIOD, 8), (2 * PERIOD, 8)):
        bench = NodeBench(plant_node, profile=MadeUpProfile(duration))
        assert limit(bench, 8, inf) == samples, "a profile that has ended ends no call"
        assert limit(bench, 8, 3) == min(samples, 3)
