"""How a controller sends its safe frames at its end. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest

import rt_controller.loop.service

PERIOD = 0.004  # s


@pytest.fixture(scope="module")
def service() -> ModuleType:
    return rt_controller.loop.service


def send(service: ModuleType, results: list[str]) -> tuple[bool, list[Any]]:
    """Send to a port whose sends end so: "sent", "refused", "down" or "gone"; return the answer, and what was done."""
    done: list[Any] = []
    port = SimpleNamespace(refused=4, down=2)

    def send_one(frame: str) -> None:
        done.append(frame)
        result = results.pop(0) if results else "sent"
        if result == "gone":
            raise OSError
        port.refused += result == "refused"
        port.down += result == "down"

    port.send = send_one
    node = SimpleNamespace(list_safe_frames=lambda: ["valve", "motor"])
    with patch.object(service, "time", SimpleNamespace(sleep=done.append)):
        return bool(service._send_safe_commands(node, port, PERIOD)), done


def test_safe_frames_are_sent_in_three_cycles(service: ModuleType) -> None:
    assert send(service, []) == (True, 3 * ["valve", "motor", PERIOD])


def test_one_cycle_that_arrives_is_enough(service: ModuleType) -> None:
    for lost in ("refused", "down"):
        assert send(service, ["sent", lost, "sent", "sent", lost, lost])[0]
        assert send(service, ["sent", "sent", lost, lost, lost, lost])[0]
        assert send(service, [lost, lost, "sent", lost, "sent", "sent"])[0]
        assert not send(service, 3 * ["sent", lost])[0]
        assert not send(service, 3 * [lost, "sent"])[0]


def test_on_a_bus_that_is_gone_nothing_more_is_sent(service: ModuleType) -> None:
    assert send(service, ["sent", "gone"]) == (False, ["valve", "motor"])
    assert send(service, ["sent", "sent", "gone"]) == (True, ["valve", "motor", PERIOD, "valve"])
