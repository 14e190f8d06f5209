"""`clutch-hil panel`: drive the clutch from the keyboard, over the bus alone.

If the terminal hangs, the set-points stop and the controller releases the clutch, because nobody watches it any more.
"""

import contextlib
import os
import re
import select
import sys
import termios
import time
import tty
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import floor, log10
from typing import TextIO

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel as Box
from rich.table import Table
from rich.text import Text

from clutch_hil.bench.pictures import palette
from clutch_hil.bench.pictures.bars import draw_bar
from clutch_hil.live.driving.demand_log import DemandLog
from clutch_hil.live.driving.supervisor import RATE, Answer, Supervisor
from plant_sim.profiles.profile import FULL_PRESSURE, PRESSURE_LIMIT, SPEED_LIMIT, TORQUE_LIMIT
from protocols.buses.bus import open_bus
from protocols.can.request import Request
from protocols.errors import InputError
from protocols.realtime.stopping import Stop

_DRAW_CYCLES = RATE // 10  # cycles: 10 Hz, as often as the controller's status arrives
_STATUS_DELAY = 0.3  # s, three status frames: an earlier status may belong to the previous request
_WIDTH, _LEAST_WIDTH = 80, 40  # characters of the box, and of the narrowest one that is not cut
_BAR_WIDTH = 28  # characters, of a box of _WIDTH
# Steps from 0 to the highest torque, speed and pressure: 0.5 Nm, 0.5 rad/s and 0.05 bar on the shipped bench
_STEPS = 60, 52, 90


def round_step(limit: float, steps: int) -> float:
    """Return the largest of 1, 2, 5, 10, ... and their decimal fractions with which `limit` takes at least `steps` steps."""
    step = limit / steps * (1.0 + 1e-9)  # rounding of the division
    decade = 10.0 ** floor(log10(step))
    return next(digit * decade for digit in (5, 2, 1) if digit * decade <= step)


_TORQUE, _SPEED, _PRESSURE = map(round_step, (TORQUE_LIMIT, SPEED_LIMIT, PRESSURE_LIMIT), _STEPS)
_KEY_STEPS = {  # key: torque [Nm], speed [rad/s], pressure [bar]
    "up": (_TORQUE, 0.0, 0.0), "down": (-_TORQUE, 0.0, 0.0),
    "page up": (10 * _TORQUE, 0.0, 0.0), "page down": (-10 * _TORQUE, 0.0, 0.0),
    "right": (0.0, _SPEED, 0.0), "left": (0.0, -_SPEED, 0.0),
    "shift right": (0.0, 10 * _SPEED, 0.0), "shift left": (0.0, -10 * _SPEED, 0.0),
    "+": (0.0, 0.0, _PRESSURE), "-": (0.0, 0.0, -_PRESSURE),
}  # fmt: skip
_CLOSING_KEYS = {"e": Request.ENGAGE, "p": Request.PRESSURE, "l": Request.LOCK}
_SEQUENCES = {  # character sequences that a terminal sends for a key without a letter
    "\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left",
    "\x1bOA": "up", "\x1bOB": "down", "\x1bOC": "right", "\x1bOD": "left",
    "\x1b[5~": "page up", "\x1b[6~": "page down", "\x1b[1;2A": "page up", "\x1b[1;2B": "page down",
    "\x1b[1;2C": "shift right", "\x1b[1;2D": "shift left", " ": "space",
}  # fmt: skip
_KEY = re.compile(r"\x1b\[[0-9;]*[A-Za-z~]|\x1bO.|[^\x1b]|\x1b(?![\[O]|$)", re.DOTALL)
_HELP = (
    f"↑ ↓ {_TORQUE:g} Nm", f"PgUp PgDn {10 * _TORQUE:g} Nm", f"← → {_SPEED:g} rad/s", f"shift ← → {10 * _SPEED:g} rad/s",
    f"+ - {_PRESSURE:g} bar", "e engage: follow the torque", "p the pressure", "l lock",
    "r release", "i idle, acknowledge", "space release now", "q quit",
)  # fmt: skip


