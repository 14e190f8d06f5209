"""A controller's node in its run: cycles, refusals, tuning, reports. Each test has the module as argument, so that it can run
on mutants (tests/mutation). The cycle is made up (node_bench.py)."""

from types import ModuleType

import numpy as np
import pytest

import rt_controller.loop.node
from protocols.can.frame_batch import load
from protocols.can.frames import DBC_1, Frame, list_bus_frames, load_frames
from protocols.errors import InputError
from rt_controller.loop.cycle import Refusal
from tests.mutation.mutants import load_mutant, parse_plain
from tests.rt_controller.node_bench import NodeBench

FRAMES = load_frames()
COUNTS = ("received", "lost", "repeated", "conflicting", "wrong_sequence", "corrupt", "misshapen", "unusable")


@pytest.fixture
def node() -> ModuleType:
    return load_mutant(parse_plain(rt_controller.loop.node))


def make_frames(*names: str) -> list[Frame]:
    return [Frame(FRAMES[name].can_id, bytes([place] * 8)) for place, name in enumerate(names)]


# --- cycles ----------------------------------------------------------------------------------------------------------


def test_a_cycle_runs_on_the_memory_of_the_node_and_one_period_where_none_is_told(node: ModuleType) -> None:
    made, sent = NodeBench(node), make_frames("ENCODER", "ANALOG_SENSORS")
    inbox = made.node._inbox.copy()
    for made.result, slots in ((0, None), (3, 1), (1, 7)):
        answer = made.node.run_cycle(inbox, load(inbox, sent), *(() if slots is None else (slots,)))
        assert answer == made.result
        call = made.calls.pop()
        assert (call.name, call.frames, call.more[0]) == ("run_cycle", sent, slots or 1)
        assert (call.states, call.settings, call.more[1]) == (made.node.states, made.node.settings, made.node.outbox)
        assert all(np.shares_memory(*pair) for pair in (
            (call.states, made.node.states), (call.settings, made.node.settings), (call.more[1], made.node.outbox),
        ))  # fmt: skip


def test_a_step_takes_and_returns_frames_as_objects(node: ModuleType) -> None:
    made, came, answers = NodeBench(node), make_frames("ENCODER"), make_frames("VALVE_COMMAND", "MOTOR_COMMAND")
    load(made.node.outbox, answers)
    for made.result in (0, 1, 2):
        assert made.node.step(came) == answers[: made.result]
    assert made.node.step(came, 5) == answers
    assert [(call.frames, call.more[0]) for call in made.calls] == [(came, 1), (came, 1), (came, 1), (came, 5)]


def test_a_step_has_room_for_more_than_the_bus_carries_in_200_ms(node: ModuleType) -> None:
    made, most = NodeBench(node), 4096  # 1800 of 111 bits, at 1 Mbit/s
    made.node.step(most * make_frames("ENCODER"))
    assert len(made.calls.pop().frames) == most
    with pytest.raises(ValueError, match="too many"):
        made.node.step((most + 1) * make_frames("ENCODER"))


# --- refusals --------------------------------------------------------------------------------------------------------


def test_a_frame_that_ends_the_service_is_told(node: ModuleType) -> None:
    made = NodeBench(node, 500)
    made.state.refused_id, made.state.refused_value = FRAMES["MOTOR_COMMAND"].can_id, 1000.0
    for refusal, words in (
        (Refusal.SECOND_CONTROLLER, "a second controller is on the bus: it sends MOTOR_COMMAND (0x090)"),
        (Refusal.RATE, "the plant runs at 1000 Hz, this controller at 500 Hz: give both one rate"),
    ):
        made.result = -refusal
        for ending in (lambda: made.node.step([]), lambda: made.node.check_sent(made.result)):
            with pytest.raises(InputError) as sentence:
                ending()
            assert str(sentence.value) == words
    assert [made.node.check_sent(count) for count in (0, 1, 4)] == [0, 1, 4]


def test_before_the_first_cycle_heartbeats_and_own_commands_are_listened_to(node: ModuleType) -> None:
    came = {codec.name: Frame(codec.can_id, bytes(8)) for codec in list_bus_frames(clutches=2)}
    for clutch, early in (
        (None, {"VALVE_COMMAND", "MOTOR_COMMAND", "PLANT_HEARTBEAT"}),
        ("b", {"VALVE_COMMAND_B", "PLANT_HEARTBEAT"}),
    ):
        made = NodeBench(node, clutch=clutch)
        assert made.node.listen(list(came.values())) == [frame for name, frame in came.items() if name not in early]
        (call,) = made.calls
        assert call.name == "receive_before_start"
        assert call.frames == [frame for name, frame in came.items() if name in early]
        assert np.shares_memory(call.states, made.node.states)
        assert call.settings is made.node.settings
        assert made.node.listen([]) == made.calls[1].frames == []


