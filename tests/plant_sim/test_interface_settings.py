"""What the plant's compiled steps are given at the start. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

import plant_sim.node.interface
from plant_sim.node.noise import draw
from protocols.can.frames import load_frames
from protocols.can.words import make_frame_definition
from tests.mutation.mutants import load_mutant, parse_plain
from tests.plant_sim.interface_bench import NOMINAL, InterfaceBench

VALVE, MOTOR, ANALOG, ENCODER = 0x080, 0x090, 0x100, 0x101  # identifiers; those of clutch b are 8 more
PLANT_STATUS, CONTROLLER_BEAT, PLANT_BEAT = 0x301, 0x700, 0x701
FRAMES = {"a": load_frames(), "b": load_frames(clutch="b")}


@pytest.fixture
def interface() -> ModuleType:
    return load_mutant(parse_plain(plant_sim.node.interface))


def test_a_plant_begins_before_its_first_sample(interface: ModuleType) -> None:
    bench = InterfaceBench(interface, columns=("one", "two", "three"), rate=400)
    node = bench.node
    assert (node.tick, bench.state.tick, bench.state.clutches[0].answered_tick) == (-1, -1, -1)
    assert (node.rate, node.late_cycles, node.lockstep, node.injected_changes) == (400, 0, False, [])
    assert node.record.tolist() == [0.0, 0.0, 0.0]
    assert len(node.outbox) == 512
    assert node.heartbeat_period == 0.05
    assert node.steady is False


def test_a_compiled_step_gets_one_record_of_state_and_one_of_settings(interface: ModuleType) -> None:
    node = InterfaceBench(interface).node
    assert (len(node._interfaces), len(node._settings)) == (1, 1)


def test_settings_tell_rate_session_and_clutches(interface: ModuleType) -> None:
    for clutches in (1, 2):
        s = InterfaceBench(interface, clutches, rate=400, session=0x1234).settings
        assert (s.rate, s.period, s.session, s.count) == (400, 0.0025, 0x1234, clutches)
        assert s.claim_session == 0x9234


def test_a_rig_has_two_clutches_at_most(interface: ModuleType) -> None:
    with pytest.raises(ValueError, match="longer"):
        InterfaceBench(interface, clutches=3)


def test_times_become_whole_cycles(interface: ModuleType) -> None:
    """10 ms for the oldest sample that is answered, 15 ms until the valve is latched, 1 s for the memory of gaps; 100 ms from
    status to status, 50 ms from heartbeat to heartbeat and claim to claim."""
    for rate, cycles in {
        5: (2, 6, 5, 1, 1, 1), 20: (2, 6, 20, 2, 1, 1), 100: (2, 6, 100, 10, 5, 5), 300: (3, 6, 300, 30, 15, 15),
        400: (4, 6, 400, 40, 20, 20), 480: (5, 7, 480, 48, 24, 24), 1000: (10, 15, 1000, 100, 50, 50),
    }.items():  # fmt: skip
        s = InterfaceBench(interface, rate=rate).settings
        sentence = s.oldest, s.latch_after, s.gap_memory, s.status_every, s.heartbeat_every, s.claim_every
        assert sentence == cycles, rate


def test_identifiers_of_the_plant_are_watched(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    assert list(bench.settings.own[:4]) == [PLANT_BEAT, PLANT_STATUS, ANALOG, ENCODER]
    assert len(bench.settings.own) == 10
    assert max(bench.settings.own[4:]) < 0, "no frame has it"
    assert bench.state.own["can_id"].tolist() == [PLANT_BEAT, PLANT_STATUS, ANALOG, ENCODER, *[0] * 6]
    assert bench.state.own["length"].tolist() == [8, 8, 8, 8, *[0] * 6]
    assert bench.state.own["data_id"].tolist()[:4] == [50945, 49921, 49408, 49409]
    bench = InterfaceBench(interface, clutches=2)
    both = [PLANT_BEAT, PLANT_STATUS, ANALOG, ENCODER, ANALOG + 8, ENCODER + 8]
    assert list(bench.settings.own[:6]) == both
    assert bench.state.own["can_id"].tolist() == [*both, *[0] * 4]


def test_commands_of_each_clutch_are_received(interface: ModuleType) -> None:
    state = InterfaceBench(interface, clutches=2).state
    rows = [state.motor, *(row for clutch in state.clutches for row in (clutch["valve"], clutch["heartbeat"]))]
    assert [(int(row["can_id"]), int(row["data_id"]), int(row["length"])) for row in rows] == [
        (MOTOR, 49296, 8), (VALVE, 49280, 8), (CONTROLLER_BEAT, 50944, 8),
        (VALVE + 8, 49288, 8), (CONTROLLER_BEAT + 8, 50952, 8),
    ]  # fmt: skip
    assert state.clutches["answered_tick"].tolist() == [-1, -1]


def test_frames_are_defined_as_in_the_dbc(interface: ModuleType) -> None:
    settings = InterfaceBench(interface, clutches=2).settings
    for name in ("MOTOR_COMMAND", "PLANT_STATUS", "PLANT_HEARTBEAT"):
        assert settings[name.lower()].tolist() == make_frame_definition(FRAMES["a"][name]).tolist()
    for clutch, its in zip("ab", settings.clutches, strict=True):
        for name in ("VALVE_COMMAND", "CONTROLLER_HEARTBEAT", "SUPERVISOR_CLAIM", "ANALOG_SENSORS", "ENCODER"):
            assert its[name.lower()].tolist() == make_frame_definition(FRAMES[clutch][name]).tolist()


def test_set_points_are_bound_to_the_session_of_the_claim(interface: ModuleType) -> None:
    for session, claim in ((9, 0x8009), (0x12345, 0xA345)):
        settings = InterfaceBench(interface, clutches=2, session=session).settings
        for k, data_id in enumerate((49536, 49544)):
            sentence = settings.clutches[k].torque_setpoint
            assert (sentence.can_id, sentence.data_id) == (0x180 + 8 * k, data_id ^ claim)
        assert settings.clutches[0].torque_setpoint.torque_demand.mask > 0


def test_a_valve_has_the_converter_of_its_parameters(interface: ModuleType) -> None:
    own = NOMINAL.with_values({"sensors.dac_range": 5.0, "sensors.dac_bits": 12.0})
    clutches = InterfaceBench(interface, clutches=2, parameters=own).settings.clutches
    assert clutches["dac_range"].tolist() == [5.0, 10.0]
    assert clutches["dac_bits"].tolist() == [12, 16]


def test_each_clutch_has_the_noise_of_its_seed(interface: ModuleType) -> None:
    bench = InterfaceBench(interface, clutches=2)
    for seed, source in zip((5, 6), bench.settings.clutches["noise_source"], strict=True):
        assert source != 0
        numbers = np.zeros(4)
        draw(int(source), numbers)
        assert numbers.tolist() == np.random.default_rng(seed).standard_normal(4).tolist()


def test_the_bus_has_the_frames_of_all_clutches_and_the_first_seed(interface: ModuleType) -> None:
    made = list[Any]()
    interface.DisturbedBus = lambda *arguments: made.append(arguments) or "bus"  # type: ignore[attr-defined]
    for clutches in (1, 2):
        node = InterfaceBench(interface, clutches, rate=400).node
        rate, seed, frames = made.pop()
        assert (node.bus, rate, seed) == ("bus", 400, 5)
        known = [codec.can_id for clutch in "ab"[:clutches] for codec in FRAMES[clutch].values()]
        assert sorted(codec.can_id for codec in frames) == sorted(set(known))