@dataclass
class Panel:
    """The operator's demand, changed by keys: torque [Nm], signed motor speed [rad/s], pressure [bar]."""

    torque: float = 5.0
    speed: float = 10.47  # 100 rpm, the speed of the profiles
    pressure: float = 2.7  # bar: 5.5 Nm at that speed (Janssens 2010, eq. 6.5)
    request: Request = Request.IDLE
    message: str = ""
    quit: bool = False
    _since: float = 0.0  # s, time of the request

    def press(self, key: str, answer: Answer, now: float) -> None:
        """Change the demand by a key pressed at `now` [s]; answer: the present state on the bus."""
        torque, speed, pressure = _KEY_STEPS.get(key, (0.0, 0.0, 0.0))
        self.torque = min(max(self.torque + torque, 0.0), TORQUE_LIMIT)
        self.speed = min(max(self.speed + speed, -SPEED_LIMIT), SPEED_LIMIT)
        self.pressure = min(max(self.pressure + pressure, 0.0), PRESSURE_LIMIT)
        if key in ("r", "space", "q", "end"):
            self._ask(Request.IDLE if self.request is Request.IDLE else Request.RELEASE, "", now)
            self.quit = self.quit or key in ("q", "end")
        elif key == "i":
            self._ask(Request.IDLE, "", now)
        elif (wanted := _CLOSING_KEYS.get(key)) and self.request is not wanted:
            if self.request.closes or (answer.phase == "idle" and self.request is Request.IDLE):
                self._ask(wanted, "", now)
            else:
                self.message = f"not engaged: the clutch must be idle first (key i), its phase is {answer.phase or '-'}"

    def react(self, answer: Answer, objection: str | None, now: float) -> None:
        """Release the clutch if the controller refuses to close it; demand idle once it is released."""
        if self.request.closes and objection:
            self._ask(Request.RELEASE, f"{objection}{'; i acknowledges it' if answer.phase == 'fault' else ''}", now)
        elif self.request is Request.RELEASE and answer.phase == "idle" and now - self._since > _STATUS_DELAY:
            self._ask(Request.IDLE, self.message, now)

    def _ask(self, request: Request, message: str, now: float) -> None:
        self.request, self.message, self._since = request, message, now


class Keyboard:
    """Read single keys of a terminal, without echo; leaving it restores the terminal. Raises InputError without a terminal."""

    def __init__(self, stream: TextIO) -> None:
        if not stream.isatty():
            raise InputError(
                "the panel needs a keyboard, but the standard input is not a terminal; use clutch-hil demand"
            )
        self._terminal = stream.fileno()
        self._pending = ""

    def __enter__(self) -> "Keyboard":
        self._before = termios.tcgetattr(self._terminal)
        tty.setcbreak(self._terminal)
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(termios.error):  # a closed terminal needs no restoring
            termios.tcsetattr(self._terminal, termios.TCSANOW, self._before)

    def read_keys(self) -> list[str]:
        """Return names of the keys pressed since the last call, letters in lower case; `end` when the terminal is closed."""
        while select.select([self._terminal], [], [], 0.0)[0]:
            try:
                read = os.read(self._terminal, 1024)
            except OSError:
                read = b""
            if not read:
                return ["end"]
            self._pending += read.decode(errors="replace")
        keys = list(_KEY.finditer(self._pending))
        if keys:
            self._pending = self._pending[keys[-1].end() :]
        return [_SEQUENCES.get(match.group(), match.group().lower()) for match in keys]


def drive(bus: str, network: str | None = None) -> tuple[str, str, bool]:
    """Run the panel until q, Ctrl-C or SIGTERM; return text, verdict, and whether the clutch was released.

    network: for the log (demand_log.py). Raises InputError when there is no terminal, no controller, or another supervisor.
    """
    panel, cycle = Panel(), 0
    with (
        Stop() as stop,
        Keyboard(sys.stdin) as keyboard,
        open_bus(bus) as port,
        DemandLog(port.name, network) as log,
        Supervisor(port) as supervisor,
    ):
        log.send("by hand, from the panel")
        began = time.monotonic()
        with Live(console=Console(), screen=True, auto_refresh=False) as live:
            while not (stop.asked or panel.quit):
                supervisor.ask(panel.request, panel.torque, panel.speed, panel.pressure)
                answer, now = supervisor.received.answer(), time.monotonic()
                for key in keyboard.read_keys():
                    panel.press(key, answer, now)
                panel.react(answer, supervisor.explain_objection(), now)
                if cycle % _DRAW_CYCLES == 0:
                    live.update(draw_panel(panel, answer, port.name, live.console.width), refresh=True)
                cycle += 1
            released = supervisor.release(panel.speed)
        seconds = time.monotonic() - began
        logged = log.describe_outcome()
    text = f"read:    keyboard, frames on {port.name}\nwrote:   set-points on {port.name} for {seconds:.1f} s\n{logged}"
    verdict = "the clutch is released" if released else "the clutch was not released within 2 s"
    return text, verdict, released