def test_what_is_refused_before_the_first_cycle_ends_the_service(node: ModuleType) -> None:
    made = NodeBench(node, 500)
    made.refusal, made.state.refused_value = int(Refusal.RATE), 250.0
    with pytest.raises(InputError, match="the plant runs at 250 Hz, this controller at 500 Hz"):
        made.node.listen([])


def test_the_first_frame_that_was_not_used_is_told_with_the_limits_of_now(node: ModuleType) -> None:
    made = NodeBench(node, 500)
    assert made.node.first_rejected == ""
    made.node.tune({"torque.demand_limit": 12.0, "torque.pressure_limit": 3.5, "phases.speed_limit": 20.5})
    for why, value, words in (
        (Refusal.LENGTH, 5.0, "frame TORQUE_SETPOINT (0x180) was received with 5 bytes; its definition has 8"),
        (Refusal.REQUEST, 7.0, "request 7 is unknown; allowed are 0 idle, 1 engage, 2 release, 3 pressure, 4 lock"),
        (Refusal.TORQUE, 40.0, "set-point 40 Nm is outside 0..12 Nm"),
        (Refusal.PRESSURE, 5.5, "set-point 5.5 bar is outside 0..3.5 bar"),
        (Refusal.SPEED, -30.0, "set-point -30 rad/s is outside -20.5..20.5 rad/s"),
        (
            Refusal.SUPERVISOR,
            float(0x0A3F),
            "the claim of supervisor 0a3f was refused: another supervisor had the clutch",
        ),
        (Refusal.RATE, 250.0, "the plant runs at 250 Hz, this controller at 500 Hz: give both one rate"),
    ):
        made.state.rejected_why, made.state.rejected_id = why, FRAMES["TORQUE_SETPOINT"].can_id
        made.state.rejected_value = value
        assert made.node.first_rejected == words


# --- tuning ----------------------------------------------------------------------------------------------------------


def test_tuned_values_are_in_the_settings_each_in_the_unit_of_the_law(node: ModuleType) -> None:
    made = NodeBench(node, clutch="b")
    before = made.node.states.copy()
    made.node.tune({
        "model.contact_pressure": 2.25, "phases.released_pressure": 1.25, "phases.fill_dwell": 0.02,
        "phases.fill_timeout": 2.5, "phases.torque_mismatch": 9.0, "phases.lost_pressure": 1.75,
        "phases.setpoint_timeout": 0.3, "phases.motor_torque_limit": 33.0, "phases.speed_limit": 21.0,
        "torque.demand_limit": 13.0, "torque.pressure_limit": 3.5, "driveline.ratio_a": 4.0, "driveline.ratio_b": 5.0,
        "pressure.valve_gain": 1.5,
    })  # fmt: skip
    of, phases = made.settings, made.settings.phases
    assert [phases.contact_pressure, phases.released_pressure] == pytest.approx([2.25e5, 1.25e5], rel=1e-12)  # Pa
    assert (phases.fill_dwell, phases.fill_timeout, of.plausibility.torque_mismatch) == (0.02, 2.5, 9.0)
    assert of.plausibility.lost_pressure == pytest.approx(1.75e5, rel=1e-12)
    assert (of.setpoint_timeout, of.motor_torque_limit, of.speed_limit) == (0.3, 33.0, 21.0)
    assert (of.demand_limit, of.pressure_limit) == (13.0, 3.5)  # the latter in bar, as in the frame
    assert of.law.valve_gain == pytest.approx(1.5e5, rel=1e-12)
    assert (of.pair.ratio, of.pair.other_ratio) == (5.0, 4.0)
    assert made.node.states == before
    assert made.node.parameters["torque.demand_limit"].value == 13.0


def test_every_parameter_of_phases_is_where_it_is_used(node: ModuleType) -> None:
    made = NodeBench(node)
    phases = made.node.parameters.list_si("phases")
    for record in (made.settings.phases, made.settings.plausibility):
        names = [name for name in record.dtype.names if name != "contact_pressure"]
        assert [record[name] for name in names] == [phases[name] for name in names]
        assert min(phases[name] for name in names) > 0.0


def test_the_other_clutch_is_waited_for_while_two_of_its_statuses_are_lost(node: ModuleType) -> None:
    for clutch, ratio, other in (("a", 3.0, 2.0), ("b", 2.0, 3.0)):
        pair = NodeBench(node, clutch=clutch).settings.pair
        assert (pair.ratio, pair.other_ratio) == (ratio, other)
        assert pair.patience == pytest.approx(0.25, rel=1e-12)  # s: half a cycle time after the second
    assert NodeBench(node).settings.pair.patience == 0.0


def test_values_that_cannot_be_are_not_taken_and_neither_are_those_beside_them(node: ModuleType) -> None:
    made = NodeBench(node)
    settings, parameters = made.node.settings.copy(), made.node.parameters
    for wrong in ({"pressure.voltage_limit": 4.5}, {"driveline.ratio_a": 2.0}, {"torque.unknown": 1.0}):
        with pytest.raises(InputError):
            made.node.tune({"torque.demand_limit": 13.0} | wrong)
        assert made.node.settings == settings
        assert made.node.parameters is parameters


