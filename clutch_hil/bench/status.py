"""Status line: the present state of the loop, on one line of the terminal."""

import time
from collections import deque
from collections.abc import Sequence
from math import isfinite, nan
from types import TracebackType

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.text import Text

from clutch_hil.bench.terminal import takes_text
from protocols.can.claim import CONTESTED_TEXT, Supervision
from protocols.can.fault_text import WAITS_FOR_IDLE, waits_for_idle
from protocols.can.frames import load_frames
from protocols.node import Column

_MOST_NOTES = 1000  # notes that wait for a blocked terminal; the newest are kept
_PLAIN_INTERVAL = 2.0  # s between lines where stderr is no terminal


class StatusLine:
    """Status line with rate, phase, torques, pressure and late cycles. Use as a context manager.

    Nothing is shown when `quiet`. When `blind`, the measured torque replaces the true one.
    """

    def __init__(
        self, plant: Sequence[Column], controller: Sequence[Column], duration: float, quiet: bool, blind: bool = False
    ) -> None:
        self._plant = {column.name: i for i, column in enumerate(plant)}
        self._controller = {column.name: i for i, column in enumerate(controller)}
        self._torque = ("clutch_torque_nm", "measured") if blind else ("truth_clutch_torque_nm", "true")
        self._of_duration, self._quiet = f"/{duration:g}" if isfinite(duration) else "", quiet
        self._phases = load_frames()["CONTROLLER_STATUS"].list_choices("phase")
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, refresh_per_second=8, transient=True)
        self._notes: deque[str] = deque(maxlen=_MOST_NOTES)
        self._printed_at = time.monotonic()
        self._counted_from = nan  # s of the plant's time
        self._cycles = 0
        self._rate = nan  # Hz, of the controller

    def __enter__(self) -> "StatusLine":
        if self._console.is_terminal and not self._quiet:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()
        self._print_notes()

    def note(self, text: str) -> None:
        """Print a text that remains on the terminal; if the terminal is blocked, print it when it continues."""
        self._notes.append(text)
        self._print_notes()

    def _print_notes(self) -> None:
        while self._notes and takes_text(self._console):
            self._console.print(self._notes.popleft(), soft_wrap=True, highlight=False, markup=False)

    def show(self, plant: np.ndarray, controller: np.ndarray) -> None:
        """Show the newest of these new rows, each array of shape (rows, columns of the node)."""
        self._cycles += len(controller)
        if self._quiet or not (len(plant) and len(controller)):
            return
        self._count(float(plant[-1, self._plant["time_s"]]))
        self._print_notes()
        if not takes_text(self._console):
            return
        now = time.monotonic()
        text = self._format(plant[-1], controller[-1])
        if self._console.is_terminal:
            self._live.update(Text(text, no_wrap=True, overflow="ellipsis"))
        elif now - self._printed_at >= _PLAIN_INTERVAL:
            self._printed_at = now
            self._console.print(text, soft_wrap=True, highlight=False)

    def _count(self, seconds: float) -> None:
        """Compute the controller's cycle rate over each second of plant time: rows may be delayed while a recorder loads."""
        if not seconds - self._counted_from < 1.0:
            self._rate = self._cycles / (seconds - self._counted_from)
            self._cycles, self._counted_from = 0, seconds

    def _format(self, plant: np.ndarray, controller: np.ndarray) -> str:
        p = {name: plant[i] for name, i in self._plant.items()}
        c = {name: controller[i] for name, i in self._controller.items()}
        return (
            f"{p['time_s']:6.1f}{self._of_duration} s  {self._format_rate()} Hz  {self._phases[int(c['phase'])]:<12}"
            f"  torque demand {c['torque_demand_nm']:z5.2f}  estimate {c['torque_estimate_nm']:z6.2f}"
            f"  {self._torque[1]} {p[self._torque[0]]:z6.2f} Nm  pressure {p['cylinder_pressure_bar']:z4.2f} bar"
            f"  late {int(c['late_cycles'])}{self._waits(c)}"
        )

    def _format_rate(self) -> str:
        return f"{self._rate:5.0f}" if isfinite(self._rate) else f"{'-':>5}"

    def _waits(self, c: dict[str, float]) -> str:
        """Return why an idle controller does not close the clutch, or that supervision is contested."""
        if waits_for_idle(c["phase"], c["request"]):
            return f"  {WAITS_FOR_IDLE}"
        return f"  {CONTESTED_TEXT}" if c["supervisor"] == Supervision.CONTESTED else ""
