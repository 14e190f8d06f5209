"""The frames with which a controller ends. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

from types import ModuleType
from typing import Any

import pytest

import rt_controller.loop.node
from protocols.can.frames import load_frames
from protocols.can.lifecycle import Lifecycle
from tests.mutation.mutants import load_mutant, parse_plain
from tests.rt_controller.node_bench import NodeBench

CODECS = {codec.can_id: codec for clutch in ("a", "b") for codec in load_frames(clutch=clutch).values()}


@pytest.fixture
def node() -> ModuleType:
    return load_mutant(parse_plain(rt_controller.loop.node))


def make_node(node: ModuleType, clutch: str | None = None) -> Any:
    """A controller of session 9 that has run 5 cycles, sent 3 heartbeats and answers sample 1030."""
    made = NodeBench(node, 500, session=9, clutch=clutch).node
    made._state.cycle, made._state.beats, made._state.sample.tick = 5, 3, 1030
    return made


def end(node: Any) -> list[tuple[str, int, tuple[float, ...]]]:
    """Names, counters and values of the safe frames; each must be valid."""
    sent = []
    for can_id, data in node.list_safe_frames():
        assert CODECS[can_id].is_valid(data)
        sent.append((CODECS[can_id].name, data[2], tuple(CODECS[can_id].unpack(data))))
    return sent


def test_at_its_end_a_controller_closes_the_valve_and_stops_the_motor(node: ModuleType) -> None:
    for clutch in (None, "a"):
        assert end(make_node(node, clutch)) == [
            ("VALVE_COMMAND", 5, (0, 0.0, 1030 % 1024)),
            ("MOTOR_COMMAND", 5, (0, 1030 % 128, 0.0, 0.0)),
            ("CONTROLLER_HEARTBEAT", 4, (Lifecycle.FINALIZED, 0, 500, 9)),
        ]


def test_the_controller_of_clutch_b_leaves_the_motor_alone(node: ModuleType) -> None:
    assert end(make_node(node, "b")) == [
        ("VALVE_COMMAND_B", 5, (0, 0.0, 6)),
        ("CONTROLLER_HEARTBEAT_B", 4, (Lifecycle.FINALIZED, 0, 500, 9)),
    ]


def test_safe_frames_that_are_sent_again_are_new_frames(node: ModuleType) -> None:
    made = make_node(node)
    assert [[counter for _, counter, _ in end(made)] for _ in range(3)] == [[5, 5, 4], [6, 6, 5], [7, 7, 6]]


def test_before_a_first_sample_the_answer_is_to_sample_0(node: ModuleType) -> None:
    for tick, answered in ((-1, 0), (0, 0), (1, 1)):
        made = make_node(node)
        made._state.sample.tick = tick
        valve, motor, _ = end(made)
        assert (valve[2][2], motor[2][1]) == (answered, answered)
