"""`clutch-hil panel` in a pseudo-terminal, with keys pressed, against a real controller and plant."""

import fcntl
import io
import os
import pty
import re
import signal
import struct
import subprocess
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from rich.cells import cell_len
from rich.console import Console

from clutch_hil.live.driving.panel import Panel, draw_panel, round_step
from clutch_hil.live.driving.supervisor import Answer
from plant_sim.profiles.profile import PRESSURE_LIMIT, SPEED_LIMIT, TORQUE_LIMIT
from protocols.buses.bus import Port, open_bus
from protocols.can.frames import Frame
from protocols.can.request import Request
from tests import needs
from tests.clutch_hil.live.running import FRAMES, Running, hear, running_bench, wait_until_open
from tests.processes import PATIENCE, list_errors, service

OPEN_PHASE, SLIP_CONTROL, LOCK = 0, 2, 5  # values of PHASE in the DBC
LONG_AGO, NOW = 0.0, 100.0  # s
SET = 0.01  # Nm, rad/s and bar: ten counts of the signal, a fifth of a key's step
REACHED = 0.5  # Nm: the estimate at 6 Nm, not the 5 Nm before
UP, PAGE_DOWN, RIGHT = "\x1b[A", "\x1b[6~", "\x1b[C"
CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")  # colours and positions on the screen

ENGAGED = Answer("active", "active", "slip control", "none", 5.0)
OPEN = Answer("active", "active", "idle", "none", 0.0)


