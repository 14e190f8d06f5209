"""A controller's node before its first cycle: parameters, frames, memory. Each test has the module as argument, so that it can
run on mutants (tests/mutation). The cycle is made up (node_bench.py)."""

from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

import rt_controller.loop.node
from protocols.can.frames import DBC, load_frames
from protocols.errors import InputError
from tests.mutation.mutants import load_mutant, parse_plain
from tests.rt_controller.node_bench import NodeBench, written

FRAMES, FRAMES_B = load_frames(), load_frames(clutch="b")
RECEIVED = ("ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT", "PLANT_HEARTBEAT", "SUPERVISOR_CLAIM")
OF_THE_OTHER = ("ENCODER", "CONTROLLER_STATUS")
SENT = ("VALVE_COMMAND", "MOTOR_COMMAND", "CONTROLLER_STATUS", "CONTROLLER_HEARTBEAT")
SENT_BY_B = tuple(name for name in SENT if name != "MOTOR_COMMAND")  # the controller of clutch a commands the motor
CLUTCHES = (None, "a", "b")


@pytest.fixture
def node() -> ModuleType:
    return load_mutant(parse_plain(rt_controller.loop.node))


def list_frames(clutch: str | None) -> tuple[list[Any], list[Any]]:
    """The frames that the controller of a clutch receives and sends, in their order."""
    own, other = (FRAMES_B, FRAMES) if clutch == "b" else (FRAMES, FRAMES_B)
    of_the_other = [other[name] for name in OF_THE_OTHER] if clutch else []
    return [own[name] for name in RECEIVED] + of_the_other, [own[n] for n in (SENT_BY_B if clutch == "b" else SENT)]


# --- parameters ------------------------------------------------------------------------------------------------------


def test_a_controller_takes_its_part_of_a_calibration(node: ModuleType) -> None:
    parts = "".join(
        f"[{part}.torque]\ndemand_limit = {value}\n" for part, value in (("controller", 21.0), ("controller_b", 22.0))
    )
    for clutch, rig, demand in ((None, "wet_clutch", 21.0), ("a", "power_shift", 21.0), ("b", "power_shift", 22.0)):
        with written(f'[calibration]\nrig = "{rig}"\n{parts}') as path:
            made = NodeBench(node, parameters_file=path, clutch=clutch)
        assert made.settings.demand_limit == made.node.parameters["torque.demand_limit"].value == demand


def test_parameters_that_contradict_each_other_are_refused(node: ModuleType) -> None:
    with written("[pressure]\nvoltage_limit = 4.125\n") as path, pytest.raises(InputError, match="limit of 4 V"):
        NodeBench(node, parameters_file=path)


def test_the_database_is_compared_with_the_guards_layout(node: ModuleType) -> None:
    compared = []
    node.check_layout = lambda *given: compared.append(given)  # type: ignore[attr-defined]
    for clutch in CLUTCHES:
        NodeBench(node, clutch=clutch)
    assert compared == 3 * [
        (DBC, FRAMES, {"motor_range": 65.536, "pressure_range": 10.0, "data_key": 0.0})
    ]  # those of clutch b follow from those of a


# --- frames ----------------------------------------------------------------------------------------------------------


def test_a_controller_checks_the_frames_that_it_receives_and_those_on_its_own_identifiers(node: ModuleType) -> None:
    for clutch in CLUTCHES:
        received, sent = list_frames(clutch)
        made = NodeBench(node, clutch=clutch)
        assert made.node.received_ids == [codec.can_id for codec in received + sent]
        for rows, codecs in ((made.state.receptions, received), (made.state.own, sent)):
            for name in ("can_id", "length", "data_id"):
                assert rows[name][: len(codecs)].tolist() == [getattr(codec, name) for codec in codecs]
        assert len(made.settings.own) == len(made.state.own) == 4
        assert made.settings.own[: len(sent)].tolist() == [codec.can_id for codec in sent]
        without_use = [*made.settings.own[len(sent) :], *made.state.receptions["can_id"][len(received) :]]
        assert all(can_id < 0 for can_id in without_use), "no frame has the identifier of a place without use"


def test_claims_of_others_are_received_apart(node: ModuleType) -> None:
    for clutch, frames in ((None, FRAMES), ("b", FRAMES_B)):
        others, claim = NodeBench(node, clutch=clutch).state.claim.others, frames["SUPERVISOR_CLAIM"]
        assert (others.can_id, others.length, others.data_id) == (claim.can_id, claim.length, claim.data_id)


def test_frames_are_read_and_written_as_the_database_has_them(node: ModuleType) -> None:
    for clutch, frames in ((None, FRAMES), ("a", FRAMES), ("b", FRAMES_B)):
        made = NodeBench(node, clutch=clutch)
        assert {name: codec.can_id for name, codec in made.node.frames.items()} == {
            name: codec.can_id for name, codec in frames.items()
        }
        for name in (*RECEIVED, *SENT):
            definition, codec = made.settings[name.lower()], frames[name]
            assert (definition.can_id, definition.length, definition.data_id) == (
                codec.can_id,
                codec.length,
                codec.data_id,
            )
            for signal in codec.definitions:
                if signal.name.lower() in codec.signals:
                    place = definition[signal.name.lower()]
                    assert (place.start, place.scale, place.offset) == (signal.start, signal.scale, signal.offset)


