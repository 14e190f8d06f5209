"""Frames between the bus and a plant's compiled steps. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

import plant_sim.node.interface
from plant_sim.node.injection import Injection
from protocols.can.frame_batch import load, make_batch, unload
from protocols.can.frames import Frame, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.errors import InputError
from tests.mutation.mutants import load_mutant, parse_plain
from tests.plant_sim.interface_bench import NO_TABLES, PERIOD, InterfaceBench

BEAT = load_frames()["PLANT_HEARTBEAT"]
FIRST, SECOND = Frame(0x080, b"first\0"), Frame(0x090, b"second\0")
CHANGED = [Frame(0x080, b"first\xff"), Frame(0x090, b"second\xff")]


@pytest.fixture
def interface() -> ModuleType:
    return load_mutant(parse_plain(plant_sim.node.interface))


# --- a sample --------------------------------------------------------------------------------------------------------


def test_a_step_takes_frames_then_makes_a_sample_then_moves_the_rig(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    assert bench.node.step([FIRST]) == bench.shown
    assert bench.taken == [[FIRST]]
    assert bench.log == [("show",), ("advance",)]


def test_a_step_that_is_refused_makes_no_sample(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    bench.why, bench.state.refused_value = 2, 250
    with pytest.raises(InputError):
        bench.node.step([FIRST])
    assert bench.log == []


def test_a_sample_is_the_frames_that_were_shown(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    bench.shown = [FIRST, SECOND]
    assert bench.node.sample() == [FIRST, SECOND]
    assert bench.log == [("show",)]


def test_a_sample_begins_with_the_next_tick(interface: ModuleType) -> None:
    tables = np.zeros((1, 5, 2))
    bench = InterfaceBench(interface, setpoints=tables)
    node = bench.node
    node.late_cycles = 4
    for tick in (0, 1):
        assert node._begin() == 3
        ((_, *given),) = bench.list_calls("begin")
        assert given[:2] == [tick, 4]
        assert given[2] is tables
        assert given[3] is node.outbox
        bench.log.clear()
    assert node.tick == 1


def test_the_sensors_of_a_clutch_are_shown_after_other_frames(interface: ModuleType) -> None:
    class Rig:
        record, table = "parameters", type("Table", (), {"kernel": "effects"})

    bench = InterfaceBench(interface)
    bench.node.tick = 6
    assert bench.node._show(1, Rig(), ("y", "states"), 2) == 5
    assert bench.log == [("show", 1, 6, "y", "states", "parameters", "effects", bench.node.outbox, 2)]


def test_a_row_is_plain_numbers(interface: ModuleType) -> None:
    node = InterfaceBench(interface, columns=("one", "two")).node
    node.record[:] = 1.5, -2.0
    assert node.make_row() == (1.5, -2.0)
    assert type(node.make_row()[0]) is float


# --- a sample on the bus ---------------------------------------------------------------------------------------------


def test_on_a_clear_bus_a_sample_is_sent_as_it_is(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    bench.disturb(clear=True)
    bench.node.tick = 3
    load(bench.node.outbox, [FIRST, SECOND])
    assert bench.node._pass_samples(2) == 2
    assert bench.log == [("is_clear", 3 * PERIOD)]
    assert unload(bench.node.outbox[:2]) == [FIRST, SECOND]
    assert bench.node.injected_changes == []


def test_on_a_disturbed_bus_a_sample_is_what_the_bus_makes_of_it(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    bench.disturb()
    bench.node.tick, bench.node.injected_changes = 3, ["before"]
    load(bench.node.outbox, [FIRST, SECOND, Frame(0x100, b"old")])
    assert bench.node._pass_samples(2) == 4
    assert bench.log == [("is_clear", 3 * PERIOD), ("begin", 3 * PERIOD), ("samples", 3, [FIRST, SECOND])]
    assert unload(bench.node.outbox[:4]) == 2 * CHANGED
    assert bench.node.injected_changes == ["before", {"begun at": 512}]


def test_a_bus_that_adds_too_many_frames_fills_the_outbox(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    bench.disturb().copies = 600
    load(bench.node.outbox, [FIRST])
    assert bench.node._pass_samples(1) == 512
    assert unload(bench.node.outbox[511:]) == CHANGED[:1]


# --- commands --------------------------------------------------------------------------------------------------------


def test_frames_are_taken_in_parts_of_the_inbox(interface: ModuleType) -> None:
    for parts in ([0], [1], [4095], [4096], [4096, 1], [4096, 4096, 4]):
        bench = InterfaceBench(interface)
        frames = [Frame(0x080, n.to_bytes(8, "big")) for n in range(sum(parts))]
        bench.node.receive(frames)
        assert [len(part) for part in bench.taken] == parts
        assert [frame for part in bench.taken for frame in part] == frames


def test_frames_of_a_batch_are_taken(interface: ModuleType) -> None:
    bench, inbox = InterfaceBench(interface), make_batch(3)
    load(inbox, [FIRST, SECOND, FIRST])
    bench.node.take(inbox, 2)
    assert bench.taken == [[FIRST, SECOND]]


def test_commands_on_a_disturbed_bus_come_as_the_bus_brings_them(interface: ModuleType) -> None:
    """What it brings acts on the next sample. Before the first sample it brings all, and a bus that is clear does always."""
    changed = 2 * CHANGED[:1]
    for tick, clear, comes in ((-1, False, [FIRST]), (0, False, changed), (0, True, [FIRST]), (4, False, changed)):
        bench, inbox = InterfaceBench(interface), make_batch(3)
        bench.disturb(clear)
        bench.node.tick = tick
        load(inbox, [FIRST, SECOND])
        bench.node.take(inbox, 1)
        assert bench.taken == [comes]
        passed = [("commands", tick + 1, [FIRST])] if comes != [FIRST] else []
        assert bench.list_calls("commands") == passed
        assert bench.list_calls("is_clear") == ([] if tick < 0 else [("is_clear", (tick + 1) * PERIOD)])
        assert unload(inbox[:2]) == [FIRST, SECOND], "it is the caller's"


def test_a_bus_that_brings_too_many_commands_fills_the_inbox(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    bench.disturb().copies = 5000
    bench.node.tick = 0
    bench.node.receive([FIRST])
    assert bench.taken == [4096 * CHANGED[:1]]


def test_missed_periods_are_told(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    bench.node.skip_periods(7)
    assert bench.log == [("skip_periods", 7)]


# --- injections ------------------------------------------------------------------------------------------------------

SUMP, DELAY = "oil.sump_temperature", "frame_delay.commands"


def split(bench: InterfaceBench, *injections: Injection) -> Any:
    return bench.node._split_injections(injections)


def test_an_injection_is_split_into_its_changes_of_rig_and_bus(interface: ModuleType) -> None:
    both = Injection({SUMP: 90.0, DELAY: 20.0}, at=1.0, ramp=0.5, until=2.0)
    rig, bus = Injection({SUMP: 80.0}, at=3.0), Injection({DELAY: 10.0}, at=4.0)
    bench = InterfaceBench(interface)
    bench.disturb()
    bench.node.tick = 6
    on_rig = [Injection({SUMP: 90.0}, 1.0, 0.5, 2.0), rig]
    on_bus = [Injection({DELAY: 20.0}, 1.0, 0.5, 2.0), bus]
    assert split(bench, both, rig, bus) == (on_rig, on_bus)
    assert bench.log == [("check", on_bus, 7 * PERIOD)]
    assert split(bench) == ([], [])


def test_in_step_no_fault_of_the_bus_is_possible(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    bench.disturb()
    bench.node.lockstep = True
    rig = Injection({SUMP: 80.0})
    assert split(bench, rig) == ([rig], [])
    with pytest.raises(InputError) as sentence:
        split(bench, rig, Injection({DELAY: 10.0}))
    assert str(sentence.value) == (
        "frame_delay.commands is a fault of the bus, and in lock-step each sample waits for its answer; play it in real"
        " time, or with simulate"
    )


def test_a_fault_that_the_bus_refuses_is_refused(interface: ModuleType) -> None:
    bench = InterfaceBench(interface)
    with pytest.raises(InputError, match="is outside 0"):
        split(bench, Injection({DELAY: -1.0}))


# --- the end ---------------------------------------------------------------------------------------------------------


def test_a_plant_ends_with_a_last_heartbeat(interface: ModuleType) -> None:
    node = InterfaceBench(interface, rate=500, setpoints=NO_TABLES).node
    for beats in (1, 2):
        ((can_id, data),) = node.list_safe_frames()
        assert (can_id, data[2]) == (BEAT.can_id, beats)
        assert BEAT.is_valid(data)
        assert BEAT.unpack(data) == (Lifecycle.FINALIZED, 500, 9)
    assert BEAT.unpack(node.make_heartbeat(Lifecycle.INACTIVE).data).lifecycle == Lifecycle.INACTIVE


def test_a_plant_that_has_claimed_set_points_releases_them_first(interface: ModuleType) -> None:
    node = InterfaceBench(interface, clutches=2, setpoints=np.zeros((2, 5, 1))).node
    claims = [load_frames(clutch=clutch)["SUPERVISOR_CLAIM"] for clutch in ("a", "b")]
    for releases in (1, 2):
        *released, (can_id, _) = node.list_safe_frames()
        assert can_id == BEAT.can_id
        for codec, frame in zip(claims, released, strict=True):
            assert (frame.can_id, frame.data[2]) == (codec.can_id, releases)
            assert codec.is_valid(frame.data)
            assert (codec.unpack(frame.data).claim, codec.unpack(frame.data).session) == (0, 0x8009)
