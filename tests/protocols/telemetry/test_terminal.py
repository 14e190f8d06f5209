"""Faults on the terminal of a service: nobody who reads, or reads no more, holds the telemetry up."""

import json
import math
import os
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

from protocols.telemetry.pending_changes import PendingChanges
from protocols.telemetry.publisher import Publisher

FAULTS = 20_000  # lines of 12 bytes: more than a pipe of 64 KiB takes


@pytest.fixture
def publisher() -> Publisher:
    """A publisher that has a fault to print for each row."""
    made = Publisher.__new__(Publisher)
    made._faults = SimpleNamespace(take=lambda rows: [SimpleNamespace(line=f"fault {k:05}") for k in range(len(rows))])  # type: ignore[assignment]
    return made


def test_a_terminal_that_is_held_loses_lines_and_holds_nothing_up(publisher: Publisher) -> None:
    """As by Ctrl-S, or by a pager that waits for its reader."""
    reader, publisher._terminal = os.pipe()
    publisher._print_faults(np.zeros((FAULTS, 1)))
    os.close(publisher._terminal)
    with open(reader) as sentence:
        lines = sentence.read().splitlines()
    assert lines == [f"fault {k:05}" for k in range(len(lines))]
    assert 1000 < len(lines) < FAULTS


def test_a_terminal_that_is_gone_is_no_error(publisher: Publisher) -> None:
    reader, publisher._terminal = os.pipe()
    os.close(reader)
    publisher._print_faults(np.zeros((3, 1)))
    os.close(publisher._terminal)


def test_a_fault_after_a_change_of_its_limit_names_the_new_limit() -> None:
    limit = "phases.fill_timeout"
    made, sink = Publisher.__new__(Publisher), SimpleNamespace(put=lambda text: None)
    made._node, made._blind, made._rate = "controller", False, 1000.0
    made._parameters, made._values = {limit: {"name": limit, "value": 1.5}}, {limit: 1.5}
    made._pending, made._requests, made._events = PendingChanges([]), deque(), deque()
    made._request = made._event = sink  # type: ignore[assignment]
    answer = {"changed": [{"name": limit, "old": 1.5, "new": 2.5, "unit": "s", "row": 3}], "row": 3}
    answer["logged"] = {"by": "me", "checked": False}
    made._mailbox = SimpleNamespace(ask=lambda text, timeout: json.dumps(answer))  # type: ignore[assignment]
    watch = made._make_fault_watch(["fault", "sample_tick"])
    assert watch is not None
    made._forward_request({"values": {limit: 2.5}}, math.inf)
    fill_timeout = 5.0  # number of the fault
    (change,) = watch.take(np.array([[0.0, 1.0], [fill_timeout, 2.0]]))
    assert "(limit 2.5 s)" in change.line