def test_the_controller_of_clutch_a_drives_the_motor(node: ModuleType) -> None:
    assert [bool(NodeBench(node, clutch=clutch).settings.drives) for clutch in CLUTCHES] == [True, True, False]


# --- settings and states ---------------------------------------------------------------------------------------------


def test_without_wishes_a_controller_runs_at_1_khz_with_both_laws_and_adapts(node: ModuleType) -> None:
    made = NodeBench(node)
    law = made.settings.law
    assert (made.node.rate, made.settings.rate, made.settings.session) == (1000, 1000, 1)
    assert (bool(law.feeds_forward), bool(law.feeds_back), bool(law.torque.adapts)) == (True, True, True)


def test_period_rate_and_session_are_those_that_are_given(node: ModuleType) -> None:
    made = NodeBench(node, 512, session=9)
    assert (made.node.rate, made.settings.period, made.settings.rate, made.settings.session) == (
        512,
        1.0 / 512.0,
        512,
        9,
    )


def test_status_and_heartbeat_come_at_their_cycle_times_and_at_most_every_cycle(node: ModuleType) -> None:
    for rate, status, heartbeat in ((1000, 100, 50), (500, 50, 25), (32, 3, 2), (10, 1, 1), (4, 1, 1)):
        with patch.object(node, "check_speed"):  # the shipped limit needs 7 Hz
            made = NodeBench(node, rate)  # 100 ms and 50 ms
        assert (made.settings.status_every, made.settings.heartbeat_every) == (status, heartbeat)
        assert made.node.heartbeat_period == 0.05


def test_a_rate_at_which_the_angle_wraps_below_the_limit_of_the_slip_is_refused(node: ModuleType) -> None:
    with pytest.raises(InputError, match=r"has 31\.4 rad/s; at 5 Hz allowed is up to 25 rad/s"):
        NodeBench(node, 5)


def test_the_law_is_the_one_that_is_given(node: ModuleType) -> None:
    for law, forward, back in (("both", True, True), ("feedforward", True, False), ("feedback", False, True)):
        settings = NodeBench(node, law=law).settings.law
        assert (bool(settings.feeds_forward), bool(settings.feeds_back)) == (forward, back)
    with pytest.raises(InputError, match="control law 'none' is unknown"):
        NodeBench(node, law="none")


def test_a_controller_adapts_where_it_is_alone_and_may(node: ModuleType) -> None:
    for clutch in CLUTCHES:
        for adaptation in (True, False):
            torque = NodeBench(node, adaptation=adaptation, clutch=clutch).settings.law.torque
            assert bool(torque.adapts) is (adaptation and clutch is None)
            assert bool(torque.alone) is (clutch is None)


def test_the_guard_has_its_limits_in_counts_and_the_identifiers_of_its_clutch(node: ModuleType) -> None:
    for clutch, offset in ((None, 0), ("a", 0), ("b", FRAMES_B["ENCODER"].can_id - FRAMES["ENCODER"].can_id)):
        guard = NodeBench(node, 500, clutch=clutch).settings.guard
        assert guard.pressure == pytest.approx(5.0 / 0.0048828125)  # bar; the factor of the DBC
        assert guard.frozen_samples == pytest.approx(0.05 * 500)  # s
        assert (guard.stale_cycles, guard.confirm_samples, guard.offset) == (5.0, 3.0, offset)
    assert offset != 0


def test_nothing_is_known_at_the_beginning(node: ModuleType) -> None:
    with written("[model]\noil_reference = 60.0\n") as path:
        made = NodeBench(node, parameters_file=path)
    state = made.state
    assert state.setpoint_age == state.other.age == np.inf
    assert state.sample.tick == state.other.tick == made.node.sample_tick == -1
    assert state.sample.temperature == 60.0 + 273.15, "until the first sample"
    assert state.law.torque.level == state.law.torque.adaptation.level == 1.0, "no correction"
    assert state.cycle == state.beats == state.guard.armed == state.claim.session == 0


# --- memory ----------------------------------------------------------------------------------------------------------


def test_memory_has_the_arrays_of_the_node(node: ModuleType) -> None:
    made = NodeBench(node).node
    assert made.states.shape == made.settings.shape == (1,)
    assert made.outbox.shape == (len(SENT),)
    assert made.record.shape == (len(made.columns),)
    for own, shared in zip((made.states, made.settings, made.outbox, made.record), made.memory, strict=True):
        assert own is shared
    made.states["record"][made.columns[1].name] = 7.0
    assert made.record[1] == 7.0, "the record is a view"


def test_the_cycle_is_compiled_at_the_beginning_on_copies(node: ModuleType) -> None:
    made = NodeBench(node, 500)
    cycle, reception = made.beginning
    assert (cycle.name, reception.name) == ("run_cycle", "receive_before_start")
    assert (cycle.frames, cycle.more[0], reception.frames) == ([], 1, []), "one period without a frame"
    for call in (cycle, reception):
        assert call.states == made.node.states
        assert not np.shares_memory(call.states, made.node.states)
        assert call.settings is made.node.settings, "nothing changes them"
    assert cycle.more[1].shape == made.node.outbox.shape
    assert not np.shares_memory(cycle.more[1], made.node.outbox)
