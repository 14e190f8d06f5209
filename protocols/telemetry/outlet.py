"""Outlet of a service to telemetry: the ring of its rows, the mailbox for changes, and the telemetry process.

All slow work is done before the loop begins. In the loop only a row is copied and one number is read.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.node import Column
from protocols.realtime.beat import TIMING, Beat, compile_record_cycle
from protocols.realtime.child import list_module_command, spawn
from protocols.realtime.clock import Clock
from protocols.realtime.mailbox import Mailbox
from protocols.realtime.notify import Notifier
from protocols.realtime.ring import RingWriter
from protocols.realtime.shared_folder import SharedFolder
from protocols.telemetry import READY
from protocols.telemetry.keys import make_bench_name
from protocols.telemetry.tuning import Tunable, Tuning, describe_parameters

RING_ROWS = 65_536  # a minute at 1 kHz
_START_TIMEOUT = 60.0  # s for the telemetry process to start; on a quiet machine it takes half a second
_POLL_PERIOD = 0.02  # s between checks
_END_TIMEOUT = 3.0  # s for the telemetry process to publish its last rows and end


class Outlet:
    """Ring, mailbox and telemetry process of the service of `node`, called `name`, on `bus`; rate [Hz].

    columns: of the node; the ring also has those of TIMING, with `prefix`. ring: its path, None for a temporary folder.
    publish: start the telemetry process. router: see `open_publisher_session`. about: further JSON values that the node
    publishes about itself. Raises InputError if the telemetry process cannot publish.
    """

    def __init__(
        self, name: str, node: Tunable, columns: Sequence[Column], bus: str, rate: int, session: int, *,
        shipped: ParameterSet, ring: Path | None, publish: bool, router: str | None, prefix: str = "",
        about: Mapping[str, Any] | None = None,
    ) -> None:  # fmt: skip
        self._folder = SharedFolder()
        self._process: subprocess.Popen[bytes] | None = None
        try:
            self._mailbox = Mailbox(self._folder.path / "mailbox")
            self._tuning = Tuning(node, self._mailbox)
            description = {
                "node": name, "bench": make_bench_name(bus), "rate": rate, "session": session, "pid": os.getpid(),
                "versions": {"clutch-hil": version("clutch-hil"), "python": sys.version.split()[0]},
                "parameters": describe_parameters(node, shipped), "planned": self._tuning.public_plan,
                "blind": self._tuning.blind,
                **(about or {}),
            }  # fmt: skip
            timing = [Column(prefix + column, unit, meaning) for column, unit, meaning in TIMING]
            path = ring or self._folder.path / "ring"
            self._ring = RingWriter(path, [*columns, *timing], RING_ROWS, description)
            compile_record_cycle()
            if publish:
                self._process = self._start_publisher(path, router)
        except BaseException:
            self._folder.remove()
            raise

    def write(self, row: Sequence[float] | np.ndarray, clock: float, wake_us: float, work_us: float, late: int) -> None:
        """Append a cycle's row; `clock` [s] of CLOCK_MONOTONIC."""
        self._ring.write(row, (clock, wake_us, work_us, late, self._tuning.count))

    def make_beat(self, clock: Clock, notifier: Notifier) -> Beat:
        """Return a Beat of `clock` that writes rows to this ring, pings `notifier`, and returns when a change waits."""
        return Beat(clock, self._ring, self._mailbox, notifier.make_ping())

    @property
    def backlog(self) -> int:
        """Rows that the collector has not read yet; 0 without a collector."""
        return self._ring.backlog

    @property
    def changes(self) -> int:
        """Number of parameters changed so far."""
        return self._tuning.count

    def has_change(self) -> bool:
        """Return whether a change of parameters waits."""
        return self._tuning.has_request()

    def tune(self) -> None:
        """Make the waiting change, if there is one; call it between two cycles."""
        if self.has_change():
            self._tuning.act(self._ring.row_count)

    def close(self) -> dict[str, Any]:
        """End the telemetry process; return its entries for the summary of the run."""
        ended = "off"
        if self._process:
            self._process.terminate()
            try:
                code = self._process.wait(_END_TIMEOUT)
                ended = "ended" if code == 0 else f"failed with exit code {code}"
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
                ended = "killed: it did not end"
        rows = self._ring.row_count
        self._ring.close()
        self._mailbox.close()
        self._folder.remove()
        return {
            "telemetry": ended,
            "rows": rows,
            "parameter_changes": self._tuning.changes,
            "injections": self._tuning.injections,
            "requests": self._tuning.requests,
        }

    def _start_publisher(self, ring: Path, router: str | None) -> "subprocess.Popen[bytes]":
        """Start the telemetry process and wait until it publishes. Raises InputError with its reason when it does not."""
        folder = self._folder.path
        command = list_module_command(
            "protocols.telemetry", str(ring), str(folder), *(["--router", router] if router else [])
        )
        terminal = os.dup(2)  # for faults of the service; stderr of the telemetry process is for its own errors
        command += ["--terminal", str(terminal)]
        with tempfile.TemporaryFile("w+", errors="replace") as log:
            process = spawn(command, log, keep=[terminal])
            os.close(terminal)
            deadline = time.monotonic() + _START_TIMEOUT
            while not (folder / READY).exists():
                if process.poll() is not None or time.monotonic() > deadline:
                    process.kill()
                    log.seek(0)
                    lines = log.read().strip().splitlines() or [f"it did not start within {_START_TIMEOUT:g} s"]
                    raise InputError(f"telemetry: {lines[-1].removeprefix('error: ')}; --no-telemetry runs without it")
                time.sleep(_POLL_PERIOD)
        return process
