"""A controller's node before its first cycle: parameters, frames, memory. Each test has the module as argument, so that it can
run on mutants (tests/mutation). The cycle is made up (node_bench.py)."""

from pathlib import Path
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
LIMITS = Path(rt_controller.loop.node.__file__).parents[1] / "parameters" / "limits.toml"


@pytest.fixture
def node() -> ModuleType:
    return load_mutant(parse_plain(rt_controller.loop.node))


def list_frames(clutch: str | None) -> tuple[list[Any], list[Any]]:
    """The frames that the controller of a clutch receives and sends, in their order."""
    own, other = (FRAMES_B, FRAMES) if clutch == "b" else (FRAMES, FRAMES_B)
    of_the_other = [other[name] for name in OF_THE_OTHER] if clutch else []
    return [own[name] for name in RECEIVED] + of_the_other, [own[n] for n in (SENT_BY_B if clutch == "b" else SENT)]


# --- parameters ------------------------------------------------------------------------------------------------------


def make_calibration(rig: str) -> str:
    parts = "".join(
        f"[{part}.torque]\ndemand_limit = {value}\n" for part, value in (("controller", 21.0), ("controller_b", 22.0))
    )
    return f'[calibration]\nrig = "{rig}"\n{parts}'


def test_parameters_are_those_of_the_file_that_changes_the_shipped_ones(node: ModuleType) -> None:
    shipped = node.load_controller_parameters()
    assert shipped["torque.demand_limit"].value == 30.0
    assert "guard.pressure" not in shipped
    with written("[torque]\ndemand_limit = 12.5\n") as path:
        changed = node.load_controller_parameters(path)
        assert {name for name in shipped if changed[name] != shipped[name]} == {"torque.demand_limit"}
        made = NodeBench(node, parameters_file=path)
        assert made.node.parameters["torque.demand_limit"].value == made.settings.demand_limit == 12.5


def test_of_a_calibration_each_controller_takes_its_part(node: ModuleType) -> None:
    for clutch, rig, part, demand in (
        (None, "wet_clutch", "controller", 21.0), ("a", "power_shift", "controller", 21.0),
        ("b", "power_shift", "controller_b", 22.0),
    ):  # fmt: skip
        assert node.name_calibration_part(clutch) == part
        with written(make_calibration(rig)) as path:
            assert node.load_controller_parameters(path, clutch)["torque.demand_limit"].value == demand
            assert NodeBench(node, parameters_file=path, clutch=clutch).settings.demand_limit == demand


def test_a_calibration_of_another_rig_is_refused(node: ModuleType) -> None:
    for clutch, rig, other in ((None, "wet_clutch", "power_shift"), ("b", "power_shift", "wet_clutch")):
        with written(make_calibration(other)) as path, pytest.raises(InputError, match=f"allowed is '{rig}'"):
            node.load_controller_parameters(path, clutch)
    assert (node.RIG, node.RIG_OF_TWO) == ("wet_clutch", "power_shift")


def test_the_shipped_parameters_are_those_of_controller_and_guard(node: ModuleType) -> None:
    shipped = node.load_shipped_parameters()
    assert {"torque.demand_limit", "guard.pressure"} <= set(shipped)
    assert set(shipped) == set(NodeBench(node).node.parameters)


def test_the_voltage_may_reach_the_guards_limit_and_no_more(node: ModuleType) -> None:
    with written("[pressure]\nvoltage_limit = 4.0\n") as path:
        NodeBench(node, parameters_file=path)
    with written("[pressure]\nvoltage_limit = 4.125\n") as path, pytest.raises(InputError) as refused:
        NodeBench(node, parameters_file=path)
    assert str(refused.value) == "parameter pressure.voltage_limit = 4.125 V is above the guard's limit of 4 V"