def test_the_parameters_of_the_guard_and_of_the_valve_are_fixed_and_no_others(node: ModuleType) -> None:
    made = NodeBench(node).node
    for name in ("pressure.valve_frequency", "pressure.valve_damping", "pressure.valve_delay", "pressure.line_lag"):
        assert made.explain_fixed(name) == (
            f"parameter {name} is fixed while the controller runs: the gains follow it at the start; change the gains"
        )
    why = "parameter guard.pressure is fixed while the controller runs: the guard's limits are set at the start"
    assert made.explain_fixed("guard.pressure") == why
    for name in ("pressure.guard", "guardian.pressure", "torque.demand_limit"):
        assert made.explain_fixed(name) is None


def test_set_points_are_read_by_the_definition_that_is_given(node: ModuleType) -> None:
    made, other = NodeBench(node), load_frames(DBC_1)["TORQUE_SETPOINT"]
    places = {signal.name: signal.start for signal in other.definitions}
    assert made.settings.torque_setpoint.request.start != places["REQUEST"]
    made.node.read_setpoints_by(other)
    for name in ("REQUEST", "TORQUE_DEMAND", "SPEED_DEMAND", "PRESSURE_DEMAND"):
        assert made.settings.torque_setpoint[name.lower()].start == places[name]


# --- reports ---------------------------------------------------------------------------------------------------------


def test_faults_are_told_with_the_first_and_their_number(node: ModuleType) -> None:
    made = NodeBench(node, 500)
    watch = made.node.watch_faults()
    assert (watch.count, watch.first, watch.verdict, watch.stands) == (0, None, "", False)
    faults = made.state.faults
    faults.count, faults.first.fault, faults.first.sample_tick, faults.first.pressure_bar = 1, 2, 1500, 5.25
    made.node.tune({"guard.pressure": 5.5})  # the limit that is told
    watch = made.node.watch_faults()
    assert watch.count == 1
    assert watch.verdict.startswith(
        "fault at 3.00 s: overpressure: the cylinder pressure is too high (limit 5.5 bar); pressure 5.25 bar, "
    )
    faults.count = 3
    assert made.node.watch_faults().verdict.startswith("3 faults, the first: fault at 3.00 s: overpressure")
    assert watch.take(np.zeros((1, len(made.node.columns))))[0].name == "none", "it takes more rows"


def test_a_row_is_the_record_in_the_order_of_the_columns(node: ModuleType) -> None:
    made = NodeBench(node)
    values = tuple(float(at) for at in range(len(made.node.columns)))
    for column, value in zip(made.node.columns, values, strict=True):
        made.state.record[column.name] = value
    assert made.node.make_row() == values


def test_late_cycles_are_those_that_the_service_has_set(node: ModuleType) -> None:
    made = NodeBench(node)
    assert made.node.late_cycles == 0
    made.node.late_cycles = 12
    assert made.node.late_cycles == made.state.late_cycles == 12


def test_receptions_are_counted_by_the_names_of_the_frames(node: ModuleType) -> None:
    for clutch, names in (
        (None, ["ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT", "PLANT_HEARTBEAT", "SUPERVISOR_CLAIM"]),
        ("b", ["ANALOG_SENSORS_B", "ENCODER_B", "TORQUE_SETPOINT_B", "PLANT_HEARTBEAT", "SUPERVISOR_CLAIM_B", "ENCODER",
               "CONTROLLER_STATUS"]),
    ):  # fmt: skip
        made = NodeBench(node, clutch=clutch)
        for place, row in enumerate(made.state.receptions):
            for count, name in enumerate(COUNTS):
                row[name] = 10 * place + count
        counted = made.node.count_receptions()
        assert list(counted) == names
        for place, counts in enumerate(counted.values()):
            assert counts == {name: 10 * place + count for count, name in enumerate(COUNTS)}


def test_strays_are_the_frames_on_own_identifiers_that_have_come(node: ModuleType) -> None:
    none = dict.fromkeys(COUNTS, 0)
    for clutch, names in ((None, ["MOTOR_COMMAND", "CONTROLLER_HEARTBEAT"]), ("b", ["CONTROLLER_STATUS_B"])):
        made = NodeBench(node, clutch=clutch)
        assert made.node.count_strays() == {}
        made.state.own[1]["received"] = 4
        made.state.own[3]["corrupt"] = 2
        expected = [none | {"received": 4}, none | {"corrupt": 2}]
        assert made.node.count_strays() == dict(zip(names, expected, strict=False))


def test_a_claim_is_described_by_its_session(node: ModuleType) -> None:
    made = NodeBench(node)
    assert made.node.describe_claim() == {"session": None, "claims_refused": 0}
    made.state.claim.session, made.state.claim.refused = 0x0B21, 3
    assert made.node.describe_claim() == {"session": "0b21", "claims_refused": 3}
