"""Services: plant and controllers as processes of the bench, started, watched and ended together."""

import json
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from protocols.child import clutch_hil, spawn
from protocols.errors import InputError
from protocols.ring import RingReader
from protocols.shared_folder import SharedFolder
from protocols.stopping import Stop

_START = 120.0  # s for both services to come up: compiling the kernel for the first time takes some of it
_STOP = 10.0  # s for a service to end once asked
_POLL = 0.05  # s between looks
_PLANT = "plant"  # the service that ends last, so that every safe command still meets a plant


class Services:
    """Processes of `clutch-hil ARGUMENTS...` by name, with a ring and a summary file each; one of them is the plant.

    Use as a context manager: leaving it ends what still runs, by force if need be, and removes their files.
    """

    def __init__(self, commands: Mapping[str, Sequence[str]]) -> None:
        self._shared = SharedFolder()
        self._folder = self._shared.path
        self._commands = dict(commands)
        self._endings = sorted(commands, key=_PLANT.__eq__)
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> "Services":
        for name, arguments in self._commands.items():
            self._processes[name] = self._spawn(name, arguments)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name in self._endings:
            if not self._stopped(name):
                self._processes[name].kill()
                self._processes[name].wait()
        self._shared.remove()

    def rings(self, stop: Stop) -> tuple[RingReader, ...]:
        """Rings of the services, in the order of their commands, once all have started. Raises InputError when one does not."""
        deadline = time.monotonic() + _START
        paths = [self._folder / f"{name}.ring" for name in self._commands]
        while not all(path.exists() for path in paths):
            self.check()
            if stop.asked or time.monotonic() > deadline:
                raise InputError("the services were stopped before they had started")
            time.sleep(_POLL)
        return tuple(map(RingReader, paths))

    def ended(self) -> list[str]:
        """Names of the services that have ended well. Raises InputError for one that has not."""
        self.check()
        return [name for name, process in self._processes.items() if process.poll() is not None]

    def check(self) -> None:
        """Raise InputError with a service's own sentence when it has failed."""
        for name, process in self._processes.items():
            if (code := process.poll()) not in (None, 0):
                if code == -signal.SIGTERM and self._summary(name).exists():
                    continue  # it had ended already when it was asked to
                if code is not None and code < 0:
                    raise InputError(f"the {name} was killed by {signal.Signals(-code).name}")
                lines = self._log(name).read_text(errors="replace").strip().splitlines() or ["it said nothing"]
                raise InputError(f"the {name} stopped: {lines[-1].removeprefix('error: ')}")

    def end(self) -> dict[str, Any]:
        """Stop the services and return their summaries by name. Raises InputError when one fails or does not stop."""
        summaries = {}
        for name in self._endings:
            if not self._stopped(name):
                raise InputError(f"the {name} did not stop within {_STOP:g} s")
            self.check()
            summaries[name] = json.loads(self._summary(name).read_text(encoding="utf-8"))
        return summaries

    def _spawn(self, name: str, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
        files = ["--ring", str(self._folder / f"{name}.ring"), "--summary", str(self._summary(name))]
        with self._log(name).open("w") as log:
            return spawn(clutch_hil(*arguments, *files), log)  # Ctrl-C is ours: controllers end first

    def _summary(self, name: str) -> Path:
        return self._folder / f"{name}.json"

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _stopped(self, name: str) -> bool:
        """Ask a service to end, if it has not; whether it did in time."""
        process = self._processes[name]
        if process.poll() is None:
            process.terminate()
        try:
            process.wait(_STOP)
        except subprocess.TimeoutExpired:
            return False
        return True
