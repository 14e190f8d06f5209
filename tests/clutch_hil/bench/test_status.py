"""The status line on a terminal that is held: the loop that records or supervises does not wait for it."""

import os
import select
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from clutch_hil.bench.status import StatusLine
from clutch_hil.live.driving.demand import _StatusLine
from clutch_hil.live.driving.supervisor import Answer
from plant_sim.profiles.profile import Setpoint
from protocols.can.request import Request
from protocols.node import Column

AT_ONCE = 10.0  # s for what takes milliseconds
PLANT = [Column(name, "1", "") for name in ("time_s", "truth_clutch_torque_nm", "cylinder_pressure_bar")]
CONTROLLER = [
    Column(name, "1", "")
    for name in ("phase", "torque_demand_nm", "torque_estimate_nm", "late_cycles", "request", "supervisor")
]


@contextmanager
def held_terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Standard error is a pipe that takes nothing more: the descriptor of its reading end, with what fills it."""
    reader, writer = os.pipe()
    monkeypatch.setattr(sys, "stderr", open(writer, "w", buffering=1))  # noqa: SIM115  # closed by the pipe's end
    while select.select([], [writer], [], 0.0)[1]:
        os.write(writer, b"." * select.PIPE_BUF)
    yield reader
    os.close(reader)


def run_in_thread(call: Callable[[], object]) -> None:
    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(AT_ONCE)
    assert not thread.is_alive()


def test_a_held_terminal_holds_up_no_recording_and_gets_the_notes_later(monkeypatch: pytest.MonkeyPatch) -> None:
    with held_terminal(monkeypatch) as held:
        line = StatusLine(PLANT, CONTROLLER, 1.0, quiet=False)

        def show() -> None:
            line._printed_at = 0.0  # a line is due
            line.show(np.zeros((1, len(PLANT))), np.zeros((1, len(CONTROLLER))))

        run_in_thread(lambda: line.note("plant: a fault"))
        run_in_thread(show)
        os.read(held, 1 << 20)  # it goes on
        show()
        assert os.read(held, 1 << 20).startswith(b"plant: a fault\n")


def test_a_held_terminal_holds_up_no_supervisor(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = Answer("active", "active")
    with held_terminal(monkeypatch):
        line = _StatusLine(1.0, quiet=False)
        run_in_thread(lambda: line.show(1.0, Setpoint(Request.ENGAGE, 1.0, 1.0, 0.0), answer))
