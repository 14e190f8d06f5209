"""Faults on the terminal of a service: nobody who reads, or reads no more, holds the telemetry up."""

import os
from types import SimpleNamespace

import numpy as np
import pytest

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