def draw_panel(panel: Panel, answer: Answer, bus: str, terminal: int = _WIDTH) -> Box:
    """Return the panel as a box of 80 columns, in a narrower `terminal` with shorter bars and without empty lines."""
    width = min(max(terminal, _LEAST_WIDTH), _WIDTH)
    wide = width == _WIDTH
    inner = width - (6 if wide else 4)  # the border, and a space or two at each side
    table = Table.grid(padding=(0, 2 if wide else 1))
    for style in (palette.DIM, "bold", "", ""):
        table.add_column(style=style)
    table.columns[1].justify = "right"
    rows: tuple[tuple[str, float | None, str, float, str], ...] = (
        ("torque demand", panel.torque, "Nm", TORQUE_LIMIT, "torque_demand_nm"),
        ("torque estimate", answer.torque_estimate, "Nm", TORQUE_LIMIT, "controller_torque_estimate_nm"),
        ("torque measured", answer.clutch_torque, "Nm", TORQUE_LIMIT, "clutch_torque_nm"),
        ("pressure demand", panel.pressure, "bar", FULL_PRESSURE, "controller_pressure_demand_bar"),
        ("pressure", answer.pressure, "bar", FULL_PRESSURE, "cylinder_pressure_bar"),
        ("motor speed demand", panel.speed, "rad/s", SPEED_LIMIT, "motor_speed_demand_rad_s"),
        ("slip", answer.slip, "rad/s", SPEED_LIMIT, "slip_speed_rad_s"),
        ("oil temperature", answer.temperature, "degC", 150.0, "oil_temperature_degc"),
        ("friction level", answer.friction_level, "", 2.0, "controller_friction_level"),
    )
    bar = _BAR_WIDTH if wide else inner - 33  # beside the longest name, -999.99, the longest unit, and spaces
    for name, value, unit, full, column in rows:
        number = "-" if value is None else f"{value:.2f}"
        table.add_row(name, number, unit, draw_bar(value, full, bar, palette.choose_colour(column)))
    states = {
        "request": panel.request.name.lower(), "phase": answer.phase, "fault": answer.fault,
        "controller": answer.controller, "plant": answer.plant, "clutch": answer.clutch,
    }  # fmt: skip
    if wide:
        grids = [_make_grid(states, 3, 2, 8, 12)]
    else:
        last = {"clutch": states.pop("clutch"), "fault": states.pop("fault")}  # a fault may take two words
        grids = [_make_grid(states, 2, 1), _make_grid(last, 2, 1)]
    message = Text(panel.message or " ", style=palette.NOTICE, no_wrap=wide, overflow="ellipsis" if wide else "fold")
    keys = Text("\n".join(_fill_lines(_HELP, inner)), style=palette.DIM)
    gap = [Text()] if wide else []
    return Box(
        Group(*grids, *gap, table, *gap, message, *gap, keys),
        title=f"clutch-hil panel, {bus}", title_align="left", width=width, padding=(1, 2) if wide else (0, 1),
        border_style=palette.DIM,
    )  # fmt: skip


def _make_grid(states: Mapping[str, str | None], pairs: int, gap: int, name: int = 0, value: int = 0) -> Table:
    """Return the states as rows of `pairs` of name and value. gap, and least widths of `name` and `value`: characters."""
    grid = Table.grid(padding=(0, gap))
    for _ in range(pairs):
        grid.add_column(style=palette.DIM, min_width=name)
        grid.add_column(min_width=value)
    cells = [(Text(label), _format_badge(state)) for label, state in states.items()]
    for first in range(0, len(cells), pairs):
        grid.add_row(*(cell for pair in cells[first : first + pairs] for cell in pair))
    return grid


def _fill_lines(parts: Sequence[str], width: int) -> list[str]:
    """Return lines of up to `width` characters of whole `parts`."""
    lines: list[str] = []
    for part in parts:
        if lines and len(lines[-1]) + 3 + len(part) <= width:
            lines[-1] += f"   {part}"
        else:
            lines.append(part)
    return lines


def _format_badge(name: str | None) -> Text:
    return Text.assemble((name or "-", palette.choose_badge(name)))
