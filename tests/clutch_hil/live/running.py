"""A plant without a profile and a controller as processes, for the commands that drive and watch them."""

import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from clutch_hil.command import make_application
from protocols.buses.bus import Port, listen, open_bus
from protocols.can.frames import Frame, load_frames
from protocols.can.request import Request
from protocols.telemetry.feed import list_live_nodes
from protocols.telemetry.keys import NODES, make_bench_name
from protocols.telemetry.session import open_consumer_session
from tests.processes import ONE_CPU, PATIENCE, service

FRAMES = load_frames()
RATE = 100  # Hz: five cycles are 50 ms, which even a busy machine seldom loses; at 1 kHz a hiccup of 6 ms is a fault
_PHASE_IDLE, _PHASE_FAULT = 0, 4


@dataclass(frozen=True)
class Running:
    """Bus name and processes of both services."""

    bus: str
    plant: subprocess.Popen
    controller: subprocess.Popen


def run_command(*arguments: str) -> Result:
    """A command run to its end in this process; `exception` is its InputError."""
    return CliRunner().invoke(make_application(), arguments)


@contextmanager
def running_bench(*, telemetry: bool, summary: Path | None = None) -> Iterator[Running]:
    """Both services on a bus of their own, ready: the controller answers. summary: file for the controller's."""
    folder = tempfile.mkdtemp(prefix="ch-")  # short: socket paths hold 107 bytes
    published = "--telemetry" if telemetry else "--no-telemetry"
    common = ["--bus", "local:bench", "--rate", str(RATE), *ONE_CPU, published]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    try:
        with (
            pytest.MonkeyPatch.context() as patch,
            _with_bus_folder(patch, folder),
            service("controller", *common, *(("--summary", str(summary)) if summary else ()), **quiet) as controller,
            service("plant", *common, **quiet) as plant,
        ):
            with open_bus("local:bench") as port:
                hear(port, "CONTROLLER_STATUS", lambda status: True)
            if telemetry:
                _await_telemetry()
            yield Running("local:bench", plant, controller)
            for child in (controller, plant):  # in this order the safe command still meets a plant
                child.terminate()
                child.wait(PATIENCE)
    finally:
        shutil.rmtree(folder)


@contextmanager
def _with_bus_folder(patch: pytest.MonkeyPatch, folder: str) -> Iterator[None]:
    patch.setenv("CLUTCH_HIL_BUS_DIR", folder)
    yield


def _await_telemetry() -> None:
    """Until both services publish."""
    deadline = time.monotonic() + PATIENCE
    with open_consumer_session() as session:
        while list_live_nodes(session, make_bench_name("local:bench")) != sorted(NODES):
            assert time.monotonic() < deadline, "the services do not publish"
            time.sleep(0.05)


def hear(port: Port, frame: str, wanted: Callable[..., bool]) -> object:
    """The first values of `frame` on the bus that are `wanted`."""
    codec = FRAMES[frame]
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        for can_id, data in listen(port, 0.02):
            if can_id == codec.can_id and wanted(values := codec.unpack(data)):
                return values
    raise AssertionError(f"{frame} never came as wanted")


def wait_until_open(port: Port) -> None:
    """Until the clutch is open and the controller idle; a fault of the test before is acknowledged as a supervisor does it."""
    setpoint = FRAMES["TORQUE_SETPOINT"]
    deadline = time.monotonic() + PATIENCE
    while (phase := hear(port, "CONTROLLER_STATUS", lambda status: True).phase) != _PHASE_IDLE:  # type: ignore[attr-defined]
        assert time.monotonic() < deadline, f"the clutch was never opened: phase {phase}"
        if phase == _PHASE_FAULT:
            for counter in range(20):
                port.send(Frame(setpoint.can_id, setpoint.pack(counter, Request.IDLE, 0.0, 0.0, 0.0)))
                time.sleep(1.0 / RATE)
            time.sleep(0.5)  # the next supervisor listens whether it is alone