CONTRADICTIONS = {
    "[torque]\npressure_limit = 9.0": "torque.pressure_limit = 9 bar is above the guard's limit of 5 bar",
    "[lock]\npressure_limit = 5.1": "lock.pressure_limit = 5.1 bar is above the guard's limit of 5 bar",
    "[pressure]\nslow_above = 6.0": "pressure.slow_above = 6 bar is above the guard's limit of 5 bar",
    "[phases]\nmotor_torque_limit = 60.0": "phases.motor_torque_limit = 60 Nm is above the guard's limit of 40 Nm",
    "[phases]\nfill_pressure = 2.0": "model.contact_pressure = 2.35 bar is not below phases.fill_pressure = 2 bar",
    "[model]\ncontact_pressure = 6.0\n[phases]\nfill_pressure = 2.6": (
        "model.contact_pressure = 6 bar is not below phases.fill_pressure = 2.6 bar"
    ),
    "[phases]\nlost_pressure = 2.35": "phases.lost_pressure = 2.35 bar is not below model.contact_pressure = 2.35 bar",
    "[phases]\nreleased_pressure = 3.0": "phases.released_pressure = 3 bar is not below model.contact_pressure",
}


def test_parameters_that_contradict_each_other_are_refused(node: ModuleType) -> None:
    for text, sentence in CONTRADICTIONS.items():
        with written(f"{text}\n") as path, pytest.raises(InputError) as refused:
            NodeBench(node, parameters_file=path)
        assert sentence in str(refused.value)
        if "is not below" in sentence:
            assert str(refused.value).endswith("would count as open while it is closed: change one of them")


FOLLOWING = ("phases.released_pressure", "phases.lost_pressure", "pressure.floor", "phases.fill_pressure")


def test_the_pressures_that_a_file_leaves_out_follow_its_contact_pressure(node: ModuleType) -> None:
    shipped = node.load_controller_parameters()
    for contact in (0.3, 1.2, 3.9, 10.0):
        with written(f"[model]\ncontact_pressure = {contact}\n") as path:
            own = NodeBench(node, parameters_file=path).node.parameters
        share = contact / shipped["model.contact_pressure"].value
        assert {name for name in shipped if own[name] != shipped[name]} == {"model.contact_pressure", *FOLLOWING}
        for name in FOLLOWING[:3]:
            assert own[name].value == pytest.approx(share * shipped[name].value, rel=1e-12)
        assert own["phases.fill_pressure"].value == pytest.approx(contact + 0.25, abs=1e-12)


def test_a_pressure_that_a_file_gives_does_not_follow(node: ModuleType) -> None:
    given = (
        "[model]\ncontact_pressure = 1.2\n[phases]\nlost_pressure = 0.2\n[pressure]\nfloor = 2.0\n"  # 2.0: as shipped
    )
    with written(given) as path:
        own = node.load_controller_parameters(path)
        assert [own[name].value for name in FOLLOWING[1:3]] == [0.2, 2.0]
        assert own["phases.released_pressure"].value < 0.6
    with written("[torque]\ndemand_limit = 12.5\n") as path:  # without a contact pressure nothing follows
        own, shipped = node.load_controller_parameters(path), node.load_controller_parameters()
        assert [own[name] for name in FOLLOWING] == [shipped[name] for name in FOLLOWING]


def test_two_gears_must_differ(node: ModuleType) -> None:
    with written("[driveline]\nratio_a = 2.0\n") as path, pytest.raises(InputError) as refused:
        NodeBench(node, parameters_file=path)
    assert str(refused.value) == "parameters driveline.ratio_a and driveline.ratio_b are both 2; two gears must differ"
    with written("[driveline]\nratio_a = 1.5\n") as path:
        NodeBench(node, parameters_file=path)


def test_limits_that_protect_from_nothing_are_refused(node: ModuleType) -> None:
    text = LIMITS.read_text()
    assert text.count("[1.0, 59.4]") == 1
    with written(text.replace("[1.0, 59.4]", "[1.0, 70.0]")) as path:
        node.LIMITS = path  # type: ignore[attr-defined]
        with pytest.raises(InputError, match=r"guard\.pressure has 70 bar"):
            NodeBench(node)


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