class Terminal:
    """A pseudo-terminal of 80 x 24 with the panel in it."""

    def __init__(self, keyboard: int, child: subprocess.Popen) -> None:
        self.child = child
        self._keyboard = keyboard
        self._screen = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def press(self, keys: str) -> None:
        os.write(self._keyboard, keys.encode())

    def shows(self, text: str) -> bool:
        """Whether `text` has been on the screen since the last call."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            if text in CONTROL.sub("", self._screen):
                self._screen = ""
                return True
            time.sleep(0.01)
        return False

    def wait_for_end(self) -> tuple[int, str]:
        """Exit code and what was printed."""
        code = self.child.wait(PATIENCE)
        deadline = time.monotonic() + 1.0
        while "verdict" not in self._screen and "error" not in self._screen and time.monotonic() < deadline:
            time.sleep(0.01)
        return code, self._screen

    def _read(self) -> None:
        while True:
            try:
                self._screen += os.read(self._keyboard, 65536).decode(errors="replace")
            except OSError:
                return


@pytest.fixture(scope="module")
def services() -> Iterator[Running]:
    with running_bench(telemetry=False) as running:
        yield running


@contextmanager
def panel(running: Running) -> Iterator[tuple[Terminal, Port]]:
    """The panel in a terminal that must be at the end as it was before; and a place on its bus."""
    needs.skip_without("terminal")
    keyboard, line = pty.openpty()
    fcntl.ioctl(line, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    before = termios.tcgetattr(line)
    with open_bus(running.bus) as port:
        wait_until_open(port)
        ends = {"stdin": line, "stdout": line, "stderr": line, "env": os.environ | {"TERM": "xterm-256color"}}
        with service("panel", "--bus", running.bus, **ends) as child:
            terminal = Terminal(keyboard, child)
            assert terminal.shows("torque demand")
            assert termios.tcgetattr(line) != before
            yield terminal, port
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == OPEN_PHASE)
    assert termios.tcgetattr(line) == before
    os.close(line)
    os.close(keyboard)


def wait_for_setpoint(port: Port, wanted: Callable[..., bool]) -> None:
    hear(port, "TORQUE_SETPOINT", wanted)


def test_keys_drive_the_clutch(services: Running) -> None:
    with panel(services) as (terminal, port):
        wait_for_setpoint(port, lambda s: s.request == Request.IDLE)
        terminal.press("e")
        wait_for_setpoint(port, lambda s: s.request == Request.ENGAGE and abs(s.torque_demand - 5.0) < SET)
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL)
        terminal.press(UP + UP + RIGHT)
        wait_for_setpoint(port, lambda s: abs(s.torque_demand - 6.0) < SET and abs(s.speed_demand - 10.97) < SET)
        hear(port, "CONTROLLER_STATUS", lambda status: abs(status.torque_estimate - 6.0) < REACHED)
        assert terminal.shows("slip control")
        terminal.press(" ")
        wait_for_setpoint(port, lambda s: s.request == Request.RELEASE)
        wait_for_setpoint(port, lambda s: s.request == Request.IDLE)  # by itself, once the controller is idle
        terminal.press("e" + PAGE_DOWN)
        wait_for_setpoint(port, lambda s: s.request == Request.ENGAGE and abs(s.torque_demand - 1.0) < SET)
        terminal.press("q")
        code, text = terminal.wait_for_end()
    assert code == 0
    assert "verdict: the clutch is released" in text


def test_a_key_locks_the_clutch_and_another_lets_it_slide(services: Running) -> None:
    with panel(services) as (terminal, port):
        terminal.press("\x1b[1;2D" * 2 + "l")  # 0.47 rad/s: a locked clutch holds the motor
        wait_for_setpoint(port, lambda s: s.request == Request.LOCK and abs(s.speed_demand - 0.47) < SET)
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == LOCK and status.sticking)
        assert terminal.shows("locked")
        terminal.press("e")
        wait_for_setpoint(port, lambda s: s.request == Request.ENGAGE)
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL and not status.sticking)
        terminal.press("q")
        assert terminal.wait_for_end()[0] == 0


def test_keys_go_from_torque_to_pressure_and_back(services: Running) -> None:
    with panel(services) as (terminal, port):
        terminal.press("e")
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL)
        terminal.press("p++")
        wait_for_setpoint(port, lambda s: s.request == Request.PRESSURE and abs(s.pressure_demand - 2.8) < SET)
        hear(port, "ANALOG_SENSORS", lambda sensors: abs(sensors.cylinder_pressure - 2.8) < 0.02)
        terminal.press("e")
        wait_for_setpoint(port, lambda s: s.request == Request.ENGAGE)
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL)
        terminal.press("q")
        assert terminal.wait_for_end()[0] == 0


def test_sigterm_releases_and_restores_the_terminal(services: Running) -> None:
    with panel(services) as (terminal, port):
        terminal.press("e")
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL)
        terminal.child.send_signal(signal.SIGTERM)
        code, text = terminal.wait_for_end()
    assert code == 0
    assert "the clutch is released" in text


def test_an_error_restores_the_terminal(services: Running) -> None:
    codec = FRAMES["TORQUE_SETPOINT"]
    with panel(services) as (terminal, port):
        port.send(Frame(codec.can_id, codec.pack(0, Request.IDLE, 0.0, 0.0, 0.0)))
        code, text = terminal.wait_for_end()
    assert code == 2
    assert "another supervisor" in text


def test_a_fault_ends_the_engagement_until_it_is_acknowledged(services: Running) -> None:
    with panel(services) as (terminal, port):
        terminal.press("e")
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL)
        services.plant.send_signal(signal.SIGSTOP)
        try:
            wait_for_setpoint(port, lambda s: s.request == Request.RELEASE)
            assert terminal.shows("fault: stale sensors; i acknowledges it")
        finally:
            services.plant.send_signal(signal.SIGCONT)
        terminal.press("i")
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == OPEN_PHASE)
        terminal.press("q")
        assert terminal.wait_for_end()[0] == 0


def test_without_a_terminal_one_sentence_is_told(local_bus: str) -> None:
    with service("panel", "--bus", local_bus, stdin=subprocess.DEVNULL) as child:
        _, errors = child.communicate(timeout=PATIENCE)
    assert child.returncode == 2
    assert list_errors(errors) == [
        "error: the panel needs a keyboard, but the standard input is not a terminal; use clutch-hil demand"
    ]


@pytest.mark.parametrize("width", [40, 41, 60, 79, 80, 200])
def test_nothing_is_cut_in_a_narrow_terminal(width: int) -> None:
    answer = Answer("inactive", "finalized", "slip control", "stale sensors", 1199.99, -999.99, 9.99, -249.99, 149.99)
    panel = Panel(
        request=Request.PRESSURE, message="not engaged: the clutch must be idle first (key i), its phase is fault"
    )
    console = Console(width=width, height=24, file=io.StringIO())
    console.print(draw_panel(panel, answer, "local:clutch", width))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert len(lines) <= 24
    assert {cell_len(line) for line in lines} == {min(width, 80)}
    text = " ".join(" ".join(line.strip("│ ") for line in lines).split())
    assert "…" not in text
    assert panel.message in text
    for shown in (
        "inactive",
        "finalized",
        "slip control",
        "stale sensors",
        "-249.99",
        "rad/s",
        "friction level",
        "quit",
        "━",
    ):
        assert shown in text, shown


def test_a_step_of_a_key_is_a_round_number_that_fits_the_bench() -> None:
    assert [round_step(limit, 60) for limit in (30.0, 48.0, 300.0, 1200.0)] == [0.5, 0.5, 5.0, 20.0]
    assert [round_step(limit, 90) for limit in (4.5, 5.4, 27.0)] == [0.05, 0.05, 0.2]


def test_demands_stay_within_the_limits() -> None:
    panel = Panel()
    for _ in range(100):
        panel.press("page up", OPEN, NOW)
        panel.press("shift right", OPEN, NOW)
        panel.press("+", OPEN, NOW)
    assert (panel.torque, panel.speed, panel.pressure) == (TORQUE_LIMIT, SPEED_LIMIT, PRESSURE_LIMIT)
    for _ in range(100):
        panel.press("page down", OPEN, NOW)
        panel.press("shift left", OPEN, NOW)
        panel.press("-", OPEN, NOW)
    assert (panel.torque, panel.speed, panel.pressure) == (0.0, -SPEED_LIMIT, 0.0)


@pytest.mark.parametrize("key", ["e", "p", "l"])
@pytest.mark.parametrize("phase", ["release", "fault", None])
def test_only_an_idle_controller_is_engaged(phase: str | None, key: str) -> None:
    panel = Panel()
    panel.press(key, Answer("active", "active", phase), NOW)
    assert panel.request is Request.IDLE
    assert "must be idle first" in panel.message


def test_an_engagement_the_controller_gives_up_is_not_asked_for_again() -> None:
    panel = Panel()
    panel.press("e", OPEN, LONG_AGO)
    panel.react(ENGAGED, None, NOW)
    assert panel.request is Request.ENGAGE
    panel.react(OPEN, "the controller has let the clutch go by itself", NOW)
    assert panel.request is Request.RELEASE
    panel.react(OPEN, None, NOW + 1.0)
    assert (panel.request, panel.message) == (Request.IDLE, "the controller has let the clutch go by itself")


@pytest.mark.parametrize("key", ["r", "space", "q", "end"])
@pytest.mark.parametrize("asked", [Request.ENGAGE, Request.PRESSURE, Request.LOCK])
def test_each_way_out_releases(key: str, asked: Request) -> None:
    panel = Panel(request=asked)
    panel.press(key, ENGAGED, NOW)
    assert panel.request is Request.RELEASE
