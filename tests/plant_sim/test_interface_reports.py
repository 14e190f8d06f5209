"""What a plant tells of its controllers, and of frames that it does not use. Each test has the module as argument, so that it
can run on mutants (tests/mutation)."""

from types import ModuleType

import pytest

import plant_sim.node.interface
from plant_sim.node.plant_cycle import Refusal
from protocols.can.lifecycle import Lifecycle
from protocols.errors import InputError
from tests.mutation.mutants import load_mutant, parse_plain
from tests.plant_sim.interface_bench import InterfaceBench

NONE = dict.fromkeys(
    ("received", "lost", "repeated", "conflicting", "wrong_sequence", "corrupt", "misshapen", "unusable"), 0
)


@pytest.fixture
def interface() -> ModuleType:
    return load_mutant(parse_plain(plant_sim.node.interface))


# --- controllers -----------------------------------------------------------------------------------------------------


def test_the_tick_that_is_answered_is_common_to_all_that_run(interface: ModuleType) -> None:
    active, ended = Lifecycle.ACTIVE, Lifecycle.FINALIZED
    for controllers, answered in {
        ((active, 0),): 0, ((active, 7),): 7, ((ended, 7),): 7, ((active, -1),): -1,
        ((active, 7), (active, 7)): 7, ((active, 7), (active, 8)): -1, ((active, 7), (ended, 3)): 7,
        ((ended, 3), (Lifecycle.UNCONFIGURED, 7)): 7, ((Lifecycle.UNCONFIGURED, 3), (active, 7)): -1,
        ((ended, 7), (ended, 7)): -1,
    }.items():  # fmt: skip
        bench = InterfaceBench(interface, clutches=len(controllers))
        for clutch, (lifecycle, tick) in zip(bench.state.clutches, controllers, strict=False):
            clutch["controller"], clutch["answered_tick"] = lifecycle, tick
        assert bench.node.answered_tick == answered, controllers


def test_the_state_of_controllers_is_what_they_have_in_common(interface: ModuleType) -> None:
    active, ended = Lifecycle.ACTIVE, Lifecycle.FINALIZED
    for states, common in {
        (active,): active, (ended,): ended, (active, active): active, (ended, ended): ended,
        (active, ended): Lifecycle.INACTIVE, (Lifecycle.UNCONFIGURED, active): Lifecycle.INACTIVE,
    }.items():  # fmt: skip
        bench = InterfaceBench(interface, clutches=len(states))
        for clutch, state in zip(bench.state.clutches, states, strict=False):
            clutch["controller"] = state
        assert bench.node.controller is common, states


# --- counts ----------------------------------------------------------------------------------------------------------


def test_frames_that_come_are_counted_by_name(interface: ModuleType) -> None:
    bench = InterfaceBench(interface, clutches=2)
    rows = [
        bench.state.motor,
        *(row for clutch in bench.state.clutches for row in (clutch["valve"], clutch["heartbeat"])),
    ]
    for number, row in enumerate(rows, 1):
        row["received"], row["lost"] = number, 10 * number
    names = "MOTOR_COMMAND", "VALVE_COMMAND", "CONTROLLER_HEARTBEAT", "VALVE_COMMAND_B", "CONTROLLER_HEARTBEAT_B"
    assert bench.node.count_receptions() == {
        name: NONE | {"received": number, "lost": 10 * number} for number, name in enumerate(names, 1)
    }
    assert list(InterfaceBench(interface).node.count_receptions()) == list(names[:3])


def test_frames_of_others_on_identifiers_of_the_plant_are_counted_where_there_are_some(interface: ModuleType) -> None:
    for clutches, places in ((1, {1: "PLANT_STATUS", 3: "ENCODER"}), (2, {0: "PLANT_HEARTBEAT", 5: "ENCODER_B"})):
        bench = InterfaceBench(interface, clutches)
        assert bench.node.count_strays() == {}
        for place in places:
            bench.state.own[place]["corrupt"] = 1 + place
        assert bench.node.count_strays() == {name: NONE | {"corrupt": 1 + place} for place, name in places.items()}


# --- what was wrong --------------------------------------------------------------------------------------------------

SENTENCES = [  # why, identifier, value, clutch of two; the sentence with two clutches, and what is gone with one
    (Refusal.SECOND_PLANT, 0x101, 0, 0, "a second plant is on the bus: it sends ENCODER (0x101)", ""),
    (Refusal.RATE, 0x700, 250, 1, "the controller of clutch b runs at 250 Hz, this plant at 500 Hz: give both one rate",
     " of clutch b"),
    (Refusal.LENGTH, 0x080, 5, 0, "frame VALVE_COMMAND (0x080) was received with 5 bytes; its definition has 8", ""),
    (Refusal.LIFECYCLE, 0x700, 7, 0, "lifecycle 7 of the controller of clutch a is unknown; allowed are 0 to 3",
     " of clutch a"),
    (Refusal.AGE, 0x090, 12, 0, "frame MOTOR_COMMAND (0x090) answers a sample of 12 ticks ago; allowed are 5", ""),
    (Refusal.AGE, 0x080, 13, 0, "frame VALVE_COMMAND (0x080) answers a sample of 13 ticks ago; allowed are 5", ""),
]  # fmt: skip


def test_the_first_frame_that_is_not_used_is_told(interface: ModuleType) -> None:
    for why, can_id, value, k, sentence, of_two in SENTENCES:
        for clutches in (1, 2):
            bench = InterfaceBench(interface, clutches, rate=500)
            assert bench.node.first_rejected == ""
            s = bench.state
            s.rejected_why, s.rejected_id, s.rejected_value, s.rejected_clutch = why, can_id, value, k
            assert bench.node.first_rejected == (sentence if clutches == 2 else sentence.replace(of_two, ""))


def test_a_frame_that_ends_the_service_is_raised(interface: ModuleType) -> None:
    for why, can_id, value, k, sentence, _ in SENTENCES:
        bench = InterfaceBench(interface, clutches=2, rate=500)
        bench.why, s = why, bench.state
        s.refused_id, s.refused_value, s.refused_clutch = can_id, value, k
        with pytest.raises(InputError) as message:
            bench.node.take(bench.node._inbox, 0)
        assert str(message.value) == sentence
        assert len(bench.taken) == 1
