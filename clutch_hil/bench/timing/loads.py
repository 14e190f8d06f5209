"""Loads: processes of ordinary priority that disturb a loop while its jitter is measured."""

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from protocols.errors import InputError, join_names
from protocols.realtime.child import list_command, spawn

_MEMORY = """
block = bytearray(64 << 20)
while True:
    block[:] = block[::-1]
"""
_DISK = """
import os, sys
block = os.urandom(1 << 20)
while True:
    with open(sys.argv[1], "wb") as file:
        for _ in range(64):
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
"""
_BUS = """
import sys, time
from protocols.buses.bus import open_bus
from protocols.can.frames import Frame
with open_bus(sys.argv[1], []) as port:
    while True:
        for _ in range(5):
            port.send(Frame(0x7F0, bytes(8)))
        port.receive()
        time.sleep(0.001)
"""
_RESTARTS = """
import signal, subprocess, sys, time
for signal_number in (signal.SIGTERM, signal.SIGINT):
    signal.signal(signal_number, lambda *_: sys.exit())
while True:
    viewer = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
    try:
        for told in (signal.SIGSTOP, signal.SIGCONT, signal.SIGSTOP):
            time.sleep(3.0)
            viewer.send_signal(told)
        time.sleep(3.0)
    finally:
        viewer.kill()
        viewer.wait()
"""
_FULL_DISK = 'mount -t tmpfs -o size=1m tmpfs "$0" && exec "$@"'  # in a separate mount namespace


def _run_python(code: str, *arguments: str) -> list[str]:
    return [sys.executable, "-P", "-c", code, *arguments]


def _load_cpu(bus: str, folder: Path) -> list[list[str]]:
    if shutil.which("hackbench"):
        return [["hackbench", "-l", "1000000000", "-g", "2"]]
    return [_run_python("while True: pass")] * (os.cpu_count() or 1)


def _load_memory(bus: str, folder: Path) -> list[list[str]]:
    return [_run_python(_MEMORY)] * (os.cpu_count() or 1)


def _load_disk(bus: str, folder: Path) -> list[list[str]]:
    return [_run_python(_DISK, str(folder / "written"))]


def _load_bus(bus: str, folder: Path) -> list[list[str]]:
    return [_run_python(_BUS, bus)]


def _load_viewer(bus: str, folder: Path) -> list[list[str]]:
    return [list_command("view", "--bus", bus, "--save", str(folder / "seen.rrd"))]


def _load_restarts(bus: str, folder: Path) -> list[list[str]]:
    return [_run_python(_RESTARTS, *viewer) for viewer in _load_viewer(bus, folder)]


def _load_all(bus: str, folder: Path) -> list[list[str]]:
    if os.geteuid() != 0 or not shutil.which("unshare"):
        raise InputError("load full needs root and unshare: it mounts a small disk of its own")
    return [
        ["unshare", "--mount", "sh", "-c", _FULL_DISK, str(folder), *viewer] for viewer in _load_viewer(bus, folder)
    ]


@dataclass(frozen=True)
class Load:
    """A load. `commands(bus, folder)` returns its commands; they write into `folder`. `everywhere`: also on the loop's CPU."""

    name: str
    what: str
    commands: Callable[[str, Path], list[list[str]]]
    everywhere: bool = True

    @contextlib.contextmanager
    def run(self, bus: str) -> Iterator[None]:
        """Run the load while entered."""
        allowed_cpus = os.sched_getaffinity(0)
        with tempfile.TemporaryDirectory() as folder:
            if self.everywhere:
                os.sched_setaffinity(0, range(os.cpu_count() or 1))
            try:
                running = [spawn(command, subprocess.DEVNULL) for command in self.commands(bus, Path(folder))]
            finally:
                os.sched_setaffinity(0, allowed_cpus)
            try:
                yield
            finally:
                for process in running:
                    process.terminate()
                    with contextlib.suppress(subprocess.TimeoutExpired):
                        process.wait(5.0)
                    process.kill()
                    process.wait()


LOADS = {
    load.name: load
    for load in (
        Load("cpu", "hackbench, or a busy process on each CPU", _load_cpu),
        Load("memory", "64 MiB moved over and over, on each CPU", _load_memory),
        Load("disk", "64 MiB written and flushed, over and over", _load_disk),
        Load("bus", "5000 frames a second that are nobody's", _load_bus, everywhere=False),
        Load("viewer", "a viewer that saves all telemetry", _load_viewer, everywhere=False),
        Load(
            "restarts",
            "a viewer that is stopped, killed and started again, every 12 s",
            _load_restarts,
            everywhere=False,
        ),
        Load("full", "a viewer whose disk is full", _load_all, everywhere=False),
    )
}


def find_loads(names: Sequence[str]) -> list[Load]:
    """Return the loads with these names. Raises InputError."""
    if unknown := [name for name in names if name not in LOADS]:
        raise InputError(f"load {unknown[0]!r} is unknown; allowed are {join_names(LOADS)}")
    return [LOADS[name] for name in names]
